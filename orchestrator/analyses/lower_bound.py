"""`desat bound`: the least firing time that a dumping run could have done with.

A run's truth (field, attitude, and with them every external torque but those of
torquers and thrusters) is taken as given; what the two have to give together in an
inertial frame then follows from the wheels' momentum that is wanted at the end, and the
least firing time for it is one linear programme over the whole run
(`components/laws/least_firing.py`). It knows the field ahead, fires no pulses, and
holds dipoles and torques over each sample of the manager at their mean: no law with
such samples does with less, but for the 0.01 rad that the body turns within a sample.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..numbers.derived import matrices
from ..numbers.spline import Spline
from ..numbers.text import Value
from ..system.errors import DesatError
from ..system.model import System
from ..system.typed import JsonObject
from . import Parts, with_titles
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

Array = NDArray[np.float64]

KEY = "dumping"
NUMBERS = ("bound", "bound_same_end", "above_bound")

NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)
NODES, WEIGHTS = (NODES + 1.0) / 2.0, WEIGHTS / 2.0
NOT_APPLICABLE = (
    "{}: no manager commands thrusters in it beside torquers; there is no firing time"
)
SMALLEST = 1e-6
"""A bound (s) below which no percentage of it is given."""


@dataclass(frozen=True)
class LowerBound:
    """What a run fired and the least that it could have."""

    seconds: float
    """fired in the run (s)"""
    least: float | None
    """with no momentum left (s); None: more than can be dumped in time"""
    least_same_end: float | None
    """with the momentum left that the run left (s)"""
    above_percent: float | None
    """how far the run is above the bound of its own end; None where that is 0 or not
    known"""
    final_momentum: float
    """left by the run, less its target (N m s)"""
    price: list[float] | None
    """s/(N m s), eci: how `least` changes with the impulse wanted"""
    period: float
    """s, of the samples that dipoles and torques are held over"""

    def numbers(self) -> dict[str, Value]:
        """As a manifest's numbers; what is not known is left out, and all where none
        fired."""
        if self.seconds == 0.0:
            return {}
        rows: dict[str, tuple[str, float | None, str]] = {
            "bound": ("Least possible firing time to zero momentum", self.least, "s"),
            "bound_same_end": (
                "Least possible firing time to the same final momentum",
                self.least_same_end,
                "s",
            ),
            "above_bound": (
                "Excess of the firing time over the least possible",
                self.above_percent,
                "%",
            ),
        }
        return with_titles(rows)

    def as_json(self) -> JsonObject:
        """What `--json` prints."""
        return asdict(self)


@dataclass(frozen=True)
class ThrusterParts(Parts):
    """Which component is what."""

    spacecraft: str
    thrusters: str
    manager: str
    torquers: str
    environment: str


PARTS = ThrusterParts


def applies(system: System) -> ThrusterParts | None:
    """By the connections; None where no manager commands thrusters."""
    for body, wire in system.by_input["tau_mean_thruster_body"].items():
        ends = (
            (wire.source, "tau_cmd_thruster_body"),
            (body, "m_mean_body"),
            (body, "b_eci"),
        )
        if all(end in system.fed for end in ends):
            return ThrusterParts(
                body, wire.source, *(system.fed[end].source for end in ends)
            )
    return None


def signals(who: ThrusterParts) -> list[str]:
    """The series that a bound is computed from, by the parts of a system."""
    of = {
        "spacecraft": ("q_bi", "h_copy_wheel"),
        "environment": ("b_eci",),
        "thrusters": ("tau_mean_thruster_body", "tau_slope_thruster_body"),
        "torquers": ("m_mean_body", "m_slope_body"),
    }
    names = [
        f"{getattr(who, role)}.{variable}"
        for role, variables in of.items()
        for variable in variables
    ]
    return [*names, f"{who.thrusters}.on_time"]


def of_run(manifest: Manifest, results: Results) -> LowerBound:
    """The bound of a run. Raises DesatError where it has none: another kind of run, or
    not recorded."""
    name = manifest.scenario
    who: ThrusterParts | None = manifest.parts.get(KEY)
    if who is None:
        raise DesatError(NOT_APPLICABLE.format(name))
    if manifest.algorithm != "gauss_seidel":
        raise DesatError(
            f"{name}: a run by {manifest.algorithm}; the bound needs gauss_seidel"
        )
    truth = _Truth(manifest, results, who)
    c_end = truth.attitude(truth.times[-1:])[0]
    left = (truth.momentum_left @ c_end).astype(float)
    seconds = float(results.values(f"{who.thrusters}.on_time")[-1])
    least, price = truth.least(truth.given - left)
    same, _ = truth.least(truth.given)
    return LowerBound(
        seconds=seconds,
        least=least,
        least_same_end=same,
        above_percent=100.0 * (seconds / same - 1.0)
        if same and same > SMALLEST
        else None,
        final_momentum=float(np.linalg.norm(truth.momentum_left)),
        price=price,
        period=truth.period,
    )


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """The bound beside what a completed run fired; none where too little was recorded."""
    if not manifest.completed:
        return {}
    with suppress(DesatError):
        (on_time,) = _series(
            manifest, results, [f"{manifest.parts[KEY].thrusters}.on_time"]
        )
        if (
            on_time[-1] > 0.0
        ):  # else the programme, which takes long, has nothing to tell
            return of_run(manifest, results).numbers()
    return {}


class _Truth:
    """What happened in a run: splines of attitude and field, and what the actuators
    gave."""

    def __init__(
        self, manifest: Manifest, results: Results, who: ThrusterParts
    ) -> None:
        self._parameters = {
            role: manifest.values_of(c) for role, c in vars(who).items()
        }
        q, h, b, tau, tau_slope, m, m_slope, _ = _series(
            manifest, results, signals(who)
        )
        self.times = times = results.times()[: len(q)]
        self.attitude = Spline(times, matrices(q))
        self._field = Spline(times, b)
        axes = self._parameters["spacecraft"].get("axes_wheel")
        in_body = h @ np.reshape(axes, (3, 4)).T if axes else h[:, :3]
        target = self._parameters["manager"].get("h_target_body", [0.0, 0.0, 0.0])
        self.momentum_left = in_body[-1] - target
        """of the wheels at the end, less the target (N m s, body)"""
        self.period = self._parameters["manager"].get("sample_time") or manifest.step

        def torque(c: Array, field: Array) -> Array:
            lead = (NODES - 0.5)[:, None]
            dipole = m[:, None] + lead * m_slope[:, None]
            thrust = tau[:, None] + lead * tau_slope[:, None]
            return thrust + np.cross(dipole, field)

        means = self._means(times[:-1], times[1:], torque)
        self.given: Array = np.diff(times) @ means
        """the impulse of torquers and thrusters in the run (N m s, eci)"""

    def _means(
        self, begin: Array, end: Array, torque: Callable[[Array, Array], Array]
    ) -> Array:
        """The mean over each interval, in eci, of torque(C, B): C (n, 3, 3, 3) and B
        (n, 3, 3; T, body) at the nodes of the interval to (n, 3, ..., 3), body."""
        at = begin[:, None] + np.outer(end - begin, NODES)
        c = self.attitude(at)
        field = np.einsum("nsij,nsj->nsi", c, self._field(at))
        mean: Array = np.einsum("s,ns...i,nsij->n...j", WEIGHTS, torque(c, field), c)
        return mean

    def least(self, impulse: Array) -> tuple[float | None, list[float] | None]:
        """The least firing time (s) for an impulse (N m s, eci) and its price; None:
        none can."""
        from desat.components.laws.least_firing import least_firing

        edges = np.append(
            np.arange(self.times[0], self.times[-1] - 1e-6, self.period), self.times[-1]
        )
        begin, end = edges[:-1], edges[1:]
        length = end - begin
        jets, coils = self._jets(), self._coils()
        thrust = self._means(
            begin, end, lambda c, b: np.broadcast_to(jets, (*b.shape[:2], *jets.shape))
        )
        unit = self._means(begin, end, lambda c, b: np.cross(coils, b[:, :, None]))
        share = self._share(begin, end)
        plan = least_firing(
            impulse,
            thrust,
            length,
            (length[:, None] * share)[:, :, None] * unit,
            bounded=self._parameters["torquers"].get("drive") != "ideal",
        )
        return (None, None) if plan is None else (plan.seconds, plan.price.tolist())

    def _jets(self) -> Array:
        """The torque of each thruster (p, 3), N m, body."""
        given = self._parameters["thrusters"]
        if "tau_level" in given:
            pairs = np.diag(given["tau_level"])
            return np.concatenate([pairs, -pairs])
        try:
            place, way = (
                np.reshape(given[k], (-1, 3))
                for k in ("position_nozzle", "direction_nozzle")
            )
            return np.cross(place, np.array(given["thrust"])[:, None] * way)
        except KeyError as error:
            raise DesatError(
                f"thrusters: no tau_level, no {error.args[0]}: torque unknown"
            ) from None

    def _coils(self) -> Array:
        """The largest dipole of each coil (c, 3), A m2, body."""
        given = self._parameters["torquers"]
        try:
            return np.asarray(
                given["m_limit"] * np.reshape(given["axes_coil"], (3, -1)).T
            )
        except KeyError as error:
            raise DesatError(
                f"torquers: no {error.args[0]}: their dipole is unknown"
            ) from None

    def _share(self, begin: Array, end: Array) -> Array:
        """The largest share of each interval that each coil may be on (n, c)."""
        given = self._parameters["torquers"]
        period = given.get("sample_time") or np.inf
        most = 1.0 - given.get("quiet_time", 0.0) / period
        if given.get("drive") == "pulsed":
            most = min(most, given["duty_max"])
        share = np.full((len(begin), len(given["axes_coil"]) // 3), most)
        if (failed := given.get("failed_coil", "none")) != "none":
            alive = np.clip((given["failed_from"] - begin) / (end - begin), 0.0, 1.0)
            rest = abs(given.get("failed_share", 0.0))
            share[:, int(failed) - 1] *= alive + (1.0 - alive) * rest
        return share


def _series(manifest: Manifest, results: Results, names: list[str]) -> list[Array]:
    """The series of these names. Raises DesatError where one is missing or steps are."""
    scenario = manifest.scenario
    missing = sorted(set(names) - set(results.names()))
    if missing:
        raise DesatError(
            f"{scenario}: not recorded, and the bound needs it: {', '.join(missing)}"
        )
    times = results.times()
    if len(times) < 2 or times[1] - times[0] > 1.5 * manifest.step:
        raise DesatError(
            f"{scenario}: the bound needs every step recorded, and at least one"
        )
    series = [results.values(name) for name in names]
    if not all(np.isfinite(values).all() for values in series):
        raise DesatError(f"{scenario}: the run diverged; it has no bound")
    return series
