"""Scenarios: TOML files in ssp/FAMILY/scenarios/, each one scenario or, with axes, a table of them.

    extends = "common"            # another file of the folder, or several, merged below this one
    without = ["parameters.manager"]  # what of those is left out
    title = "…"                   # and story: two sentences for a reader
    craft = "craft.toml"          # in ssp/FAMILY/: the spacecraft, see files/craft.py; or
    ssd = "SystemStructure.ssd"   # its wiring kept by hand; without either, what is there
    step, stop, start             # seconds
    epoch = 2026-01-01T00:00:00Z  # UTC of t = 0, for every component with an epoch_j2000
    [sources]                     # manager = "manager_other": another FMU for a component
    [shared]                      # a parameter for every component that has it
    [parameters.manager]          # parameters (or unconnected inputs) of one component
    [design]                      # parameters below these that `desat design` computes: designs/
    [output_classes]              # "component.output" = "state" | "interval"
    [decimation]                  # manager = 10: steps once in 10 steps of the master
    [dispersions]                 # "component.parameter" = how `desat draws` draws it
    draws = 20                    # its numbers in the tables are medians of so many draws
    twin = "NAME"                 # a scenario that the report shows beside this one
    [numbers.NAME], [[plots]]     # what the report shows
    [[paper]]                     # a paper's values for the numbers
    [axes.method.crcp]            # each axis' values are partial scenarios (`without` included);
    [axes.case.ilqr-1]            # the product of the axes gives scenarios FILE-crcp-ilqr-1

`{method}` in a text stands for the axis' value of the cell, in title and story for its label.
"""

from __future__ import annotations

import itertools
import tomllib
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..system.errors import DesatError, nearest
from . import places

if TYPE_CHECKING:  # what a list of scenarios does without, and loads slowly
    from ..system.model import System

ROOT = places.SCENARIOS

KEYS = {
    "extends", "abstract", "title", "story", "craft", "ssd", "step", "stop", "start", "sources",
    "shared", "parameters", "output_classes", "decimation", "dispersions", "twin", "numbers",
    "plots", "paper", "axes", "labels", "source", "epoch", "design", "draws",
}  # fmt: skip


@dataclass(frozen=True)
class Scenario:
    """One scenario: its name `family/name`, its file, and its merged data."""

    name: str
    file: Path
    data: dict[str, Any]
    cell: dict[str, str]
    """The value of each axis, where the file has axes."""
    folder: Path
    """Where its SSD and FMUs of its own are looked for."""

    @property
    def family(self) -> str:
        """The folder of ssp/ that it belongs to."""
        return self.name.partition("/")[0]

    @property
    def twin(self) -> str | None:
        """The full name of its twin."""
        twin = self.data.get("twin")
        return f"{self.family}/{twin}" if twin and f"{self.family}/{twin}" != self.name else None

    @property
    def packed(self) -> Path:
        """Where `desat pack` puts its .ssp."""
        return places.packed() / f"{self.name}.ssp"

    @property
    def design(self) -> Path | None:
        """The file with its design, where it has a [design]; `of` names the scenario that has it
        made."""
        if "design" not in self.data:
            return None
        name = self.data["design"].get("of", self.name.partition("/")[2])
        return ROOT / self.family / "design" / f"{name}.toml"

    def parameters(self, designed: bool = True) -> dict[str, Any]:
        """Its [parameters], with those of its design below. Raises DesatError where it has none."""
        merged: dict[str, Any] = {}
        if designed and self.design is not None:
            if not self.design.exists():
                name = f"{self.family}/{self.design.stem}"
                raise DesatError(f"{self.name} has no design yet; run `desat design {name}`")
            merged = _copy(read_toml(self.design)["parameters"])
        _merge(merged, self.data.get("parameters", {}))
        return merged

    def system(self, blocks: bool = False, designed: bool = True) -> tuple[System, list[str]]:
        """The system that it describes and what is wrong with it so far (schema, missing FMUs,
        parameters); `designed` False leaves its design out."""
        from ..system.parameters import assign
        from ..system.replace import drop_unwanted
        from . import library

        folder = self.folder
        where = places.shown(self.file)
        system, problems = self._wired(folder, where)
        system.name = self.name
        for key in ("start", "stop", "step"):
            if key in self.data:
                setattr(system, key, float(self.data[key]))
        system.output_classes.update(self.data.get("output_classes", {}))
        system.about = self.about()
        for name, source in self.data.get("sources", {}).items():
            component = _component(system, name, f"{where}: sources")
            ours = "/" not in source and not source.endswith(".fmu")
            component.source = f"resources/{source}.fmu" if ours else source
            component.fmu = library.find(component.source, folder)
            if ours and component.fmu is None:
                component.fmu = library.built(component.source)
        for name, decimation in self.data.get("decimation", {}).items():
            _component(system, name, f"{where}: decimation").decimation = int(decimation)
        problems += library.load_interfaces(system, blocks)
        for name in self.data.get("sources", {}):
            drop_unwanted(system, system.components[name])
        shared = dict(self.data.get("shared", {}))
        if "epoch" in self.data:
            shared["epoch_j2000"] = _epoch(self.data["epoch"], where)
        problems += set_shared(system, shared, where)
        for name, values in self.parameters(designed).items():
            component = _component(system, name, f"{where}: parameters")
            for parameter, value in values.items():
                if component.interface is None:
                    continue
                try:
                    assign(component, parameter, value, f"{where}: {name}")
                except DesatError as error:
                    problems.append(str(error))
        return system, problems

    def _wired(self, folder: Path, where: str) -> tuple[System, list[str]]:
        """The system of its craft file or SSD, and the problems of that."""
        from . import craft, ssp

        file = folder / self.data.get("craft", craft.FILE)
        if "ssd" in self.data:
            if "craft" in self.data:
                raise DesatError(f"{where}: craft and ssd: only one of them can say what is wired")
            return ssp.read(folder / self.data["ssd"])
        if "craft" in self.data or file.exists():
            return craft.read(file), []
        return ssp.read(folder / ssp.FILE)

    def about(self) -> dict[str, Any]:
        """What travels with a packed system: story, numbers, plots and the like."""
        keys = ("title", "story", "source", "twin", "numbers", "plots", "output_classes",
                "labels", "dispersions")  # fmt: skip
        about = {k: self.data[k] for k in keys if k in self.data}
        return {"name": self.name, **about, "cell": self.cell}


def _epoch(value: Any, where: str) -> float:
    """Seconds from 2000-01-01T12:00:00 UTC to a TOML date-time."""
    if not isinstance(value, datetime) or value.tzinfo is None:
        raise DesatError(f"{where}: epoch = {value}: a UTC time is needed, 2026-01-01T00:00:00Z")
    return (value - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds()


def _component(system: System, name: str, where: str) -> Any:
    if name not in system.components:
        raise DesatError(f"{where}: no component {name}{nearest(name, system.components)}")
    return system.components[name]


def set_shared(system: System, shared: dict[str, Any], where: str) -> list[str]:
    """Give parameters to every component that has them; return what is wrong with that."""
    from ..system.interface import base_name
    from ..system.parameters import assign

    problems = []
    for name, value in shared.items():
        owners = [
            c for c in system.components.values() if c.interface and c.interface.elements(name)
        ]
        if not owners:
            known = {
                base_name(s.name)
                for c in system.components.values() if c.interface
                for s in c.interface.of("parameter")
            }  # fmt: skip
            hint = nearest(name, known)
            problems.append(f"{where}: shared: no component has a parameter {name}{hint}")
        for component in owners:
            try:
                assign(component, name, value, f"{where}: {component.name}")
            except DesatError as error:
                problems.append(str(error))
    return problems


# --- finding ----------------------------------------------------------------------------------


@cache
def families() -> tuple[str, ...]:
    """The folders of ssp/ that hold scenarios."""
    return tuple(sorted(p.parent.name for p in ROOT.glob("*/scenarios")))


def summary(family: str) -> str:
    """What a family of scenarios is about, in a line; empty where its folder does not say."""
    file = ROOT / family / "family.toml"
    return str(read_toml(file).get("title", "")) if file.exists() else ""


@cache
def scenarios(family: str | None = None) -> dict[str, Scenario]:
    """All scenarios by name, or those of one family. Raises DesatError for a bad file."""
    if family is not None and family not in families():
        raise DesatError(f"no family {family}{nearest(family, families())}")
    found: dict[str, Scenario] = {}
    for name in (family,) if family else families():
        for file in sorted((ROOT / name / "scenarios").glob("*.toml")):
            for scenario in _read(file, name):
                found[scenario.name] = scenario
    return found


def craft_files(names: list[str]) -> list[Path]:
    """The craft files of some families, or of all, and those given by their path. Raises
    DesatError for an unknown family."""
    from . import craft

    files: list[Path] = []
    for name in names or families():
        if name.endswith(".toml"):
            files.append(Path(name))
        elif name in families():
            files += craft.files(ROOT / name)
        else:
            raise DesatError(f"no family {name}{nearest(name, families())}")
    return files


def find(name: str) -> Scenario:
    """The scenario of a name. Raises DesatError with the nearest name."""
    family = name.partition("/")[0]
    known = scenarios(family) if family in families() else scenarios()
    if name not in known:
        raise DesatError(f"no scenario {name}{nearest(name, known)}")
    return known[name]


def own(file: Path) -> Scenario:
    """The scenario of a file that is not one of ours. `extends` names files beside it, or ours as
    FAMILY/NAME; its SSD is beside it, else that of the family that it extends.

    Raises DesatError, which names the file, for what is wrong with it.
    """
    where = places.shown(file)
    made = _read(file, "")
    if len(made) != 1:
        what = "is abstract" if not made else f"has axes, and so is {len(made)} scenarios"
        raise DesatError(f"{where}: it {what}; one scenario is needed")
    (scenario,) = made
    family = scenario.data.pop("family", "")
    beside = (file.parent / scenario.data.get("ssd", "SystemStructure.ssd")).is_file()
    return replace(
        scenario,
        name=f"{family}/{file.stem}" if family else file.stem,
        folder=file.parent if beside or not family else ROOT / family,
    )


def _base(name: str, file: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    """What a file extends: a file beside it or, for one that is not ours, FAMILY/NAME of ours."""
    if "/" not in name or file.is_relative_to(ROOT):
        return _load(file.with_name(f"{name}.toml"), seen)
    where = f"{places.shown(file)}: extends"
    family, _, stem = name.partition("/")
    if family not in families():
        raise DesatError(f"{where}: no family {family}{nearest(family, families())}")
    if name in scenarios(family):
        data = _copy(scenarios(family)[name].data)
    elif (ROOT / family / "scenarios" / f"{stem}.toml").is_file():
        data = _load(ROOT / family / "scenarios" / f"{stem}.toml", seen)
    else:
        raise DesatError(f"{where}: no scenario {name}{nearest(name, scenarios(family))}")
    if "design" in data:  # it stays that of the scenario that it was made for
        data["design"].setdefault("of", stem)
    return {**data, "family": family}


def _read(file: Path, family: str) -> list[Scenario]:
    data = _load(file)
    if data.get("abstract"):
        return []
    axes: dict[str, dict[str, Any]] = data.pop("axes", {})
    cells = []
    for values in itertools.product(*(axis.items() for axis in axes.values())):
        cell = dict(zip(axes, (key for key, _ in values), strict=True))
        merged = _copy(data)
        for _, partial in values:
            partial = dict(partial)
            _leave_out(merged, partial, places.shown(file))
            _merge(merged, partial)
        merged["labels"] = {
            axis: axes[axis][value].get("label", value) for axis, value in cell.items()
        }
        merged.pop("label", None)
        name = "-".join([file.stem, *cell.values()])
        _known_keys(merged, file)
        texts = {k: _fill(merged[k], merged["labels"]) for k in ("title", "story") if k in merged}
        whole = _fill(merged, cell) | texts
        cells.append(Scenario(f"{family}/{name}", file, whole, cell, ROOT / family))
    return cells


def read_toml(file: Path) -> dict[str, Any]:
    """What a TOML file holds, the caller's at the top level only. Raises DesatError where there is
    none or it cannot be read."""
    where = places.shown(file)
    try:
        stat = file.stat()
        return dict(_parsed(file, stat.st_mtime_ns, stat.st_size))
    except FileNotFoundError as error:
        raise DesatError(f"{where}: no such file") from error
    except tomllib.TOMLDecodeError as error:
        raise DesatError(f"{where}: {error}") from error
    except UnicodeDecodeError as error:
        raise DesatError(f"{where}: byte {error.start} is not UTF-8") from error


@cache
def _parsed(file: Path, time: int, size: int) -> dict[str, Any]:
    """Bases are read once for all that extend them."""
    return tomllib.loads(file.read_text(encoding="utf-8"))


def _copy(value: Any) -> Any:
    """A copy of what a TOML file has; ten times faster than `deepcopy`."""
    if isinstance(value, dict):
        return {k: _copy(v) for k, v in value.items()}
    return [_copy(v) for v in value] if isinstance(value, list) else value


def _load(file: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    where = places.shown(file)
    data = read_toml(file)
    bases = data.pop("extends", [])
    if file in seen:
        raise DesatError(f"{where}: extends itself")
    merged: dict[str, Any] = {}
    for base in [bases] if isinstance(bases, str) else bases:
        below = _base(base, file, (*seen, file))
        if merged:
            _merge(merged, below)
        else:
            merged = below
    merged.pop("abstract", None)
    _leave_out(merged, data, where)
    _merge(merged, data)
    return merged


def _leave_out(merged: dict[str, Any], data: dict[str, Any], where: str) -> None:
    """Take out of `merged` what data's `without` names, and `without` out of data."""
    for path in data.pop("without", []):
        *tables, key = path.split(".")
        owner: Any = merged
        for table in tables:
            owner = owner.get(table, {})
        if key not in owner:
            raise DesatError(f"{where}: without {path}: there is none before")
        del owner[key]


def _known_keys(data: dict[str, Any], file: Path) -> None:
    for key in data:
        if key not in KEYS and (key != "family" or file.is_relative_to(ROOT)):
            raise DesatError(f"{places.shown(file)}: unknown key {key}{nearest(key, KEYS)}")


def _merge(into: dict[str, Any], new: dict[str, Any]) -> None:
    """Tables are merged, everything else is replaced."""
    for key, value in new.items():
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = _copy(value)


def _fill(value: Any, cell: dict[str, str]) -> Any:
    """Texts with `{axis}` replaced by the axis' value of the cell."""
    if not cell:
        return value
    if isinstance(value, str):
        for axis, name in cell.items():
            value = value.replace(f"{{{axis}}}", name)
        return value
    if isinstance(value, dict):
        return {k: _fill(v, cell) for k, v in value.items()}
    if isinstance(value, list):
        return [_fill(v, cell) for v in value]
    return value
