"""Write FMUs of FMI 3.0 by repacking native FMUs of FMI 2.0.

The library of a native FMU implements both versions (c/fmi3.c), so nothing is compiled
again. Arrays are arrays, modes and choices are enumerations, and the inputs that a
block usually takes from another form a terminal.
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
    STARTED,
    TOOL,
    annotation,
    common,
    default_experiment,
    log_categories,
    made_by,
    nominal,
    start_value,
    title,
    unit_definitions,
    units_of,
    unknowns,
)
from .native import pack

# platforms of FMI 2.0 that FMI 3.0 names otherwise
PLATFORMS = {
    "linux64": ("x86_64-linux",),
    "linux32": ("x86-linux",),
    "win64": ("x86_64-windows",),
    "win32": ("x86-windows",),
    "darwin64": ("x86_64-darwin", "aarch64-darwin"),
}
_TYPE = {"Real": "Float64", "Integer": "Int64", "Boolean": "Boolean"}


def repack(
    native: Path,
    block: type[Block],
    target: Path,
    depends: Mapping[str, Collection[str]] | None = None,
    experiment: Mapping[str, float] = ONE_SECOND,
) -> Path:
    """Write a native FMU (FMI 2.0) of a block as one of FMI 3.0; return its path.

    `depends` and `experiment` are as in `description.model_description` and must be
    those of the FMI 2.0 one.
    """
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
        for fmi3_platform in PLATFORMS.get(platform, (platform,)):
            members[f"binaries/{fmi3_platform}/{library}"] = data
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
    """Return the FMI 3.0 model description of a block as UTF-8 XML.

    The value reference of an array is that of its first element in FMI 2.0; time has
    the one after the last.
    """
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
            dependencies = " ".join(sorted((references[name] for name in on), key=int))
            etree.SubElement(
                structure,
                kind,
                valueReference=references[v.name],
                dependencies=dependencies,
            )
    if block.role:
        _annotate(root, "Block", {"name": identifier, "role": block.role})
    return _xml(root)


def _xml(root: Any) -> bytes:
    """Return an XML tree as UTF-8 bytes."""
    return bytes(
        etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    )


def _annotate(parent: Any, text: str, attributes: dict[str, str]) -> None:
    """Add an annotation of the project to an element."""
    element = etree.SubElement(
        etree.SubElement(parent, "Annotations"), "Annotation", type=TOOL
    )
    etree.SubElement(element, text, attributes)


def _variable(parent: Any, v: Variable, reference: int) -> None:
    """Add a variable, with its dimensions."""
    attributes = {"name": v.name, "valueReference": str(reference), **common(v)}
    if v.choices:
        attributes["declaredType"] = v.name
    if v.type == "Real":
        attributes |= units_of(v)
        attributes |= {"nominal": nominal(v)} if nominal(v) else {}
    if not v.choices:
        for key, bound in (("min", v.minimum), ("max", v.maximum)):
            if bound is not None:
                attributes[key] = repr(bound)
    if v.causality in STARTED:
        attributes["start"] = " ".join(map(start_value, v.flat_start()))
    element = etree.SubElement(
        parent, "Enumeration" if v.choices else _TYPE[v.type], attributes
    )
    if note := annotation(v, v.name):
        _annotate(element, "Variable", note)
    for length in v.shape:
        etree.SubElement(element, "Dimension", start=str(length))


def _type_definitions(root: Any, block: type[Block]) -> None:
    """Add an enumeration for each variable that has choices."""
    choice_variables = [v for v in block.variables if v.choices]
    if not choice_variables:
        return
    types = etree.SubElement(root, "TypeDefinitions")
    for v in choice_variables:
        enumeration = etree.SubElement(types, "EnumerationType", name=v.name)
        for value, name in enumerate(v.choices):
            if name != "-":
                etree.SubElement(enumeration, "Item", name=name, value=str(value))


def terminals(block: type[Block]) -> bytes:
    """Return icon and terminals of a block as UTF-8 XML.

    One terminal is that of its role, with all its outputs. There is one more for each
    role that its inputs usually come from; its members have the names of that role's
    outputs. A loop of blocks has no terminals.
    """
    root = etree.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = etree.SubElement(root, "GraphicalRepresentation")
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    etree.SubElement(
        graphics, "CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"}
    )
    etree.SubElement(graphics, "Icon", corners)
    if not block.role:
        return _xml(root)
    members: dict[str, dict[str, str]] = {block.role: {}}
    for v in block.variables:
        if v.causality == "output":
            members[block.role][v.name] = v.name
        elif v.causality == "input" and v.source:
            role, _, name = v.source[0].partition(".")
            members.setdefault(role, {}).setdefault(name, v.name)
    terminal_list = etree.SubElement(root, "Terminals")
    for role, names in members.items():
        terminal = etree.SubElement(
            terminal_list,
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
    """Return the description of how the sources are compiled, as UTF-8 XML."""
    root = etree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = etree.SubElement(
        root, "BuildConfiguration", modelIdentifier=identifier
    )
    sources = etree.SubElement(configuration, "SourceFileSet", language="C11")
    for name in files:
        if name.endswith(".c"):
            etree.SubElement(sources, "SourceFile", name=name)
    etree.SubElement(configuration, "Library", name="m", external="true")
    return _xml(root)
