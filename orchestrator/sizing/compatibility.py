"""Find which managers fit a craft, and with which gains.

The blocks declare it themselves (`components/contract/fitting.py`); here the
declarations are evaluated for a system.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np

from desat.components.contract.block import Block
from desat.components.contract.fitting import Law, Need, needs_of
from desat.components.contract.roles import Manager
from desat.fmus.own import OwnBlockError, is_own
from desat.fmus.registry import block_class, names

from ..analyses.needs import instead
from ..runs.case import Case
from ..runs.prepare import prepare, resolved
from ..system.errors import DesatError, nearest
from ..system.expression import product, values_of
from ..system.model import Component, Parameter, System
from ..system.options import Options
from ..system.sensors import KNOWN, noise_of

ROLE = "manager"
BANDWIDTH = 5.0  # law rate over orbit rate, for a craft whose own law gives none
PLAINEST = "manager_cross_product"  # listed after the craft's own
ALL = "all"
# s: sample time of a law that must sample, where neither the craft's manager nor its
# coils do
SAMPLE = 10.0


@dataclass(frozen=True)
class Terms:
    """Quantities that rules of gains use besides the craft's parameters."""

    orbit_rate: float  # rad/s
    field: float  # T, mean magnitude
    inertial: bool  # the attitude stays fixed in eci


@dataclass(frozen=True)
class Fitting:
    """A law that fits a craft."""

    name: str
    manager: str  # its block, or its file as the user gave it
    is_own: bool  # the law that the craft flies, with its own values
    case: Case  # the craft that flies it, prepared
    # parameter -> its rule and the resulting value; empty for the craft's own law
    gains: Mapping[str, str]

    @property
    def options(self) -> Options:
        """Return the options with which the craft flies it."""
        return self.case.options

    @property
    def label(self) -> str:
        """Return the name, marked if the law is the craft's own."""
        return f"{self.name} (own)" if self.is_own else self.name


@dataclass(frozen=True)
class Refused:
    """A manager that does not fit a craft."""

    name: str
    why: str


def law_name(component: Component) -> str:
    """Return the name of the law that a manager is set to."""
    if component.block is None:
        return component.model
    if law := _law_of(component):
        return law.name
    return component.model.removeprefix("manager_").replace("_", " ")


def _law_of(component: Component) -> Law | None:
    """Find the law that a component's choices select among its block's laws."""
    block, laws = component.block, tuple[Law, ...]()
    if block is not None and issubclass(block, Manager):
        laws = block.offers
    signals = component.interface.signals

    def chosen(law: Law) -> bool:
        """Return whether the component has the choices of a law."""
        choices = {
            k: v for k, v in law.gains.items() if k in signals and signals[k].choices
        }
        return all(
            signals[k].named(component.values[k]) == v for k, v in choices.items()
        )

    return laws[0] if len(laws) == 1 else next(filter(chosen, laws), None)


def managers() -> list[str]:
    """Return the sorted names of the project's managers."""
    return [name for name in names() if issubclass(block_class(name), Manager)]


def fitting(
    case: Case,
    terms: Terms,
    names: Sequence[str] = (ALL,),
    others: Sequence[str] = (),
) -> tuple[list[Fitting], list[Refused]]:
    """Find the laws that fit the craft of a case, and the managers that do not.

    Parameters
    ----------
    case
        The craft with its own law.
    terms
        Quantities that rules of gains use.
    names
        Laws or managers of the project by name, or all.
    others
        Block files and FMUs of the user's own.

    Returns
    -------
    tuple
        The laws, the craft's own first, and the refused managers with the reason.

    Raises
    ------
    DesatError
        If a name is unknown, or the case has a problem.
    """
    system, _ = case.or_raise()
    manager_flown = system.components[ROLE]
    parameters = _table_of(system, manager_flown, terms)
    laws_fitting = [
        Fitting(law_name(manager_flown), manager_flown.model, True, case, {})
    ]
    some = sorted(
        _laws_of(names),
        key=lambda m: (m != manager_flown.model, m != PLAINEST),
    )
    refused: list[Refused] = []
    for manager in (*some, *others):
        block = _read_block(manager)
        label = (
            manager
            if block is None or is_own(manager)
            else manager.removeprefix("manager_")
        )
        if reason := "" if block is None else _lacks(block, manager, system, terms):
            if manager != manager_flown.model:
                refused.append(Refused(label.replace("_", " "), reason))
            continue
        for law in _laws(block, manager):
            if law.name == laws_fitting[0].name or not _is_asked(
                law, manager, names, others
            ):
                continue
            try:
                laws_fitting.append(_fit(case, manager_flown, manager, law, parameters))
            except DesatError as error:
                refused.append(Refused(law.name, str(error).splitlines()[0]))
    return laws_fitting, refused


def check_names(names: Sequence[str], others: Sequence[str] = ()) -> None:
    """Check the names of laws, managers and files before anything flies.

    Parameters
    ----------
    names
        Laws or managers of the project by name, or all.
    others
        Block files and FMUs of the user's own.

    Raises
    ------
    DesatError
        If there is no law, manager or file of a name, or if a file declares laws that
        cannot be read.
    """
    _laws_of(names)
    for manager in others:
        if Path(manager).suffix not in (".py", ".fmu"):
            raise DesatError(f"{manager}: a law of your own is a .py or an .fmu file")
        if not Path(manager).is_file():
            raise DesatError(f"--law {manager}: No such file or directory")
        _laws(_read_block(manager), manager)


def _laws_of(names: Sequence[str]) -> list[str]:
    """Return the managers that laws or managers name."""
    every = managers()
    by_law = {law.name: m for m in every for law in _laws(block_class(m), m)}
    law_names = (
        by_law | {m: m for m in every} | {m.removeprefix("manager_"): m for m in every}
    )
    for name in names:
        if name not in law_names and name != ALL:
            close = nearest(name, law_names).partition("; there is ")[0]
            laws = ", ".join(sorted(by_law))
            raise DesatError(f"{name}: no law and no manager{close}; there is {laws}")
    return (
        every
        if ALL in names
        else list(dict.fromkeys(law_names[name] for name in names))
    )


def _is_asked(
    law: Law, manager: str, requested: Sequence[str], others: Sequence[str]
) -> bool:
    """Return whether a law is among those that were named."""
    names = (law.name, manager, manager.removeprefix("manager_"), ALL)
    return manager in others or any(n in requested for n in names)


def _block(manager: str) -> type[Block] | None:
    """Return the block of a manager, or None for an FMU."""
    return None if manager.endswith(".fmu") else block_class(manager)


def _read_block(manager: str) -> type[Block] | None:
    """Return the block of a manager, or raise DesatError for an unsuitable file."""
    try:
        return _block(manager)
    except OwnBlockError as error:
        raise DesatError(str(error)) from error


def _laws(block: type[Block] | None, manager: str) -> tuple[Law, ...]:
    """Return the laws of a manager.

    One that is not of the project and declares none has a single law with its own
    values.
    """
    declared = block.offers if block is not None and issubclass(block, Manager) else ()
    ours = manager in names()
    if block is not None and not ours:
        _check_offers(declared, block, Path(manager).name)
    return declared or (() if ours else (Law(Path(manager).stem.replace("_", " ")),))


def _check_offers(declared: Any, block: type[Block], place: str) -> None:
    """Raise DesatError for laws that a file declares in another form than `Law` has."""
    if isinstance(declared, Law) or not isinstance(declared, (tuple, list)):
        raise DesatError(
            f'{place}: offers: a tuple is needed, as offers = (Law("my law"),)'
        )
    parameters = {v.name for v in block.variables if v.causality == "parameter"}
    for law in declared:
        if not isinstance(law, Law) or not isinstance(law.name, str) or not law.name:
            raise DesatError(
                f'{place}: offers: {law!r} is no law with a name, as Law("my law")'
            )
        _check_offer(law, parameters, f"{place}: offers: Law {law.name}")


def _check_offer(law: Law, parameters: Collection[str], place: str) -> None:
    """Raise DesatError where gains, units or rate of a law are not those of a block."""
    for field, values in (("gains", law.gains), ("units", law.units)):
        if not isinstance(values, Mapping):
            raise DesatError(
                f'{place}: {field}: a dict is needed, as {{"gain": "craft.rate"}}'
            )
        for key in values:
            if key not in parameters:
                raise DesatError(
                    f"{place}: {field}: no parameter {key}"
                    f"{nearest(str(key), parameters)}"
                )
    for key, rule in law.gains.items():
        if not _is_rule(rule):
            raise DesatError(
                f"{place}: gains: {key} is {rule!r}; a finite number, true or false, a choice by "
                "its name, or a product of numbers and component.parameter is needed"
            )
    if law.rate and law.rate not in law.gains:
        raise DesatError(f"{place}: rate: {law.rate!r} is none of its gains")


def _is_rule(rule: Any) -> bool:
    """Return whether a gain of a law is a text, true or false, or a finite number."""
    if isinstance(rule, (int, float)):
        return isfinite(rule)
    return isinstance(rule, str)


def _lacks(block: type[Block], manager: str, system: System, terms: Terms) -> str:
    """Return why a manager is of no use to a craft, or ""."""
    if not issubclass(block, Manager):
        return f"{manager} is no manager"
    if block.no_law:
        return block.no_law
    for need in needs_of(block):
        if has := _instead(need, system, terms):
            return f"it needs {need.value}; {has}"
    return ""


def _instead(need: Need, system: System, terms: Terms) -> str:
    """Return what a craft has instead of a need, or "" where it meets it."""
    if need is Need.DESIGN:
        return "those of this craft are for its own law alone"
    if need is Need.INERTIAL:
        return "" if terms.inertial else "the craft turns"
    return instead(need, system, ROLE)


def _table_of(system: System, manager: Component, terms: Terms) -> dict[str, Any]:
    """Return a system's parameters; `craft` has the terms of rules."""
    parameters: dict[str, Any] = dict(system.parameters)
    law = _law_of(manager) if manager.block is not None else None
    noise = noise_of(system)

    def with_rate(rate: float) -> dict[str, Any]:
        """Return the table for a law rate (1/s)."""
        return parameters | {
            "craft": {
                "rate": Parameter(rate, "1/s"),
                "field": Parameter(terms.field, "T"),
                "orbit_rate": Parameter(terms.orbit_rate, "rad/s"),
                **{name: Parameter(noise[name], unit) for name, unit in KNOWN.items()},
            }
        }

    rate = BANDWIDTH * terms.orbit_rate
    if law is not None and law.rate:
        unit = product(str(law.gains[law.rate]), with_rate(1.0))[0]
        rate = float(str(manager.values[law.rate])) / unit or rate
    return with_rate(rate)


def _fit(
    case: Case,
    own_manager: Component,
    manager: str,
    law: Law,
    parameters: Mapping[str, Any],
) -> Fitting:
    """Prepare a law of a manager with its gains.

    Raises DesatError where the craft cannot fly it.
    """
    placed, component = case.options, own_manager
    if manager != own_manager.model:
        placed = replace(placed, sources=[*placed.sources, f"{ROLE}={manager}"])
        component = resolved(case.scenario, placed)[0].components[ROLE]
    values: dict[str, Any] = {}
    gain_texts: dict[str, str] = {}
    for key, value, rule in _gains(component, own_manager, law, parameters):
        values[f"{ROLE}.{key}"] = value
        gain_texts[key] = rule
    fitted = replace(placed, values={**placed.values, **values})
    fitted_case = prepare(case.scenario, fitted)
    fitted_case.or_raise()
    return Fitting(law.name, manager, False, fitted_case, gain_texts)


def _gains(
    component: Component, manager: Component, law: Law, parameters: Mapping[str, Any]
) -> Iterator[tuple[str, Any, str]]:
    """Yield parameter, value and rule of all that a law takes from the craft."""
    signals = component.interface.signals
    for key, rule in law.gains.items():
        elements = component.interface.elements.get(key, ())
        if isinstance(rule, bool) or rule in elements[0].choices:
            yield key, rule, str(rule)
            continue
        number, unit = product(str(rule), parameters)  # a plain number is its own value
        number *= unit.factor
        gain_unit = law.units.get(key, elements[0].unit_name)
        text = f"{rule} = {number:.4g} {gain_unit}".removesuffix(" 1")
        yield key, number if key in signals else [number] * len(elements), text
    if component.model != manager.model:
        follows = {
            s.array: s.follows
            for s in component.interface.parameters
            if s.follows and s.array not in law.gains
        }
        for key, text in follows.items():
            try:
                values = list(values_of(component, key, text, parameters).values())
            except DesatError:
                continue  # the craft does not have that parameter
            yield key, values[0] if key in signals else values, text
    if "sample_time" in signals and not component.values["sample_time"]:
        coils = parameters.get("torquers", {}).get("sample_time")
        sample = float(coils.value) if coils is not None and coils.value else SAMPLE
        yield "sample_time", sample, f"{sample:g} s"


def terms_of(period: float, b: Any, inertial: bool) -> Terms:
    """Return the terms of a flight of this period (s) in a field b (rows, 3) T."""
    return Terms(2.0 * pi / period, float(np.linalg.norm(b, axis=1).mean()), inertial)
