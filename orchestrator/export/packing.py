"""Pack a system as one .ssp for other tools, and write the SSDs of craft files.

What is written is the part of SSP that tools interpret alike (libcosim and Ecos run it
in the tests): one flat system, wired connectors only, one parameter set for each
component, and the step size in annotations.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Collection, Sequence, Set
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from lxml import etree

from desat.components.contract.roles import ECI
from desat.fmus import starts

from ..files import craft, library, paths, ssp
from ..files.completion import complete
from ..files.io import place_of, replace_text
from ..files.scenario import ROOT, Scenario, families
from ..files.ssp import ABOUT, FILE, OMS, OSP, SSC, SSD, SSV
from ..runs.prepare import prepare
from ..system.errors import DesatError, nearest
from ..system.interface import Signal, base_name
from ..system.model import Component, Connection, Fmu, System
from ..system.options import Options


def pack_scenario(
    scenario: Scenario,
    target: Path | None = None,
    force: bool = False,
    fmus: str = "python",
    choose: Callable[[System], System] | None = None,
    tell: Callable[[str], None] = lambda text: None,
    arrays: bool = False,
) -> Path:
    """Check a scenario, write its .ssp and return its path.

    An archive that is newer than all its sources is not written again.

    Parameters
    ----------
    scenario
        The scenario.
    target
        Path of the archive; default: in the folder of packed ones.
    force
        Write in any case.
    fmus
        "python" or "native".
    choose
        Gives a system with `substeps = "auto"` the number that a run would take;
        without it a run of the archive chooses.
    tell
        Called with a line for each thing that other tools interpret differently.
    arrays
        As for `pack`.

    Raises
    ------
    DesatError
        If the scenario has problems; the text lists all.
    """
    folder = (
        paths.packed_folder() / "native" if fmus == "native" else paths.packed_folder()
    )
    folder = folder / "arrays" if arrays else folder
    path = target or folder / f"{scenario.name}.ssp"
    inputs = [
        *(ROOT / scenario.family).rglob("*.toml"),
        *(ROOT / scenario.family).rglob("*.ssd"),
        *paths.fmus().rglob("*.fmu"),
        Path(__file__),
        *(paths.PACKAGE / "files").glob("*.py"),
        *(paths.PACKAGE / "language").glob("*.py"),
    ]
    newest = max(p.stat().st_mtime_ns for p in inputs)
    if not force and path.exists() and path.stat().st_mtime_ns > newest:
        return path
    system, _ = prepare(scenario, Options()).or_raise()
    system = choose(system) if choose is not None else system
    pack(system, path, fmus, arrays)
    for text in otherwise(system):
        tell(f"{scenario.name}: {text}")
    return path


def otherwise(system: System) -> list[str]:
    """Return a line for each thing that other tools interpret differently.

    The archive's description has these lines.
    """
    lines = []
    if slow := [c.name for c in system.components.values() if c.step_ratio > 1]:
        lines.append(
            f"{', '.join(slow)}: slower than the step, by a hint (osp:StepSizeHint) that libcosim "
            "reads and Ecos, for one, does not: it steps them each time"
        )
    if third := [
        c.name for c in system.components.values() if c.interface.fmi == "3.0"
    ]:
        lines.append(
            f"{', '.join(third)}: of FMI 3.0, which masters of FMI 2.0 alone cannot load"
        )
    return lines


def pack(
    system: System, target: Path, fmus: str = "python", arrays: bool = False
) -> None:
    """Write a system as one self-contained .ssp in the universal profile.

    Blocks of the project are packed as Python FMUs, which run on more platforms, or
    where `fmus` is "native" as native ones if there are such. Components that step once
    in several steps get a step-size hint; of the other tools only libcosim reads it.

    With `arrays` it is of SSP 2.0: our FMUs are those of FMI 3.0, and an array has one
    connector with its dimensions and one connection.

    Raises
    ------
    DesatError
        If other tools would misread the system: a connection converts units or values,
        or a component has no file.
    """
    for connection in system.connections:
        if (connection.factor, connection.offset) != (1.0, 0.0):
            raise DesatError(
                f"{system.place}:{connection.line}: {connection} converts its value; other tools "
                "would not, so it cannot be packed"
            )
    connections = (
        _whole_arrays(system) if arrays else list(map(_ends, system.connections))
    )
    wired_ends = {end for pair in connections for end in pair}
    members: dict[str, bytes] = {}
    root = etree.Element(
        f"{{{SSD}}}SystemStructureDescription",
        name=system.name.replace("/", "_"),
        version="2.0" if arrays else "1.0",
        # declared here: libcosim takes a later declaration for content
        nsmap={"ssd": SSD, "ssc": SSC, "ssv": SSV, "osp": OSP, "oms": OMS},
    )
    if lines := otherwise(system):
        root.set("description", "In other tools: " + "; ".join(lines))
    top = _sub(root, "System", name="system")
    elements = _sub(top, "Elements")
    for component in map(system.components.__getitem__, _sources_first(system)):
        if component.fmu is None:
            raise DesatError(
                f"{system.place}: {component.name}: no FMU {component.source}"
            )
        # The component's name: Ecos names instances by file, and noise is keyed by
        # the instance.
        source = f"resources/{component.name}.fmu"
        kind = "fmi3" if arrays else fmus
        members[source] = _started(component, library.of_kind(component.fmu, kind))
        element = _sub(
            elements,
            "Component",
            name=component.name,
            type="application/x-fmu-sharedlibrary",
            implementation="CoSimulation",
            source=source,
        )
        _list_connectors(element, component, wired_ends)
        if component.parameters:
            file = f"resources/{component.name}.ssv"
            members[file] = _parameter_set(component, arrays)
            bindings = _sub(element, "ParameterBindings")
            _sub(bindings, "ParameterBinding", source=file)
        if component.step_ratio > 1:
            annotation = _annotation(element, "com.opensimulationplatform")
            hint = repr(component.step_ratio * system.step)
            etree.SubElement(annotation, f"{{{OSP}}}StepSizeHint", value=hint)
    _list_connections(top, connections)
    _annotate_for_omsimulator(top, system)
    _default_experiment(root, system)
    members[FILE] = _text(root)
    annotations = system.about.as_json() if system.about else {}
    if annotations or system.parts > 1:
        about = {**annotations, "substeps": system.substeps}
        members[ABOUT] = json.dumps(about, indent=1, sort_keys=True).encode()
    _write_archive(members, target)


def _sources_first(system: System) -> list[str]:
    """Return the components, each after those whose values it reads at the start only.

    Hosts that set each FMU once in initialisation mode then give it what it reads.
    """
    sources = {name: [name] for name in system.components}
    for c in system.connections:
        if system.components[c.target].interface.signals[c.input].initial:
            sources[c.target].insert(0, c.source)
    return list(dict.fromkeys(x for name in sources for x in sources[name]))


def _started(component: Component, fmu: Fmu) -> bytes:
    """Return the file of a component's FMU, of ours with the scenario's start values.

    Hosts that read no parameter set start it with them.
    """
    data = fmu.path.read_bytes()
    if fmu.path.is_dir() or not fmu.ours:
        return data
    signals = component.interface.signals
    values = [
        starts.Start(signals[name].kind[0], signals[name].reference, value)
        for name, value in component.parameters.items()
    ]
    if not values:
        return data
    members = starts.members_of(data)
    return starts.pack(starts.with_starts(members, fmu.sha256, values))


_Ends = tuple[tuple[str, str], tuple[str, str]]


def _ends(c: Connection) -> _Ends:
    """Return component and variable at both ends of a connection."""
    return (c.source, c.output), (c.target, c.input)


def _whole_arrays(system: System) -> list[_Ends]:
    """Return the connections, those of the elements of two arrays as one.

    Raises DesatError if an array is wired in part, or its elements in another order.
    """
    suffixes: dict[_Ends, dict[str, str]] = {}
    for c in system.connections:
        ends = (c.source, c.output_array), (c.target, c.input_array)
        output = c.output.removeprefix(c.output_array)
        suffixes.setdefault(ends, {})[c.input.removeprefix(c.input_array)] = output
    for ends, elements in suffixes.items():
        for component, name in ends:
            arrays = system.components[component].interface.arrays
            indices = [s.name.removeprefix(name) for s in arrays[name]]
            if [*elements] != indices or [*elements.values()] != indices:
                raise DesatError(
                    f"{system.place}: {component}.{name}: its elements are not all wired, in "
                    "their order, to one array: pack it without --arrays"
                )
    return list(suffixes)


def _list_connectors(
    element: Any, component: Component, wired_ends: Collection[tuple[str, str]]
) -> None:
    """Add the connectors of a component that connections use."""
    interface = component.interface
    listed = [
        (name, of)
        for name, of in interface.elements.items()
        if (component.name, name) in wired_ends
    ]
    if not listed:  # SSP does not allow an empty list
        return
    places = {signal: i for i, signal in enumerate(interface.signals)}
    connectors = _sub(element, "Connectors")
    for name, of in sorted(listed, key=lambda pair: places[pair[1][0].name]):
        connector = _sub(connectors, "Connector", name=name, kind=of[0].causality)
        is_array = of[0].name != name
        kind = _TYPES_2[of[0].kind] if is_array else of[0].kind
        etree.SubElement(connector, f"{{{SSC}}}{kind}")
        for size in _shape_of(of) if is_array else ():
            etree.SubElement(connector, f"{{{SSC}}}Dimension", size=str(size))


# Types of SSP 1.0 -> those of SSP 2.0.
_TYPES_2 = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean"}


def _shape_of(elements: Sequence[Signal]) -> tuple[int, ...]:
    """Return the shape of an array from the index of its last element."""
    _, _, index = elements[-1].name.removesuffix("]").rpartition("[")
    return tuple(map(int, index.split(",")))


def _list_connections(top: Any, ends: Sequence[_Ends]) -> None:
    """Add the connections of a system."""
    if not ends:
        return
    connections = _sub(top, "Connections")
    for (source, output), (target, into) in ends:
        _sub(
            connections,
            "Connection",
            startElement=source,
            startConnector=output,
            endElement=target,
            endConnector=into,
        )


def _sub(parent: Any, tag: str, /, **attributes: str) -> Any:
    """Add an element of the SSD name space."""
    return etree.SubElement(parent, f"{{{SSD}}}{tag}", attributes)


def _annotation(parent: Any, kind: str) -> Any:
    """Add an annotation of a kind."""
    return etree.SubElement(
        _sub(parent, "Annotations"), f"{{{SSC}}}Annotation", type=kind
    )


def _text(root: Any) -> bytes:
    """Return an XML tree as UTF-8 bytes."""
    return bytes(
        etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    )


def _parameter_set(component: Component, arrays: bool = False) -> bytes:
    """Return the parameter set of a component as XML.

    With `arrays` an array is one parameter, with the values of all its elements.
    """
    root = etree.Element(
        f"{{{SSV}}}ParameterSet",
        name="parameters",
        version="2.0" if arrays else "1.0",
        nsmap={"ssv": SSV, "ssc": SSC},
    )
    parameters = etree.SubElement(root, f"{{{SSV}}}Parameters")
    interface = component.interface
    names = dict.fromkeys(
        base_name(name) if arrays else name for name in component.parameters
    )
    for name in names:
        parameter = etree.SubElement(parameters, f"{{{SSV}}}Parameter", name=name)
        elements = interface.elements[name]
        is_array = elements[0].name != name
        kind = _TYPES_2[elements[0].kind] if is_array else elements[0].kind
        text = " ".join(_value_text(component.values[s.name]) for s in elements)
        element = etree.SubElement(parameter, f"{{{SSV}}}{kind}", value=text)
        for size in _shape_of(elements) if is_array else ():
            etree.SubElement(element, f"{{{SSC}}}Dimension", size=str(size))
    return _text(root)


def _value_text(value: object) -> str:
    """Format a value for a parameter set."""
    return str(value).lower() if isinstance(value, bool) else f"{value!r}".strip("'")


def _annotate_for_omsimulator(top: Any, system: System) -> None:
    """Add the step size for OMSimulator."""
    annotation = _annotation(top, "org.openmodelica")
    oms = etree.SubElement(annotation, f"{{{OMS}}}Annotations")
    information = etree.SubElement(oms, f"{{{OMS}}}SimulationInformation")
    etree.SubElement(
        information,
        f"{{{OMS}}}FixedStepMaster",
        description="oms-ma",
        stepSize=f"{system.step!r}",
    )


def _default_experiment(root: Any, system: System) -> None:
    """Add the times of the experiment, with the step size for OSP."""
    times = {"startTime": repr(system.start), "stopTime": repr(system.stop)}
    experiment = _sub(root, "DefaultExperiment", **times)
    annotation = _annotation(experiment, "com.opensimulationplatform")
    algorithm = etree.SubElement(annotation, f"{{{OSP}}}Algorithm")
    etree.SubElement(
        algorithm,
        f"{{{OSP}}}FixedStepAlgorithm",
        baseStepSize=f"{system.step!r}",
        numWorkerThreads="0",
    )


def _write_archive(members: dict[str, bytes], target: Path) -> None:
    """Write the members of an archive."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in sorted(members.items()):
            info = zipfile.ZipInfo(name)
            info.create_system, info.external_attr = 3, 0o644 << 16
            # There are hundreds of these with the same FMUs: level 6 takes three times as
            # long for 10 % less.
            archive.writestr(info, data, zipfile.ZIP_DEFLATED, compresslevel=1)
    replace_text(target, buffer.getvalue())


# --- The SSD of a craft file, a standard SSP 1.0 file that is committed beside it -----


def craft_files(names: list[str]) -> list[Path]:
    """Return the craft files of some families, or of all, and those given by path.

    Raises
    ------
    DesatError
        If a family is unknown.
    """
    files: list[Path] = []
    for name in names or families():
        if name.endswith(".toml"):
            files.append(Path(name))
        elif name in families():
            files += craft.files(ROOT / name)
        else:
            raise DesatError(f"no family {name}{nearest(name, families())}")
    return files


def target(path: Path) -> Path:
    """Return the path of a craft file's SSD."""
    return path.with_name(
        ssp.FILE if path.name == craft.FILE else f"{craft.stem(path)}.ssd"
    )


def write(path: Path) -> tuple[Path, bool]:
    """Write the SSD of a craft file if it differs.

    Returns its path, and whether it was written.
    """
    file, new = target(path), text(path).encode()
    place_of(file)
    if file.exists() and file.read_bytes() == new:
        return file, False
    replace_text(file, new)
    return file, True


def text(path: Path) -> str:
    """Return the SSD of a craft file: one line an element, in the file's order.

    Raises
    ------
    DesatError
        If the file has problems; the text lists all.
    """
    draft = craft.read(path, Options(blocks=True))
    complete(draft)
    name, title = quoteattr(draft.name), draft.title
    about = f" description={quoteattr(title)}" if title else ""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<!-- made by `desat pack` from {path.name.replace('--', '- -')}: change that -->",
        f"<!-- {ECI} -->",
        f'<ssd:SystemStructureDescription xmlns:ssd="{ssp.SSD}" xmlns:ssc="{ssp.SSC}"'
        f' xmlns:ssv="{ssp.SSV}" name={name} version="1.0">',
        f"  <ssd:System name={name}{about}>",
        "    <ssd:Elements>",
    ]
    wired_ends = {(c.target, c.input) for c in draft.connections}
    wired_ends |= {(c.source, c.output) for c in draft.connections}
    for component in draft.components.values():
        lines += _component_lines(component, wired_ends)
    lines += ["    </ssd:Elements>", "    <ssd:Connections>"]
    lines += [
        f"      <ssd:Connection startElement={quoteattr(c.source)}"
        f" startConnector={quoteattr(c.output)} endElement={quoteattr(c.target)}"
        f" endConnector={quoteattr(c.input)}/>"
        for c in draft.connections
    ]
    lines += ["    </ssd:Connections>", "  </ssd:System>"]
    if draft.stop is not None:
        start, stop = draft.start, draft.stop
        lines.append(
            f'  <ssd:DefaultExperiment startTime="{start!r}" stopTime="{stop!r}"/>'
        )
    return "\n".join([*lines, "</ssd:SystemStructureDescription>"]) + "\n"


def _component_lines(
    component: Component, wired_ends: Set[tuple[str, str]]
) -> list[str]:
    """Return the lines of a component, with the connectors that are wired."""
    interface = component.interface
    lines = [
        f"      <ssd:Component name={quoteattr(component.name)}"
        ' type="application/x-fmu-sharedlibrary" implementation="CoSimulation"'
        f" source={quoteattr(component.source)}>",
        "        <ssd:Connectors>",
        *(
            f"          <ssd:Connector name={quoteattr(s.name)} kind={quoteattr(s.causality)}>"
            f"<ssc:{s.kind}/></ssd:Connector>"
            for s in (*interface.inputs, *interface.outputs)
            if (component.name, s.name) in wired_ends
        ),
        "        </ssd:Connectors>",
    ]
    if component.parameters:
        lines += [
            "        <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>",
            '          <ssv:ParameterSet name="parameters" version="1.0"><ssv:Parameters>',
        ]
        for name, value in component.parameters.items():
            kind = component.interface.signals[name].kind
            number = str(value).lower() if isinstance(value, bool) else repr(value)
            lines.append(
                f"            <ssv:Parameter name={quoteattr(name)}>"
                f'<ssv:{kind} value="{number}"/></ssv:Parameter>'
            )
        lines += [
            "          </ssv:Parameters></ssv:ParameterSet>",
            "        </ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>",
        ]
    return [*lines, "      </ssd:Component>"]
