"""The system that a scenario describes: its craft or SSD, with other FMUs, values and times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..system.draft import Draft, DraftComponent, adopt_shared, drop_unwanted
from ..system.errors import DesatError
from ..system.interface import Interface, base_name
from ..system.model import J2000
from ..system.options import Options
from ..system.parameters import parse_assignment
from . import craft, library, own, paths, ssp
from .io import TomlTable
from .merge import Keys

if TYPE_CHECKING:
    from ..language.content import Content


def draft(
    content: Content, parameters: TomlTable, folder: Path, where: str, blocks: bool,
    given: Callable[[Keys], tuple[str, str]],
) -> Draft:  # fmt: skip
    """The system of a scenario, with interfaces, and what is wrong with it (schema, missing
    FMUs, parameters). `parameters`: a table a component; `folder`: where craft, SSD and FMUs are;
    `where`: the scenario's file, for messages; `given`: file and key where a value of it was
    given. Raises DesatError for a component that there is not.
    """
    made = _wired(content, folder, where, given)
    for key in ("start", "stop", "step"):
        if (value := getattr(content, key)) is not None:
            setattr(made, key, value)
            made.given[key] = ": ".join(given((key,)))
    made.substeps = content.substeps or made.substeps
    made.accuracy = content.accuracy or made.accuracy
    for output, of in content.output_classes.items():
        made.output_classes[output] = of
        made.given[output] = ": ".join(given(("output_classes", output)))
    _place(made, content.sources, folder, where, given)
    for name, step_ratio in content.step_ratio.items():
        made.component(name, f"{where}: step_ratio").step_ratio = step_ratio
    before = {name: made.components[name].interface for name in content.sources}
    library.load_interfaces(made, blocks)
    for name in content.sources:
        component = made.components[name]
        own = [key for key in _keep_alike(component, before[name])
               if f"parameters.{name}." in component.given.get(key, "")]  # fmt: skip
        if own:
            made.warnings.append(f"{name}: {component.source.rpartition('/')[2]} does not take "
                                 f"{', '.join(own)} of the craft")  # fmt: skip
        drop_unwanted(made, component)
    for name, value in content.shared.items():
        made.share(name, value, *given(("shared", name)))
    if content.epoch is not None:
        made.share("epoch_j2000", (content.epoch - J2000).total_seconds(), *given(("epoch",)))
    for name, values in parameters.items():
        component = made.component(name, f"{where}: parameters")
        for parameter, value in values.items():
            at = given(("parameters", name, parameter))
            made.try_to_assign(component, parameter, value, *at)
    for name in content.sources:
        adopt_shared(made, made.components[name])
    return made


def _wired(
    content: Content, folder: Path, where: str, given: Callable[[Keys], tuple[str, str]]
) -> Draft:  # fmt: skip
    """The system of a scenario's craft file or SSD."""
    if content.ssd:
        if content.craft:
            raise DesatError(f"{where}: craft and ssd: only one of them can say what is wired")
        return ssp.read(_named_file(folder, content.ssd, "ssd", given))
    if content.craft:
        return craft.read(_named_file(folder, content.craft, "craft", given))
    for name, read in ((craft.FILE, craft.read), (ssp.FILE, ssp.read)):
        if (folder / name).exists():
            return read(folder / name)
    raise DesatError(f"{where}: nothing says what is wired: extends, craft or ssd is needed, or "
                     f"{craft.FILE} or {ssp.FILE} in {paths.shown(folder)}")  # fmt: skip


def _named_file(
    folder: Path, name: str, key: str, given: Callable[[Keys], tuple[str, str]]
) -> Path:  # fmt: skip
    """The file that a scenario names. Raises DesatError where it is not there."""
    file = folder / name
    if not file.exists():
        at = ": ".join(given((key,)))
        raise DesatError(f"{at} = {name!r}: no such file in {paths.shown(folder)}")
    return file


def _place(
    made: Draft, sources: dict[str, str], folder: Path, where: str,
    given: Callable[[Keys], tuple[str, str]],
) -> None:  # fmt: skip
    """Put other FMUs in the places of components: files, or ours by their names."""
    for name, source in sources.items():
        component = made.component(name, f"{where}: sources")
        ours = "/" not in source and not source.endswith(".fmu")
        component.source = f"resources/{source}.fmu" if ours else source
        component.placed = ": ".join(given(("sources", name)))
        component.fmu = library.find(component.source, folder)
        if ours and component.fmu is None:
            component.fmu = library.of_ours(component.source)


# --- The options of a run applied to a draft: times, values, other FMUs in components' places ---


def modify(
    draft: Draft, options: Options, designed: Mapping[str, Mapping[str, Any]] | None = None,
    drawn: Mapping[str, str] | None = None,
) -> None:  # fmt: skip
    """Apply options to a draft. `designed`: parameters, a table a component, below those of the
    options; `drawn`: of the values that are drawn, file and key of their dispersion; one that does
    not fit is a problem of the draft. Raises DesatError for what else is unknown or does not fit.
    """
    if isinstance(options.stop, float | int):
        draft.stop, draft.given["stop"] = options.stop, f"--stop {options.stop:g}"
    if options.step is not None:
        draft.step, draft.given["step"] = options.step, f"--step {options.step:g}"
    if options.substeps is not None:
        draft.substeps = options.substeps
    if options.accuracy is not None:
        draft.accuracy = options.accuracy
    for output, of in options.output_classes.items():
        draft.output_classes[output] = of
        draft.given[output] = f"--output-class {output}={of}"
    for text in options.sources:
        _replace(draft, text, options)
    for where, name, variable, value in _assignments(options, designed or {}, drawn or {}):
        if name == "shared" and name not in draft.components:
            draft.share(variable, value, where)
        else:
            component = draft.component(name, where)
            of_program = where == f"{name}.{variable}"
            try:
                if fed := _source_of(draft, name, variable):
                    raise DesatError(f"{where}: {name}.{variable}: {fed} feeds it: it never has "
                                     "this value")  # fmt: skip
                component.assign(variable, value, name if of_program else f"{where}: {name}")
            except DesatError as error:
                if f"{name}.{variable}" not in (drawn or {}):
                    raise
                draft.problems.append(str(error))  # of this draw alone
            component.given[base_name(variable)] = where


def _source_of(draft: Draft, name: str, variable: str) -> str:
    """The output that feeds an input, or some of its elements; none for one that is open."""
    of = str if variable != base_name(variable) else base_name
    feeds = (c for c in draft.connections if c.target == name and of(c.input) == variable)
    return next((f"{c.source}.{c.output}" for c in feeds), "")


def _assignments(
    options: Options, designed: Mapping[str, Mapping[str, Any]], drawn: Mapping[str, str]
) -> Iterator[tuple[str, str, str, Any]]:
    """Who says it, component, variable and value of all that is to be assigned."""
    for name, values in designed.items():
        for variable, value in values.items():
            yield f"--design: {name}.{variable}", name, variable, value
    given = set()
    for text in options.sets:
        name, variable, value = parse_assignment(text)
        if (name, variable) in given:
            raise DesatError(f"--set {text}: {name}.{variable} is given twice")
        given.add((name, variable))
        yield f"--set {text}", name, variable, value
    for key, value in options.values.items():
        name, _, variable = key.partition(".")
        yield drawn.get(key, key), name, variable, value


def _replace(draft: Draft, text: str, options: Options) -> None:
    """Put another FMU in a component's place, with those parameters of the old one that it
    declares alike; what is left out is a warning."""
    name, _, source = text.partition("=")
    if not source:
        raise DesatError(f"--source {text}: the form is COMPONENT=FMU")
    component = draft.component(name, f"--source {text}")
    component.placed = f"--source {text}"
    file = Path(source)
    component.source = source if file.suffix == ".fmu" else f"resources/{source}.fmu"
    if own.is_own(source):
        if options.blocks:
            raise DesatError(f"--source {text}: --blocks runs our blocks, not a file of your own")
        made = own.build(file)
        component.source = f"resources/{file.stem}.fmu"
        component.fmu = library.load(made.native or made.python)
        if made.why and options.fmus == "native":
            draft.warnings.append(f"{name}: {file.name} runs as Python: {made.why}")
    else:
        component.fmu = library.load(file) if file.is_file() else library.of_ours(component.source)
    old = component.interface
    if not library.load_interface(draft, component, options.blocks):
        return
    drop_unwanted(draft, component)
    if lost := _keep_alike(component, old):
        draft.warnings.append(
            f"{name}: {source} does not take {', '.join(lost)} of the FMU that it replaces"
        )
    adopt_shared(draft, component)


def _keep_alike(component: DraftComponent, old: Interface | None) -> list[str]:
    """Take the values away that a component's new interface does not declare as the old one did;
    their names."""
    before = old.signals if old else {}
    now = component.interface.signals if component.interface else {}

    def alike(key: str) -> bool:
        return key in before and key in now and all(
            getattr(before[key], what) == getattr(now[key], what)
            for what in ("causality", "kind", "unit", "choices")
        )  # fmt: skip

    given = component.parameters
    component.parameters = {key: value for key, value in given.items() if alike(key)}
    component.references = {
        name: text for name, text in component.references.items()
        if old is not None and all(alike(s.name) for s in old.elements.get(name, ()))
    }  # fmt: skip
    return list(dict.fromkeys(base_name(k) for k in given if k not in component.parameters))
