"""Scenarios: TOML files in ssp/FAMILY/scenarios/, each one scenario or, with axes, a table of them.

    extends = "common"            # another file of the folder, or several, merged below this one
    without = ["parameters.manager"]  # what of those is left out
    title = "…"                   # and story: two sentences for a reader
    craft = "craft.toml"          # in ssp/FAMILY/: the spacecraft, see files/craft.py; or
    ssd = "SystemStructure.ssd"   # its wiring kept by hand; without either, what is there
    step, stop, start             # seconds
    [stop_when]                   # a condition that ends it before: study/stopping.py
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
    [numbers.NAME], [plots.NAME]  # what the report shows
    [paper.NAME]                  # a paper's values for the numbers
    [axes.method.crcp]            # each axis' values are partial scenarios (`without` included);
    [axes.case.ilqr-1]            # the product of the axes gives scenarios FILE-crcp-ilqr-1

`language.py` declares every key and `desat keys` prints them. `{method}` in a text stands for the
axis' value of the cell, in title and story for its label.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..system.errors import DesatError, nearest
from . import places
from .merge import Origins, copy, fill, leave_out, load, merge, origin, toml

if TYPE_CHECKING:  # what a list of scenarios does without, and loads slowly
    from ..system.model import System

ROOT = places.SCENARIOS


@dataclass(frozen=True)
class Scenario:
    """One scenario: its name `family/name`, its file, and its merged data."""

    name: str
    file: Path
    data: dict[str, Any]
    cell: dict[str, str]
    """The value of each axis, where the file has axes."""
    folder: Path
    """Where its craft file or SSD and FMUs of its own are looked for."""
    origins: Origins = field(default_factory=dict, repr=False, compare=False)
    """Where each value was given: path -> file and cell."""

    def where(self, path: tuple[str, ...]) -> str:
        """File and path of a value, for messages."""
        file, cell = origin(self.origins, path)
        return f"{file or places.shown(self.file)}: {cell}{'.'.join(path)}"

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
            from .refuse import design

            merged = copy(design(self.design)["parameters"])
        merge(merged, self.data.get("parameters", {}), {}, ("", ""))
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
                "labels", "dispersions", "stop_when")  # fmt: skip
        about = {k: self.data[k] for k in keys if k in self.data}
        if "plots" in about:
            about["plots"] = list(about["plots"].values())  # a list keeps its order in JSON
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
    return str(toml(file).get("title", "")) if file.exists() else ""


@cache
def survey(family: str) -> tuple[dict[str, Scenario], dict[str, str]]:
    """The scenarios of a family by name, and what is wrong with its other files by their stem."""
    good: dict[str, Scenario] = {}
    broken: dict[str, str] = {}
    for file in sorted((ROOT / family / "scenarios").glob("*.toml")):
        try:
            good |= {s.name: s for s in _read(file, family)}
        except DesatError as error:
            broken[file.stem] = str(error)
    known = {name.partition("/")[2] for name in good}
    wrong: dict[str, str] = {}
    for scenario in good.values():
        for path, other in _others(scenario.data):
            unread = any(f"{other}-".startswith(f"{stem}-") for stem in broken)
            if other not in known and not unread:
                text = f"{scenario.where(path)}: no scenario {other}{nearest(other, known)}"
                wrong.setdefault(scenario.name, text)
    for name, text in wrong.items():
        broken.setdefault(good.pop(name).file.stem, text)
    return good, broken


def _others(data: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Path and name of the other scenarios that one names."""
    if "twin" in data:
        yield ("twin",), data["twin"]
    for key in {"of", "end_of"} & data.get("design", {}).keys():
        yield ("design", key), data["design"][key]
    for name, number in data.get("numbers", {}).items():
        if "reference" in number:
            yield ("numbers", name, "reference"), number["reference"]


def readable(family: str | None = None) -> tuple[dict[str, Scenario], list[str]]:
    """All scenarios by name, or those of one family, whose files are right; and what is wrong with
    the others, one line each."""
    if family is not None and family not in families():
        raise DesatError(f"no family {family}{nearest(family, families())}")
    good: dict[str, Scenario] = {}
    lines: list[str] = []
    for name in (family,) if family else families():
        scenarios, broken = survey(name)
        good |= scenarios
        lines += [line for text in broken.values() for line in text.splitlines()]
    return good, list(dict.fromkeys(lines))


@cache
def scenarios(family: str | None = None) -> dict[str, Scenario]:
    """All scenarios by name, or those of one family. Raises DesatError for a bad file."""
    good, lines = readable(family)
    if lines:
        raise DesatError("\n".join(lines))
    return good


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
    """The scenario of a name. Raises DesatError with the nearest name, or with what is wrong with
    its file."""
    family, _, rest = name.partition("/")
    known, _ = readable(family if family in families() else None)
    if name in known:
        return known[name]
    broken = survey(family)[1] if family in families() else {}
    for stem, text in broken.items():
        if f"{rest}-".startswith(f"{stem}-"):
            raise DesatError(text)
    raise DesatError(f"no scenario {name}{nearest(name, known)}")


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
    wiring = [scenario.data[k] for k in ("ssd", "craft") if k in scenario.data]
    beside = (file.parent / (wiring or ["SystemStructure.ssd"])[0]).is_file()
    own_craft = not wiring and (file.parent / "craft.toml").is_file()
    ours = "/" in scenario.name and not beside and not own_craft
    return scenario if ours else replace(scenario, folder=file.parent)


def _read(file: Path, family: str) -> list[Scenario]:
    given: Origins = {}
    where = places.shown(file)
    data = load(file, given)
    home = data.pop("family", family)
    abstract = data.pop("abstract", False)
    axes: dict[str, dict[str, Any]] = data.pop("axes", {})
    if empty := [axis for axis, values in axes.items() if not values and not abstract]:
        raise DesatError(f"{where}: axes.{empty[0]}: an axis needs a value")
    cells = []
    for values in itertools.product(*(axis.items() for axis in axes.values())):
        cell = dict(zip(axes, (key for key, _ in values), strict=True))
        merged, origins = copy(data), dict(given)
        for axis, (value, partial) in zip(axes, values, strict=True):
            partial = copy(partial)
            partial.pop("label", None)
            leave_out(merged, partial, origins, where)
            merge(merged, partial, origins, (where, f"axes.{axis}.{value}."))
        labels = {axis: axes[axis][value].get("label", value) for axis, value in cell.items()}
        texts = {k: fill(merged[k], labels) for k in ("title", "story") if k in merged}
        name = "-".join([file.stem, *cell.values()])
        name = f"{home}/{name}" if home else name
        whole = fill(merged, cell) | texts
        scenario = Scenario(name, file, whole, cell, ROOT / home, origins)
        if not abstract:
            _refuse(scenario, axes)
        scenario.data["labels"] = labels
        cells.append(scenario)
    return [] if abstract else cells


def _refuse(scenario: Scenario, axes: dict[str, Any]) -> None:
    """Raise DesatError with what is wrong with the merged data of a scenario."""
    from .refuse import paper_problems, problems

    found = [*problems(scenario.data, part=False)]
    found = found or [*paper_problems(scenario.data, scenario.cell, axes)]
    if found:
        raise DesatError("\n".join(f"{scenario.where(p)}: {text}" for p, text in found))
