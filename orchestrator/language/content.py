"""What a scenario says, whole: the objects of its tables; and what of it travels with
its system in an .ssp, and stands in a manifest, as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Protocol, Self

from pydantic import Field, FiniteFloat, PrivateAttr, ValidationError

from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.model import Told
from .kinds import TRAVELS, Bounds, Maybe, Text, declared
from .paper import OfNumber, PaperRow, by_number
from .scenario import Dispersion, ScenarioTable

_USES = {name: of.use for name, of in declared(ScenarioTable).items()}
KEYS = (*(name for name, use in _USES.items() if use in TRAVELS), "labels")
"""What travels."""
OWN = ("name", "cell", "labels")
"""Keys beside those of the language."""


class Entry(PaperRow):
    """A row of a paper's table as it is of one cell."""

    values: Maybe[FiniteFloat] = None
    tolerance: Maybe[OfNumber | Bounds | str] = None
    tuned: Text = ""
    in_sample: Text = ""
    remark: str = ""

    @property
    def of(self) -> str:
        """The number of a run that it is held against."""
        return self.number or self.quantity


class Content(ScenarioTable):
    """What a scenario says, and what its file adds: its name, and the value of each
    axis."""

    name: str = ""
    cell: dict[str, str] = Field({})
    labels: dict[str, str] = Field({})
    """Of the values of the axes, for a reader."""
    _json: Mapping[str, Any] | None = PrivateAttr(default=None)

    @cached_property
    def entries(self) -> dict[str, Entry]:
        """The rows of a paper's tables as they are of its cell."""
        rows = of_cell(self.written.get("paper", {}), self.cell)
        return {name: Entry.model_validate(row) for name, row in rows.items()}

    @property
    def judged(self) -> dict[str, Entry]:
        """Those that have a number of ours: all but those that no run decides."""
        return {name: row for name, row in self.entries.items() if not row.not_judged}

    @property
    def data(self) -> dict[str, Any]:
        """What a file of its own would have: of rows of a paper's tables those of its
        cell."""
        own = {k: v for k, v in self.written.items() if k not in OWN}
        return (
            {**own, "paper": of_cell(own["paper"], self.cell)}
            if "paper" in own
            else own
        )

    def as_json(self) -> Mapping[str, Any]:
        """What travels, in the order of KEYS; plots as a list, which keeps their order."""
        if self._json is not None:
            return self._json
        told = {k: self.written[k] for k in KEYS if k in self.written}
        if "plots" in told:
            told["plots"] = [
                {"name": name, **plot} for name, plot in told["plots"].items()
            ]
        return {"name": self.name, **told, "cell": self.cell}

    def counted(self) -> Mapping[str, Any]:
        """What of it moves bits, and is not resolved into its system."""
        return {k: x for k, x in self.as_json().items() if _USES.get(k) == "run"}

    def travelled(self, about: Mapping[str, Any]) -> Self:
        """Itself, read from this JSON, which it keeps."""
        self._json = about
        return self


NOTHING = Content.model_construct().travelled({})
"""What a foreign system says."""


def content_of(about: object) -> Content:
    """What a system (its `about`) or a manifest (the same as JSON) says of its
    scenario. Raises DesatError for JSON that is not in the language of today."""
    if isinstance(about, Content):
        return about
    if not about or not isinstance(about, Mapping):
        return NOTHING
    try:
        return Content.model_validate(data_of(about)).travelled(about)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(["about", *map(str, first["loc"])])
        raise DesatError(
            f"{where}: {first['msg']}: no content that this desat reads"
        ) from error


def data_of(about: Mapping[str, Any]) -> dict[str, Any]:
    """What travelled, as data of a scenario: its plots with names again."""
    data = dict(about)
    if isinstance(plots := data.get("plots"), list):
        data["plots"] = {}
        for i, plot in enumerate(plots, 1):
            named = isinstance(plot, dict) and isinstance(plot.get("name"), str)
            name = plot["name"] if named else str(i)
            own = {k: v for k, v in plot.items() if k != "name"} if named else plot
            data["plots"][f"{name} ({i})" if name in data["plots"] else name] = own
    return data


def of_cell(rows: Mapping[str, Any], cell: Mapping[str, str]) -> dict[str, Any]:
    """Of the rows of a paper's tables, as they are written, those of one cell: of
    tables by method and of lists with a value for each of `columns` the cell's own."""
    method, case = (cell.get(axis, "") for axis in ("method", "case"))
    kept: dict[str, Any] = {}
    for name, row in rows.items():
        values, columns = row.get("values"), row.get("columns")
        mine = "not_judged" in row or not isinstance(values, dict) or method in values
        if not mine or method not in row.get("only", [method]):
            continue
        kept[name] = own = {
            k: v for k, v in row.items() if k not in ("columns", "only")
        }
        for key in ("values", "tolerance", "remark", "tuned", "in_sample"):
            said = row.get(key)
            if isinstance(said, dict) and not (key == "tolerance" and by_number(said)):
                said = said.get(method)
            if isinstance(said, dict) and "cases" in said:
                said = said["what"] if case.startswith(tuple(said["cases"])) else None
            band = key == "tolerance" and all(
                isinstance(x, (int, float)) for x in said or ()
            )
            if isinstance(said, list) and columns is not None and not band:
                said = said[columns.index(case)]
            own[key] = said
            if said is None:
                del own[key]
    return kept


# --- What of a system is drawn, and how: its [dispersions] by component and variable --


class Described(Protocol):
    """Components, and what a scenario says of them."""

    @property
    def about(self) -> Told | None:
        """What the scenario says."""

    @property
    def components(self) -> Mapping[str, Any]:
        """By name, each with its `interface`, which may be None."""


def dispersions_of(system: Described) -> dict[str, Dispersion]:
    """`component.variable` -> how it is drawn."""
    spread: dict[str, Dispersion] = {}
    for key, spec in content_of(system.about).dispersions.items():
        owner, _, variable = key.partition(".")
        owners = _having(system, variable) if owner == "*" else [owner]
        spread |= {f"{name}.{variable}": spec for name in owners}
    return spread


def _having(system: Described, variable: str) -> list[str]:
    """Return the components that have a variable."""
    return [
        name
        for name, component in system.components.items()
        if component.interface is not None
        and component.interface.elements.get(variable)
    ]


def overridden_by(system: Described, name: str) -> list[str]:
    """What is drawn of the parameters that a name gives a value: `component.parameter`,
    an element of it, or `shared.parameter`."""
    owner, variable = (part.strip() for part in base_name(name.strip()).split(".", 1))
    wanted = {f"{owner}.{variable}"}
    if owner == "shared" and owner not in system.components:
        wanted = {f"{owner}.{variable}" for owner in _having(system, variable)}
    return sorted(wanted & dispersions_of(system).keys())
