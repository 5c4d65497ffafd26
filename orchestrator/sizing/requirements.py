"""Define the requirements of a sizing."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from ..system.errors import DesatError
from . import quantities


@dataclass(frozen=True)
class SizingRequirements:
    """Requirements that a sizing has to meet besides those of the craft."""

    duty: float = 0.5  # of the coils
    # rods over the least rod, and wheel capacity over the momentum they hold
    margin: float = 1.3
    slew_angle: float = 0.0  # rad
    slew_time: float = 0.0  # s
    # rad/s; None: that of the craft's scenario `detumbling.toml`, else TIP_OFF
    tip_off: float | None = None
    arm: float | None = None  # m, of thrusters; None: the craft's
    specific_impulse: float | None = None  # s; None: the craft's
    laws: bool = True  # other laws than the craft's own have curves
    year: bool = True
    flown: bool = True  # the closed loop flies with the rods that count

    def __post_init__(self) -> None:
        """Raise DesatError for a requirement that makes no sense."""
        if not 0.0 < self.duty < 1.0:
            raise DesatError(
                f"--duty {100.0 * self.duty:g}: a share between 0 and 100 % is needed"
            )
        quantities.MARGIN(self.margin)
        if (self.slew_angle > 0.0) != (self.slew_time > 0.0):
            raise DesatError(
                "--slew: an angle (deg) and a time (s) above 0 are needed, as 60/300"
            )
        if self.slew_angle > pi * (1.0 + 1e-9):
            raise DesatError(
                f"--slew: {np.degrees(self.slew_angle):.4g} deg: a turn to any "
                "attitude is of 180 deg at most; the angle is in deg"
            )
        if self.arm is not None:
            quantities.ARM(self.arm)
        if self.specific_impulse is not None:
            quantities.ISP(self.specific_impulse)
        if self.tip_off is not None:
            quantities.TIP_OFF(float(np.degrees(self.tip_off)))
        if self.slew_time > 0.0:
            quantities.SLEW_TIME(self.slew_time)
