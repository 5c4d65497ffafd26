"""Who computes the values that a scenario's [design] asks for, found in a folder `providers/`.

Such values are a layer below those that the scenario gives itself. The core does not compute any:
a module of a folder `providers/` has the functions of `LayerProvider`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, Protocol, cast

from ..files.scenario import Scenario
from ..system import discovery
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options

NOW = "now"  # `--design now`: computed for the run, and not kept


class LayerProvider(Protocol):
    """A module that provides a layer of values, and judges systems that use one."""

    def parameters_for(
        self, scenario: Scenario, options: Options
    ) -> Mapping[str, Mapping[str, Any]]:
        """Return the values by component and parameter that `options.design` asks for."""

    def warnings(self, scenario: Scenario, options: Options, system: System) -> list[str]:
        """Return what to beware of in a system that runs with the kept values."""

    def problems(self, system: System) -> Iterable[str]:
        """Return what is wrong with such values in a system, a line each."""


@cache
def provider() -> LayerProvider | None:
    """Return the module that provides designs; None where it is absent."""
    found = discovery.imported(full for _, full in discovery.modules("providers"))
    return cast(LayerProvider, found[0]) if found else None


def needed(asked: str) -> LayerProvider:
    """Return the provider. Raises DesatError, naming what asks for it, where it is absent."""
    found = provider()
    if found is None:
        raise DesatError(f"{asked}: designs are computed by desat.papers, which is not installed")
    return found


def designed(scenario: Scenario | None, options: Options) -> dict[str, dict[str, Any]] | None:
    """Return the layer that `options.design` asks for, without what the scenario gives itself;
    None where it asks for none. Raises DesatError where a design is needed and nobody provides it.
    """
    if scenario is None:
        return None
    if options.design is None:
        if scenario.design is not None:
            needed(f"{scenario.name}: [design]")
        return None
    provided = needed(f"--design {options.design}").parameters_for(scenario, options)
    own = scenario.parameters(designed=False)
    return {
        name: {key: value for key, value in values.items() if key not in own.get(name, {})}
        for name, values in provided.items()
    }


def warnings(scenario: Scenario | None, options: Options, system: System) -> list[str]:
    """Return what to beware of in a system that runs with the kept design of a scenario."""
    found = provider()
    if found is None or scenario is None or options.design is not None:
        return []
    return found.warnings(scenario, options, system)


def problems(system: System) -> Iterable[str]:
    """Return what is wrong with the designed values of a system, a line each."""
    found = provider()
    return found.problems(system) if found is not None else ()
