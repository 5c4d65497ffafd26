"""Define the quantities that a sizing accepts, from options and from programs."""

from __future__ import annotations

from ..system.quantity import Quantity

DUTY = Quantity("--duty", "%")
MARGIN = Quantity("--margin", "1", 1.0, 100.0, noun="a factor of")
NEEDS = Quantity("--margin-factor", "1", 0.1, 100.0, noun="a factor of")
SLEW_ANGLE = Quantity("--slew", "deg")
SLEW_TIME = Quantity("--slew", "s", 0.0, 1e6, above=True, noun="a time")
TIP_OFF = Quantity("--tip-off", "deg/s", 0.0, 1000.0, above=True, noun="a number")
ARM = Quantity("--arm", "m", 0.0, 100.0, above=True, noun="a number")
ISP = Quantity("--isp", "s", 0.0, 1e5, above=True, noun="a number")
INCLINATIONS = Quantity("--inclinations", "deg", 0.0, 180.0)
ALTITUDES = Quantity("--altitudes", "km", 150.0, 2000.0)
RODS = Quantity("--rods", "A.m2", 0.0, 1e5, above=True, noun="numbers")
WHEELS = Quantity("--wheels", "N.m.s", 0.0, 1e5, above=True, noun="numbers")
THRESHOLDS = Quantity("--thresholds", "%", 1.0, 100.0)
YEARS = Quantity("--years", "1", 0.0, 1000.0, above=True, noun="numbers")
DIPOLES = Quantity("--dipoles", "A.m2", 0.0, 1e4)
