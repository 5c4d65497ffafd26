"""FMI 3.0: a native FMU packed anew. The library that it has for FMI 2.0 has both faces
(c/fmi3.c), so that nothing is compiled again; arrays are arrays, modes and choices are
enumerations, and what a block usually takes from another is a terminal.
"""

from __future__ import annotations

import zipfile
from collections.abc import Collection, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from lxml import etree

from desat.components.contract.block import Block, Variable

from .description import (
    DATE,
    NATIVE_TOOL,
    ONE_SECOND,
    TOOL,
    annotation,
    common,
    default_experiment,
    log_categories,
    made_by,
    start_value,
    title,
    unit_definitions,
    units_of,
    unknowns,
)
from .native import pack

PLATFORMS = {
    "linux64": ("x86_64-linux",),
    "linux32": ("x86-linux",),
    "win64": ("x86_64-windows",),
    "win32": ("x86-windows",),
    "darwin64": ("x86_64-darwin", "aarch64-darwin"),
}
"""What FMI 3.0 calls the platforms of FMI 2.0; others are called the same."""
_TYPE = {"Real": "Float64", "Integer": "Int64", "Boolean": "Boolean"}


def repack(
    native: Path,
    block: type[Block],
    target: Path,
    depends: Mapping[str, Collection[str]] | None = None,
    experiment: Mapping[str, float] = ONE_SECOND,
) -> Path:
    """Write a native FMU (FMI 2.0) of a block as one of FMI 3.0, and return its path;
    `depends` and `experiment` as in `description.model_description`, as they were for
    that one."""
    with zipfile.ZipFile(native) as archive:
        old = {n: archive.read(n) for n in archive.namelist()}
    root = etree.fromstring(old.pop("modelDescription.xml"))
    identifier, token = str(root.get("modelName")), str(root.get("guid"))
    members = {
        "modelDescription.xml": model_description(
            block, identifier, token, depends, experiment
        )
    }
    for name, data in old.items():
        kind, _, rest = name.partition("/")
        if kind != "binaries":
            members[name] = data
            continue
        platform, _, library = rest.partition("/")
        for called in PLATFORMS.get(platform, (platform,)):
            members[f"binaries/{called}/{library}"] = data
    files = sorted(n.partition("/")[2] for n in members if n.startswith("sources/"))
    members["terminalsAndIcons/icon.png"] = members.pop("model.png")
    members["sources/buildDescription.xml"] = _build_description(identifier, files)
    members["terminalsAndIcons/terminalsAndIcons.xml"] = terminals(block)
    target.parent.mkdir(parents=True, exist_ok=True)
    return pack(members, target)


def model_description(
    block: type[Block],
    identifier: str,
    token: str,
    depends: Mapping[str, Collection[str]] | None,
    experiment: Mapping[str, float],
) -> bytes:
    """The FMI 3.0 model description of a block as UTF-8 XML. An array's value reference
    is that of its first element in FMI 2.0; time has the one after the last."""
    root = etree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=identifier,
        instantiationToken=token,
        description=title(block),
        version=version("desat"),
        generationTool=NATIVE_TOOL,
        generationDateAndTime=DATE,
        variableNamingConvention="structured",
    )
    etree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=identifier,
        needsExecutionTool="false",
        canBeInstantiatedOnlyOncePerProcess="false",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        providesDirectionalDerivatives="false",
        canHandleVariableCommunicationStepSize="true",
    )
    made_by(root, block)
    unit_definitions(root, block)
    _type_definitions(root, block)
    log_categories(root)
    default_experiment(root, experiment)
    variables = etree.SubElement(root, "ModelVariables")
    references: dict[str, str] = {}
    count = 0
    for v in block.variables:
        references[v.name] = str(count)
        _variable(variables, v, count)
        count += v.size
    etree.SubElement(
        variables,
        "Float64",
        name="time",
        valueReference=str(count),
        causality="independent",
        variability="continuous",
        description="time (s)",
    )
    structure = etree.SubElement(root, "ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        for v, now, start in unknowns(block, depends):
            on = now if kind == "Output" else start
            found = " ".join(sorted((references[name] for name in on), key=int))
            etree.SubElement(
                structure, kind, valueReference=references[v.name], dependencies=found
            )
    if block.role:
        _annotate(root, "Block", {"name": identifier, "role": block.role})
    return _xml(root)


def _xml(root: Any) -> bytes:
    return bytes(
        etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    )


def _annotate(parent: Any, what: str, attributes: dict[str, str]) -> None:
    made = etree.SubElement(
        etree.SubElement(parent, "Annotations"), "Annotation", type=TOOL
    )
    etree.SubElement(made, what, attributes)


def _variable(parent: Any, v: Variable, reference: int) -> None:
    attributes = {"name": v.name, "valueReference": str(reference), **common(v)}
    if v.choices:
        attributes["declaredType"] = v.name
    if v.type == "Real":
        attributes |= units_of(v)
    if not v.choices:
        for key, bound in (("min", v.minimum), ("max", v.maximum)):
            if bound is not None:
                attributes[key] = repr(bound)
    if v.causality != "output":
        attributes["start"] = " ".join(map(start_value, v.flat_start()))
    element = etree.SubElement(
        parent, "Enumeration" if v.choices else _TYPE[v.type], attributes
    )
    if note := annotation(v, v.name):
        _annotate(element, "Variable", note)
    for length in v.shape:
        etree.SubElement(element, "Dimension", start=str(length))


def _type_definitions(root: Any, block: type[Block]) -> None:
    chosen = [v for v in block.variables if v.choices]
    if not chosen:
        return
    types = etree.SubElement(root, "TypeDefinitions")
    for v in chosen:
        made = etree.SubElement(types, "EnumerationType", name=v.name)
        for value, name in enumerate(v.choices):
            if name != "-":
                etree.SubElement(made, "Item", name=name, value=str(value))


def terminals(block: type[Block]) -> bytes:
    """Icon and terminals of a block as UTF-8 XML: a terminal of its role, with all its
    outputs, and one of each role that its inputs usually come from, whose members are
    called as that one's outputs are; none for a loop of blocks."""
    root = etree.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    drawn = etree.SubElement(root, "GraphicalRepresentation")
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    etree.SubElement(
        drawn, "CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"}
    )
    etree.SubElement(drawn, "Icon", corners)
    if not block.role:
        return _xml(root)
    members: dict[str, dict[str, str]] = {block.role: {}}
    for v in block.variables:
        if v.causality == "output":
            members[block.role][v.name] = v.name
        elif v.causality == "input" and v.source:
            role, _, name = v.source[0].partition(".")
            members.setdefault(role, {}).setdefault(name, v.name)
    made = etree.SubElement(root, "Terminals")
    for role, names in members.items():
        terminal = etree.SubElement(
            made,
            "Terminal",
            name=role,
            matchingRule="bus",
            terminalKind=f"{TOOL}.{role}",
        )
        for name, variable in names.items():
            etree.SubElement(
                terminal,
                "TerminalMemberVariable",
                variableName=variable,
                memberName=name,
                variableKind="signal",
            )
    return _xml(root)


def _build_description(identifier: str, files: list[str]) -> bytes:
    root = etree.Element("fmiBuildDescription", fmiVersion="3.0")
    made = etree.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    sources = etree.SubElement(made, "SourceFileSet", language="C11")
    for name in files:
        if name.endswith(".c"):
            etree.SubElement(sources, "SourceFile", name=name)
    etree.SubElement(made, "Library", name="m", external="true")
    return _xml(root)
