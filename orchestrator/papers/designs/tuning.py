"""Search the one free number of a law of magnetic dumping."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import numpy as np
from scipy.optimize import brentq

from ...engine.instances.base import ComponentError
from ...system.errors import DesatError
from ...system.model import System
from . import MadeDesign, Parameters
from .plant import Array, DesignFlight, Plant

WEIGHT_UNIT, GAIN_UNIT = "1/(T2.s2)", "1/(T.s)"
# minimum, maximum and step of the decimal logarithm of a law's free number
SEARCH = (-1.0, 8.0, 0.1)


def flies(system: System, model: str, law: str = "") -> bool:
    """Return whether the system's manager is this block with this `law`."""
    manager = system.components.get("manager")
    if manager is None or manager.model != model:
        return False
    return (manager.choice("law") if "law" in manager.interface.signals else "") == law


def of_flight(
    parameters: Parameters,
    flight: DesignFlight,
    tuned: dict[str, tuple[float, str]] | None = None,
    notes: tuple[str, ...] = (),
) -> MadeDesign:
    """Return the design of the manager parameters of a flight."""
    return MadeDesign("manager", parameters, flight.reached(), tuned or {}, notes)


def with_weight(plant: Plant, parameters: Callable[[float], Parameters]) -> MadeDesign:
    """Return the design with F as given, or tuned to the required final momentum."""
    if plant.settings.final_momentum:
        return tune(plant, parameters, "momentum_weight", WEIGHT_UNIT)
    if not plant.settings.momentum_weight:
        raise DesatError(
            f"{plant.system.name}: design: momentum_weight or final_momentum needed"
        )
    fixed = parameters(1.0)
    return of_flight(fixed, plant.fly(**fixed))


def shape(plant: Plant) -> Array:
    """Return the diagonal (3,) of F; only its shape counts where a number is tuned."""
    return np.asarray(plant.settings.momentum_weight or (1.0, 1.0, 1.0), float)


def tune(
    plant: Plant, parameters: Callable[[float], Parameters], name: str, unit: str
) -> MadeDesign:
    """Find the smallest free number with which the run ends at the required size.

    The search goes from SEARCH upwards. The final momentum falls with the number, and
    rises again where a sample is too long for it.

    Raises
    ------
    DesatError
        If no number leads there, or the end is reached without dumping.
    """
    place = f"{plant.system.name}: design"
    if (final_momentum := plant.settings.final_momentum) is None:
        raise DesatError(f"{place}: final_momentum is needed")
    best = inf

    def excess(log: float) -> float:
        """Return the final momentum beyond the required one (N m s).

        It is inf where the run diverges after one that did not.
        """
        nonlocal best
        try:
            size = plant.fly(**parameters(float(10.0**log))).size
        except ComponentError:
            if best == inf:
                raise
            return inf  # the run has diverged
        best = min(best, size)
        return size - final_momentum

    lowest, highest, step = SEARCH
    low = high = lowest
    while (value := excess(high)) > 0.0:
        low, high = high, high + step
        if high > highest or value == inf:
            raise DesatError(
                f"{place}: final_momentum = {final_momentum:g} N m s: no {name} up to {10**low:.0e} {unit} "
                f"ends there; the least is {best:.3g} N m s"
            )
    if low == high and value < 0.0:
        raise needless(plant, final_momentum)
    log = high if value == 0.0 else brentq(excess, low, high, xtol=1e-13, rtol=1e-14)
    number = 10.0 ** float(log)
    chosen = parameters(number)
    return of_flight(chosen, plant.fly(**chosen), {name: (number, unit)})


def needless(plant: Plant, final_momentum: float) -> DesatError:
    """Return the error for an end that is reached without dumping."""
    return DesatError(
        f"{plant.system.name}: design: final_momentum = {final_momentum:g} N m s is reached without dumping"
    )
