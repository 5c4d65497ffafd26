"""Read scenarios: TOML files in ssp/FAMILY/scenarios/.

Each file is one scenario or, with axes, a table of them.

`desat help keys` prints the keys of such a file, `language/scenario.py` declares them.
Besides:

    extends = "common"            # another file of the folder, or several, merged below this one
    without = ["parameters.manager"]  # what is left out of those
    [axes.method.crcp]            # each axis' values are partial scenarios (`without` included);
    [axes.case.ilqr-1]            # the product of the axes gives scenarios FILE-crcp-ilqr-1

`{method}` in a text stands for the cell's value of that axis, or for its label in title
and description.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..system.errors import DesatError, nearest, require
from . import paths
from .io import TomlTable, at, toml, utf8_name
from .merge import Origins, copy, fill, leave_out, merge, origin

if TYPE_CHECKING:
    from ..language.content import Content

ROOT = paths.SCENARIOS
# Prefix of the name of a role whose standard numbers and plots a scenario extends.
ROLES = "roles"


@dataclass(frozen=True)
class Scenario:
    """A scenario: its content and its location."""

    content: Content
    file: Path
    folder: Path  # of its craft file or SSD and its own FMUs
    target: str = field(default="", compare=False)  # as it was named
    # whether its file is that of a system (.ssp, .ssd, or a folder with one), which may
    # have the content with it
    is_system_file: bool = False
    # source of each value: path -> file and cell
    origins: Origins = field(default_factory=dict, repr=False, compare=False)

    @property
    def name(self) -> str:
        """Return its name, `family/name`."""
        return self.content.name

    @property
    def cell(self) -> dict[str, str]:
        """Return the value of each axis, if the file has axes."""
        return self.content.cell

    def place(self, path: tuple[str, ...]) -> str:
        """Return file, line and path of a value, for messages."""
        file, key = self.origin_of(path)
        return f"{at(file, key)}: {key}"

    def origin_of(self, path: tuple[str, ...]) -> tuple[str, str]:
        """Return file and key that give a value.

        For a parameter that the scenario itself does not give, it is the design's file.
        """
        value: Any = self.content.written
        for key in path:
            value = value.get(key, {}) if isinstance(value, dict) else {}
        if value == {} and path[0] == "parameters" and self.design is not None:
            return paths.shown(self.design), ".".join(path)
        return _place_of(self.origins, path, paths.shown(self.file))

    def origin(self, *path: str) -> str:
        """Return file and key that give a value, as one text."""
        return ": ".join(self.origin_of(path))

    @property
    def family(self) -> str:
        """Return the folder of ssp/ to which it belongs."""
        return self.name.partition("/")[0]

    @property
    def baseline(self) -> str | None:
        """Return the full name of its baseline; None if it has no other scenario."""
        baseline = f"{self.family}/{self.content.baseline}"
        return baseline if self.content.baseline and baseline != self.name else None

    @property
    def design(self) -> Path | None:
        """Return the file with its design, if it has a [design].

        `of` names the scenario whose design it uses.
        """
        if self.content.design is None:
            return None
        name = self.content.design.of or self.name.partition("/")[2]
        return ROOT / self.family / "design" / f"{name}.toml"

    @property
    def each_draw(self) -> dict[str, Any] | None:
        """Return its [design] if that is computed anew for each draw."""
        design = self.content.design
        return design.written if design and design.each_draw else None

    def parameters(self, designed: bool = True) -> TomlTable:
        """Return its [parameters] merged over those of its design.

        Raises
        ------
        DesatError
            If the design does not exist yet.
        """
        merged: TomlTable = {}
        if designed and self.design is not None:
            if not self.design.exists():
                name = f"{self.family}/{self.design.stem}"
                raise DesatError(
                    f"{self.name} has no design yet; run `desat design {name}`"
                )
            from .reader import design

            merged = copy(design(self.design).parameters)
        merge(merged, self.content.parameters, {}, ("", ""))
        return merged


# --- finding --------------------------------------------------------------------------


@cache
def families() -> tuple[str, ...]:
    """Return the folders of ssp/ that hold scenarios."""
    return tuple(sorted(p.parent.name for p in ROOT.glob("*/scenarios")))


def summary(family: str) -> str:
    """Return the title of a family of scenarios, in a line.

    It is empty if its folder gives none.
    """
    file = ROOT / family / "family.toml"
    return str(toml(file).get("title", "")) if file.exists() else ""


def abbreviations(family: str, text: str) -> str:
    """Spell out a family's abbreviations that occur in a text; empty without any."""
    file = ROOT / family / "family.toml"
    meanings = toml(file).get("abbreviations", {}) if file.exists() else {}
    there = [
        f"{name}: {meaning}"
        for name, meaning in meanings.items()
        if re.search(rf"\b{name}\b", text)
    ]
    return "; ".join(there)


@cache
def cells(file: Path, family: str) -> dict[str, Scenario]:
    """Read the scenarios of a file, by name.

    Raises
    ------
    DesatError
        If there are problems, with a line for each.
    """
    return {s.name: s for s in _read(file, family)}


@cache
def _cell(file: Path, family: str, name: str) -> Scenario | None:
    """Read only the scenario of this name in a file; None if it has none.

    Raises DesatError, with a line for each problem of the scenario.
    """
    return next(iter(_read(file, family, name)), None)


@cache
def survey(family: str) -> tuple[dict[str, Scenario], dict[str, str]]:
    """Read the scenarios of a family by name, and the problems of its other files.

    The problems are returned by the stem of the file.
    """
    good: dict[str, Scenario] = {}
    broken: dict[str, str] = {}
    for file in sorted((ROOT / family / "scenarios").glob("*.toml")):
        try:
            scenarios_found = cells(file, family)
        except DesatError as error:
            broken[file.stem] = str(error)
            continue
        for name in good.keys() & scenarios_found.keys():
            both = f"{paths.shown(good[name].file)} and {paths.shown(file)}"
            broken[file.stem] = (
                f"{both}: both make a scenario {name}; rename a file or a value"
            )
        good |= scenarios_found
    scenario_names = {name.partition("/")[2] for name in good}
    wrong: dict[str, str] = {}
    for scenario in good.values():
        for path, other in _others(scenario.content):
            unread = any(f"{other}-".startswith(f"{stem}-") for stem in broken)
            if other not in scenario_names and not unread:
                text = f"{scenario.place(path)}: no scenario {other}{nearest(other, scenario_names)}"
                wrong.setdefault(scenario.name, text)
    for name, text in wrong.items():
        broken.setdefault(good.pop(name).file.stem, text)
    return good, broken


def of_its_file(name: str) -> Scenario | None:
    """Return the scenario of a name from the one file that has it.

    The result is None if there is none or something is wrong; `survey` reports what.
    """
    family, _, rest = name.partition("/")
    files = (ROOT / family / "scenarios").glob("*.toml") if family in families() else ()
    candidates = [f for f in files if f"{rest}-".startswith(f"{f.stem}-")]
    try:
        found_scenarios = [
            scenario
            for f in candidates
            if (scenario := _cell(f, family, name)) is not None
        ]
    except DesatError:
        return None
    return found_scenarios[0] if len(found_scenarios) == 1 else None


def _others(content: Content) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield path and name of each other scenario that a scenario names."""
    if content.baseline:
        yield ("baseline",), content.baseline
    for key in ("of", "end_of"):
        if name := getattr(content.design, key, ""):
            yield ("design", key), name
    for name, number in content.numbers.items():
        if number.reference:
            yield ("numbers", name, "reference"), number.reference


def readable(family: str | None = None) -> tuple[dict[str, Scenario], list[str]]:
    """Return the scenarios by name whose files are correct, of one family or all.

    Also return what is wrong with the other files, one line each.
    """
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
    """Return the scenarios by name, of one family or all.

    Raises
    ------
    DesatError
        If a file is wrong.
    """
    good, lines = readable(family)
    if lines:
        raise DesatError("\n".join(lines))
    return good


def find(name: str) -> Scenario:
    """Find the scenario of a name.

    Raises
    ------
    DesatError
        If there is none, with the nearest name, or if its file is wrong.
    """
    family, _, rest = name.partition("/")
    if (scenario := of_its_file(name)) is not None and all(
        of_its_file(f"{family}/{other}") for _, other in _others(scenario.content)
    ):
        return scenario
    scenarios_read, _ = readable(family if family in families() else None)
    broken = survey(family)[1] if family in families() else {}
    twice = [
        t
        for t in broken.values()
        if t.partition("both make a scenario ")[2].startswith(name)
    ]
    if name in scenarios_read and not twice:
        return scenarios_read[name]
    for stem, text in broken.items():
        if f"{rest}-".startswith(f"{stem}-"):
            raise DesatError(text)
    if name in families():
        raise DesatError(
            f"{name} is a family of {len(scenarios_read)} scenarios (desat list {name}); one of them is "
            f"needed, as {next(iter(scenarios_read))}"
        )
    hint = (
        "; a name is needed here, no file"
        if name.endswith(".toml")
        else nearest(name, [*scenarios_read, *files_in_current_folder()])
    )
    raise DesatError(f"no scenario {name}{hint}")


def files_in_current_folder() -> list[str]:
    """Find the scenario files and crafts in the current folder."""
    here = Path()
    return [
        *(f.stem for f in here.glob("*.toml")),
        *(f.parent.name for f in here.glob(f"*/{paths.NOMINAL}")),
    ]


def name_of_file(file: Path) -> str:
    """Derive the scenario name of a user's own file.

    Beside a craft file it is the name of the craft, which is its folder's, followed by
    that of the scenario unless it is the nominal one.
    """
    file = file.resolve()
    if not (file.parent / "craft.toml").is_file():
        return utf8_name(file.stem)
    craft = utf8_name(file.parent.name)
    return craft if file.name == paths.NOMINAL else f"{craft}-{utf8_name(file.stem)}"


def read_foreign(file: Path) -> Scenario:
    """Read the scenario of a file that is not one of ours.

    `extends` names files beside it, or ours as FAMILY/NAME. Its SSD is beside it, or
    otherwise that of the family that it extends.

    Raises
    ------
    DesatError
        If something is wrong with it; the message names the file.
    """
    place = paths.shown(file)
    cells_found = _read(file, "")
    if len(cells_found) != 1:
        problem = (
            "is abstract"
            if not cells_found
            else f"has axes, and so is {len(cells_found)} scenarios"
        )
        raise DesatError(f"{place}: it {problem}; one scenario is needed")
    (scenario,) = cells_found
    wiring = scenario.content.ssd or scenario.content.craft
    has_wiring = (file.parent / (wiring or "SystemStructure.ssd")).is_file()
    own_craft = not wiring and (file.parent / "craft.toml").is_file()
    ours = "/" in scenario.name and not has_wiring and not own_craft
    return scenario if ours else replace(scenario, folder=file.parent)


# --- reading --------------------------------------------------------------------------


def load(file: Path, origins: Origins, seen: tuple[Path, ...] = ()) -> TomlTable:
    """Load the data of a file merged over those of its bases.

    Raises
    ------
    DesatError
        If there are problems, with a line for each.
    """
    place = paths.shown(file)
    state = file.stat() if file.is_file() else None
    data = copy(_table(file, place, state and (state.st_mtime_ns, state.st_size)))
    bases = data.pop("extends", [])
    if file in seen:
        chain = " -> ".join(f.stem for f in (*seen[seen.index(file) :], file))
        raise DesatError(f"{place}: extends itself ({chain})")
    from ..language.scenario import OWN_KEYS  # imports pydantic, so only if needed

    merged: TomlTable = {}
    stems = [f.stem for f in file.parent.glob("*.toml")]
    for base in [bases] if isinstance(bases, str) else bases:
        below: Origins = {}
        if base.startswith(f"{ROLES}/"):
            table = load(_of_role(base, place), below, (*seen, file))
        elif "/" in base and not file.is_relative_to(paths.SCENARIOS):
            table = _ours(base, place, below, (*seen, file))
        elif base in stems:
            table = load(file.with_name(f"{base}.toml"), below, (*seen, file))
        else:
            raise DesatError(
                f"{place}: extends: no file {base}.toml{nearest(base, stems)}"
            )
        merge(merged, table, origins, below)
    for name in OWN_KEYS:
        merged.pop(name, None)
    craft = file.parent / data.get("craft", "craft.toml")
    of_files = [bases] if isinstance(bases, str) else bases
    if not any(x in stems for x in of_files) and craft.is_file():
        _add_dispersions(merged, craft, origins)
    leave_out(merged, data, origins, place)
    merge(merged, data, origins, (place, ""))
    return merged


def _add_dispersions(merged: TomlTable, craft: Path, origins: Origins) -> None:
    """Add the dispersions of the craft file."""
    spreads = toml(craft).get("dispersions", {})
    if isinstance(spreads, dict):  # otherwise the craft file's reader says so
        place = (paths.shown(craft), "")
        merge(merged, {"dispersions": spreads}, origins, place)


@lru_cache(maxsize=1024)
def _table(file: Path, place: str, _: object) -> TomlTable:
    """Read and check the data of a file, which must not be changed.

    They are cached, because files share their bases. Raises DesatError, with a line for
    each problem.
    """
    from ..language.scenario import ScenarioFile
    from .reader import WrongError, read

    data = toml(file)
    try:
        read(ScenarioFile, data, part=True)
    except WrongError as wrong:
        problems = [(".".join(path), text) for path, text in wrong.problems]
        lines = [f"{at(place, key)}: {key}: {text}" for key, text in problems]
        raise DesatError("\n".join(lines)) from wrong
    return data


def _of_role(name: str, place: str) -> Path:
    """Find the file with the standard numbers and plots of a role, `roles/manager`."""
    folder = paths.PACKAGE / "templates" / ROLES
    role, role_names = (
        name.partition("/")[2],
        sorted(f.stem for f in folder.glob("*.toml")),
    )
    if role not in role_names:
        raise DesatError(f"{place}: extends: no {name}{nearest(role, role_names)}")
    return folder / f"{role}.toml"


def _ours(name: str, place: str, origins: Origins, seen: tuple[Path, ...]) -> TomlTable:
    """Load what a file that is not one of ours extends as FAMILY/NAME.

    It is a scenario, or a file of the family. The `family` of the result names the
    family.
    """
    family, _, stem = name.partition("/")
    require(family, families(), f"{place}: extends: no family")
    file = paths.SCENARIOS / family / "scenarios" / f"{stem}.toml"
    if not file.is_file() or "axes" in (data := load(file, origins, seen)):
        try:
            scenario = find(name)
        except DesatError as error:
            raise DesatError(f"{place}: extends: {error}") from error
        data = copy(scenario.content.data)
        origins.update(scenario.origins)
    if isinstance(
        data.get("design"), dict
    ):  # the design stays that of the scenario for which it was made
        data["design"].setdefault("of", stem)
    return {**data, "family": family}


def _read(file: Path, family: str, only: str | None = None) -> list[Scenario]:
    """Read the scenarios that a file defines, or only the one of a name.

    Raises DesatError, with a line for each problem.
    """
    places: Origins = {}
    place = paths.shown(file)
    data = load(file, places)
    home = data.pop("family", family)
    abstract = data.pop("abstract", False)
    axes: dict[str, TomlTable] = data.pop("axes", {})
    if empty := [axis for axis, values in axes.items() if not values and not abstract]:
        raise DesatError(f"{place}: axes.{empty[0]}: an axis needs a value")
    cells = []
    for values in itertools.product(*(axis.items() for axis in axes.values())):
        cell = dict(zip(axes, (key for key, _ in values), strict=True))
        stem = file.stem if home else name_of_file(file)
        name = f"{home}/" * bool(home) + "-".join([stem, *cell.values()])
        if only not in (None, name):
            continue
        merged, origins = copy(data), dict(places)
        for axis, (value, partial) in zip(axes, values, strict=True):
            partial = copy(partial)
            partial.pop("label", None)
            leave_out(merged, partial, origins, place)
            merge(merged, partial, origins, (place, f"axes.{axis}.{value}."))
        if abstract:
            continue
        labels = {
            axis: axes[axis][value].get("label", value) for axis, value in cell.items()
        }
        texts = {
            k: fill(merged[k], labels) for k in ("title", "description") if k in merged
        }
        content = {
            **fill(merged, cell),
            **texts,
            "name": name,
            "cell": cell,
            "labels": labels,
        }
        cells.append(
            Scenario(
                _content(content, axes, origins, place),
                file,
                ROOT / home,
                origins=origins,
            )
        )
    return cells


def _content(data: TomlTable, axes: TomlTable, origins: Origins, place: str) -> Content:
    """Validate the merged data of a scenario and build its content.

    Raises DesatError, with a line for each problem.
    """
    from ..language.content import Content
    from .reader import WrongError, build_complete, paper_problems

    try:
        content = build_complete(Content, data)
        if wrong := list(paper_problems(content, axes)):
            raise WrongError(wrong)
    except WrongError as error:
        problems = (
            (*_place_of(origins, path, place), text) for path, text in error.problems
        )
        lines = [f"{at(file, key)}: {key}: {text}" for file, key, text in problems]
        raise DesatError("\n".join(lines)) from error
    return content


def _place_of(origins: Origins, path: tuple[str, ...], place: str) -> tuple[str, str]:
    """Return file and key that give a value.

    The file is `place` if the value was not given.
    """
    file, cell = origin(origins, path)
    return file or place, f"{cell}{'.'.join(path)}"
