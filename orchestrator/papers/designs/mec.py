"""Compute the costate of minimum-energy magnetic dumping: paper 000, eqs. 10-12.

[design]
final_momentum = 0.05             # N m s: the cheapest end of this size
final_momentum_body = [0, 0, 0]   # or this end
end_of = "NAME"                   # or the end of another scenario's run, with its
                                  # stored design
"""

from __future__ import annotations

import numpy as np

from desat.components.laws import magnetic_offline as offline

from ...files.scenario import Scenario, find
from ...system.errors import DesatError
from ...system.model import System
from ...system.options import Options
from . import MadeDesign, Parameters
from .plant import Array, DesignFlight, Plant
from .tuning import flies, needless, of_flight

LARGEST_MISS = 1e-9  # N m s: largest miss of an end that a costate was solved for
# iterations of a costate: the first solves the linear equations, the others remove
# rounding errors
REFINEMENTS = 3


KEYS = ("final_momentum", "final_momentum_body", "end_of")


def applies(system: System) -> bool:
    """Return whether the manager is `manager_magnetic` with the law mec."""
    return flies(system, "manager_magnetic", "mec")


def make(scenario: Scenario, options: Options) -> MadeDesign:
    """Compute the costate with which the run ends at the required momentum."""
    plant = Plant(scenario, options)
    if plant.manager_value("saturation"):
        raise DesatError(
            f"{plant.system.name}: design: mec needs manager.saturation = false"
        )
    weight, settings = np.asarray(plant.manager_value("dipole_weight")), plant.settings
    fixed: Parameters = {
        "horizon": plant.horizon,
        "omega_nominal_body": list(plant.omega),
    }

    def fly(p: Array) -> DesignFlight:
        """Fly with a costate."""
        return plant.fly(costate=p.tolist(), **fixed)

    start = fly(np.zeros(3)).momentum[0]
    end = np.asarray(settings.final_momentum_body or (0.0, 0.0, 0.0), float)
    if settings.end_of:
        if f"{scenario.family}/{settings.end_of}" == scenario.name:
            raise DesatError(
                f"{scenario.name}: design: end_of = {settings.end_of!r}: the name of "
                "another scenario of the family is needed"
            )
        other = find(f"{plant.system.name.partition('/')[0]}/{settings.end_of}")
        end = Plant(other, designed=True).fly().momentum[-1]
    p = offline.costate(
        plant.field, plant.omega, weight, plant.n_con, start, end, plant.horizon
    )
    # Variation of extremals: the end is linear in p, also with commands held over a
    # sample
    flight, size = fly(p), float(np.linalg.norm(p))
    miss = np.linalg.norm(flight.momentum[-1] - end)
    note = (
        f"The costate of the continuous problem would miss the end by {miss:.2e} N m s"
    )
    varied = [fly(p + size * e) for e in np.eye(3)]
    effect = np.stack(
        [(v.momentum[-1] - flight.momentum[-1]) / size for v in varied], axis=1
    )
    if final_momentum := settings.final_momentum:
        dipoles = [(v.dipole - flight.dipole) / size for v in varied]
        cost = np.array([[np.sum(a * weight * b) for b in dipoles] for a in dipoles])
        free = flight.momentum[-1] - effect @ p
        if final_momentum >= np.linalg.norm(free):
            raise needless(plant, final_momentum)
        end = offline.cheapest_end(free, effect, cost, final_momentum)
    for _ in range(REFINEMENTS):
        p = p - np.linalg.solve(effect, flight.momentum[-1] - end)
        flight = fly(p)
    miss = np.linalg.norm(flight.momentum[-1] - end)
    if not miss <= LARGEST_MISS:
        raise DesatError(
            f"{plant.system.name}: design: the end is missed by {miss:.1e} N m s"
        )
    return of_flight({**fixed, "costate": p.tolist()}, flight, notes=(note,))
