from __future__ import annotations

from collections.abc import Iterator
from math import floor

from ..bases.dumping import FALLBACK
from ..bases.earth_field import EarthField
from ..bases.known_slew import KnownSlew
from ..bases.momentum_management import MomentumManagement, NominalProfile
from ..contract.block import Mat33, Output, Parameter, Vec3, Vec4
from ..contract.fitting import Law
from ..laws import momentum_management as laws
from ..laws.attitude_control import rest_to_rest
from ..maths.attitude import matrix, propagate, rotate, rotate_back
from ..maths.vector import ZERO, add, cross, mat_vec, norm, scale, sub
from ..physics.geomagnetic import dipole
from ..physics.orbit import (
    Elements,
    elements_from_state,
    ellipse_state,
    mean_motion,
    perifocal_axes,
)
from ..physics.torques import gravity_gradient_eci

HOLD, _ = range(2)
PREDICTED, _ = range(2)
_, IGRF = range(2)
NOTHING: Mat33 = (0.0,) * 9
LARGEST = 1e30  # value of `condition` for a singular costate


class ManagerOpenLoop(MomentumManagement, NominalProfile, KnownSlew, EarthField):
    """Open-loop momentum management

    Every `update_period` from t_i on, over the samples until t_f = t_i +
    `desaturation_period`,

        H_D = H_NOM(t_f) - H(t_i) - integral of T_GG                       (eqs. 2 and 7)
        P = [integral of [B]'S[B] dt]^-1 H_D,      S = A A'                (Table 1)

    and at each sample until the next update mu_M = S (B x P), so that T_M brings the
    momentum exactly to H_NOM(t_f) if the prediction is right (eq. 3). Integrals are
    sums over the middles of samples, on two-body motion from r_eci and v_eci. The field
    is that of the manager's own model, dipole or IGRF, times `field_scale` (1: right);
    with `field_tilt` false it is a dipole along the Earth's axis. With `command_field`
    measured, mu_M takes the magnetometer's field. The weighting `wheels` weighs the
    coils' energy differently; it does not minimise the wheels' speed.

    H_NOM is a table from the ground (`desat design`), in eci. The paper's current
    minimum energy (ME) law has a period of 600 s, updated every 200 s. The matrix of a
    short period is nearly singular. Where `condition`, the ratio of its largest to its
    smallest eigenvalue, exceeds `condition_limit`, there is no new costate: `mode` is
    fallback and the last command is held, or, with `on_singular` none, there is no
    command.

    With `manoeuvre` the manager knows the slew of `guidance_slew` with the same
    q_begin_bi, q_end_bi, t_begin and t_end. A single desaturation period then extends
    from `lead_time` before it to `lag_time` after it, along the planned attitude. As
    the craft is at rest at both ends, the wheels' momentum suffices there (eq. 7).

    Coils, limits and invalid measurements: see `bases/momentum_management.py`.

    Source: Chen, Davenport & Sturch (paper 001), eqs. 1-3, 7 and 8, Table 1.
    """

    offers = (Law("open loop"),)

    desaturation_period: float = Parameter("s", "t_f - t_i", start=600.0, min=1.0)
    update_period: float = Parameter(
        "s", "between updates, no more than desaturation_period", start=200.0, min=1.0
    )
    condition_limit: float = Parameter(
        "1", "largest condition of the costate's matrix", start=1e4, min=1.0
    )
    on_singular: int = Parameter(
        "1",
        "without a costate: hold the last command, or none",
        choices=("hold", "none"),
        start="hold",
    )
    command_field: int = Parameter(
        "1",
        "the field that makes the dipole of the costate",
        choices=("predicted", "measured"),
        start="predicted",
    )
    field_model: int = Parameter(
        "1",
        "the manager's own field",
        choices=("dipole", "igrf"),
        start="dipole",
        needs=("r_eci", "v_eci"),
    )
    field_scale: float = Parameter(
        "1", "it is multiplied by this; 1: right", start=1.0, min=0.0
    )
    field_tilt: bool = Parameter(
        "1", "false: its dipole lies along the Earth's axis", start=True
    )
    lead_time: float = Parameter(
        "s", "from the period's begin to the slew's", start=600.0, min=0.0
    )
    lag_time: float = Parameter(
        "s", "from the slew's end to the period's", start=600.0, min=0.0
    )
    condition: float = Output(
        "1", "of the last costate's matrix; 1e30: singular", interval=True
    )
    miss_predicted: float = Output(
        "N.m.s", "what the prediction itself misses H_NOM(t_f) by", interval=True
    )

    def start(self) -> None:
        """Check the periods (s) and start without a costate."""
        super().start()
        if self.update_period > self.desaturation_period * (1.0 + 1e-9):
            self.fail(
                f"update_period = {self.update_period} s is longer than desaturation_period "
                f"= {self.desaturation_period} s"
            )
        self._in_samples("desaturation_period", self.desaturation_period)
        self._in_samples("update_period", self.update_period)
        self.start_known_slew()
        self.start_field(igrf=self.field_model == IGRF)
        self._costate = self._last = ZERO
        self._has_solution = False
        self._next = -1.0
        self.condition = self.miss_predicted = 0.0

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        plan_end = self.t_end + self.lag_time if self.manoeuvre else end
        last = max(end + self.desaturation_period, plan_end)
        self.check_igrf_years(begin, last, self.field_model == IGRF and self.field_tilt)
        yield from super().foresee(begin, end, wired_names)

    def _forget(self) -> None:
        """Discard the plan after a lost measurement, so that a new one follows it."""
        super()._forget()
        self._next = -1.0

    def _in_samples(self, name: str, period: float) -> None:
        """Refuse a period (s) that is no multiple of the sample time."""
        count = period / self.sample_time
        if abs(count - floor(count + 0.5)) > 1e-6 or count < 0.5:
            self.fail(
                f"{name} = {period} s is no multiple of sample_time = {self.sample_time} s"
            )

    def law(self, t: float, h: Vec3) -> Vec3 | None:
        """Return the dipole mu_M = S (B x P) (A m2, body), or None for no command.

        h is the momentum (N m s, body). The costate P is solved anew (eqs. 2, 3 and 7)
        where an update is due; without a solution the last command is held, or there is
        none.
        """
        orbit = elements_from_state(self.r_eci, self.v_eci)
        if t >= self._next - 1e-6 * self.sample_time:
            end = self._end(t)
            self._solve(orbit, t, end, rotate_back(self.q_bi, h))
            lead = self.t_begin - self.lead_time
            self._next = end if self._in_manoeuvre(t) else t + self.update_period
            if self.manoeuvre and t + 1e-6 < lead < self._next:
                self._next = lead
        if not self._has_solution:
            self.mode = FALLBACK
            if self.on_singular != HOLD:
                return None
            self.tau_desired_body = cross(self._last, self.field())
            return self._last
        q, _, b_eci = self._ahead(orbit, t, 0.5 * self.sample_time)
        b = rotate(q, b_eci) if self.command_field == PREDICTED else self.field()
        self._last = laws.open_loop_dipole(rotate(q, self._costate), b, self._s)
        self.tau_desired_body = cross(self._last, b)
        return self._last

    def _end(self, t: float) -> float:
        """Return the end t_f (s) of a period that begins at t (s).

        It is a whole number of samples later.
        """
        if self._in_manoeuvre(t):
            remaining = self.t_end + self.lag_time - t
            return (
                t + floor(remaining / self.sample_time + 1.0 - 1e-6) * self.sample_time
            )
        return t + self.desaturation_period

    def _in_manoeuvre(self, t: float) -> bool:
        """Return whether t (s) is within the manoeuvre.

        It extends from the beginning of the lead time to the end of the lag time.
        """
        begin, end = self.t_begin - self.lead_time, self.t_end + self.lag_time
        return self.manoeuvre and begin <= t + 1e-6 and t < end - 1e-6

    def _solve(self, orbit: Elements, t: float, end: float, h_eci: Vec3) -> None:
        """Solve for the costate (A m2/T, eci) of the period from t to `end` (s).

        h_eci is the present H (N m s, eci).
        """
        nominal = self.nominal(end)
        self._has_solution = False
        if nominal is None:
            return
        dt = self.sample_time
        impulse, product = ZERO, NOTHING
        for k in range(floor((end - t) / dt + 0.5)):
            q, r, b = self._ahead(orbit, t, (k + 0.5) * dt)
            gravity = gravity_gradient_eci(r, q, self._inertia)
            impulse = add(impulse, scale(dt, gravity))
            product = _plus(
                product, dt, laws.field_product(b, _rotate_weighting(self._s, q))
            )
        change = sub(sub(nominal, h_eci), impulse)
        self.condition = min(laws.condition(product), LARGEST)
        if self.condition > self.condition_limit:
            return
        self._has_solution = True
        self._costate = laws.open_loop_costate(product, change)
        self.miss_predicted = norm(sub(mat_vec(product, self._costate), change))

    def _ahead(
        self, orbit: Elements, t: float, ahead: float
    ) -> tuple[Vec4, Vec3, Vec3]:
        """Predict attitude, position (m) and field (T), `ahead` (s) of t (s).

        The attitude is the planned one; position and field are in eci.
        """
        a, e, inclination, raan, perigee, anomaly = orbit
        n = mean_motion(a)
        x, y = perifocal_axes(inclination, raan, perigee)
        r, _ = ellipse_state(a, e, anomaly + n * ahead, n, x, y)
        if self.field_tilt:
            b = self.field_eci(r, t + ahead, self.field_model == IGRF)
        else:
            b = self.to_eci(
                dipole(self.to_date(r), (0.0, 0.0, -norm(self.dipole_earth)))
            )
        q = self.q_bi
        if self.manoeuvre:
            s, _ = rest_to_rest(
                (t + ahead - self.t_begin) / (self.t_end - self.t_begin)
            )
            q = propagate(self._q_begin, self._rotation, s)
        return q, r, scale(self.field_scale, b)


def _rotate_weighting(s: Mat33, q: Vec4) -> Mat33:
    """Rotate the weighting to eci: C(q)' S C(q)."""
    c = matrix(q)
    x = rotate_back(q, mat_vec(s, (c[0], c[3], c[6])))
    y = rotate_back(q, mat_vec(s, (c[1], c[4], c[7])))
    z = rotate_back(q, mat_vec(s, (c[2], c[5], c[8])))
    return (x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2])


def _plus(a: Mat33, share: float, b: Mat33) -> Mat33:
    """Return a + share b."""
    return tuple(x + share * y for x, y in zip(a, b, strict=True))  # type: ignore[return-value]
