"""Compute the minimum firing time with which a dumping run could have done.

This is `desat bound`, and of scenarios with `firing_bound` a number of each run: it is
meant for an emptying of minutes, and may take longer than a flight of days. The true
field and attitude of a run, and with them every external torque except those of
torquers and thrusters, are taken as given. The total impulse that torquers and
thrusters must give in an inertial frame then follows from the target momentum of the
wheels at the end. The minimum firing time for it is one linear programme over the whole
run (`components/laws/least_firing.py`). The programme knows the field in advance, fires
no pulses, and holds dipoles and torques over each sample of the manager at their mean.
No law with such samples needs less, except for the 0.01 rad that the body turns within
a sample.
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
SMALLEST = 1e-6  # s: a bound below this has no percentage
MOST_SAMPLES = 10_000  # of the manager, in the programme


@dataclass(frozen=True)
class LowerBound:
    """Firing time of a run, and its lower bound."""

    seconds: float  # s, fired in the run
    # s, with zero final momentum; None: more than can be dumped in time
    least: float | None
    least_same_end: float | None  # s, with the final momentum of the run
    # %, excess of the run over least_same_end; None where that is 0 or not known
    above_percent: float | None
    final_momentum: float  # N m s, final momentum of the run, less its target
    # s/(N m s), eci: change of least with the required impulse
    price: list[float] | None
    period: float  # s, of the samples over which dipoles and torques are held

    def numbers(self) -> dict[str, Value]:
        """Return the numbers for a manifest; unknown ones are left out.

        There are none where nothing fired.
        """
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
        """Return the content of `--json`."""
        return asdict(self)


@dataclass(frozen=True)
class ThrusterParts(Parts):
    """Components that take part in dumping."""

    spacecraft: str
    thrusters: str
    manager: str
    torquers: str
    environment: str


PARTS = ThrusterParts


def applies(system: System) -> ThrusterParts | None:
    """Find the parts by the connections; None without commanded thrusters.

    A manager has to command them.
    """
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


def signals(parts: ThrusterParts) -> list[str]:
    """Return the series that a bound is computed from."""
    of = {
        "spacecraft": ("q_bi", "h_copy_wheel"),
        "environment": ("b_eci",),
        "thrusters": ("tau_mean_thruster_body", "tau_slope_thruster_body"),
        "torquers": ("m_mean_body", "m_slope_body"),
    }
    names = [
        f"{getattr(parts, role)}.{variable}"
        for role, variables in of.items()
        for variable in variables
    ]
    return [*names, f"{parts.thrusters}.on_time"]


def of_run(manifest: Manifest, results: Results) -> LowerBound:
    """Compute the bound of a run.

    Raises
    ------
    DesatError
        If it has none: another kind of run, or series are not recorded.
    """
    name = manifest.scenario
    parts: ThrusterParts | None = manifest.parts.get(KEY)
    if parts is None:
        raise DesatError(NOT_APPLICABLE.format(name))
    if manifest.algorithm != "gauss_seidel":
        raise DesatError(
            f"{name}: a run by {manifest.algorithm}; the bound needs gauss_seidel"
        )
    _check_size(manifest, results, parts)
    truth = _Truth(manifest, results, parts)
    c_end = truth.attitude(truth.times[-1:])[0]
    remaining = (truth.momentum_left @ c_end).astype(float)
    seconds = float(results.values(f"{parts.thrusters}.on_time")[-1])
    least, price = truth.least(truth.delivered - remaining)
    same, _ = truth.least(truth.delivered)
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
    """Compute the bound of a completed run of a scenario that asks for it.

    Empty where nothing fired, or too little was recorded.
    """
    if not manifest.completed or not manifest.about.get("firing_bound"):
        return {}
    with suppress(DesatError):
        (on_time,) = _series(
            manifest, results, [f"{manifest.parts[KEY].thrusters}.on_time"]
        )
        if on_time[-1] > 0.0:  # without firing the slow programme has no result
            return of_run(manifest, results).numbers()
    return {}


def _check_size(manifest: Manifest, results: Results, parts: ThrusterParts) -> None:
    """Raise DesatError where a run has more samples than the programme takes."""
    times = results.times()
    period = manifest.values_of(parts.manager).get("sample_time") or manifest.step
    count = round((times[-1] - times[0]) / period)
    if count > MOST_SAMPLES:
        raise DesatError(
            f"{manifest.scenario}: no bound: {count} samples of {period:g} s; the programme "
            f"takes up to {MOST_SAMPLES}, as with --stop {MOST_SAMPLES * period:g}"
        )


class _Truth:
    """True motion of a run: splines of attitude and field, and actuator impulses."""

    def __init__(
        self, manifest: Manifest, results: Results, parts: ThrusterParts
    ) -> None:
        """Read attitude, field, momentum and torques of a run, interpolated in time."""
        self._parameters = {
            role: manifest.values_of(c) for role, c in vars(parts).items()
        }
        q, h, b, tau, tau_slope, m, m_slope, _ = _series(
            manifest, results, signals(parts)
        )
        self.times = times = results.times()[: len(q)]
        self.attitude = Spline(times, matrices(q))
        self._field = Spline(times, b)
        axes = self._parameters["spacecraft"].get("axes_wheel")
        in_body = h @ np.reshape(axes, (3, -1)).T if axes else h[:, :3]
        target = self._parameters["manager"].get("h_target_body", [0.0, 0.0, 0.0])
        # N m s, body: wheel momentum at the end, less the target
        self.momentum_left = in_body[-1] - target
        self.period = self._parameters["manager"].get("sample_time") or manifest.step

        def torque(c: Array, field: Array) -> Array:
            """Compute the torque (n, 3, 3; N m, body) of the actuators at the nodes."""
            lead = (NODES - 0.5)[:, None]
            dipole = m[:, None] + lead * m_slope[:, None]
            thrust = tau[:, None] + lead * tau_slope[:, None]
            return thrust + np.cross(dipole, field)

        means = self._means(times[:-1], times[1:], torque)
        # N m s, eci: impulse of torquers and thrusters in the run
        self.delivered: Array = np.diff(times) @ means

    def _means(
        self, begin: Array, end: Array, torque: Callable[[Array, Array], Array]
    ) -> Array:
        """Compute means over intervals, in eci, of a torque(C, B) in body.

        C (n, 3, 3, 3) and B (n, 3, 3; T, body) are at the nodes of each interval; the
        torque is (n, 3, ..., 3).
        """
        at = begin[:, None] + np.outer(end - begin, NODES)
        c = self.attitude(at)
        field = np.einsum("nsij,nsj->nsi", c, self._field(at))
        mean: Array = np.einsum("s,ns...i,nsij->n...j", WEIGHTS, torque(c, field), c)
        return mean

    def least(self, impulse: Array) -> tuple[float | None, list[float] | None]:
        """Compute the minimum firing time (s) for an impulse, and its derivative.

        The impulse is in N m s, eci; the derivative by it in s/(N m s). Both are None
        where thrusters and coils cannot give it.
        """
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
            limits_dipole=self._parameters["torquers"].get("drive") != "ideal",
        )
        return (None, None) if plan is None else (plan.seconds, plan.price.tolist())

    def _jets(self) -> Array:
        """Return the torque of each thruster (p, 3), N m, body."""
        values = self._parameters["thrusters"]
        if "tau_level" in values:
            pairs = np.diag(values["tau_level"])
            return np.concatenate([pairs, -pairs])
        try:
            place, way = (
                np.reshape(values[k], (-1, 3))
                for k in ("position_nozzle", "direction_nozzle")
            )
            return np.cross(place, np.array(values["thrust"])[:, None] * way)
        except KeyError as error:
            raise DesatError(
                f"thrusters: no tau_level, no {error.args[0]}: torque unknown"
            ) from None

    def _coils(self) -> Array:
        """Return the largest dipole of each coil (c, 3), A m2, body."""
        values = self._parameters["torquers"]
        try:
            return np.asarray(
                values["m_limit"] * np.reshape(values["axes_coil"], (3, -1)).T
            )
        except KeyError as error:
            raise DesatError(
                f"torquers: no {error.args[0]}: their dipole is unknown"
            ) from None

    def _share(self, begin: Array, end: Array) -> Array:
        """Return the largest share of each interval that each coil may be on (n, c)."""
        values = self._parameters["torquers"]
        period = values.get("sample_time") or np.inf
        most = 1.0 - values.get("quiet_time", 0.0) / period
        if values.get("drive") == "pulsed":
            most = min(most, values["duty_max"])
        share = np.full((len(begin), len(values["axes_coil"]) // 3), most)
        if (failed_coil := values.get("failed_coil", "none")) != "none":
            alive = np.clip((values["failed_from"] - begin) / (end - begin), 0.0, 1.0)
            rest = abs(values.get("failed_share", 0.0))
            share[:, int(failed_coil) - 1] *= alive + (1.0 - alive) * rest
        return share


def _series(manifest: Manifest, results: Results, names: list[str]) -> list[Array]:
    """Read series; raise DesatError where one is missing or steps are not recorded."""
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
