"""Write the modelDescription.xml and the documentation page of a block's FMU."""

from __future__ import annotations

import inspect
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any

from lxml import etree

from desat.components.contract.block import Block, Scalar, Variable
from desat.components.contract.units import unit_of

BASE_UNIT_EXPONENTS = ("kg", "m", "s", "A", "K", "rad")
# Name of the project's annotations. They hold: a block's role; the names of a mode's
# values; shared parameters; which parameters or inputs have no effect without an input
# or output; the range of usual values; which output is the mean over a step of a
# quantity whose integral counts, and its slope; which input is read at the start.
TOOL = "desat"
# generationTool of Python FMUs and of native ones
GENERATION_TOOL, NATIVE_TOOL = "desat with PythonFMU", "desat"
# default experiment of a block (s): any step will do
ONE_SECOND = {"startTime": 0.0, "stepSize": 1.0}
# displayUnit of FMI: the unit in which a host may show values
DISPLAY = {"rad": "deg", "rad/s": "deg/s"}
# image of an FMU in hosts: a turning wheel (96 x 96 pixels)
ICON = Path(__file__).with_name("icon.png")
LICENCE = Path(__file__).with_name("license.txt")
# the causalities whose variables have a start value
STARTED = ("input", "parameter")
# the same for all FMUs, so that equal contents give equal files
DATE = "1980-01-01T00:00:00Z"


def title(block: type[Block]) -> str:
    """Return the first line of a block's docstring."""
    return (inspect.getdoc(block) or block.__name__).splitlines()[0]


def model_description(
    block: type[Block],
    identifier: str,
    guid: str,
    date: str,
    version: str,
    sources: Sequence[str] = (),
    depends: Mapping[str, Collection[str]] | None = None,
    experiment: Mapping[str, float] = ONE_SECOND,
) -> bytes:
    """Return the FMI 2.0 model description of a block as UTF-8 XML.

    State outputs have no dependencies. Interval outputs depend on all inputs, or on
    those that `depends` gives. Every output is an initial unknown that depends on the
    parameters and on the inputs it starts from.

    Parameters
    ----------
    block
        Class of the block.
    identifier, guid
        Name and GUID of the FMU.
    date, version
        Generation date and version of the FMU.
    sources
        Names of the C files of a native FMU; an FMU without needs Python in its host.
    depends
        Inputs on which each interval output depends, by output.
    experiment
        startTime, stopTime, stepSize (s), those that are known.
    """
    root = etree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=identifier,
        guid=guid,
        description=title(block),
        version=version,
        generationTool=NATIVE_TOOL if sources else GENERATION_TOOL,
        generationDateAndTime=date,
        variableNamingConvention="structured",
    )
    made_by(root, block)
    simulation = etree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=identifier,
        needsExecutionTool="false" if sources else "true",
        canHandleVariableCommunicationStepSize="true",
        canInterpolateInputs="false",
        canBeInstantiatedOnlyOncePerProcess="false",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    if sources:
        files = etree.SubElement(simulation, "SourceFiles")
        for name in sources:
            etree.SubElement(files, "File", name=name)
    unit_definitions(root, block)
    log_categories(root)
    default_experiment(root, experiment)
    annotations = etree.SubElement(root, "VendorAnnotations")
    tool = etree.SubElement(annotations, "Tool", name=TOOL)
    etree.SubElement(tool, "Block", name=identifier, role=block.role)

    variables = etree.SubElement(root, "ModelVariables")
    index_of: dict[str, list[int]] = {}
    count = 0
    for variable in block.variables:
        for element, start in zip(
            variable.elements(), variable.flat_start(), strict=True
        ):
            _scalar_variable(variables, variable, element, count, start)
            count += 1
            index_of.setdefault(variable.name, []).append(count)

    structure = etree.SubElement(root, "ModelStructure")
    outputs = etree.SubElement(structure, "Outputs")
    initial = etree.SubElement(structure, "InitialUnknowns")
    for v, on, start_on in unknowns(block, depends):
        now, starts_from = (
            sorted(i for name in names for i in index_of[name])
            for names in (on, start_on)
        )
        for index in index_of[v.name]:
            _unknown(outputs, index, now)
            _unknown(initial, index, starts_from)
    return bytes(
        etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    )


def unknowns(
    block: type[Block], depends: Mapping[str, Collection[str]] | None = None
) -> Iterator[tuple[Variable, list[str], list[str]]]:
    """Yield each output with its dependencies in a step and at the start.

    `depends` is as in `model_description`.
    """
    inputs = [v.name for v in block.variables if v.causality == "input"]
    parameters = [v.name for v in block.variables if v.causality == "parameter"]
    for v in block.variables:
        if v.causality == "output":
            on = (
                inputs
                if depends is None
                else [n for n in inputs if n in depends.get(v.name, ())]
            )
            yield v, on if v.interval else [], [*parameters, *v.starts_from]


def _unknown(parent: Any, index: int, dependencies: list[int]) -> None:
    """Add an unknown with the indices that it depends on."""
    etree.SubElement(
        parent,
        "Unknown",
        index=str(index),
        dependencies=" ".join(map(str, dependencies)),
    )


def _scalar_variable(
    parent: Any, v: Variable, name: str, reference: int, start: Any
) -> None:
    """Add a scalar variable, one element of a block's variable."""
    attributes = {"name": name, "valueReference": str(reference), **common(v)}
    element = etree.SubElement(parent, "ScalarVariable", attributes)
    value = etree.SubElement(element, v.type)
    if v.type == "Real":
        for key, unit in units_of(v).items():
            value.set(key, unit)
    for key, bound in (("min", v.minimum), ("max", v.maximum)):
        if bound is not None:
            value.set(key, repr(bound))
    if size := nominal(v):
        value.set("nominal", size)
    if v.causality in STARTED:
        value.set("start", start_value(start))
    if note := annotation(v, name):
        tool = etree.SubElement(
            etree.SubElement(element, "Annotations"), "Tool", name=TOOL
        )
        etree.SubElement(tool, "Variable", note)


def units_of(v: Variable) -> dict[str, str]:
    """Return the unit of a Real, and its display unit where that differs."""
    return {"unit": v.unit} | (
        {"displayUnit": DISPLAY[v.unit]} if v.unit in DISPLAY else {}
    )


def nominal(v: Variable) -> str:
    """Return the usual size of a Real for XML; empty where it is not known."""
    size = max(map(abs, v.usual), default=0.0) if v.usual else 0.0
    return repr(float(size)) if v.type == "Real" and 0.0 < size < inf else ""


def start_value(x: Scalar) -> str:
    """Format a start value for XML."""
    return str(x).lower() if isinstance(x, bool) else repr(x)


def common(v: Variable) -> dict[str, str]:
    """Return the attributes that a variable has both in FMI 2.0 and in FMI 3.0."""
    attributes = {
        "description": describe(v),
        "causality": v.causality,
        "variability": "fixed"
        if v.causality == "parameter"
        else "continuous"
        if v.type == "Real"
        else "discrete",
    }
    is_calculated = v.causality not in STARTED
    return attributes | ({"initial": "calculated"} if is_calculated else {})


def annotation(v: Variable, name: str) -> dict[str, str]:
    """Return the annotation of a variable, or of its element `name`.

    It is empty for most variables.
    """
    entries = {
        "choices": " ".join(v.choices),
        "shared": "true" if v.shared else "",
        "follows": v.follows,
        "initial": "true" if v.initial else "",
        "mean": "true" if v.mean else "",
        "slope": name.replace(v.name, v.slope, 1) if v.slope else "",
        "neededBy": " ".join(v.needed_by),
        "usual": " ".join(map(repr, v.usual or ())),
    }
    return {key: text for key, text in entries.items() if text}


def describe(v: Variable) -> str:
    """Return the description of a variable, with the names of a mode's values."""
    if not v.choices:
        return v.description
    return f"{v.description}: " + ", ".join(
        f"{i} = {name}" for i, name in enumerate(v.choices) if name != "-"
    )


def made_by(root: Any, block: type[Block]) -> None:
    """Add author and license to the FMU of a block or loop of the project only."""
    if _is_ours(block):
        root.set("author", "the desat authors")
        root.set("license", "MIT")


def licence(block: type[Block]) -> dict[str, bytes]:
    """Return the member of an FMU with its license, for one of the project only."""
    member = "documentation/licenses/license.txt"
    return {member: LICENCE.read_bytes()} if _is_ours(block) else {}


def _is_ours(block: type[Block]) -> bool:
    """Return whether a block is of the project, or made of its blocks."""
    return block.__module__.startswith(("desat.components.", "desat.export."))


def unit_definitions(root: Any, block: type[Block]) -> None:
    """Add the units of a block's variables, in the form of both FMI versions."""
    definitions = etree.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(v.unit for v in block.variables if v.type == "Real"):
        unit = unit_of(name)
        element = etree.SubElement(definitions, "Unit", name=name)
        base = etree.SubElement(element, "BaseUnit")
        for exponent in BASE_UNIT_EXPONENTS:
            if getattr(unit, exponent):
                base.set(exponent, str(getattr(unit, exponent)))
        if unit.factor != 1.0:
            base.set("factor", repr(unit.factor))
        if display_unit := DISPLAY.get(name):
            factor = repr(unit.factor / unit_of(display_unit).factor)
            etree.SubElement(element, "DisplayUnit", name=display_unit, factor=factor)


def log_categories(root: Any) -> None:
    """Add the category that the messages of an FMU have."""
    categories = etree.SubElement(root, "LogCategories")
    etree.SubElement(
        categories, "Category", name="logStatusError", description="Failures"
    )


def default_experiment(root: Any, experiment: Mapping[str, float]) -> None:
    """Add startTime, stopTime and stepSize (s), those that are known."""
    times = {k: repr(v).removesuffix(".0") for k, v in experiment.items()}
    etree.SubElement(root, "DefaultExperiment", times)


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<title>{{ name }}</title>
<style>body{font:15px/1.5 sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.2rem .5rem;text-align:left;
vertical-align:top}pre{background:#f4f4f4;padding:.6rem}</style></head><body>
<p>desat block <code>{{ name }}</code>{% if role %}, role <code>{{ role }}</code>{% endif %}</p>
{{ text }}
{% for causality, rows in tables %}
<h2>{{ causality }}</h2>
<table><tr><th>name<th>unit<th>start<th>bounds<th>meaning</tr>
{% for v in rows %}<tr><td><code>{{ v.name }}{{ v.dims }}</code><td>{{ v.unit }}<td>{{ v.start }}
<td>{{ v.bounds }}<td>{{ v.text }}</tr>
{% endfor %}</table>
{% endfor %}
<p>Frames: eci; lvlh (z to nadir, y to minus orbit normal); body. v_body = C(q_bi) v_eci, scalar
last. A state output belongs to the communication point, an interval output to the step just
made. SI units.</p>
</body></html>
"""


def documentation(block: type[Block], identifier: str) -> str:
    """Return the block's page as self-contained HTML: docstring and variables."""
    # imported here because every command loads this module and few build FMUs
    from jinja2 import Environment
    from markdown_it import MarkdownIt
    from markupsafe import Markup

    first, _, rest = (inspect.getdoc(block) or "").partition("\n")
    text = MarkdownIt().enable("table").render(f"# {first}\n{rest}")
    tables = [
        (heading, [_row(v) for v in block.variables if v.causality == causality])
        for heading, causality in (
            ("Inputs", "input"),
            ("Outputs", "output"),
            ("Parameters", "parameter"),
        )
    ]
    page = Environment(autoescape=True).from_string(_PAGE)
    return page.render(
        name=identifier, role=block.role, text=Markup(text), tables=tables
    )


def _row(v: Variable) -> dict[str, str]:
    """Return the cells of a variable's row in the page."""
    bounds = ""
    if v.minimum is not None or v.maximum is not None:
        low = "-inf" if v.minimum is None else f"{v.minimum:g}"
        high = "inf" if v.maximum is None else f"{v.maximum:g}"
        bounds = f"{low} to {high}"
    if v.usual:
        bounds += f"{', ' if bounds else ''}usually {v.usual[0]:g} to {v.usual[1]:g}"
    kind = ", interval" if v.interval else ", state" if v.causality == "output" else ""
    return {
        "name": v.name,
        "dims": "".join(f"[{n}]" for n in v.shape),
        "unit": v.unit,
        "start": "" if v.causality == "output" else start_text(v),
        "bounds": bounds,
        "text": describe(v) + kind,
    }


def start_text(v: Variable) -> str:
    """Format the start value for readers: a choice's name, or numbers."""
    if v.choices and isinstance(v.start, int):
        return v.choices[v.start]
    flat = v.flat_start()
    if len(set(flat)) == 1:
        return _number(flat[0])
    return json.dumps(
        [float(_number(x)) if not isinstance(x, bool) else x for x in flat]
    )


def _number(x: Any) -> str:
    """Format a number with six digits, or a truth value."""
    return str(x).lower() if isinstance(x, bool) else f"{x:.6g}"
