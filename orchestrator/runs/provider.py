"""Find the provider of the layer of values for a scenario's [design].

The core computes none. A module of a folder `providers/` (`papers/` has one) has the
functions of `LayerProvider`, which stands for it where it is absent.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import cast

from ..files.scenario import Scenario
from ..system import discovery
from ..system.errors import DesatError
from ..system.model import System, Values
from ..system.options import Options


class LayerProvider:
    """Interface of a provider, with the behaviour where there is none."""

    def parameters_for(
        self, scenario: Scenario, options: Options
    ) -> Mapping[str, Values]:
        """Return the designed values for `options.design`, by component.

        There are none without it. They are a layer below the scenario's own values.
        Called for a scenario that has a [design], or is to have one. Raises DesatError
        where it cannot be made.
        """
        request = f"{scenario.name}: [design]"
        if options.design is not None:
            request = f"--design {options.design}"
        raise DesatError(
            f"{request}: designs are computed by desat.papers, which is not installed"
        )

    def warnings(
        self, scenario: Scenario, options: Options, system: System
    ) -> Iterable[str]:
        """Return warnings on a system that runs with the kept design of a scenario."""
        return ()

    def problems(self, system: System) -> Iterable[str]:
        """Return a line for each problem of the designed values of a system."""
        return ()


@cache
def provider() -> LayerProvider:
    """Return the module that provides designs, or its substitute."""
    modules = discovery.load("providers")
    return cast(LayerProvider, modules[0]) if modules else LayerProvider()
