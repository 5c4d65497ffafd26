from __future__ import annotations

from collections.abc import Iterator

from ..bases.near_earth import NearEarth
from ..contract.block import TURN, Parameter, Vec3
from ..physics.orbit import MU
from ..physics.tle import teme_state

# Age of elements (days): from the first on SGP4 is off by tens of kilometres, from the
# second on by hundreds.
DOUBTFUL, MEANINGLESS = 7.0, 30.0
DAY = 86400.0  # s


class EnvironmentTle(NearEarth):
    """Orbit from two-line elements with the Earth's field, Sun, eclipse and atmosphere

    Position and velocity by SGP4 and SDP4 (Vallado and others, Revisiting Spacetrack
    Report #3, AIAA 2006-6753; WGS-72) from the mean elements of a two-line set,
    `epoch_j2000` - `epoch_tle_j2000` + t after their epoch. TEME, the frame of SGP4, is
    taken as `eci`. `components.physics.tle.tle_parameters` converts the two lines to
    the parameters. The derivatives of the mean motion are not among them, as SGP4 does
    not use them.

    Firings do not act on this orbit, whatever is wired; they would appear in the next
    element set only. `environment_propagated` includes them.

    v is the velocity of SGP4, whose short-period part is simplified: on low, nearly
    circular orbits it is the derivative of r to 0.04 m/s. The derivatives of the field
    follow r.

    The host's Python needs the package sgp4 (pip install sgp4). Without it the block
    fails at its start, with a message that names the package.
    """

    third_bodies = True  # SGP4 includes them for slow orbits

    epoch_j2000: float = Parameter(
        "s",
        "UTC of t = 0: seconds since 2000-01-01T12:00:00 UTC, leap seconds not counted; "
        "629208000 is 2019-12-10T00:00:00",
        start=629208000.0,
        min=-3.2e9,
        max=3.2e9,
    )
    epoch_tle_j2000: float = Parameter(
        "s",
        "UTC of the elements, counted like epoch_j2000. All start values: ISS, 2019-12-09",
        start=629181509.3634241,
        min=-3.2e9,
        max=3.2e9,
    )
    bstar: float = Parameter("1", "drag term B*, per Earth radius", start=3.8792e-5)
    eccentricity: float = Parameter(
        "1", "mean eccentricity", start=7.417e-4, min=0.0, max=0.99
    )
    argument_of_perigee: float = Parameter(
        "rad", "mean argument of perigee", start=0.3083420829620822, usual=TURN
    )
    inclination: float = Parameter(
        "rad", "mean inclination", start=0.9013560935706996, min=0.0, max=3.1415926536
    )
    mean_anomaly: float = Parameter(
        "rad", "mean anomaly", start=1.4946964807494398, usual=TURN
    )
    mean_motion: float = Parameter(
        "rad/s", "mean motion (Kozai)", start=0.0011272670555414889, min=1e-6, max=2e-3
    )
    raan: float = Parameter(
        "rad",
        "mean right ascension of the ascending node",
        start=3.686137125541276,
        usual=TURN,
    )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield a warning where the run is far from the epoch of the elements.

        Raises
        ------
        BlockError
            If the run begins so far from it that SGP4 is not valid.
        """
        since = self.epoch_j2000 - self.epoch_tle_j2000
        first, last = (since + begin) / DAY, (since + end) / DAY
        days = first if abs(first) > abs(last) else last
        age = f"{abs(days):.0f} days {'after' if days > 0.0 else 'before'}"
        if abs(first) > MEANINGLESS:
            self.fail(
                f"epoch_j2000: the run is {age} the epoch of its elements (epoch_tle_j2000); "
                f"SGP4 is not valid beyond {MEANINGLESS:g} days"
            )
        if abs(days) > DOUBTFUL:
            yield (
                f"epoch_j2000: the run is {age} the epoch of its elements "
                f"(epoch_tle_j2000); beyond {DOUBTFUL:g} days SGP4 is off by tens of "
                "kilometres"
            )
        yield from super().foresee(begin, end, wired_names)

    def size(self) -> tuple[float, float]:
        return (MU / self.mean_motion**2) ** (1.0 / 3.0), self.eccentricity

    def motion(self, t: float) -> tuple[Vec3, Vec3]:
        elements = (
            self.epoch_tle_j2000,
            self.bstar,
            self.eccentricity,
            self.argument_of_perigee,
            self.inclination,
            self.mean_anomaly,
            self.mean_motion,
            self.raan,
        )
        return teme_state(elements, self.epoch_j2000 - self.epoch_tle_j2000 + t)
