"""Make the layers of a scenario and of a command's options (`system/layer.py`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..system.errors import DesatError
from ..system.layer import SHARED, Layer, Place, Value
from ..system.model import J2000, Fmu, Values
from ..system.options import Options
from ..system.parameters import parse_assignment
from . import craft, library, own, paths, ssp
from .io import TomlTable
from .merge import Keys

if TYPE_CHECKING:
    from ..language.content import Content

Origin = Callable[
    [Keys], tuple[str, str]
]  # path of a value -> file and key that give it


def of_craft(content: Content, folder: Path, place: str, origin: Origin) -> Layer:
    """Read the craft file or SSD of a scenario.

    Parameters
    ----------
    content
        The content of the scenario.
    folder
        The folder of craft, SSD and FMUs.
    place
        The scenario's file, for messages.
    origin
        Function that returns file and key of a value of the scenario.

    Raises
    ------
    DesatError
        If there is none, or something is wrong with it.
    """
    if content.ssd:
        if content.craft:
            raise DesatError(
                f"{place}: craft and ssd: only one of them can say what is wired"
            )
        return ssp.read(_named_file(folder, content.ssd, "ssd", origin))
    if content.craft:
        return craft.read(_named_file(folder, content.craft, "craft", origin))
    for name, read in ((craft.FILE, craft.read), (ssp.FILE, ssp.read)):
        if (folder / name).exists():
            return read(folder / name)
    raise DesatError(
        f"{place}: nothing says what is wired: extends, craft or ssd is needed, or {craft.FILE} or "
        f"{ssp.FILE} in {paths.shown(folder)}"
    )


def _named_file(folder: Path, name: str, key: str, origin: Origin) -> Path:
    """Return the file that a scenario names. Raises DesatError if it is missing."""
    file = folder / name
    if not file.exists():
        at = ": ".join(origin((key,)))
        raise DesatError(f"{at} = {name!r}: no such file in {paths.shown(folder)}")
    return file


def of_scenario(
    name: str,
    content: Content,
    parameters: TomlTable,
    folder: Path,
    place: str,
    origin: Origin,
) -> Layer:
    """Make the layer of a scenario above that of its craft.

    Parameters
    ----------
    name
        The scenario's name.
    parameters
        A table for each component: those of the scenario, merged over those of its
        design.
    content, folder, place, origin
        As for `of_craft`.
    """
    layer = Layer(
        place,
        name=name,
        about=content,
        start=content.start,
        stop=content.stop,
        step=content.step,
        substeps=content.substeps or None,
        accuracy=content.accuracy or None,
        output_classes=dict(content.output_classes),
        step_ratios=dict(content.step_ratio),
    )

    def at(*key: str) -> str:
        return ": ".join(origin(key))

    for key in ("start", "stop", "step"):
        if getattr(content, key) is not None:
            layer.origins[key] = at(key)
    for output in content.output_classes:
        layer.origins[output] = at("output_classes", output)
    for component, source in content.sources.items():
        layer.places.append(_place(component, source, folder, at("sources", component)))
    for variable, value in content.shared.items():
        by = at("shared", variable)
        layer.values.append(Value(SHARED, variable, value, by, by))
    if content.epoch is not None:
        seconds = (content.epoch - J2000).total_seconds()
        value_of_epoch = Value(SHARED, "epoch_j2000", seconds, at("epoch"), place)
        layer.values.append(value_of_epoch)
    for component, values in parameters.items():
        for variable, value in values.items():
            file, path = origin(("parameters", component, variable))
            layer.values.append(
                Value(component, variable, value, f"{file}: {path}", file)
            )
    return layer


def _place(component: str, source: str, folder: Path, origin: str) -> Place:
    """Return the place of an FMU: a file, or one of ours by its name."""
    ours = "/" not in source and not source.endswith(".fmu")
    file = f"resources/{source}.fmu" if ours else source
    fmu = library.find(file, folder)
    if ours and fmu is None:
        fmu = library.of_ours(file)
    return Place(component, file, fmu, origin=origin, label=file.rpartition("/")[2])


def of_options(
    options: Options,
    sampled: Mapping[str, str] | None = None,
    designed: Mapping[str, Values] | None = None,
) -> Layer:
    """Make the layer of a command's options.

    Parameters
    ----------
    options
        Times, replacing FMUs and values.
    sampled
        File and key of the dispersion of each value that is sampled. A sampled value
        that does not fit is a problem of its sample; any other value raises an error.
    designed
        Parameters of a design that the options select, a table for each component,
        below those of the options.

    Raises
    ------
    DesatError
        If an option has another form, or gives a value twice.
    """
    layer = Layer(
        "--set",
        of_options=True,
        step=options.step,
        stop=float(options.stop) if isinstance(options.stop, float | int) else None,
        substeps=options.substeps,
        accuracy=options.accuracy,
        output_classes=dict(options.output_classes),
    )
    for key in ("stop", "step"):
        if (time := getattr(layer, key)) is not None:
            layer.origins[key] = f"--{key} {time:g}"
    for output, of in options.output_classes.items():
        layer.origins[output] = f"--output-class {output}={of}"
    layer.places = [_replacement(text, options, layer) for text in options.sources]
    layer.values = [*_designed_values(designed or {}), *_values(options, sampled or {})]
    return layer


def _designed_values(parameters: Mapping[str, Values]) -> Iterator[Value]:
    """Yield the values of a design."""
    for component, values in parameters.items():
        for variable, value in values.items():
            origin = f"--design: {component}.{variable}"
            yield Value(component, variable, value, origin, origin, raises=True)


def _values(options: Options, sampled: Mapping[str, str]) -> Iterator[Value]:
    """Yield the values of the options."""
    names_given = set()
    for text in options.sets:
        name, variable, value = parse_assignment(text)
        if (name, variable) in names_given:
            raise DesatError(f"--set {text}: {name}.{variable} is given twice")
        names_given.add((name, variable))
        origin = f"--set {text}"
        typed = text.partition("=")[2].strip()
        yield Value(name, variable, value, origin, origin, name != SHARED, typed)
    for key, value in options.values.items():
        name, _, variable = key.partition(".")
        origin = sampled.get(key, key)
        raises = name != SHARED and key not in sampled
        prefix = origin if name == SHARED else sampled.get(key, "")
        yield Value(name, variable, value, origin, prefix, raises)


def _replacement(text: str, options: Options, layer: Layer) -> Place:
    """Return the place of an FMU that replaces another.

    It is an FMU file, a block of ours or a user's own block file.
    """
    name, _, source = text.partition("=")
    if not source:
        raise DesatError(f"--source {text}: the form is COMPONENT=FMU")
    file = Path(source)
    fmu: Fmu | None
    in_archive = source if file.suffix == ".fmu" else f"resources/{source}.fmu"
    if own.is_own(source):
        if options.blocks:
            raise DesatError(
                f"--source {text}: --blocks runs our blocks, not a file of your own"
            )
        built = own.build(file)
        if built.reason and options.fmus == "native":
            layer.warnings.append(f"{name}: {file.name} runs as Python: {built.reason}")
        in_archive = f"resources/{file.stem}.fmu"
        fmu = library.load(built.native or built.python)
    else:
        fmu = library.load(file) if file.is_file() else library.of_ours(in_archive)
    return Place(name, in_archive, fmu, origin=f"--source {text}", label=source)
