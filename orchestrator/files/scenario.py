"""Scenarios: TOML files in ssp/FAMILY/scenarios/, each one scenario or, with axes, a
table of them.

`desat help keys` prints the keys of such a file, `language/scenario.py` declares them.
Besides:

    extends = "common"            # another file of the folder, or several, merged below this one
    without = ["parameters.manager"]  # what of those is left out
    [axes.method.crcp]            # each axis' values are partial scenarios (`without` included);
    [axes.case.ilqr-1]            # the product of the axes gives scenarios FILE-crcp-ilqr-1

`{method}` in a text stands for the axis' value of the cell, in title and description
for its label.
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
    from ..system.layer import Layer
    from .builder import Builder

ROOT = paths.SCENARIOS
ROLES = "roles"
"""Before the name of a role, whose standard numbers and plots a scenario extends."""


@dataclass(frozen=True)
class Scenario:
    """One scenario: what it says, and where that stands."""

    content: Content
    file: Path
    folder: Path
    """Where its craft file or SSD and FMUs of its own are looked for."""
    origins: Origins = field(default_factory=dict, repr=False, compare=False)
    """Where each value was given: path -> file and cell."""

    @property
    def name(self) -> str:
        """Its name, `family/name`."""
        return self.content.name

    @property
    def cell(self) -> dict[str, str]:
        """The value of each axis, where the file has axes."""
        return self.content.cell

    def where(self, path: tuple[str, ...]) -> str:
        """File and path of a value, for messages."""
        file, key = self.origin_of(path)
        return f"{at(file, key)}: {key}"

    def origin_of(self, path: tuple[str, ...]) -> tuple[str, str]:
        """File and key that give a value; of a parameter that its data do not have, its
        design."""
        own: Any = self.content.written
        for key in path:
            own = own.get(key, {}) if isinstance(own, dict) else {}
        if own == {} and path[0] == "parameters" and self.design is not None:
            return paths.shown(self.design), ".".join(path)
        return _place_of(self.origins, path, paths.shown(self.file))

    @property
    def family(self) -> str:
        """The folder of ssp/ that it belongs to."""
        return self.name.partition("/")[0]

    @property
    def baseline(self) -> str | None:
        """The full name of its baseline."""
        baseline = f"{self.family}/{self.content.baseline}"
        return baseline if self.content.baseline and baseline != self.name else None

    @property
    def design(self) -> Path | None:
        """The file with its design, where it has a [design]; `of` names the scenario
        that has it made."""
        if self.content.design is None:
            return None
        name = self.content.design.of or self.name.partition("/")[2]
        return ROOT / self.family / "design" / f"{name}.toml"

    @property
    def each_draw(self) -> dict[str, Any] | None:
        """What it says of its design, where that is made anew for the values of each
        draw."""
        design = self.content.design
        return design.written if design and design.each_draw else None

    def parameters(self, designed: bool = True) -> TomlTable:
        """Its [parameters], with those of its design below. Raises DesatError where it
        has none."""
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

    def layers(self, designed: bool = True) -> list[Layer]:
        """Read the layers of its craft and of itself; `designed` False leaves its
        design out.

        Raises
        ------
        DesatError
            Where it has no craft, or no design yet.
        """
        from . import layers

        where, parameters = paths.shown(self.file), self.parameters(designed)
        craft = layers.of_craft(self.content, self.folder, where, self.origin_of)
        own = layers.of_scenario(
            self.name, self.content, parameters, self.folder, where, self.origin_of
        )
        return [craft, own]

    def builder(self, blocks: bool = False, designed: bool = True) -> Builder:
        """Begin the system that it describes; `designed` False leaves its design out."""
        from .builder import Builder

        craft, own = self.layers(designed)
        return Builder(craft, blocks).add(own)


# --- finding --------------------------------------------------------------------------


@cache
def families() -> tuple[str, ...]:
    """The folders of ssp/ that hold scenarios."""
    return tuple(sorted(p.parent.name for p in ROOT.glob("*/scenarios")))


def summary(family: str) -> str:
    """What a family of scenarios is about, in a line; empty where its folder does not
    say."""
    file = ROOT / family / "family.toml"
    return str(toml(file).get("title", "")) if file.exists() else ""


def abbreviations(family: str, text: str) -> str:
    """The abbreviations of a family that a text has, spelt out; empty where there are
    none."""
    file = ROOT / family / "family.toml"
    known = toml(file).get("abbreviations", {}) if file.exists() else {}
    there = [
        f"{name}: {what}"
        for name, what in known.items()
        if re.search(rf"\b{name}\b", text)
    ]
    return "; ".join(there)


@cache
def cells(file: Path, family: str) -> dict[str, Scenario]:
    """The scenarios of a file by name. Raises DesatError, a line a problem."""
    return {s.name: s for s in _read(file, family)}


@cache
def _cell(file: Path, family: str, name: str) -> Scenario | None:
    """The scenario of this name of a file, read alone; None where the file makes none
    of the name. Raises DesatError, a line a problem with it."""
    return next(iter(_read(file, family, name)), None)


@cache
def survey(family: str) -> tuple[dict[str, Scenario], dict[str, str]]:
    """The scenarios of a family by name, and what is wrong with its other files by
    their stem."""
    good: dict[str, Scenario] = {}
    broken: dict[str, str] = {}
    for file in sorted((ROOT / family / "scenarios").glob("*.toml")):
        try:
            made = cells(file, family)
        except DesatError as error:
            broken[file.stem] = str(error)
            continue
        for name in good.keys() & made.keys():
            both = f"{paths.shown(good[name].file)} and {paths.shown(file)}"
            broken[file.stem] = (
                f"{both}: both make a scenario {name}; rename a file or a value"
            )
        good |= made
    known = {name.partition("/")[2] for name in good}
    wrong: dict[str, str] = {}
    for scenario in good.values():
        for path, other in _others(scenario.content):
            unread = any(f"{other}-".startswith(f"{stem}-") for stem in broken)
            if other not in known and not unread:
                text = f"{scenario.where(path)}: no scenario {other}{nearest(other, known)}"
                wrong.setdefault(scenario.name, text)
    for name, text in wrong.items():
        broken.setdefault(good.pop(name).file.stem, text)
    return good, broken


def of_its_file(name: str) -> Scenario | None:
    """The scenario of a name from the one file that has it; None where there is none,
    or something is wrong: `survey` says what."""
    family, _, rest = name.partition("/")
    files = (ROOT / family / "scenarios").glob("*.toml") if family in families() else ()
    found = [f for f in files if f"{rest}-".startswith(f"{f.stem}-")]
    try:
        made = [
            scenario for f in found if (scenario := _cell(f, family, name)) is not None
        ]
    except DesatError:
        return None
    return made[0] if len(made) == 1 else None


def _others(content: Content) -> Iterator[tuple[tuple[str, ...], str]]:
    """Path and name of the other scenarios that one names."""
    if content.baseline:
        yield ("baseline",), content.baseline
    for key in ("of", "end_of"):
        if name := getattr(content.design, key, ""):
            yield ("design", key), name
    for name, number in content.numbers.items():
        if number.reference:
            yield ("numbers", name, "reference"), number.reference


def readable(family: str | None = None) -> tuple[dict[str, Scenario], list[str]]:
    """All scenarios by name, or those of one family, whose files are right; and what is
    wrong with the others, one line each."""
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


def find(name: str) -> Scenario:
    """The scenario of a name. Raises DesatError with the nearest name, or with what is
    wrong with its file."""
    family, _, rest = name.partition("/")
    if (scenario := of_its_file(name)) is not None and all(
        of_its_file(f"{family}/{other}") for _, other in _others(scenario.content)
    ):
        return scenario
    known, _ = readable(family if family in families() else None)
    broken = survey(family)[1] if family in families() else {}
    twice = [
        t
        for t in broken.values()
        if t.partition("both make a scenario ")[2].startswith(name)
    ]
    if name in known and not twice:
        return known[name]
    for stem, text in broken.items():
        if f"{rest}-".startswith(f"{stem}-"):
            raise DesatError(text)
    if name in families():
        raise DesatError(
            f"{name} is a family of {len(known)} scenarios (desat list {name}); one of them is "
            f"needed, as {next(iter(known))}"
        )
    hint = (
        "; a name is needed here, no file"
        if name.endswith(".toml")
        else nearest(name, [*known, *_beside()])
    )
    raise DesatError(f"no scenario {name}{hint}")


def _beside() -> list[str]:
    """The scenario files and crafts of the folder that the command was given in."""
    here = Path()
    return [
        *(f.stem for f in here.glob("*.toml")),
        *(f.parent.name for f in here.glob(f"*/{paths.NOMINAL}")),
    ]


def name_of_file(file: Path) -> str:
    """The name of what a file of one's own says: beside a craft file the craft's, which
    is its folder's, with that of another scenario than its nominal one."""
    file = file.resolve()
    if not (file.parent / "craft.toml").is_file():
        return utf8_name(file.stem)
    craft = utf8_name(file.parent.name)
    return craft if file.name == paths.NOMINAL else f"{craft}-{utf8_name(file.stem)}"


def own(file: Path) -> Scenario:
    """The scenario of a file that is not one of ours. `extends` names files beside it,
    or ours as FAMILY/NAME; its SSD is beside it, else that of the family that it
    extends.

    Raises DesatError, which names the file, for what is wrong with it.
    """
    where = paths.shown(file)
    made = _read(file, "")
    if len(made) != 1:
        what = (
            "is abstract" if not made else f"has axes, and so is {len(made)} scenarios"
        )
        raise DesatError(f"{where}: it {what}; one scenario is needed")
    (scenario,) = made
    wiring = scenario.content.ssd or scenario.content.craft
    beside = (file.parent / (wiring or "SystemStructure.ssd")).is_file()
    own_craft = not wiring and (file.parent / "craft.toml").is_file()
    ours = "/" in scenario.name and not beside and not own_craft
    return scenario if ours else replace(scenario, folder=file.parent)


# --- reading --------------------------------------------------------------------------


def load(file: Path, origins: Origins, seen: tuple[Path, ...] = ()) -> TomlTable:
    """The data of a file merged over that of its bases. Raises DesatError, a line a
    problem."""
    where = paths.shown(file)
    state = file.stat() if file.is_file() else None
    data = copy(_table(file, where, state and (state.st_mtime_ns, state.st_size)))
    bases = data.pop("extends", [])
    if file in seen:
        chain = " -> ".join(f.stem for f in (*seen[seen.index(file) :], file))
        raise DesatError(f"{where}: extends itself ({chain})")
    from ..language.scenario import OWN_KEYS  # pydantic, only where a scenario is read

    merged: TomlTable = {}
    known = [f.stem for f in file.parent.glob("*.toml")]
    for base in [bases] if isinstance(bases, str) else bases:
        below: Origins = {}
        if base.startswith(f"{ROLES}/"):
            table = load(_of_role(base, where), below, (*seen, file))
        elif "/" in base and not file.is_relative_to(paths.SCENARIOS):
            table = _ours(base, where, below, (*seen, file))
        elif base in known:
            table = load(file.with_name(f"{base}.toml"), below, (*seen, file))
        else:
            raise DesatError(
                f"{where}: extends: no file {base}.toml{nearest(base, known)}"
            )
        merge(merged, table, origins, below)
    for name in OWN_KEYS:
        merged.pop(name, None)
    leave_out(merged, data, origins, where)
    merge(merged, data, origins, (where, ""))
    return merged


@lru_cache(maxsize=1024)
def _table(file: Path, where: str, _: object) -> TomlTable:
    """What a file says, checked, not to be changed; kept, as files share their bases.
    Raises DesatError, a line a problem."""
    from ..language.scenario import ScenarioFile
    from .reader import WrongError, read

    data = toml(file)
    try:
        read(ScenarioFile, data, part=True)
    except WrongError as wrong:
        named = [(".".join(path), text) for path, text in wrong.problems]
        lines = [f"{at(where, key)}: {key}: {text}" for key, text in named]
        raise DesatError("\n".join(lines)) from wrong
    return data


def _of_role(name: str, where: str) -> Path:
    """The file with the standard numbers and plots of a role, `roles/manager`."""
    folder = paths.PACKAGE / "templates" / ROLES
    role, known = name.partition("/")[2], sorted(f.stem for f in folder.glob("*.toml"))
    if role not in known:
        raise DesatError(f"{where}: extends: no {name}{nearest(role, known)}")
    return folder / f"{role}.toml"


def _ours(name: str, where: str, origins: Origins, seen: tuple[Path, ...]) -> TomlTable:
    """What a scenario file that is not one of ours extends as FAMILY/NAME: a scenario,
    or a file of the family. Its `family` says which."""
    family, _, stem = name.partition("/")
    require(family, families(), f"{where}: extends: no family")
    file = paths.SCENARIOS / family / "scenarios" / f"{stem}.toml"
    if not file.is_file() or "axes" in (data := load(file, origins, seen)):
        try:
            scenario = find(name)
        except DesatError as error:
            raise DesatError(f"{where}: extends: {error}") from error
        data = copy(scenario.content.data)
        origins.update(scenario.origins)
    if "design" in data:  # it stays that of the scenario that it was made for
        data["design"].setdefault("of", stem)
    return {**data, "family": family}


def _read(file: Path, family: str, only: str | None = None) -> list[Scenario]:
    """The scenarios that a file makes, or the one of a name. Raises DesatError, a line
    a problem with these."""
    given: Origins = {}
    where = paths.shown(file)
    data = load(file, given)
    home = data.pop("family", family)
    abstract = data.pop("abstract", False)
    axes: dict[str, TomlTable] = data.pop("axes", {})
    if empty := [axis for axis, values in axes.items() if not values and not abstract]:
        raise DesatError(f"{where}: axes.{empty[0]}: an axis needs a value")
    cells = []
    for values in itertools.product(*(axis.items() for axis in axes.values())):
        cell = dict(zip(axes, (key for key, _ in values), strict=True))
        stem = file.stem if home else name_of_file(file)
        name = f"{home}/" * bool(home) + "-".join([stem, *cell.values()])
        if only not in (None, name):
            continue
        merged, origins = copy(data), dict(given)
        for axis, (value, partial) in zip(axes, values, strict=True):
            partial = copy(partial)
            partial.pop("label", None)
            leave_out(merged, partial, origins, where)
            merge(merged, partial, origins, (where, f"axes.{axis}.{value}."))
        if abstract:
            continue
        labels = {
            axis: axes[axis][value].get("label", value) for axis, value in cell.items()
        }
        texts = {
            k: fill(merged[k], labels) for k in ("title", "description") if k in merged
        }
        said = {
            **fill(merged, cell),
            **texts,
            "name": name,
            "cell": cell,
            "labels": labels,
        }
        cells.append(
            Scenario(_content(said, axes, origins, where), file, ROOT / home, origins)
        )
    return cells


def _content(said: TomlTable, axes: TomlTable, origins: Origins, where: str) -> Content:
    """What a scenario says, merged. Raises DesatError, a line a problem, with what is
    wrong."""
    from ..language.content import Content
    from .reader import WrongError, paper_problems, whole

    try:
        content = whole(Content, said)
        if wrong := list(paper_problems(content, axes)):
            raise WrongError(wrong)
    except WrongError as error:
        given = (
            (*_place_of(origins, path, where), text) for path, text in error.problems
        )
        lines = [f"{at(file, key)}: {key}: {text}" for file, key, text in given]
        raise DesatError("\n".join(lines)) from error
    return content


def _place_of(origins: Origins, path: tuple[str, ...], where: str) -> tuple[str, str]:
    """File, or `where` nothing was given, and key that give a value."""
    file, cell = origin(origins, path)
    return file or where, f"{cell}{'.'.join(path)}"
