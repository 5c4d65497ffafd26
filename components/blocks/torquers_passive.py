from __future__ import annotations

from collections.abc import Iterator
from math import atan, ceil, cos, pi, tan

from ..contract.block import Output, Parameter, Vec3
from ..contract.roles import Torquers
from ..maths.attitude import rotate
from ..maths.vector import ZERO, add, scale, sub

MU_0 = 4e-7 * pi  # T m/A, permeability of free space
# Largest change of H in one part of a rod's course, relative to the coercive field.
PART = 0.05
MOST_PARTS = 1000


class TorquersPassive(Torquers):
    """A permanent magnet and hysteresis rods: the oldest way to stop a tumble

    The dipole is m = `magnet_body` + B_rod V / mu_0, with V the volume of rods along
    each body axis. The flux B_rod of an axis follows the field H = B_ext / mu_0 along
    it, between the two branches of its loop, H_b(B) = tan(pi B / (2 B_s)) / k -+ H_c
    with k = tan(pi B_r / (2 B_s)) / H_c:

        dB/dH = 2/pi k B_s cos^2(pi B / (2 B_s)) [q + (1 - q) ((H - H_b) / (2 H_c))^2]

    with H_b the branch that H moves away from, and q = `reversal_slope` the slope of B
    just after a reversal of H, relative to that of its branch. Rods are of one material
    and long compared to their width: `coercive_field`, `remanence` and `saturation` are
    measured values of the rod, and interactions between adjacent rods are neglected.

    At each step H changes from its last value to that at the beginning of the step.
    Over the step it is extrapolated from the previous one, which gives m_mean_body and
    m_slope_body. The block reads no command and takes no power.

    Source: Flatley & Henretty, "A Magnetic Hysteresis Model", NASA Flight Mechanics
    Symposium (1995), eqs. 1 to 6.
    """

    magnet_body: Vec3 = Parameter(
        "A.m2", "dipole of the permanent magnet, body", usual=(-10.0, 10.0)
    )
    rod_volume: Vec3 = Parameter(
        "m3",
        "volume of all rods along each body axis; 0: none",
        min=0.0,
        needs=("b_eci", "q_bi"),
        usual=(0.0, 1e-3),
    )
    coercive_field: float = Parameter(
        "A/m",
        "H_c of a rod",
        start=12.0,
        min=1e-3,
        usual=(0.1, 1e3),
    )
    remanence: float = Parameter(
        "T",
        "B_r of a rod",
        start=0.004,
        min=1e-9,
        usual=(1e-4, 2.0),
    )
    saturation: float = Parameter(
        "T",
        "B_s of a rod",
        start=0.025,
        min=1e-9,
        usual=(1e-3, 3.0),
    )
    reversal_slope: float = Parameter(
        "1", "q: slope just after a reversal", min=0.0, max=1.0
    )
    flux_body: Vec3 = Output(
        "T", "flux of the rods along each body axis, at the step's begin"
    )

    def start(self) -> None:
        super().start()
        if not 0.0 < self.remanence < self.saturation:
            self.fail(
                f"remanence = {self.remanence} T is not below saturation = "
                f"{self.saturation} T"
            )
        self._steepness = (
            tan(0.5 * pi * self.remanence / self.saturation) / self.coercive_field
        )
        self._field: Vec3 | None = None
        self._flux = ZERO
        self.on_time = self.dipole_energy = self.electric_energy = 0.0
        self.m_mean_body, self.m_slope_body = self.magnet_body, ZERO

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        if "m_cmd_body" in wired_names:
            yield "m_cmd_body is wired, and a magnet and rods read no command"
        yield from super().foresee(begin, end, wired_names)

    def output(self, t: float) -> None:
        self.flux_body = self._flux
        self.m_body = self._dipole(self._flux)

    def advance(self, t: float, dt: float) -> None:
        """Follow the hysteresis and set the mean dipole (A m2, body) and its slope.

        The field at the end of the step is extrapolated from its change over the last
        one.
        """
        field = scale(1.0 / MU_0, rotate(self.q_bi, self.b_eci))
        if self._field is None:
            x, y, z = (self._anhysteretic(h) for h in field)
            self._flux, before = (x, y, z), field
        else:
            before = self._field
            self._flux = self._follow(self._flux, before, field)
        self._field = field
        ahead = self._follow(self._flux, field, add(field, sub(field, before)))
        m0, m1 = self._dipole(self._flux), self._dipole(ahead)
        self.m_mean_body, self.m_slope_body = scale(0.5, add(m0, m1)), sub(m1, m0)

    def _dipole(self, flux: Vec3) -> Vec3:
        """Compute the dipole (A m2, body) at a flux (T)."""
        x, y, z = (b * v / MU_0 for b, v in zip(flux, self.rod_volume, strict=True))
        return add(self.magnet_body, (x, y, z))

    def _anhysteretic(self, h: float) -> float:
        """Compute the flux (T) of a rod that was demagnetised in H (A/m)."""
        return 2.0 / pi * self.saturation * atan(self._steepness * h)

    def _follow(self, flux: Vec3, begin: Vec3, end: Vec3) -> Vec3:
        """Compute the flux (T) of each axis as H (A/m) changes linearly."""
        x, y, z = (
            self._along(b, h0, h1) for b, h0, h1 in zip(flux, begin, end, strict=True)
        )
        return (x, y, z)

    def _along(self, b: float, begin: float, end: float) -> float:
        """Integrate the flux (T) of an axis from b on as H (A/m) changes linearly."""
        parts = min(ceil(abs(end - begin) / (PART * self.coercive_field)), MOST_PARTS)
        for i in range(parts):
            h = begin + (end - begin) * i / parts
            step = (end - begin) / parts
            slope = self._slope(b, h, step)
            # midpoint rule
            b += step * self._slope(b + 0.5 * step * slope, h + 0.5 * step, step)
        return b

    def _slope(self, b: float, h: float, way: float) -> float:
        """Compute dB/dH (T m/A) at b and H (A/m) as H rises (way above 0) or falls."""
        angle = 0.5 * pi * min(max(b / self.saturation, -0.999999), 0.999999)
        middle = tan(angle) / self._steepness
        from_branch = h - middle + self.coercive_field
        if way < 0.0:
            from_branch = middle + self.coercive_field - h
        share = min(max(from_branch / (2.0 * self.coercive_field), 0.0), 1.0)
        on_branch = 2.0 / pi * self._steepness * self.saturation * cos(angle) ** 2
        q = self.reversal_slope
        return on_branch * (q + (1.0 - q) * share * share)
