"""Define the scenario language: every key of a scenario's TOML file.

Each key is declared once, as a field, with type, unit and meaning. `desat help keys`
prints them, `files/reader.py` checks data against them. A table of the language is a
class here, and its keys are the fields.
"""

from __future__ import annotations

import math
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    FiniteFloat,
    Tag,
    model_validator,
)

from ..system.choices import MOST_ACCURACY
from ..system.model import ACCURACY, MOST_SUBSTEPS
from .kinds import (
    LanguageTable,
    Many,
    Maybe,
    MeanAndDeviation,
    NumberOrText,
    Range,
    Text,
    TextOrTexts,
    Three,
    Unit,
    Value,
    Written,
    by_kind,
    declared,
    either,
    incomplete,
    key,
    ordered,
    utc,
)
from .paper import PaperRow

_Positive = Annotated[FiniteFloat, Field(gt=0.0)]
if TYPE_CHECKING:
    _Widths = float | tuple[float, ...]
else:
    _Widths = either(
        number=_Positive, list=Annotated[Many[_Positive], Field(min_length=1)]
    )
_Accuracy = Annotated[FiniteFloat, Field(gt=0.0, le=MOST_ACCURACY)]
_Substeps = Annotated[
    Annotated[int, Field(ge=1, le=MOST_SUBSTEPS), Tag("<number>")]
    | Annotated[Literal["auto"], Tag("<text>")],
    Discriminator(by_kind),
]
_Sequence = Annotated[str, Field(pattern="^[123]{3}$")]
_Window = Annotated[
    Many[float], Field(min_length=2, max_length=2), AfterValidator(ordered)
]
_Weights = Annotated[
    Many[Annotated[FiniteFloat, Field(ge=0.0)]], Field(min_length=3, max_length=3)
]


class Number(Written):
    """[numbers.NAME]: a number of each run, from its series or other runs' numbers."""

    title: Text = key("what the number is, for a reader")
    signals: TextOrTexts = key(
        "`component.output`, or several where the measure takes several",
        default=(),
        alias="signal",
    )
    measure: Text = key(
        "how the series becomes a number (`desat help measures`); default: last",
        default="last",
    )
    options: dict[str, Value] = key("the measure's own options")
    derive: Text = key(
        "what is computed of the signals and then measured, such as euler"
    )
    sequence: _Sequence = key(
        "of euler and euler_lvlh: the axes turned about; default: 321"
    )
    element: Maybe[Annotated[int, Field(ge=1)]] = key(
        "only this element of what is measured, from 1 on"
    )
    window: _Window = key(
        "only rows of this time, ends included; an end of 1e9: that of the run; default: all",
        "s",
    )
    percent_of: Maybe[NumberOrText] = key(
        "in per cent of this: a value in the signal's unit, or a text"
    )
    unit: Unit = key("the unit it is given in, converted from the signal's")
    of: Text = key("with `reference`: the number that is compared")
    reference: Text = key(
        "the scenario of this family whose number it is compared with"
    )
    form: Maybe[Literal["saving", "ratio", "difference", "paired_ratio"]] = key(
        "how: saving (per cent less) or ratio, of samples that of their medians; difference or "
        "paired_ratio, of samples pair by pair"
    )

    @model_validator(mode="after")
    def _check_reference(self) -> Self:
        """Check that the number is either of signals or of another scenario."""
        keys_given = {
            "signal" if name == "signals" else name for name in self.model_fields_set
        }
        relation, series = {"of", "reference", "form"}, {"signal"}
        if "signal" in keys_given and keys_given & relation:
            raise incomplete("either signal or of, reference and form, not both")
        if missing := (relation if keys_given & relation else series) - keys_given:
            raise incomplete(f"{', '.join(sorted(missing))} missing")
        return self


class LimitLine(LanguageTable):
    """An entry of a plot's `limits` as a table: a line, or a band about zero."""

    NEEDED = ("value",)
    value: NumberOrText = key(
        "a number in the plot's unit, or parameters `component.parameter[i]`"
    )
    name: Text = key("what the legend calls it")
    fill: bool = key("true: a filled band about zero instead of a line")
    unless: dict[str, Value] = key(
        "left out where `component.parameter` has this value"
    )


if TYPE_CHECKING:
    _Limit = LimitLine
else:
    _Limit = Annotated[
        either(table=LimitLine, text=Text, number=FiniteFloat),
        AfterValidator(lambda x: x if isinstance(x, LimitLine) else LimitLine(value=x)),
    ]


class Plot(LanguageTable):
    """[plots.NAME]: a figure of the report.

    Figures are in the order of their tables.
    """

    NEEDED = ("title", "signals")
    title: Text = key("the caption")
    signals: Annotated[Many[Text], Field(min_length=1)] = key(
        "`component.output`, one or several"
    )
    components: Many[str] = key(
        "names of the elements; those without a name are not shown"
    )
    axis: Text = key("the quantity on the axis; default: the title")
    unit: Unit = key("the unit of the axis; default: the first signal's")
    norm: bool = key("true: the size of vectors, one line each")
    log: bool = key("true: a logarithmic axis")
    derive: Text = key(
        "what is computed from the signals first, such as pointing or euler"
    )
    sequence: _Sequence = key(
        "of euler and euler_lvlh: the axes turned about; default: 321"
    )
    steady: Maybe[_Positive] = key(
        "a second panel shows the time from here on at its own scale", "s"
    )
    orbit: Maybe[_Positive] = key("the axis of times counts these", "s")
    envelope: bool = key(
        "true: where a line is faster than the plot is wide, what it lies between"
    )
    points: Maybe[Annotated[int, Field(ge=10)]] = key(
        "so many points a line; default: 3000"
    )
    limits: Many[_Limit] = key("limit lines: numbers, parameters, or tables")


class Dispersion(Written):
    """An entry of [dispersions], "component.parameter" or "*.parameter".

    It has exactly one kind.
    """

    # lower bound of the share of draws that are within the range; with a smaller share,
    # drawing again until one is within would take too long
    LEAST_INSIDE: ClassVar[float] = 0.01

    normal: MeanAndDeviation = key("each element: [mean, deviation]")
    within: Range = key("with normal: an element beyond [low, high] is drawn again")
    uniform: Range = key("each element: [low, high]")
    direction: Maybe[FiniteFloat] = key("a vector of random direction and this size")
    attitude: Maybe[Literal["random"]] = key("a quaternion, uniform over all attitudes")
    signs: Annotated[Many[FiniteFloat], Field(min_length=1)] = key(
        "each: plus or minus this"
    )
    one_of: Annotated[Many[Value], Field(min_length=1)] = key("one of these values")
    seed: Maybe[Literal[True]] = key("a seed of its own for each sample")
    factor: Annotated[Maybe[FiniteFloat], Field(gt=1.0)] = key(
        "times or divided by at most this in 90 %: its value, with direction its size; of "
        "a matrix of inertia its second moments, of plates their areas"
    )
    plus_minus: Maybe[_Widths] = key(
        "each element: its value and at most this more or less in 90 %; a list has a "
        "width for each"
    )

    @property
    def kind(self) -> str:
        """Return how it is drawn: `normal`, `uniform` and so on."""
        fields = self.model_fields_set - {"within"}
        (kind,) = fields - {"factor"} or fields
        return kind

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Check that there is exactly one kind, and that `within` is wide enough."""
        kinds = [k for k in type(self).model_fields if k != "within"]
        fields = self.model_fields_set - {"within"}
        if len(fields) != 1 and fields != {"direction", "factor"}:
            raise incomplete(f"exactly one of {', '.join(kinds)} is needed")
        if not self.within:
            return self
        if not self.normal:
            raise incomplete("within goes with normal only")
        mean, deviation = self.normal
        width = max(deviation, 1e-300) * math.sqrt(2)
        low, high = (math.erf((x - mean) / width) for x in self.within)
        if not (inside := (high - low) / 2) >= self.LEAST_INSIDE:
            raise incomplete(
                f"within: {100 * inside:.2g} % of normal = {list(self.normal)} is in "
                f"{list(self.within)}; {100 * self.LEAST_INSIDE:g} % is needed"
            )
        return self


class Requirement(Written):
    """[requirements.NAME]: limits of a number.

    They apply to a run, and to a share of a campaign's cases.
    """

    NEEDED = ("number",)
    number: Text = key("the number, of [numbers] or of an analysis")
    max: Maybe[FiniteFloat] = key(
        "a run is within where the number is at most this, in its unit"
    )
    min: Maybe[FiniteFloat] = key("or where it is at least this; both may be given")
    probability: Annotated[float, Field(gt=0.0, lt=1.0)] = key(
        "the share of all cases that must be within; default: 0.95", default=0.95
    )
    confidence: Annotated[float, Field(ge=0.5, lt=1.0)] = key(
        "met where it is so with this confidence (Clopper-Pearson); default: 0.95",
        default=0.95,
    )

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        """Check that there is a limit."""
        if not self.model_fields_set & {"max", "min"}:
            raise incomplete("max or min is needed")
        return self

    def holds(self, values: Any) -> Any:
        """Check which values, in the number's unit, are finite and within the limits.

        The result is True or False for one value, and an array for an array.
        """
        low = -math.inf if self.min is None else self.min
        high = math.inf if self.max is None else self.max
        return (values <= high) & (values >= low) & (abs(values) < math.inf)


class Design(Written):
    """[design]: what `desat design` computes for this scenario."""

    of: Text = key("the scenario of this family whose design it uses")
    final_momentum: Maybe[_Positive] = key("size at the end", "N.m.s")
    final_momentum_body: Three = key("vector at the end, body", "N.m.s")
    momentum_weight: _Weights = key("weight of the momentum, one an axis", "1/(T2.s2)")
    nodes: Maybe[Annotated[int, Field(ge=2)]] = key("nodes of the gain table")
    end_of: Text = key("ends where the design of this scenario ends")
    peak_weight: Annotated[FiniteFloat, Field(ge=0.0)] = key(
        "weight of large wheels", "A2.m4", default=0.0
    )
    peak_momentum: Maybe[_Positive] = key("when a wheel is large", "N.m.s")
    peak_share: Maybe[_Positive] = key(
        "when a wheel is large, of the largest of the course without peak_weight; that is then in "
        "the course's mean squared dipoles"
    )
    lost_momentum_weight: _Weights = key(
        "momentum_weight of the courses with a coil lost", "1/(T2.s2)"
    )
    lost_peak_share: Maybe[_Positive] = key(
        "peak_share of the courses with a coil lost"
    )
    lost_effort: _Positive = key(
        "mean squared dipoles of the course without peak_weight, below which one with a coil lost "
        "has coils to spare",
        "A2.m4",
        default=0.0,
    )
    hold_weight: Maybe[_Positive] = key("how stiffly held", "1/(T2.s2)")
    each_draw: bool = key("true: made anew for each sample")
    assume: dict[str, dict[str, Value]] = key(
        "parameters that the design assumes instead"
    )


class DesignFile(LanguageTable):
    """A file of ssp/FAMILY/design/, as `desat design` writes it."""

    NEEDED = ("parameters",)
    tuned: dict[str, Value] = key("what was tuned for it")
    reached: dict[str, Value] = key("what the run that it was computed with ended with")
    parameters: dict[str, dict[str, Value]] = key(
        "the designed parameters of a component"
    )
    made_of: dict[str, Value] = key(
        "what it was made from, `component.parameter` and more"
    )


def _value_reached(value: Any) -> Any:
    """Check that a value is a whole number, a name, true or false."""
    if (
        isinstance(value, bool)
        or type(value) is int
        or (isinstance(value, str) and value.strip())
    ):
        return value
    raise ValueError("a whole number, the name of a value, true or false is needed")


class StopWhen(LanguageTable):
    """[stop_when]: a condition that ends the run before its stop time.

    It is evaluated after each step. It has exactly one of `below`, `above` and
    `reaches`.
    """

    NEEDED = ("signal",)
    signal: Text = key("`component.output`; it need not be recorded")
    below: Maybe[NumberOrText] = key(
        "met while the sizes of all elements are below this"
    )
    above: Maybe[NumberOrText] = key("met while the size of any element is above this")
    reaches: Annotated[Any, AfterValidator(_value_reached)] = key(
        "met while an Integer, such as a mode, has this value (or its name); true or false"
    )
    held: Annotated[FiniteFloat, Field(ge=0.0)] = key(
        "met for so long; default: 0", "s", default=0.0
    )
    unit: Unit = key("the unit of the limit; default: the signal's")

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Check that there is exactly one condition, and a unit only for limits."""
        keys_given = self.model_fields_set & {"below", "above", "reaches"}
        if len(keys_given) != 1:
            raise incomplete("exactly one of below, above, reaches is needed")
        if self.unit and "reaches" in keys_given:
            raise incomplete("unit: only with below and above")
        return self


class ScenarioTable(Written):
    """Keys that both a whole file and a value of an axis may have."""

    without: Many[Text] = key(
        "paths of what is left out of that before, such as plots.rate", use="file"
    )
    title: Text = key(
        "what it is, in a line; `{NAME}` stands for the label of the axis NAME",
        use="text",
    )
    description: Text = key("two sentences for a reader", use="text")
    source: Text = key("the paper it is from", use="text")
    unstable: Text = key(
        "why its sampled attitude loop is unstable on purpose: a warning then, else a problem",
        use="text",
    )
    craft: Text = key("the craft file, beside; default: craft.toml", use="system")
    ssd: Text = key(
        "the wiring as an SSD kept by hand, in place of a craft file", use="system"
    )
    start: Maybe[FiniteFloat] = key("start time", "s", use="system")
    step: Maybe[FiniteFloat] = key("the master's step", "s", use="system")
    substeps: Maybe[_Substeps] = key(
        "number of substeps in each step for components that exchange step averages (actuators "
        "and body); auto, the default: a run chooses it by `accuracy`",
        use="resolved",
    )
    accuracy: Maybe[_Accuracy] = key(
        f"attitude error that `substeps = auto` keeps below, as the run estimates it; {ACCURACY:g}",
        "rad",
        use="resolved",
    )
    stop: Maybe[FiniteFloat] = key("stop time", "s", use="system")
    residual_bound: Maybe[_Positive] = key(
        "largest momentum residual, over the largest momentum: above it a run ends with 1; 1e-9",
        use="run",
    )
    impulse_bound: Maybe[_Positive] = key(
        "the same for the external impulse against one computed outside the body; 1e-6",
        use="run",
    )
    energy_bound: Maybe[_Positive] = key(
        "bound of the unresolved work within a step, relative to the energy of a turn of 1 rad in "
        "it: above it a run ends with 1; 2e-8",
        use="run",
    )
    firing_bound: bool = key(
        "true: of each run the least possible firing time too, as `desat bound` computes it",
        default=False,
        use="text",
    )
    stop_when: Maybe[StopWhen] = key("a condition that ends it before", use="run")
    epoch: Maybe[Annotated[datetime, AfterValidator(utc)]] = key(
        "UTC of t = 0", use="system"
    )
    sources: dict[str, Text] = key("another FMU for a component", use="system")
    shared: dict[str, Value] = key(
        "a parameter for every component that has it", use="system"
    )
    parameters: dict[str, dict[str, Value]] = key(
        "parameters (or unwired inputs) of a component", use="system"
    )
    design: Maybe[Design] = key(
        "parameters below these that `desat design` computes", use="system"
    )
    output_classes: dict[str, Literal["state", "interval"]] = key(
        "`component.output`: its class", use="resolved"
    )
    step_ratio: dict[str, Annotated[int, Field(ge=1)]] = key(
        "steps once in so many steps", use="system"
    )
    dispersions: dict[str, Dispersion] = key(
        '"component.parameter": how `desat campaign` samples it', use="run"
    )
    samples: Annotated[int, Field(ge=0)] = key(
        "its numbers in tables are medians of this many samples", default=0, use="file"
    )
    baseline: Text = key(
        "a scenario of this family that the report shows beside this one", use="text"
    )
    numbers: dict[str, Number] = key("the numbers of a run", use="run")
    requirements: dict[str, Requirement] = key(
        "what runs are held against: `desat run` ends with 1 where one is not met; a "
        "campaign judges all cases together",
        use="run",
    )
    plots: dict[str, Plot] = key("the figures of the report, in this order", use="run")
    paper: dict[str, PaperRow] = key("a paper's values beside the numbers", use="file")


class AxisCell(ScenarioTable):
    """[axes.AXIS.VALUE]: the changes that a value of an axis makes to the scenario."""

    label: Text = key("the value's name for a reader", use="file")


class ScenarioFile(ScenarioTable):
    """File of a scenario."""

    extends: TextOrTexts = key(
        "another file of the folder, or several, merged below this one; roles/manager, "
        "roles/thrusters: the standard numbers and plots of a managed run, of thrusters",
        default=(),
        use="file",
        inherited=False,
    )
    abstract: bool = key("true: only for others to extend", use="file", inherited=False)
    axes: dict[str, dict[str, AxisCell]] = key(
        "each axis' values; their product gives scenarios", use="file"
    )


OWN_KEYS = tuple(
    name for name, of in declared(ScenarioFile).items() if not of.inherited
)
# keys that no file inherits from those that it extends
