"""Build the system of a scenario: that of its craft or SSP file, with values in order.

The values of a design and of the scenario replace those of the craft, those of the
options replace both. FMUs are replaced before the values of the same source are given.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from ..language.content import content_of, dispersions_of
from ..system.errors import DesatError, require
from ..system.interface import base_name
from ..system.model import J2000, Fmu, Values
from ..system.options import Options
from ..system.parameters import OPTIONS, parse_assignment, target_of, with_date
from . import craft, library, own, paths, ssp
from .draft import SHARED, Assignment, Draft
from .replacement import adopt_shared, replace_fmu
from .scenario import Scenario


def build(
    scenario: Scenario,
    options: Options,
    designed: Mapping[str, Values] | None = None,
) -> Draft:
    """Build the draft of a scenario's system with the options.

    Parameters
    ----------
    scenario
        The scenario, which may be that of an SSP file.
    options
        Times, replacing FMUs, values, and what components run as.
    designed
        Parameters of a design that the options select, a table for each component, in
        place of the scenario's own design; None: the own design counts.

    Raises
    ------
    DesatError
        If the system cannot be read; problems of values are in the draft.
    """
    draft = read_wiring(scenario, options)
    if not scenario.is_system_file:
        _add_scenario(draft, scenario, options, designed is None)
    if designed:
        own_values = scenario.parameters(designed=False)
        draft.assign(_design_values(designed, own_values))
    draw_origins = _drawn_origins(draft, scenario, options) if options.values else {}
    _add_options(draft, options, draw_origins)
    if options.fmus != "native":
        draft.components = {
            name: replace(c, fmu=c.fmu and library.of_kind(c.fmu, options.fmus))
            for name, c in draft.components.items()
        }
    return draft


def read_wiring(scenario: Scenario, options: Options) -> Draft:
    """Read the craft file, or the SSP file, of a scenario.

    Raises
    ------
    DesatError
        If there is none, or something is wrong with it.
    """
    if scenario.is_system_file:
        return ssp.read(scenario.file, options)
    content, place = scenario.content, paths.shown(scenario.file)
    if content.ssd and content.craft:
        raise DesatError(
            f"{place}: craft and ssd: only one of them can say what is wired"
        )
    for key, read in (("ssd", ssp.read), ("craft", craft.read)):
        if name := getattr(content, key):
            if not (file := scenario.folder / name).exists():
                folder = paths.shown(scenario.folder)
                raise DesatError(
                    f"{scenario.origin(key)} = {name!r}: no such file in {folder}"
                )
            return read(file, options)
    for name, read in ((craft.FILE, craft.read), (ssp.FILE, ssp.read)):
        if (file := scenario.folder / name).exists():
            return read(file, options)
    raise DesatError(
        f"{place}: nothing says what is wired: extends, craft or ssd is needed, or {craft.FILE} or "
        f"{ssp.FILE} in {paths.shown(scenario.folder)}"
    )


def _add_scenario(
    draft: Draft, scenario: Scenario, options: Options, designed: bool
) -> None:
    """Add times, FMUs and values of a scenario; `designed` those of its design, too."""
    content, at = scenario.content, scenario.origin
    draft.name, draft.about = scenario.name, content
    draft.substeps = content.substeps or draft.substeps
    draft.accuracy = content.accuracy or draft.accuracy
    draft.start = draft.start if content.start is None else content.start
    for key in ("start", "stop", "step"):
        if (time := getattr(content, key)) is not None:
            _set_time(draft, key, time, at(key))
    for output, output_class in content.output_classes.items():
        draft.output_classes[output] = output_class
        draft.origins[output] = at("output_classes", output)
    for name, source in content.sources.items():
        is_ours = "/" not in source and not source.endswith(".fmu")
        file = f"resources/{source}.fmu" if is_ours else source
        fmu = library.find(file, scenario.folder)
        if is_ours and draft.sizes:
            file, fmu = draft.of_ours(source)
        elif is_ours and fmu is None:
            fmu = library.of_ours(file)
        label = file.rpartition("/")[2]
        origin = at("sources", name)
        replace_fmu(draft, name, file, fmu, origin, label, options.blocks)
    for name, ratio in content.step_ratio.items():
        require(
            name,
            draft.components,
            f"{paths.shown(scenario.file)}: step_ratio: no component",
        )
        draft.components[name] = replace(draft.components[name], step_ratio=ratio)
    draft.assign(_scenario_values(scenario, designed))
    for name in content.sources:
        adopt_shared(draft, name)


def _set_time(draft: Draft, key: str, time: float, origin: str) -> None:
    """Set start, stop or step (s) of a draft."""
    setattr(draft, key, float(time))
    draft.origins[key] = origin
    draft.guesses.pop(key, None)


def _scenario_values(scenario: Scenario, designed: bool) -> Iterator[Assignment]:
    """Yield the values of a scenario and, with `designed`, of its design below them."""
    content, at = scenario.content, scenario.origin
    for name, value in content.shared.items():
        yield Assignment(SHARED, name, value, at("shared", name))
    if content.epoch is not None:
        seconds = (content.epoch - J2000).total_seconds()
        yield Assignment(SHARED, "epoch_j2000", seconds, at("epoch"))
    for owner, values in scenario.parameters(designed).items():
        for name, value in values.items():
            file, key = scenario.origin_of(("parameters", owner, name))
            yield Assignment(owner, name, value, f"{file}: {key}", subject=file)


def _design_values(
    designed: Mapping[str, Values], own_values: Mapping[str, Values]
) -> Iterator[Assignment]:
    """Yield the values of a design that the options select, but the scenario's own."""
    for owner, values in designed.items():
        for name, value in values.items():
            if name not in own_values.get(owner, {}):
                yield Assignment(owner, name, value, f"--design: {owner}.{name}")


def _drawn_origins(
    draft: Draft, scenario: Scenario, options: Options
) -> dict[str, str]:
    """Return file and key of the dispersion of each drawn value.

    A draw has a value for each dispersion; without that the result is empty.
    """
    spread = dispersions_of(draft)
    if not spread.keys() <= options.values.keys():
        return {}
    dispersions = content_of(draft.about).dispersions
    origins = {}
    for name in spread:
        key = name if name in dispersions else f"*.{name.partition('.')[2]}"
        path = ("dispersions", key)
        place = draft.place, ".".join(path)
        if not scenario.is_system_file:
            place = scenario.origin_of(path)
        origins[name] = ": ".join(place)
    return origins


def _add_options(
    draft: Draft, options: Options, draw_origins: Mapping[str, str]
) -> None:
    """Add times, FMUs and values of the options.

    A drawn value that does not fit is a problem of its draw.

    Raises
    ------
    DesatError
        If an option has another form or a value that does not fit, gives a value
        twice, or gives an input a value that an output feeds.
    """
    draft.substeps = options.substeps or draft.substeps
    draft.accuracy = options.accuracy or draft.accuracy
    for key in ("stop", "step"):
        if isinstance(time := getattr(options, key), float | int):
            _set_time(draft, key, time, f"--{key} {time:g}")
    for output, output_class in options.output_classes.items():
        draft.output_classes[output] = output_class
        draft.origins[output] = f"--output-class {output}={output_class}"
    values = list(_option_values(options, draw_origins))
    replaced = []
    for text in options.sources:
        name, file, fmu, label = _chosen_fmu(text, options, draft)
        names = [assignment.name for assignment in values if assignment.owner == name]
        replace_fmu(
            draft, name, file, fmu, f"--source {text}", label, options.blocks, names
        )
        replaced.append(name)
    for assignment in values:
        _check_open(draft, assignment)
    before = len(draft.problems)
    draft.assign(
        assignment
        for assignment in values
        if assignment.origin not in draw_origins.values()
    )
    if len(draft.problems) > before:
        raise DesatError("\n".join(dict.fromkeys(draft.problems[before:])))
    draft.assign(
        assignment
        for assignment in values
        if assignment.origin in draw_origins.values()
    )
    for name in replaced:
        adopt_shared(draft, name)


def _option_values(
    options: Options, draw_origins: Mapping[str, str]
) -> Iterator[Assignment]:
    """Yield the values of the options; raise DesatError for one that is given twice."""
    names_given = set()
    for text in options.sets:
        owner, name, value = parse_assignment(text)
        if (owner, name) in names_given:
            raise DesatError(f"--set {text}: {owner}.{name} is given twice")
        names_given.add((owner, name))
        typed = text.partition("=")[2].strip()
        yield Assignment(owner, name, value, f"--set {text}", typed)
    for key, value in options.values.items():
        owner, name = target_of(key)
        if owner in OPTIONS and not name:
            raise DesatError(f"sets: {key}: it is an argument: {owner}={value!r}")
        origin, subject = draw_origins.get(key, key), draw_origins.get(key, "")
        yield Assignment(owner, name, with_date(name, value), origin, subject=subject)


def _check_open(draft: Draft, assignment: Assignment) -> None:
    """Raise DesatError if an output feeds the input that a value is for."""
    name = assignment.name
    for c in draft.connections:
        end = c.input if name != base_name(name) else c.input_array
        if c.target == assignment.owner and end == name:
            raise DesatError(
                f"{assignment.origin}: {assignment.owner}.{name}: {c.source}.{c.output} feeds it: it never "
                "has this value"
            )


def _chosen_fmu(
    text: str, options: Options, draft: Draft
) -> tuple[str, str, Fmu | None, str]:
    """Return component, file in an archive, FMU and label of a `--source`.

    The FMU is a file, a block of ours or made from a user's own block file.
    """
    name, _, source = text.partition("=")
    if not source:
        raise DesatError(f"--source {text}: the form is COMPONENT=FMU")
    file = Path(source)
    if not own.is_own(source) and file.suffix != ".fmu" and not file.is_file():
        return name, *draft.of_ours(source), source
    if not own.is_own(source):
        fmu = library.load(file) if file.is_file() else library.of_ours(source)
        return name, source, fmu, source
    if options.blocks:
        raise DesatError(
            f"--source {text}: --blocks runs our blocks, not a file of your own"
        )
    built = own.build(file)
    if built.reason and options.fmus == "native":
        draft.warnings.append(f"{name}: {file.name} runs as Python: {built.reason}")
    own_fmu = library.load(built.native or built.python)
    return name, f"resources/{file.stem}.fmu", own_fmu, source
