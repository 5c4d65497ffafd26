from __future__ import annotations

from collections.abc import Iterator
from math import copysign

from ..bases.dumping import DUMPING, FALLBACK, IDLE, MomentumDumping
from ..bases.earth_field import EarthField
from ..bases.known_slew import KnownSlew
from ..contract.block import Mat33, Mat34, Output, Parameter, Table, Vec3, Vec4
from ..contract.fitting import Law, Need
from ..laws import (
    cross_product,
    field_check,
    forecast,
    momentum_observer,
    null_space,
    predictive,
    receding_horizon,
    slew,
    thrust_limit,
)
from ..laws import disturbance_learning as learning
from ..laws.blending import Split
from ..laws.integrated import null_direction, null_vector
from ..laws.momentum_management import scale_to_limit, without
from ..maths import matrix
from ..maths.attitude import inverse, normalise, product, rotate, rotate_back
from ..maths.vector import IDENTITY, ZERO, add, cross, dot, mat_vec, norm, scale, sub
from ..physics.orbit import lvlh_attitude, orbit_motion
from ..physics.torques import gravity_gradient_eci
from ..physics.wheel_array import body_momentum, pseudo_inverse, to_coils, to_wheels

HOLD, EMPTY = range(2)
NADIR, _, IGRF = range(3)
PLAN_TIME = 30.0  # s, shortest time between plans
ORBITS = 1.5  # horizon of a plan
LONGEST_INTERVAL = 0.05  # of a plan, in orbits
# Weight of momentum against energy, goal hold: q = n^2 / b^2, w_p = PEAK q h_s^2,
# h_s = PEAK_SCALE times the peak.
PEAK = 0.1
PEAK_SCALE = 0.85
# Goal hold: wheels count as empty below this share of their capacity (1), and the weight
# of momentum falls there, but not below LEAST_SHARE squared of the whole weight.
EMPTY_FILL = 0.02
LEAST_SHARE = 1e-2
LEAST_EIGENVALUE = 1e-3  # of the coils' price, relative to its mean
LEAST_ENERGY = 0.05  # relative price of a dipole of a coil that gives none
COIL_PRICE = 2e-3  # goal empty: price of a full dipole or a second, squared and halved
PATIENCE = 1e-3  # goal empty: relative discount of a last second against a first
NO_DIPOLES: Vec4 = (0.0, 0.0, 0.0, 0.0)
NO_FIRING: Table = (0.0,) * (predictive.THRUSTERS * predictive.INTERVALS)


class ManagerPredictive(MomentumDumping, KnownSlew, EarthField):
    """One law for every craft: plans on a forecast of field and torque, and replans

    Every 30 s, or `sample_time` where that is longer, coils and thrusters are planned
    over the next 1.5 orbits, or until `end`. A plan has up to 64 intervals: the first
    is as long as the time between plans, and each next one is twice as long, up to a
    twentieth of an orbit. The plan minimises

        sum dt [ w_e u^2 / 2 + q |X|^2 / 2 + 0.1 q h_s^2 sum (h_i / h_s)^16 ]        (hold)

    where X is the wheel momentum minus its target (eci), u the dipole that the coils
    really give and h_i the momentum of wheel i. q = w_m n^2 / b^2 with b^2 half the mean
    of sum |a_j x B|^2, and n^2 the mean square of the orbit's angular rate with the
    weight sum |a_j x B|^2: n is the orbit rate, and on an eccentric orbit the rate near
    the perigee, where coils act. h_s is 0.85 times the largest wheel momentum of the
    last orbit and of the plan without this term. w_m and w_e are the first two of the
    `weights`, the same for every craft. Where the capacity `h_limit` of a wheel is
    known, w_m is multiplied by

        min(1, h_p / (0.02 h_limit))^2

    with h_p the largest wheel momentum of the last orbit. The law removes momentum at
    about the rate sqrt(w_m) n, n by default. This is the rate for a wheel that is
    filled to 2 %. With less in the wheels they take longer to fill, and the rate falls
    in proportion, so that no energy is spent to keep empty wheels emptier. With `goal`
    empty the cost is the thrusters' time, weighted by the third, and X is to be zero at
    `end`; thrusters are used for this goal only. Between plans a coil follows the
    plan's costate with the measured field.

    The forecast assumes two-body motion from r_eci and v_eci. The attitude is fixed to
    lvlh or eci, whichever the measured rate is nearer to (or at `q_bo` from lvlh). With
    `manoeuvre` it also makes the slew of `guidance_slew` with the same q_begin_bi,
    q_end_bi, slew_body, t_begin and t_end: the momentum that the body takes up meanwhile
    is not dumped, and field and torques ahead are those of the attitude then. The
    field is that of `field_model`, scaled to the measurements of the last orbit.
    Torques are the gravity gradient of `inertia` and the estimates of
    `laws/disturbance_learning.py`: the scale of the gravity gradient, torques that are
    constant in eci, constant in lvlh or periodic in lvlh with the orbit, the craft's
    own dipole, and the signed `effectiveness` of each coil and thruster axis. The plan
    thus allows for a coil that is lost, weak or reversed. A coil counts as whole until
    its loss is likely; it is then dead, turned or has another share. A torque that
    comes in pulses makes the filter slower and no coil lost. The filter takes its noise
    from the sensors: `h_noise`, `rate_noise` and `attitude_noise`. `laws/predictive.py`
    has the solver.

    Thrusters that are weaker than `tau_level` still give small commands in full. The
    share of the level that they reach, `thruster_limit`, is learnt from firings that
    are cut short, with its standard deviation (`laws/thrust_limit.py`). Plans to empty
    use what is certain: the estimate less one standard deviation, one half at first, or
    what a firing has shown. Only the first interval of a plan may use the estimate. A
    firing beyond what is certain teaches this limit and nothing else about its axis.

    With `goal` empty a constant error of the attitude (body) is learnt from the
    direction of the measured field (`laws/attitude_error.py`), and corrected where it is
    beyond three standard deviations. The model's field may err by `field_spread`,
    relative and across it; a larger error of a poor model looks like one of the
    attitude. The noise of the field begins at `field_noise` and follows from the
    measurements.

    Where the size of the measured field differs from the model by more than half, and
    the model is as strong as the Earth's field can be there, the model is used in its
    place (`field_rejected`): coils near the magnetometer, or a sensor at its limit.
    Where it differs otherwise by more than 0.3 of the model and five deviations
    `field_noise`, or a plan to hold has not converged after 30 steps, `mode`
    is fallback: M = n (h x B) / |B|^2, the cross-product law, until the next plan. If
    the optimiser of a plan to empty has not converged after four stages of 80 trials,
    the iterate that ends nearest is flown. Without a valid field there is no dipole;
    without a valid attitude nothing is commanded. The wheels are commanded as by
    `manager_cross_product`. Their momentum in the null space, which no coil can remove,
    decays at `null_gain`, or at the rate n, to twice the largest momentum that a wheel
    had otherwise in the last orbit. This residual keeps the wheels away from zero
    speed; a smaller one is not increased. With `standstill_weight` it is held at this
    many times the largest momentum that a wheel had otherwise plus 0.02 `h_limit`: a
    small weight empties the null space, a weight of 1 keeps all wheels with equal
    shares in the null space from standstill. No wheel is filled beyond 0.9 of a
    capacity that is known.
    """

    craft_needs = (Need.COILS,)
    offers = (
        Law(
            "predictive",
            {
                "goal": "hold",
                "field_noise": "craft.field_noise",
                "h_noise": "craft.h_noise",
                "rate_noise": "craft.rate_noise",
                "attitude_noise": "craft.attitude_noise",
            },
        ),
    )

    goal: int = Parameter(
        "1",
        "hold: the momentum is kept low; empty: it is at its target at `end`",
        choices=("hold", "empty"),
        start="hold",
    )
    weights: Vec3 = Parameter(
        "1",
        "of momentum, coil energy and propellant; 1 each: as the rules have it",
        start=(1.0, 1.0, 1.0),
        min=0.0,
    )
    end: float = Parameter("s", "with goal empty: when, from t = 0 on", min=0.0)
    horizon: float = Parameter("s", "how far a plan reaches; 0: 1.5 orbits", min=0.0)
    sample_time: float = Parameter(
        "s",
        "time between samples, a multiple of the step; above 0",
        start=10.0,
        min=0.0,
    )
    axes_coil: Mat34 = Parameter(
        "1",
        "M, columns: the coils' axes, body; zero where there is no coil",
        start=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        shared=True,
    )
    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each coil, mean over a sample",
        start=20.0,
        min=0.0,
        needs=("b_body", "r_eci", "v_eci", "h_wheel", "m_cmd_body"),
        follows="torquers.m_limit",
    )
    h_limit: float = Parameter(
        "N.m.s",
        "momentum capacity of a wheel; 0: not known, all momentum counts in full",
        min=0.0,
        follows="wheels.inertia_wheel * wheels.speed_limit",
    )
    dead_coil: int = Parameter(
        "1",
        "which coil is known to be dead",
        choices=("none", "1", "2", "3", "4"),
        start="none",
    )
    tau_level: Vec3 = Parameter(
        "N.m",
        "torque of the thrusters about each axis while they fire; 0: none",
        needs=("tau_cmd_thruster_body",),
        min=0.0,
    )
    least_pulse: float = Parameter(
        "s",
        "on-times that the thrusters make are multiples of it",
        start=0.05,
        min=1e-6,
    )
    null_gain: float = Parameter(
        "1/s",
        "rate at which momentum in the wheels' null space decays to what keeps them from "
        "standstill; 0: the orbit's",
        min=0.0,
        needs=("h_wheel", "tau_cmd_wheel"),
    )
    standstill_weight: float = Parameter(
        "1",
        "weight of time near standstill against momentum in the null space, which is held "
        "at so many times what keeps all wheels from standstill; 0: it decays to twice "
        "the largest momentum of a wheel, and is never increased",
        min=0.0,
        max=10.0,
        needs=("h_wheel", "tau_cmd_wheel"),
    )
    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(40.45, 0.0, 0.0, 0.0, 42.09, 0.0, 0.0, 0.0, 40.36),
        shared=True,
    )
    inertia_scale: float = Parameter(
        "1",
        "the law's own inertia is the inertia times this; 1: right",
        start=1.0,
        min=0.0,
    )
    attitude: int = Parameter(
        "1",
        "measured: q_bi; assumed: q_bo from lvlh",
        choices=("measured", "assumed"),
        start="measured",
    )
    q_bo: Vec4 = Parameter(
        "1",
        "assumed attitude: body from lvlh, scalar last; normalised",
        start=(0.0, 0.0, 0.0, 1.0),
    )
    field_model: int = Parameter(
        "1",
        "model of the field ahead",
        choices=("orbit_dipole", "dipole", "igrf"),
        start="igrf",
    )
    b_amplitude: Vec3 = Parameter(
        "T",
        "orbit_dipole: amplitudes along velocity, minus orbit normal, nadir",
        start=(23e-6, 2.4e-6, 46e-6),
    )
    field_spread: float = Parameter(
        "1",
        "goal empty: error of the model's field across it, relative, standard deviation; "
        "0: the attitude is taken as it is",
        start=0.02,
        min=0.0,
        max=1.0,
    )
    field_noise: float = Parameter(
        "T",
        "standard deviation of a component of the measured field",
        start=1e-6,
        min=0.0,
    )
    h_noise: float = Parameter(
        "N.m.s", "standard deviation of a measured wheel momentum", start=1e-4, min=0.0
    )
    rate_noise: float = Parameter(
        "rad/s", "standard deviation of a measured rate", start=1e-5, min=0.0
    )
    attitude_noise: float = Parameter(
        "rad", "standard deviation of a measured attitude", start=2e-4, min=0.0
    )
    mode: int = Output(
        "1",
        "what the manager does; fallback: the cross-product law",
        interval=True,
        choices=("idle", "dumping", "-", "fallback"),
    )
    effectiveness: Vec4 = Output(
        "1",
        "e, the share of its commanded dipole that each coil is seen to have, with its sign",
        interval=True,
    )
    thruster_effectiveness: Vec3 = Output(
        "1", "the same of the thrusters about each axis", interval=True
    )
    thruster_limit: Vec3 = Output(
        "1",
        "share of tau_level that thrusters are seen to reach about each axis",
        interval=True,
    )
    gravity_scale: float = Output(
        "1", "s, gravity gradient as it is seen over what the law knows", interval=True
    )
    torque_eci: Vec3 = Output(
        "N.m", "the constant torque that is seen, eci", interval=True
    )
    plan_steps: int = Output("1", "Newton steps of the last plan", interval=True)
    field_rejected: bool = Output(
        "1",
        "the measured field is not the Earth's, and the model is used",
        interval=True,
    )
    filter_restarts: int = Output(
        "1", "how often the filter was lost and started anew", interval=True
    )

    def start(self) -> None:
        """Refuse parameters without a plan, and begin with nothing learnt."""
        super().start()
        self._check_plan()
        self._live = without(self.axes_coil, self.dead_coil)
        self._check_actuators()
        self._to_coils = pseudo_inverse(self._live)
        self._null = null_vector(self.axes_wheel)
        self._inertia: Mat33 = tuple(self.inertia_scale * x for x in self.inertia)  # type: ignore[assignment]
        self._q_bo = normalise(self.q_bo)
        self.start_field(igrf=self.field_model == IGRF)
        self._show(learning.first_state(ZERO))
        self._last_sample = momentum_observer.NO_SAMPLE
        self._filter = momentum_observer.NO_FILTER
        self._limits = momentum_observer.NO_FIRINGS
        self._coils = NO_DIPOLES
        self._thrust = self._dipole_planned = self._costate = ZERO
        self.thruster_limit = (1.0, 1.0, 1.0)
        self.plan_steps = self.filter_restarts = 0
        self._sees_field = self.field_rejected = self._plan_failed = False
        self._check = field_check.begin(self.field_spread, self.field_noise)
        self.start_known_slew()
        self._fields = self._models = 0.0
        self._field_scale = 1.0
        self._plan_time = -1.0
        self._peaks = null_space.NO_PEAKS

    def _slew(self) -> slew.Slew:
        """Return the slew that is foreseen."""
        end = self.t_end if self.manoeuvre else self.t_begin + 1.0
        return slew.Slew(self._rotation, self.t_begin, end)

    def _check_plan(self) -> None:
        """Refuse weights and times with which there is no plan."""
        a, b, c = self.weights
        if a + b + c <= 0.0:
            self.fail("weights = (0, 0, 0): a plan needs a weight that is above 0")
        if b <= 0.0:
            self.fail(
                "weights[2] = 0: coil energy needs a weight above 0, as a price sets dipoles"
            )
        if self.goal == HOLD and a <= 0.0:
            self.fail(
                "weights[1] = 0: with goal hold the momentum needs a weight above 0"
            )
        if self.sample_time <= 0.0:
            self.fail("sample_time = 0 s: a plan is made of samples")
        if 0.0 < self.horizon < 2.0 * self.sample_time:
            self.fail(
                f"horizon = {self.horizon:.10g} s is below two samples of sample_time = "
                f"{self.sample_time:.10g} s"
            )
        if self.goal == EMPTY and self.end < 2.0 * self.sample_time:
            self.fail(
                f"end = {self.end:.10g} s is before now or within two samples of sample_time "
                f"= {self.sample_time:.10g} s"
            )
        if self.goal == EMPTY and c <= 0.0:
            self.fail(
                "weights[3] = 0: with goal empty propellant needs a weight above 0"
            )

    def _check_actuators(self) -> None:
        """Refuse a craft without a coil or a thruster that the law could use."""
        x, y, z = self.tau_level
        with_coils = self.m_limit > 0.0 and any(x != 0.0 for x in self._live)
        if not with_coils and not (self.goal == EMPTY and x + y + z > 0.0):
            self.fail(
                f"m_limit = {self.m_limit:.10g} A m2 with these axes_coil: no coil is left "
                "that the law could use"
            )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        self.check_igrf_years(begin, end, self.field_model == IGRF)
        yield from super().foresee(begin, end, wired_names)

    def empty_null_space(self) -> None:
        """Add the torques that reduce the wheels' null-space momentum to its limit."""
        if not self.enable:
            return
        if self.h_null != 0.0:
            super().empty_null_space()
            return
        torque = null_space.drive_to_level(
            self.h_wheel,
            null_direction(self.h_wheel, self.axes_wheel, self._to_wheels, self._null),
            self.null_rate(),
            self._peak(),
            self.h_limit,
            self.standstill_weight,
        )
        self.tau_cmd_wheel = tuple(
            x + y for x, y in zip(torque, self.tau_cmd_wheel, strict=True)
        )

    def null_rate(self) -> float:
        """Return the rate (1/s) of the null space: that of the orbit by default."""
        if self.null_gain > 0.0:
            return self.null_gain
        return norm(self.v_eci) / norm(self.r_eci)

    def _peak(self) -> float:
        """Return the largest momentum (N m s) of a wheel over the last orbit."""
        return max(self._peaks[0])

    def _momentum_share(self) -> float:
        """Return the share (1) of the rate n at which momentum is removed.

        It is the peak of the last orbit over EMPTY_FILL of the capacity, and at most 1.
        In the first orbit, whose peak is not known, it is 1.
        """
        empty = EMPTY_FILL * self.h_limit
        _, newest, first = self._peaks
        if empty <= 0.0 or newest < first + null_space.BINS:
            return 1.0
        return min(max(self._peak() / empty, LEAST_SHARE), 1.0)

    def dump(self, t: float, elapsed_time: float, h: Vec3) -> tuple[Vec3, Split]:
        """Learn from the last sample, plan where a plan is due, and follow the plan."""
        is_attitude_assumed = self.attitude == 1
        if not (self.valid_q or is_attitude_assumed) or (
            self.goal == EMPTY and t >= self.end - 1e-6
        ):
            self.mode, self._coils, self._thrust = IDLE, NO_DIPOLES, ZERO
            self._last_sample = momentum_observer.NO_SAMPLE
            return ZERO, (ZERO, ZERO)
        lvlh = lvlh_attitude(self.r_eci, self.v_eci)
        q = product(self._q_bo, lvlh) if is_attitude_assumed else self.q_bi
        model = self._field(self.r_eci, self.v_eci, t)
        self._judge_field(model)
        q = self._correct_attitude(q, model)
        turn = cross(self.r_eci, self.v_eci)
        turn = scale(1.0 / dot(self.r_eci, self.r_eci), turn)
        orbital = rotate(q, turn)
        rate = orbital if is_attitude_assumed else self.rate()
        b = scale(self._field_scale, model)
        if self._sees_field:
            b = rotate_back(q, self.b_body)
        total = add(add(h, self.h_target_body), mat_vec(self._inertia, rate))
        self._observe(t, q, b, total)
        is_strange = field_check.is_strange(b, model, self.field_noise)
        _, orbit = orbit_motion(self.r_eci, self.v_eci)
        if self._sees_field:
            self._scale_field(b, model, orbit)
        model = scale(self._field_scale, model)
        wheels = to_wheels(self._to_wheels, add(h, self.h_target_body))
        self._peaks = null_space.store_peak(
            null_space.Peaks(*self._peaks), t, orbit, max(map(abs, wheels))
        )
        # whether the attitude is fixed to lvlh, or else to eci, but for a slew
        resting = sub(rate, slew.rate_at(self._slew(), t))
        turning = is_attitude_assumed or norm(sub(resting, orbital)) < norm(resting)
        if self._plan_time < 0.0 or t - self._plan_time >= self._period() - 1e-6:
            from_lvlh = product(q, inverse(lvlh))
            pointing = forecast.Pointing(t, q, from_lvlh, turning, self._slew())
            self._plan(pointing, orbit, rotate_back(q, h), sub(b, model))
            self._plan_time = t
        mean = rotate(q, add(b, sub(self._field_amid_sample(t), model)))
        if self._plan_failed or is_strange:
            mode, m = FALLBACK, cross_product.normalised(h, mean, norm(turn))
        else:
            mode, m = DUMPING, self._dipole(mean, rotate(q, self._costate))
        return self._drive_actuators(mode, m, mean)

    def _drive_actuators(self, mode: int, m: Vec3, mean: Vec3) -> tuple[Vec3, Split]:
        """Command a dipole m (A m2, body) in the mean field (T) and the planned thrust.

        Return the torque (N m, body) that both give, and dipole and thrust themselves.
        """
        m = self._chosen_dipole(mode, m)
        self._coils = to_coils(self._to_coils, m)
        dipole = self._effective_dipole(self._coils)
        return add(cross(dipole, mean), self._effective_thrust()), (m, self._thrust)

    def _chosen_dipole(self, mode: int, m: Vec3) -> Vec3:
        """Return a dipole m (A m2, body) within the coils' limits, and show its mode.

        Without a valid field it is zero.
        """
        if not self.valid_b:
            self.mode = FALLBACK if norm(self._thrust) > 0.0 else IDLE
            return ZERO
        self.mode = mode
        return scale_to_limit(m, to_coils(self._to_coils, m), self.m_limit)

    def _judge_field(self, model: Vec3) -> None:
        """Reject a measured field whose size is not the Earth's. model: its field (T)."""
        self.field_rejected = self.valid_b and field_check.is_rejected(
            self.b_body,
            self._field_scale * norm(model),
            self.field_noise,
            self.dipole_earth,
            self.r_eci,
        )
        self._sees_field = self.valid_b and not self.field_rejected

    def _correct_attitude(self, q: Vec4, model: Vec3) -> Vec4:
        """Return the attitude q corrected by its constant error, where significant.

        Learn the error from the measured field, goal empty only; model: its field (T,
        eci). What is stored of the last sample (eci) is corrected by the change of the
        error.
        """
        if self.goal != EMPTY or self.field_spread <= 0.0:
            return q
        before = field_check.AttitudeCheck(*self._check)
        check = before
        if self._sees_field:
            check = field_check.learn_error(before, self.b_body, model, q)
        self._check = check
        if not check.is_misaligned:
            return q
        correction = field_check.correction_of(check)
        self._last_sample, self._filter = momentum_observer.turn_back(
            momentum_observer.Sample(*self._last_sample),
            momentum_observer.Filter(*self._filter),
            product(correction, inverse(field_check.correction_of(before))),
        )
        return product(correction, q)

    def _period(self) -> float:
        """Return the time (s) from plan to plan, a multiple of the sample time."""
        if self.goal == EMPTY:
            return self.sample_time
        return self.sample_time * float(
            int(max(PLAN_TIME / self.sample_time, 1.0) + 0.999999)
        )

    def _field(self, r: Vec3, v: Vec3, t: float) -> Vec3:
        """Compute the model's B (T, eci) at r (m) with v (m/s) at t (s)."""
        if self.field_model == NADIR:
            in_lvlh = receding_horizon.orbit_dipole(
                self.r_eci, self.v_eci, self.b_amplitude
            )
            return rotate_back(lvlh_attitude(r, v), in_lvlh(r))
        return self.field_eci(r, t, igrf=self.field_model == IGRF)

    def _field_amid_sample(self, t: float) -> Vec3:
        """Compute the scaled model's B (T, eci) half a sample after t (s)."""
        ((r, v),) = receding_horizon.coast(
            self.r_eci, self.v_eci, (0.5 * self.sample_time,)
        )
        return scale(self._field_scale, self._field(r, v, t + 0.5 * self.sample_time))

    def _scale_field(self, b: Vec3, model: Vec3, orbit: float) -> None:
        """Update the scale of the model's field by a measured field (T, eci).

        orbit: the orbit's period (s).
        """
        memory = max(1.0 - self.sample_time / orbit, 0.0)
        self._fields, self._models = field_check.compare(
            self._fields, self._models, b, model, memory
        )
        self._field_scale = self._fields / self._models

    def _effective_dipole(self, coils: Vec4) -> Vec3:
        """Compute the dipole (A m2, body) that the coils give for these commands."""
        a, b, c, d = coils
        e, f, g, i = self.effectiveness
        return body_momentum(self._live, (e * a, f * b, g * c, i * d))

    def _craft(self) -> momentum_observer.Craft:
        """Return what is known of the craft and its sensors."""
        return momentum_observer.Craft(
            self._inertia,
            self._live,
            self.m_limit,
            self.tau_level,
            self.least_pulse,
            self.sample_time,
            self.h_noise,
            self.rate_noise,
            self.attitude_noise,
            learning.EMPTYING if self.goal == EMPTY else learning.HOLDING,
        )

    def _observe(self, t: float, q: Vec4, b: Vec3, total: Vec3) -> None:
        """Learn from the change of the craft's momentum since the last sample.

        b (T, eci): field; total (N m s, body): momentum of the craft.
        """
        craft = self._craft()
        gravity = gravity_gradient_eci(self.r_eci, q, self._inertia)
        interval = momentum_observer.Interval(
            momentum_observer.Sample(*self._last_sample),
            momentum_observer.Sample(t, q, self.r_eci, self.v_eci, b, gravity),
            self._coils,
            self._thrust,
        )
        estimate, limits = momentum_observer.observe(
            momentum_observer.Filter(*self._filter),
            momentum_observer.ThrustLimits(*self._limits),
            interval,
            craft,
            total,
            self.valid_b,
        )
        self._last_sample, self._filter, self._limits = interval.end, estimate, limits
        self._show(
            learning.judge(
                estimate.x, estimate.p, craft.doubt, estimate.coil_suspicions
            )
        )
        self.thruster_limit = learning.vector(limits.share, 0)
        self.filter_restarts = estimate.restarts

    def _show(self, x: Table) -> None:
        """Store the expected x of `disturbance_learning`, and show it."""
        self._expected_state = x
        self.gravity_scale = x[learning.GRAVITY]
        self.torque_eci = learning.vector(x, learning.INERTIAL)
        e = learning.COILS
        self.effectiveness = (x[e], x[e + 1], x[e + 2], x[e + 3])
        self.thruster_effectiveness = learning.vector(x, learning.THRUSTERS)

    def _effective_thrust(self) -> Vec3:
        """Compute the torque (N m, body) that the thrusters give for the command."""
        x, y, z = self.thruster_effectiveness
        n_x, n_y, n_z = momentum_observer.reach(
            self._thrust, self.thruster_limit, self.tau_level
        )
        return (x * n_x, y * n_y, z * n_z)

    def _axes(self) -> tuple[predictive.Vectors, predictive.Vectors, Table]:
        """Return three commands (1, body) whose coils' energies add up.

        Also the dipole that a unit of each really gives (1, body), and the limit of
        each (A m2).
        """
        p, e = self._to_coils, self.effectiveness
        price = predictive.ZERO_MATRIX
        for i in range(4):
            w = max(e[i] * e[i], LEAST_ENERGY)
            row = (p[3 * i], p[3 * i + 1], p[3 * i + 2])
            price = matrix.add_square(price, row, w)
        least = LEAST_EIGENVALUE * (price[0] + price[4] + price[8]) / 3.0
        # R = L L', the commands are the columns of L'^-1
        l11, _, _, l21, l22, _, l31, l32, l33 = predictive.root(
            matrix.add(price, matrix.scale(least, IDENTITY))
        )
        commands = (
            (1.0 / l11, 0.0, 0.0),
            (-l21 / (l11 * l22), 1.0 / l22, 0.0),
            (
                (l21 * l32 - l31 * l22) / (l11 * l22 * l33),
                -l32 / (l22 * l33),
                1.0 / l33,
            ),
        )
        coils = tuple(to_coils(p, command) for command in commands)
        dipoles = tuple(self._effective_dipole(c) for c in coils)
        return commands, dipoles, tuple(self._reach(c) for c in coils)

    def _reach(self, coils: Vec4) -> float:
        """Return the multiple (A m2) of commands to coils (1) that is within limits."""
        largest = max(map(abs, coils))
        return self.m_limit / largest if largest > 1e-9 else 0.0

    def _dipole(self, b: Vec3, costate: Vec3) -> Vec3:
        """Compute the dipole to command (A m2, body) in the field b (T, body).

        costate: body.
        """
        if self.goal == EMPTY:
            return self._dipole_planned
        commands, dipoles, most = self._axes()
        m = ZERO
        for i in range(3):
            v = -dot(cross(dipoles[i], b), costate) / self.weights[1]
            m = add(m, scale(min(max(v, -most[i]), most[i]), commands[i]))
        return m

    def _plan(
        self, pointing: forecast.Pointing, orbit: float, x0: Vec3, off: Vec3
    ) -> None:
        """Plan with the attitude `pointing` on an orbit with the period `orbit` (s).

        x0: X (N m s, eci); off: the measured field minus that of the model (T, eci).
        """

        def field(r: Vec3, v: Vec3, at: float) -> Vec3:
            """Compute the scaled model's B (T, eci)."""
            return scale(self._field_scale, self._field(r, v, at))

        holds, period = self.goal == HOLD, self._period()
        reach = self.end - pointing.t
        if holds:
            reach = self.horizon if self.horizon > 0.0 else ORBITS * orbit
        longest = max(LONGEST_INTERVAL * orbit, period)
        count, dt = forecast.lay_grid(reach, period, longest, holds)
        _, dipoles, _ = self._axes()
        x, y, z = self.tau_level
        e, f, g = self.thruster_effectiveness
        ahead = forecast.predict(
            forecast.Craft(
                self._inertia,
                self._live,
                dipoles,
                (x * e, y * f, z * g),
                self._to_wheels,
                self.h_target_body,
                self._expected_state,
            ),
            pointing,
            self.r_eci,
            self.v_eci,
            field,
            off,
            count,
            dt,
            predictive.COILS if holds else predictive.ACTUATORS,
        )
        if holds:
            self._hold(count, x0, dt, ahead)
        else:
            self._empty(count, x0, dt, ahead)

    def _hold(self, count: int, x0: Vec3, dt: Table, ahead: forecast.Forecast) -> None:
        """Plan a course of low momentum from X = x0 (N m s, eci) on."""
        _, _, limits = self._axes()
        share = self._momentum_share()
        momentum = self.weights[0] * share * share * ahead.stiffness
        problem = predictive.PathProblem(
            count,
            x0,
            dt,
            ahead.drift,
            ahead.effect,
            self.weights[1],
            limits,
            ahead.wheel_axes,
            to_wheels(self._to_wheels, self.h_target_body),
            momentum,
            0.0,
            1.0,
        )
        u, _, path, steps, _ = predictive.plan_path(problem, predictive.NO_PLAN)
        largest = predictive.find_largest_momentum(problem, path)
        peak_scale = PEAK_SCALE * max(largest, self._peak(), 1e-9)
        peak = PEAK * momentum * peak_scale * peak_scale
        _, self._costate, _, more_steps, has_converged = predictive.plan_path(
            predictive.penalise_peaks(problem, peak, peak_scale), u
        )
        self.plan_steps, self._plan_failed = steps + more_steps, not has_converged

    def _empty(self, count: int, x0: Vec3, dt: Table, ahead: forecast.Forecast) -> None:
        """Plan dipole and pulses of the first interval so that X = x0 becomes zero.

        x0 in N m s, eci.
        """
        fee = [0.0] * predictive.INTERVALS
        _, _, limits = self._axes()
        rest, reach, begin = x0, 0.0, 0.0
        for k in range(count):
            reach += dt[k]
            rest = add(rest, ahead.drift[k])
        for k in range(count):
            fee[k] = self.weights[2] * (1.0 - PATIENCE * begin / reach)
            begin += dt[k]
        level = max(max(self.tau_level), 1e-9)
        least = level * self.least_pulse
        weight = 10.0 * self.weights[2] / (level * least)
        near, stride = 0.01 * least, 0.5 * self.weights[2] / level
        problem = predictive.UnloadingProblem(
            count,
            rest,
            ahead.effect,
            COIL_PRICE,
            limits,
            tuple(fee),
            self._longest_firings(count, dt),
            weight,
        )
        u, self.plan_steps, _ = predictive.plan_unloading(problem, near, stride)
        thrust = (self._pulse(u[3], 0), self._pulse(u[4], 1), self._pulse(u[5], 2))
        if count == 1:
            # the coils compensate the rounding of the pulses
            for j in range(3):
                on = thrust[j] * self.sample_time / max(self.tau_level[j], 1e-9)
                rest = add(rest, scale(on, ahead.effect[predictive.COILS + j]))
            problem = predictive.UnloadingProblem(
                count,
                rest,
                *problem[2:6],
                NO_FIRING,
                weight,
            )
            u, _, _ = predictive.plan_unloading(problem, near, stride)
        commands, _, _ = self._axes()
        m = ZERO
        for j in range(3):
            m = add(m, scale(u[j], commands[j]))
        self._dipole_planned, self._thrust = m, thrust

    def _longest_firings(self, count: int, dt: Table) -> Table:
        """Return the longest on-times (s) of a plan to empty, THRUSTERS an interval.

        The first interval may take what the thrusters are seen to reach, a later one
        what is certain, so that a weaker thruster still has the time that it needs.
        """
        shares, deviations, bounds = self._limits
        most = [0.0] * (predictive.THRUSTERS * predictive.INTERVALS)
        for j in range(predictive.THRUSTERS):
            limit = shares[j] if self.tau_level[j] > 0.0 else 0.0
            certain = thrust_limit.dependable(limit, deviations[j], bounds[j])
            for k in range(count):
                share = certain if k > 0 else limit
                most[predictive.THRUSTERS * k + j] = share * dt[k]
        return tuple(most)

    def _pulse(self, on_time: float, axis: int) -> float:
        """Round an on-time (s) to whole pulses: mean torque (N m) over a sample."""
        count = int(abs(on_time) / self.least_pulse + 0.5)
        on = copysign(float(count) * self.least_pulse, on_time)
        return self.tau_level[axis] * on / self.sample_time
