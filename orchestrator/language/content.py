"""Represent the whole content of a scenario as objects of its tables.

Part of it travels with the system in an .ssp, and in a manifest, as JSON.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Protocol, Self

from pydantic import Field, FiniteFloat, PrivateAttr, ValidationError

from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.model import About
from .kinds import TRAVELS, Bounds, Maybe, Text, declared
from .paper import OfNumber, PaperRow, by_number
from .scenario import Dispersion, ScenarioTable

_USES = {name: of.use for name, of in declared(ScenarioTable).items()}
# Keys that travel.
KEYS = (*(name for name, use in _USES.items() if use in TRAVELS), "labels")
OF_THE_CELL = ("name", "cell", "labels")  # keys besides those of the language


class PaperEntry(PaperRow):
    """Row of a paper's table for one cell."""

    values: Maybe[FiniteFloat] = None
    tolerance: Maybe[OfNumber | Bounds | str] = None
    tuned: Text = ""
    in_sample: Text = ""
    remark: str = ""

    @property
    def of(self) -> str:
        """Return the number of a run with which the row is compared."""
        return self.number or self.quantity


class Content(ScenarioTable):
    """Content of a scenario, with its name and the value of each axis."""

    name: str = ""
    cell: dict[str, str] = Field({})
    labels: dict[str, str] = Field({})
    """Labels of the axes' values, for a reader."""
    _json: Mapping[str, Any] | None = PrivateAttr(default=None)

    @cached_property
    def entries(self) -> dict[str, PaperEntry]:
        """Return the rows of a paper's tables for this cell."""
        rows = of_cell(self.written.get("paper", {}), self.cell)
        return {name: PaperEntry.model_validate(row) for name, row in rows.items()}

    @property
    def judged(self) -> dict[str, PaperEntry]:
        """Return the rows with a number of ours.

        Those that cannot be tested by simulation are left out.
        """
        return {name: row for name, row in self.entries.items() if not row.not_judged}

    @property
    def data(self) -> dict[str, Any]:
        """Return the data that a separate file of this scenario would have.

        Rows of a paper's tables are those of its cell.
        """
        entries = {k: v for k, v in self.written.items() if k not in OF_THE_CELL}
        return (
            {**entries, "paper": of_cell(entries["paper"], self.cell)}
            if "paper" in entries
            else entries
        )

    def as_json(self) -> Mapping[str, Any]:
        """Return what travels, in the order of KEYS; plots become an ordered list."""
        if self._json is not None:
            return self._json
        document = {k: self.written[k] for k in KEYS if k in self.written}
        if "plots" in document:
            document["plots"] = [
                {"name": name, **plot} for name, plot in document["plots"].items()
            ]
        return {"name": self.name, **document, "cell": self.cell}

    def counted(self) -> Mapping[str, Any]:
        """Return the entries that affect bits and are not resolved into the system."""
        return {k: x for k, x in self.as_json().items() if _USES.get(k) == "run"}

    def travelled(self, about: Mapping[str, Any]) -> Self:
        """Store the JSON from which this content was read, and return it."""
        self._json = about
        return self


NOTHING = Content.model_construct().travelled({})  # content of a foreign system


def content_of(about: object) -> Content:
    """Return the content of the scenario of a system or a manifest.

    A system has it as `about`, a manifest as the same in JSON.

    Raises
    ------
    DesatError
        If the JSON is not in the language of today.
    """
    if isinstance(about, Content):
        return about
    if not about or not isinstance(about, Mapping):
        return NOTHING
    try:
        return Content.model_validate(data_of(about)).travelled(about)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(["about", *map(str, first["loc"])])
        raise DesatError(
            f"{place}: {first['msg']}: no content that this desat reads"
        ) from error


def data_of(about: Mapping[str, Any]) -> dict[str, Any]:
    """Convert what travelled to data of a scenario, with its plots by name again."""
    data = dict(about)
    if isinstance(plots := data.get("plots"), list):
        data["plots"] = {}
        for i, plot in enumerate(plots, 1):
            named = isinstance(plot, dict) and isinstance(plot.get("name"), str)
            name = plot["name"] if named else str(i)
            entries = {k: v for k, v in plot.items() if k != "name"} if named else plot
            data["plots"][f"{name} ({i})" if name in data["plots"] else name] = entries
    return data


def of_cell(rows: Mapping[str, Any], cell: Mapping[str, str]) -> dict[str, Any]:
    """Select the rows of a paper's tables, as they are written, for one cell.

    From tables by method, and from lists with a value for each of `columns`, the cell's
    own value is taken.
    """
    method, case = (cell.get(axis, "") for axis in ("method", "case"))
    selected_rows: dict[str, Any] = {}
    for name, row in rows.items():
        values, columns = row.get("values"), row.get("columns")
        mine = "not_judged" in row or not isinstance(values, dict) or method in values
        if not mine or method not in row.get("only", [method]):
            continue
        selected_rows[name] = selected = {
            k: v for k, v in row.items() if k not in ("columns", "only")
        }
        for key in ("values", "tolerance", "remark", "tuned", "in_sample"):
            entry = row.get(key)
            if isinstance(entry, dict) and not (
                key == "tolerance" and by_number(entry)
            ):
                entry = entry.get(method)
            if isinstance(entry, dict) and "cases" in entry:
                entry = (
                    entry["what"] if case.startswith(tuple(entry["cases"])) else None
                )
            band = key == "tolerance" and all(
                isinstance(x, (int, float)) for x in entry or ()
            )
            if isinstance(entry, list) and columns is not None and not band:
                entry = entry[columns.index(case)]
            selected[key] = entry
            if entry is None:
                del selected[key]
    return selected_rows


# --- Dispersions of a system: its [dispersions] by component and variable -------------


class Described(Protocol):
    """Components, with the content of their scenario."""

    @property
    def about(self) -> About | None:
        """Return the content of the scenario."""

    @property
    def components(self) -> Mapping[str, Any]:
        """Return the components by name."""


def dispersions_of(system: Described) -> dict[str, Dispersion]:
    """Return how each `component.variable` is drawn."""
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
        if component.interface.elements.get(variable)
    ]


def overridden_by(system: Described, name: str) -> list[str]:
    """Find dispersions of the parameters that a name sets.

    The name is `component.parameter`, an element of it, or `shared.parameter`.
    """
    owner, variable = (part.strip() for part in base_name(name.strip()).split(".", 1))
    target = {f"{owner}.{variable}"}
    if owner == "shared" and owner not in system.components:
        target = {f"{owner}.{variable}" for owner in _having(system, variable)}
    return sorted(target & dispersions_of(system).keys())
