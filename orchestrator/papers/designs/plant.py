"""Model dumping by magnetic torquers as the paper does: fixed attitude, ideal wheels.

Field, attitude and N_con come from the scenario's own environment and spacecraft. Every
end that is tuned or solved for is that of a run of the scenario on bare blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.blocks.spacecraft_fixed_attitude import (
    SpacecraftFixedAttitude,
    constant_torque,
)
from desat.components.contract.block import Vec3
from desat.components.maths.attitude import normalise, product, rotate
from desat.components.maths.vector import norm, scale
from desat.components.physics.orbit import lvlh_attitude

from ...engine.loop import run, stepping
from ...engine.master import Master
from ...engine.recording.recorder import Recorder
from ...files.scenario import Scenario
from ...language.scenario import Design
from ...system.errors import DesatError, nearest
from ...system.model import Component
from ...system.options import Options
from ...system.parameters import bare_block, expand
from .origin import case_for

Array = NDArray[np.floating[Any]]
MOMENTUM, DIPOLE = "spacecraft.h_copy_wheel", "torquers.m_mean_body"
ENERGY = "torquers.dipole_energy"


@dataclass(frozen=True)
class DesignFlight:
    """Course of a run.

    It has the wheels' momentum (rows, 3; N m s), the dipole over each step (steps, 3; A
    m2) and its energy (A2 m4 s).
    """

    momentum: Array
    dipole: Array
    energy: float

    @property
    def size(self) -> float:
        """Return the final momentum |h_f| (N m s)."""
        return float(np.linalg.norm(self.momentum[-1]))

    def reached(self) -> dict[str, tuple[Any, str]]:
        """Return the final values: name -> value and unit."""
        return {
            "final_momentum": (self.size, "N.m.s"),
            "final_momentum_body": ([float(x) for x in self.momentum[-1]], "N.m.s"),
            "dipole_energy": (self.energy, "A2.m4.s"),
        }


class Plant:
    """A scenario flown on bare blocks with varying parameters of its manager.

    It has the values of `options`; with `designed` it has the stored design, and
    nothing is assumed.
    """

    def __init__(
        self, scenario: Scenario, options: Options | None = None, designed: bool = False
    ) -> None:
        """Build the scenario on bare blocks in the paper's fixed attitude.

        Raises DesatError if its spacecraft is not of that block.
        """
        case = case_for(scenario, options or Options(), designed)
        self.system, self._schedule = case.or_raise()
        self.settings = scenario.content.design or Design()
        spacecraft = self._bare("spacecraft")
        if not isinstance(spacecraft, SpacecraftFixedAttitude):
            raise DesatError(
                f"{scenario.name}: a design is made in the paper's model, with the block "
                "spacecraft_fixed_attitude; [design] of = NAME takes that of another scenario"
            )
        self.manager = self._component("manager")
        self.horizon = self.system.steps * self.system.step
        self._environment = self._bare("environment")
        self._at(0.0)
        r, v = self._environment.r_eci, self._environment.v_eci
        spacecraft.r_eci, spacecraft.v_eci = r, v
        spacecraft.start()
        spacecraft.output(self.system.start)
        self._attitude = normalise(spacecraft.q_bo)
        self.omega: Vec3 = spacecraft.omega_bi_body
        nadir = rotate(spacecraft.q_bi, scale(-1.0 / norm(r), r))
        self.n_con = constant_torque(spacecraft.inertia, self.omega, nadir, norm(r))

    def _component(self, name: str) -> Component:
        """Return a component, or raise DesatError."""
        if name not in self.system.components:
            hint = nearest(name, self.system.components)
            raise DesatError(f"{self.system.name}: no component {name}{hint}")
        return self.system.components[name]

    def _bare(self, name: str) -> Any:
        """Return the block of a component with its parameters.

        The block of the environment is started.
        """
        block: Any = bare_block(self._component(name))
        if name == "environment":
            block.start()
        return block

    def _at(self, t: float) -> None:
        """Set the environment to `t` (s) after the start."""
        self._environment.output(self.system.start + t)

    def field(self, t: float) -> Vec3:
        """Return B (T, body) in the fixed attitude, `t` (s) after the start."""
        self._at(t)
        e = self._environment
        return rotate(product(self._attitude, lvlh_attitude(e.r_eci, e.v_eci)), e.b_eci)

    def manager_value(self, name: str) -> Any:
        """Return a parameter of the manager; a choice by its name."""
        signals = self.manager.interface.elements.get(name, ())
        if signals[0].choices:
            return self.manager.choice(signals[0].name)
        values = [self.manager.values[s.name] for s in signals]
        return values if signals[0].name != name else values[0]

    def fly(self, **parameters: Any) -> DesignFlight:
        """Run the scenario with these parameters of its manager; return its series."""
        values = dict(self.manager.parameters)
        place = f"{self.system.name}: manager"
        for name, value in parameters.items():
            values.update(expand(self.manager.interface, name, value, place))
        manager = replace(self.manager, parameters=values)
        system = replace(
            self.system, components={**self.system.components, "manager": manager}
        )
        with Master(system, self._schedule) as master:
            master.initialise()
            recorder = Recorder(None, master, (MOMENTUM, DIPOLE, ENERGY))
            run(master, stepping(master, recorder), system.steps, recorder)
            master.terminate()
            with recorder.finish(master) as results:
                return DesignFlight(
                    results.values(MOMENTUM)[:, :3],
                    results.values(DIPOLE),
                    float(results.values(ENERGY)[-1]),
                )
