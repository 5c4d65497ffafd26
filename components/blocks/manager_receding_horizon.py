from __future__ import annotations

from collections.abc import Iterator
from math import copysign
from types import ModuleType
from typing import ClassVar

from ..bases.dumping import FALLBACK, IDLE, RECEDING_HORIZON, ThrusterDumping
from ..bases.earth_field import EarthField
from ..contract.block import Output, Parameter, Vec3, Vec4
from ..laws import blending, dumping, receding_horizon
from ..maths import least_effort
from ..maths.attitude import normalise, product, rotate
from ..maths.vector import ZERO, add, cross, scale, sub
from ..physics.orbit import lvlh_attitude

ORBIT_DIPOLE, _, IGRF = range(3)


class ManagerRecedingHorizon(ThrusterDumping, EarthField):
    """Dumping with the least thruster time, planned over the remaining time

    At each sample a new plan is made from the measured momentum for all samples until
    `horizon`: mean dipoles M_k and on-times of the thrusters, by the linear programme

        minimise  the thrusters' on-time
        C_f' h_target - C_0' h = T sum C_k' (N_T,k + M_k x B_k + n_con)
        |M_k| <= duty m_limit each axis, 0 for `dead_axis`
        |N_T,k| <= (1 - reserve) thruster_duty tau_level each axis

    T = `sample_time`; C the attitude, fixed at `q_bo` from lvlh, and B_k the field, in
    the middle of sample k on two-body motion from r_eci and v_eci. The plan's first
    sample is commanded. Its field is the measured one with the model's change over half
    a sample; the fields of the other samples come from the manager's own model, times
    `field_scale` (1: right):

    - `orbit_dipole`: (b_x cos u, b_y, b_z sin u) in lvlh, u the argument of latitude (eq. 30);
    - `dipole`: centred, Earth-fixed; `igrf`: IGRF-14 up to `igrf_degree`, as the environments do.

    With `field_spread` above 0 the model is corrected by the magnetometer's
    measurements since the start: B = b + A b + c |b| at every sample ahead, with b the
    model's field. A and c are the most likely values if each element is 0 with this
    prior standard deviation and a measurement differs from the fit by `field_noise`.
    This form covers a misaligned attitude, a wrong scale and a wrong constant part. A
    plan with a wrong model counts on torques that the coils cannot give.

    On-times are rounded to multiples of `least_pulse`; the next plan corrects the
    rounding. No plan follows the last sample, so there the dipole compensates the
    rounding as far as it can. A firing that may be early or late is late, when more is
    known. The `reserve` is for deviations from the prediction. Where no plan keeps it
    in all samples, it is used, at first in this sample only.

    Where there is no plan (the momentum is more than can be dumped in time) the torque
    N = -g_rate h, or -h over the remaining time where that is more, is split by the
    bounded 1-norm blend of `manager_combined`, its thrusters within thruster_duty
    tau_level, and `mode` is 3 instead of 2. The same applies at a sample whose field is
    not valid, with thrusters alone. Where the momentum is not valid nothing is dumped.
    From `horizon` on `mode` is 0: no dumping. The wheels are commanded as by
    `manager_combined`.
    """

    # Constants that bound its work areas, and what each has for a sample.
    work_areas: ClassVar[tuple[tuple[ModuleType, str, int], ...]] = (
        (least_effort, "COLUMNS", 6),
        (receding_horizon, "SAMPLES", 1),
    )
    no_law = "it empties the wheels once, until `horizon`, and rests from then on"

    sample_time: float = Parameter(
        "s",
        "time between samples, a multiple of the step; above 0, and at least horizon / 600",
        start=10.0,
        min=0.0,
    )
    horizon: float = Parameter(
        "s",
        "when the momentum shall be h_target_body, after the start; to the nearest sample",
        start=600.0,
        min=1.0,
        needs=("r_eci", "v_eci", "h_wheel", "b_body", "tau_cmd_thruster_body"),
    )
    tau_level: Vec3 = Parameter(
        "N.m",
        "torque of each axis while it fires",
        start=0.04,
        min=1e-9,
        follows="thrusters.tau_level",
    )
    thruster_duty: float = Parameter(
        "1",
        "largest share of the period that the thrusters of an axis may be on",
        start=1.0,
        min=0.0,
        max=1.0,
    )
    reserve: float = Parameter(
        "1", "share of that time that plans leave free", start=0.2, min=0.0, max=1.0
    )
    reserve_cost: float = Parameter(
        "s", "how much more firing a plan may need to leave it free", start=0.5, min=0.0
    )
    least_pulse: float = Parameter(
        "s",
        "on-times that the thrusters make are multiples of it",
        start=0.05,
        min=1e-6,
        follows="thrusters.least_pulse",
    )
    g_rate: float = Parameter(
        "1/s", "closed-loop rate of the fallback", start=0.0077, min=0.0
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
        start="orbit_dipole",
    )
    field_scale: float = Parameter(
        "1", "the model's field is multiplied by it", start=1.0
    )
    b_x: float = Parameter(
        "T", "orbit_dipole: amplitude along the velocity", start=23e-6
    )
    b_y: float = Parameter(
        "T", "orbit_dipole: constant part, minus orbit normal", start=2.4e-6
    )
    b_z: float = Parameter("T", "orbit_dipole: amplitude to nadir", start=46e-6)
    field_spread: float = Parameter(
        "1",
        "how wrong the model may be, as a share of the field; 0: it is taken as it is",
        start=0.1,
        min=0.0,
    )
    field_noise: float = Parameter(
        "T",
        "how much a measurement may differ from the best fit of the model",
        start=1e-6,
        min=1e-10,
    )
    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle", "-", "receding_horizon", "fallback"),
    )

    def start(self) -> None:
        super().start()
        if self.sample_time <= 0.0:
            self.fail("sample_time = 0 s: a plan is made of samples")
        if self.horizon / self.sample_time > receding_horizon.SAMPLES:
            self.fail(
                f"horizon = {self.horizon:.10g} s is more than {receding_horizon.SAMPLES} "
                f"samples of sample_time = {self.sample_time:.10g} s"
            )
        self._q_bo = normalise(self.q_bo)
        self._fit = receding_horizon.NO_FIT
        self.start_field(igrf=self.field_model == IGRF)

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        self.check_igrf_years(begin, begin + self.horizon, self.field_model == IGRF)
        yield from super().foresee(begin, end, wired_names)

    def dump(
        self, t: float, elapsed_time: float, h: Vec3
    ) -> tuple[Vec3, blending.Split]:
        """Plan until the horizon; return torque (N m, body) and split of this sample.

        h is the momentum (N m s, body). Without a valid field or a plan the fallback
        commands. The dipole of the last sample compensates the rounding of its pulses.
        """
        samples = int((self.horizon - elapsed_time) / self.sample_time + 0.5)
        if samples < 1:
            self.mode = IDLE
            return ZERO, (ZERO, ZERO)
        if not self.valid_b:
            return self._fallback(h, self.sample_time * samples)
        q_bi, fields = self._predict_course(t, samples)
        step = self._plan_first_sample(h, q_bi, fields)
        if step is None:
            return self._fallback(h, self.sample_time * samples)
        self.mode = RECEDING_HORIZON
        m, on_times = step
        n_t = self._torque(tuple(map(self._round_on_time, on_times)))  # type: ignore[arg-type]
        if samples == 1:
            missing = add(cross(m, fields[0]), sub(self._torque(on_times), n_t))
            m, _ = blending.bounded_one_norm(missing, fields[0], self.limits())
        return add(cross(m, self.b_body), n_t), (m, n_t)

    def _plan_first_sample(
        self, h: Vec3, q_bi: tuple[Vec4, ...], fields: tuple[Vec3, ...]
    ) -> tuple[Vec3, Vec3] | None:
        """Return dipole and on-times of the plan's first sample.

        The reserve is kept in all samples, or in all but this one, where that costs no
        more than `reserve_cost`; otherwise in none.
        """
        longest_on = self.thruster_duty * self.sample_time
        on_with_reserve = (1.0 - self.reserve) * longest_on
        free = self._step(h, q_bi, fields, (longest_on, longest_on))
        if free is None:
            return None
        for longest in (
            (on_with_reserve, on_with_reserve),
            (longest_on, on_with_reserve),
        ):
            step = self._step(h, q_bi, fields, longest)
            if step is not None and step[2] <= free[2] + self.reserve_cost:
                return step[0], step[1]
        return free[0], free[1]

    def _step(
        self,
        h: Vec3,
        q_bi: tuple[Vec4, ...],
        fields: tuple[Vec3, ...],
        longest: tuple[float, float],
    ) -> tuple[Vec3, Vec3, float] | None:
        """Plan with these longest on-times (s); return the first sample."""
        return receding_horizon.first_step(
            add(h, self.h_target_body),
            self.h_target_body,
            q_bi,
            fields,
            self.n_con_body,
            self.limits(),
            self.tau_level,
            longest,
            self.sample_time,
        )

    def _fallback(self, h: Vec3, remaining_time: float) -> tuple[Vec3, blending.Split]:
        """Blend in place of a plan, with `remaining_time` (s) until the horizon."""
        self.mode = FALLBACK
        rate = max(self.g_rate, 1.0 / remaining_time)
        n = dumping.ilqr(h, self.rate(), rate, self.n_con_body)
        field = self.b_body if self.valid_b else ZERO
        m, (x, y, z) = blending.bounded_one_norm(n, field, self.limits())
        a, b, c = scale(self.thruster_duty, self.tau_level)
        n_t = (min(max(x, -a), a), min(max(y, -b), b), min(max(z, -c), c))
        return add(cross(m, field), n_t), (m, n_t)

    def _round_on_time(self, on_time: float) -> float:
        """Round an on-time (s) to whole pulses."""
        count = int(abs(on_time) / self.least_pulse + 0.5)
        return copysign(count * self.least_pulse, on_time)

    def _torque(self, on_times: Vec3) -> Vec3:
        """Compute the mean torque (N m) over a sample of on-times (s)."""
        x, y, z = (
            level * on / self.sample_time
            for level, on in zip(self.tau_level, on_times, strict=True)
        )
        return (x, y, z)

    def _predict_course(
        self, t: float, samples: int
    ) -> tuple[tuple[Vec4, ...], tuple[Vec3, ...]]:
        """Predict attitudes and fields B (T, body) until the end.

        Attitudes are those now, in the middle of each sample and at the end; fields are
        those in the middle of each sample.
        """
        period = self.sample_time
        middles = tuple(
            period * (k + 0.5) for k in range(min(samples, receding_horizon.SAMPLES))
        )
        ahead = (0.0, *middles, period * samples)
        states = receding_horizon.coast(self.r_eci, self.v_eci, ahead)
        q_bi = tuple(product(self._q_bo, lvlh_attitude(r, v)) for r, v in states)
        fields = tuple(
            scale(self.field_scale, b)
            for b in self._model_fields(t, ahead[:-1], q_bi[:-1], states[:-1])
        )
        if self.field_spread > 0.0:
            self._fit = receding_horizon.learnt(self._fit, fields[0], self.b_body)
            fields = receding_horizon.correct_fields(
                self._fit, fields, self.field_spread, self.field_noise
            )
        return q_bi, (add(self.b_body, sub(fields[1], fields[0])), *fields[2:])

    def _model_fields(
        self,
        t: float,
        ahead: tuple[float, ...],
        q_bi: tuple[Vec4, ...],
        states: tuple[tuple[Vec3, Vec3], ...],
    ) -> tuple[Vec3, ...]:
        """Compute the model's B (T, body) at times `ahead` (s) of t.

        `states` are position and velocity (m, m/s; eci) at these times.
        """
        if self.field_model == ORBIT_DIPOLE:
            amplitudes = (self.b_x, self.b_y, self.b_z)
            in_lvlh = receding_horizon.orbit_dipole(self.r_eci, self.v_eci, amplitudes)
            return tuple(
                rotate(self._q_bo, in_lvlh(r))
                for _, (r, _) in zip(ahead, states, strict=True)
            )
        return tuple(
            rotate(q, self.field_eci(r, t + s, igrf=self.field_model == IGRF))
            for s, q, (r, _) in zip(ahead, q_bi, states, strict=True)
        )
