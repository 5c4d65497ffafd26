"""Who computes the layer of values that a scenario's [design] asks for.

The core computes none. A module of a folder `providers/` (`papers/` has one) has the
functions of `LayerProvider`, which stands for it where it is absent.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import cast

from ..files.scenario import Scenario
from ..system import discovery
from ..system.errors import DesatError
from ..system.model import System, Values
from ..system.options import Options


class LayerProvider:
    """What a provider does, and what is done where there is none."""

    def parameters_for(
        self, scenario: Scenario, options: Options
    ) -> Mapping[str, Values]:
        """Return the values, by component, that `options.design` asks for; none without
        it.

        They are a layer below what the scenario gives itself. Called for a scenario
        that has a [design], or is to have one. Raises DesatError where it cannot be
        made.
        """
        asked = f"{scenario.name}: [design]"
        if options.design is not None:
            asked = f"--design {options.design}"
        raise DesatError(
            f"{asked}: designs are computed by desat.papers, which is not installed"
        )

    def warnings(
        self, scenario: Scenario, options: Options, system: System
    ) -> Iterable[str]:
        """Return what to beware of in a system that runs with the kept design of a
        scenario."""
        return ()

    def problems(self, system: System) -> Iterable[str]:
        """Return what is wrong with the designed values of a system, a line each."""
        return ()


def provider() -> LayerProvider:
    """Return the module that provides designs, or what stands for it."""
    found = discovery.load("providers")
    return cast(LayerProvider, found[0]) if found else LayerProvider()
