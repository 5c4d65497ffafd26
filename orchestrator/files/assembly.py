"""The system that a scenario describes: its craft or SSD, with other FMUs, values and times."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..system.draft import Draft
from ..system.errors import DesatError
from ..system.replace import adopt_shared, drop_unwanted
from . import craft, library, paths, ssp
from .merge import Keys


def draft(
    data: dict[str, Any], parameters: dict[str, Any], folder: Path, where: str, blocks: bool,
    given: Callable[[Keys], tuple[str, str]],
) -> Draft:  # fmt: skip
    """The system of a scenario's data, with interfaces, and what is wrong with it (schema, missing
    FMUs, parameters). `parameters`: a table a component; `folder`: where craft, SSD and FMUs are;
    `where`: the scenario's file, for messages; `given`: file and key where a value of the data was
    given. Raises DesatError for a component that there is not.
    """
    made = _wired(data, folder, where, given)
    for key in ("start", "stop", "step"):
        if key in data:
            setattr(made, key, float(data[key]))
            made.given[key] = ": ".join(given((key,)))
    made.inner = data.get("inner", made.inner)
    made.accuracy = float(data.get("accuracy", made.accuracy))
    for output, of in data.get("output_classes", {}).items():
        made.output_classes[output] = of
        made.given[output] = ": ".join(given(("output_classes", output)))
    _place(made, data.get("sources", {}), folder, where, given)
    for name, decimation in data.get("decimation", {}).items():
        made.component(name, f"{where}: decimation").decimation = int(decimation)
    library.load_interfaces(made, blocks)
    for name in data.get("sources", {}):
        drop_unwanted(made, made.components[name])
    for name, value in data.get("shared", {}).items():
        made.share(name, value, *given(("shared", name)))
    if "epoch" in data:
        made.share("epoch_j2000", _epoch(data["epoch"], where), *given(("epoch",)))
    for name, values in parameters.items():
        component = made.component(name, f"{where}: parameters")
        for parameter, value in values.items():
            at = given(("parameters", name, parameter))
            made.try_to_assign(component, parameter, value, *at)
    for name in data.get("sources", {}):
        adopt_shared(made, made.components[name])
    return made


def _wired(
    data: dict[str, Any], folder: Path, where: str, given: Callable[[Keys], tuple[str, str]]
) -> Draft:  # fmt: skip
    """The system of a scenario's craft file or SSD."""
    if "ssd" in data:
        if "craft" in data:
            raise DesatError(f"{where}: craft and ssd: only one of them can say what is wired")
        return ssp.read(_named(folder, data, "ssd", given))
    if "craft" in data:
        return craft.read(_named(folder, data, "craft", given))
    for name, read in ((craft.FILE, craft.read), (ssp.FILE, ssp.read)):
        if (folder / name).exists():
            return read(folder / name)
    raise DesatError(f"{where}: nothing says what is wired: extends, craft or ssd is needed, or "
                     f"{craft.FILE} or {ssp.FILE} in {paths.shown(folder)}")  # fmt: skip


def _named(
    folder: Path, data: dict[str, Any], key: str, given: Callable[[Keys], tuple[str, str]]
) -> Path:  # fmt: skip
    """The file that a scenario names. Raises DesatError where it is not there."""
    file: Path = folder / data[key]
    if not file.exists():
        at = ": ".join(given((key,)))
        raise DesatError(f"{at} = {data[key]!r}: no such file in {paths.shown(folder)}")
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
            component.fmu = library.built(component.source)


def _epoch(value: Any, where: str) -> float:
    """Seconds from 2000-01-01T12:00:00 UTC to a TOML date-time."""
    if not isinstance(value, datetime) or value.tzinfo is None:
        raise DesatError(f"{where}: epoch = {value}: a UTC time is needed, 2026-01-01T00:00:00Z")
    return (value - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds()
