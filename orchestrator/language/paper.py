"""Define a row of a paper's table beside ours, `[paper.NAME]`."""

from __future__ import annotations

from math import inf
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Discriminator, FiniteFloat, Tag, model_validator

from .kinds import (
    Bounds,
    LanguageTable,
    Many,
    Maybe,
    Text,
    Unit,
    by_kind,
    either,
    incomplete,
    key,
    width,
)


class OfNumber(LanguageTable):
    """Band relative to another number of the run."""

    NEEDED = ("of", "from_", "to")
    of: Text = key("the other number")
    from_: FiniteFloat = key("least, as a multiple of it", default=0.0, alias="from")
    to: FiniteFloat = key("most, as a multiple of it", default=0.0)


class Tuning(LanguageTable):
    """What was tuned or chosen, and for which cases."""

    NEEDED = ("what", "cases")
    what: Text = key("what was tuned to the paper, or what the cell had a part in")
    cases: Many[Text] = key("beginnings of the cases' names that this holds for")


class ShareOfDraws(LanguageTable):
    """The share of the draws whose number is within one limit.

    The limit is a lower or an upper one.
    """

    least: FiniteFloat = key(
        "counts samples whose number is this or more", default=-inf
    )
    most: FiniteFloat = key("counts samples whose number is this or less", default=inf)

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Check that there is exactly one limit."""
        if len(self.model_fields_set) != 1:
            raise incomplete("exactly one of least, most is needed")
        return self


Width = Annotated[str, AfterValidator(width)]
_Cell = either(text=Width, table=OfNumber, list=Bounds)


def by_number(tolerance: Any) -> bool:
    """Return whether a tolerance, as written, is a band relative to another number.

    Otherwise it may be a table by method.
    """
    return isinstance(tolerance, dict) and tolerance.keys() == {"of", "from", "to"}


def _tolerance(value: Any) -> str:
    """Return the tag of a tolerance's kind."""
    is_list = isinstance(value, (list, tuple))
    if is_list and value and all(type(x) in (int, float) for x in value):
        return "<band>"
    return by_kind(value)


Tolerances = Annotated[
    Annotated[Width, Tag("<text>")]
    | Annotated[Bounds, Tag("<band>")]
    | Annotated[OfNumber, Tag("<table>")]
    | Annotated[Many[_Cell], Tag("<list>")],  # type: ignore[valid-type]
    Discriminator(_tolerance),
]
_PerMethod: Any = Annotated[
    Annotated[Tolerances, Tag("<any>")]
    | Annotated[dict[str, Tolerances], Tag("<methods>")],
    Discriminator(
        lambda v: "<methods>" if isinstance(v, dict) and not by_number(v) else "<any>"
    ),
]
Values = either(number=FiniteFloat, list=Many[FiniteFloat])
Remarks = either(text=str, list=Many[str])


class PaperRow(LanguageTable):
    """[paper.NAME]: a row of a paper's table beside ours.

    `values`, `tolerance` and `remark` apply to all cells, or are tables by method, or
    lists with an item for each of `columns`.
    """

    NEEDED = ("table", "quantity", "unit")
    table: Text = key("the paper's table, such as 2, or a heading")
    quantity: Text = key(
        "what the row gives, and the number of that name, where `number` is not"
    )
    heading: Text = key(
        "the quantity in words, for headings; default: its name without `_`"
    )
    number: Text = key("which number of the run it is held against; default: quantity")
    unit: Unit = key("its unit")
    columns: Many[Text] = key("the cases that lists give values for, in this order")
    values: either(  # type: ignore[valid-type]
        number=FiniteFloat, list=Many[FiniteFloat], table=dict[str, Values]
    ) = key("the paper's values, in `unit`; left out: it gives none")
    tolerance: _PerMethod = key(
        'what counts as within: "3 %", "0.02", [low, high] (inf: no bound), { of, from, to }'
    )
    each: Bounds = key("[low, high] that every sample keeps to")
    tuned: either(text=Text, table=dict[str, either(text=Text, table=Tuning)]) = key(  # type: ignore[valid-type]
        "what was tuned to this row"
    )
    in_sample: either(text=Text, table=dict[str, either(text=Text, table=Tuning)]) = (  # type: ignore[valid-type]
        key(
            "why it is no test although nothing was tuned to it: what it had a part in, or repeats"
        )
    )
    definition: Text = key("what is measured, in a sentence; default: the number's own")
    share: Maybe[ShareOfDraws] = key(
        "the share of samples (%) whose number is within this, with interval"
    )
    remark: either(text=str, list=Many[str], table=dict[str, Remarks]) = key(  # type: ignore[valid-type]
        "for a reader"
    )
    flag: bool = key("true: 0 and 1 are shown as no and yes")
    only: Many[Text] = key("only for these methods")
    label: Text = key("stands in the method's place")
    case: Text = key("stands in the case's place")
    not_judged: Text = key(
        "why no simulation can test what the paper says; the row has no number of ours and no band",
    )

    @model_validator(mode="after")
    def _undecided(self) -> Self:
        """Check that a row that is not judged has no number or band."""
        keys_given = {
            "number",
            "tolerance",
            "each",
            "share",
            "tuned",
        } & self.model_fields_set
        if self.not_judged and keys_given:
            raise incomplete(
                f"not_judged, and {', '.join(sorted(keys_given))}: one of the two"
            )
        return self

    @model_validator(mode="after")
    def _columns(self) -> Self:
        """Check that lists have an item for each column."""
        for name in ("values", "tolerance", "remark"):
            value = getattr(self, name)
            for row in value.values() if isinstance(value, dict) else [value]:
                if not isinstance(row, tuple) or (
                    name == "tolerance" and _tolerance(row) == "<band>"
                ):
                    continue
                if not self.columns:
                    raise incomplete(f"{name} is a list, and there are no columns")
                if len(row) != len(self.columns):
                    raise incomplete(
                        f"{name}: {len(row)} for {len(self.columns)} columns"
                    )
        return self
