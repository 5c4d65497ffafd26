"""Prepare many cases of a scenario, which differ in drawn or swept values alone."""

from __future__ import annotations

import re
from dataclasses import replace

from desat.components.contract.block import Scalar

from ..analyses.manifest import Manifest, SubstepChoice
from ..engine.master import MasterPool
from ..files.build import build
from ..files.draft import Draft
from ..files.scenario import Scenario
from ..language.content import content_of
from ..system.check import foresee, without_effect
from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.model import Component, System, Values
from ..system.options import Options
from ..system.parameters import expand
from . import validation
from .case import Case, described_by
from .prepare import prepare, with_stop


class Cases:
    """Cases of a scenario: what they have in common is prepared once."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._drafts: dict[bool, Draft] = {}
        # first prepared case, by the options without values
        self._first: dict[str, Case] = {}
        # substeps that cases with drawn values begin with, by the options without these
        self.substep_choices: dict[str, SubstepChoice | None] = {}

    def draft(self, blocks: bool) -> Draft:
        """Return the system to draw values for, as `draft_to_draw` does."""
        if blocks not in self._drafts:
            self._drafts[blocks] = draft_to_draw(self.scenario, blocks)
        return self._drafts[blocks]

    def prepare(self, options: Options) -> Case:
        """Prepare one of many cases that differ in values alone (`options.values`).

        Only the components that get a value are resolved and checked again. System and
        problems are those that `prepare` finds; the warnings are those of the first
        case.

        Raises
        ------
        DesatError
            As `prepare`.
        """
        options = with_stop(self.scenario, options)
        key = repr(replace(options, values=dict.fromkeys(sorted(options.values))))
        if key not in self._first:
            case = prepare(self.scenario, options)
            system, _ = case.or_raise()
            begun = Manifest.of(system, options, case.target)
            self._first[key] = replace(case, manifest=begun, spare=MasterPool())
            return self._first[key]
        first = self._first[key]
        system, _ = first.or_raise()
        changed_components = _changed(system, options.values)
        if changed_components is None:
            return prepare(self.scenario, options)
        system = replace(system, components={**system.components, **changed_components})
        part = replace(system, components=changed_components)
        if [*without_effect(part, first.unwired), *foresee(part, first.unwired)[0]]:
            return prepare(self.scenario, options)  # reports problems in the usual way
        manifest = first.manifest and first.manifest.varied(
            system, changed_components.values()
        )
        return replace(first, options=options, system=system, manifest=manifest)


def draft_to_draw(scenario: Scenario, blocks: bool) -> Draft:
    """Return a scenario's system to draw values for.

    Raises
    ------
    DesatError
        If there are problems with it, or with its dispersions.
    """
    draft = build(scenario, Options(blocks=blocks))
    scenario_described = described_by(draft, scenario)
    if scenario_described is not None and not draft.problems:
        problems = validation.content_problems(
            scenario_described.content, draft.components
        )
        draft.problems += [
            f"{scenario_described.place(path)}: {text}"
            for path, text in problems
            if "dispersions" in path
        ]
    if draft.problems:
        raise DesatError("\n".join(draft.problems))
    return draft


def _changed(system: System, values: Values) -> dict[str, Component] | None:
    """Return the components of a checked system that get other values.

    None where more than their own values would change, or a value does not fit.
    """
    texts = [t for c in system.components.values() for t in c.references.values()]
    entries = [
        content_of(system.about).written.get(k)
        for k in ("numbers", "stop_when", "design")
    ]
    words = set(re.findall(r"\w+", " ".join([*texts, repr(entries)])))
    parameters: dict[str, dict[str, Scalar]] = {}
    for name, value in values.items():
        owner, _, variable = name.partition(".")
        component = system.components.get(owner)
        if component is None or isinstance(value, str):
            return None
        signals = component.interface.elements.get(variable, ())
        if (
            any(s.shared for s in signals)
            or variable.endswith("sample_time")
            or (variable == "delay" or base_name(variable) in words)
        ):
            return None
        try:
            elements = expand(component.interface, variable, value, owner)
        except DesatError:
            return None
        parameters.setdefault(owner, dict(component.parameters)).update(elements)
    return {
        name: replace(system.components[name], parameters=elements)
        for name, elements in parameters.items()
    }
