from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..bases.pulses import ENTRIES, Jet, PulsedThrusters
from ..contract.block import MOST_NOZZLES, NOZZLES, Output, Parameter, Table, Vec3
from ..maths.allocation import gives, least_on_times
from ..maths.vector import ZERO, add, cross, norm, scale

SIDES = (
    ("+x", (1.0, 0.0, 0.0)),
    ("-x", (-1.0, 0.0, 0.0)),
    ("+y", (0.0, 1.0, 0.0)),
    ("-y", (0.0, -1.0, 0.0)),
    ("+z", (0.0, 0.0, 1.0)),
    ("-z", (0.0, 0.0, -1.0)),
)


class ThrustersNozzles(PulsedThrusters):
    """Pulsed thrusters: nozzles anywhere on the body

    Nozzle i at r_i with the force F_i = thrust_i direction_i on the body has the torque
    r_i x F_i. At each sample the on-times x_i follow from the linear programme

        minimise sum x_i,   sum x_i (r_i x F_i) = sample_time tau_cmd,   0 <= x_i <= sample_time

    where nozzles that are partners have one on-time: a couple without a force,

    and where the nozzles cannot give that impulse, the error's 1-norm is minimised
    first. Each on-time is rounded to the nearest multiple of `least_pulse` and left out
    where shorter than `least_on_time`. Pulses begin at the sample or are centred in the
    period (`placement`). Their edges may fall anywhere inside a step; impulse and first
    moment are exact (mean and slope).

        on_time += sum over the nozzles
        propellant += (on-time + pulse_loss each pulse) thrust / (g0 I_sp)

    Up to eight scheduled firings (`schedule_...`: for instance an orbit manoeuvre) add
    torque and force, and count in `schedule_on_time` and `schedule_propellant` only.
    They are those of the nozzles that `schedule_nozzle` names, each with a share s_i of
    its thrust in the mean (off-modulated), and those specified directly, of an engine
    that is none of the nozzles:

        tau = schedule_tau + sum s_i r_i x F_i,   F = schedule_force + sum s_i F_i
        schedule_propellant += time (|schedule_force| + sum s_i thrust_i) / (g0 I_sp)

    `on_time_nozzle` is the time that each nozzle was open, scheduled or not.

    The default is six nozzles of 0.1 N at 0.4 m: 40 mN m about each axis, one nozzle
    each way.

    Source: Crawford, AIAA 69-845 (1969), for the programme.
    """

    position_nozzle: Table = Parameter(
        "m",
        "position of each nozzle from the centre of mass, body",
        shape=(NOZZLES, 3),
        start=(
            (0.0, 0.4, 0.0),
            (0.0, -0.4, 0.0),
            (-0.4, 0.0, 0.0),
            (0.4, 0.0, 0.0),
            (0.4, 0.0, 0.0),
            (0.4, 0.0, 0.0),
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0),
        ),
        usual=(-20.0, 20.0),
    )
    direction_nozzle: Table = Parameter(
        "1",
        "direction of each nozzle's force on the body, unit vector; zero: no nozzle",
        shape=(NOZZLES, 3),
        start=(
            (0.0, 0.0, 1.0),
            (0.0, 0.0, 1.0),
            (0.0, 0.0, 1.0),
            (0.0, 0.0, 1.0),
            (0.0, 1.0, 0.0),
            (0.0, -1.0, 0.0),
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0),
        ),
        usual=(-1.0, 1.0),
    )
    thrust: Table = Parameter(
        "N",
        "thrust of each nozzle",
        shape=(NOZZLES,),
        start=0.1,
        min=0.0,
        usual=(0.0, 1e3),
    )

    partner_nozzle: Table = Parameter(
        "1",
        "number of the nozzle that fires with each, as a couple, the same of both; 0: none",
        shape=(NOZZLES,),
        min=0.0,
        usual=(0.0, float(MOST_NOZZLES)),
    )
    schedule_nozzle: Table = Parameter(
        "1",
        "scheduled firings: a row each, the share of the time that each nozzle is open",
        shape=(ENTRIES, NOZZLES),
        min=0.0,
        max=1.0,
    )
    on_time_nozzle: Table = Output(
        "s",
        "time that each nozzle was open, scheduled firings included",
        shape=(NOZZLES,),
    )

    def start(self) -> None:
        self._jets = tuple(self._jet(i) for i in range(len(self.thrust)))
        for i in range(len(self.thrust)):
            self._check_partner(i)
        self._open = (0.0,) * len(self.thrust)
        super().start()

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        torques = tuple(jet[0] for jet in self._jets)
        missing = [name for name, side in SIDES if not gives(torques, side)]
        if missing and "tau_cmd_thruster_body" in wired_names:
            yield (
                f"thrust, position_nozzle and direction_nozzle give no torque about "
                f"{', '.join(missing)} alone: what is commanded there is not given"
            )
        yield from super().foresee(begin, end, wired_names)

    def output(self, t: float) -> None:
        super().output(t)
        self.on_time_nozzle = self._open

    def _jet(self, i: int) -> Jet:
        """Compute torque (N m), force (N) and thrust (N) of nozzle i."""
        x, y, z = self.direction_nozzle[3 * i : 3 * i + 3]
        if (x, y, z) != ZERO and abs(norm((x, y, z)) - 1.0) > 1e-6:
            self.fail(
                f"direction_nozzle: row {i + 1} = {(x, y, z)} is not a unit vector"
            )
        px, py, pz = self.position_nozzle[3 * i : 3 * i + 3]
        force = scale(self.thrust[i], (x, y, z))
        return cross((px, py, pz), force), force, self.thrust[i]

    def commanded_on_times(self, period: float) -> Iterable[tuple[float, Jet]]:
        impulse = scale(period, self.tau_cmd_thruster_body)
        torques = tuple(jet[0] for jet in self._jets)
        return zip(self.on_times(torques, impulse, period), self._jets, strict=True)

    def on_times(
        self, torques: tuple[Vec3, ...], impulse: Vec3, longest: float
    ) -> tuple[float, ...]:
        """Compute the on-time (s) of each nozzle for an angular impulse (N m s).

        A couple counts as one nozzle: its first gives the torque of both.
        """
        partners = self.partner_nozzle
        columns = tuple(
            torque
            if partners[i] == 0.0
            else add(torque, torques[int(partners[i]) - 1])
            if int(partners[i]) - 1 > i
            else ZERO
            for i, torque in enumerate(torques)
        )
        times = least_on_times(columns, impulse, longest)
        return tuple(
            x
            if int(partners[i]) - 1 > i or partners[i] == 0.0
            else times[int(partners[i]) - 1]
            for i, x in enumerate(times)
        )

    def _check_partner(self, i: int) -> None:
        """Refuse a partner that is not the partner of its own, or no nozzle."""
        partner = self.partner_nozzle[i]
        if partner == 0.0:
            return
        k = int(partner) - 1
        if partner != k + 1 or k >= len(self.thrust) or k == i:
            self.fail(f"partner_nozzle: row {i + 1} = {partner:g} is no other nozzle")
        if self.partner_nozzle[k] != i + 1:
            self.fail(
                f"partner_nozzle: row {i + 1} = {k + 1}, and row {k + 1} = "
                f"{self.partner_nozzle[k]:g}: each is the partner of the other"
            )

    def scheduled_jet(self, i: int) -> Jet:
        torque, force, thrust = super().scheduled_jet(i)
        for share, jet in zip(self._shares(i), self._jets, strict=True):
            torque = add(torque, scale(share, jet[0]))
            force = add(force, scale(share, jet[1]))
            thrust += share * jet[2]
        return torque, force, thrust

    def record_firing(self, i: int, seconds: float) -> None:
        self._open = tuple(
            x + seconds if k == i else x for k, x in enumerate(self._open)
        )

    def record_scheduled_firing(self, i: int, seconds: float) -> None:
        if seconds > 0.0:
            self._open = tuple(
                x + share * seconds
                for x, share in zip(self._open, self._shares(i), strict=True)
            )

    def _shares(self, i: int) -> Table:
        """Return the share of each nozzle in the scheduled firing i."""
        count = len(self.thrust)
        return tuple(self.schedule_nozzle[count * i + k] for k in range(count))
