"""The SSD of a craft file, a standard SSP 1.0 file that is committed beside it."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from desat.components.contract.roles import ECI

from ..system.errors import DesatError, nearest
from ..system.model import Component
from ..system.resolve import resolve
from . import craft, ssp
from .scenario import ROOT, families


def craft_files(names: list[str]) -> list[Path]:
    """The craft files of some families, or of all, and those given by their path. Raises
    DesatError for an unknown family."""
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
    """Where the SSD of a craft file belongs."""
    return path.with_name(ssp.FILE if path.name == craft.FILE else f"{craft.stem(path)}.ssd")


def write(path: Path) -> tuple[Path, bool]:
    """Write the SSD of a craft file where it differs: its path, and whether it was written."""
    file, new = target(path), text(path).encode()
    if file.exists() and file.read_bytes() == new:
        return file, False
    file.write_bytes(new)
    return file, True


def text(path: Path) -> str:
    """The SSD of a craft file: one line an element, in the order of the craft file.

    Raises DesatError with everything that is wrong with the file.
    """
    draft = craft.read(path)
    name, title = quoteattr(draft.name), draft.about.get("title", "")
    about = f" description={quoteattr(title)}" if title else ""
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<!-- made by `desat craft` from {path.name.replace('--', '- -')}: change that -->",
        f"<!-- {ECI} -->",
        f'<ssd:SystemStructureDescription xmlns:ssd="{ssp.SSD}" xmlns:ssc="{ssp.SSC}"'
        f' xmlns:ssv="{ssp.SSV}" name={name} version="1.0">',
        f"  <ssd:System name={name}{about}>",
        "    <ssd:Elements>",
    ]
    for component in resolve(draft).components.values():
        lines += _component_lines(component)
    lines += ["    </ssd:Elements>", "    <ssd:Connections>"]
    lines += [
        f"      <ssd:Connection startElement={quoteattr(c.source)}"
        f" startConnector={quoteattr(c.output)} endElement={quoteattr(c.target)}"
        f" endConnector={quoteattr(c.input)}/>"
        for c in draft.connections
    ]
    lines += ["    </ssd:Connections>", "  </ssd:System>"]
    if draft.stop is not None:
        lines.append(
            f'  <ssd:DefaultExperiment startTime="{draft.start!r}" stopTime="{draft.stop!r}"/>'
        )
    return "\n".join([*lines, "</ssd:SystemStructureDescription>"]) + "\n"


def _component_lines(component: Component) -> list[str]:
    lines = [
        f"      <ssd:Component name={quoteattr(component.name)}"
        ' type="application/x-fmu-sharedlibrary" implementation="CoSimulation"'
        f" source={quoteattr(component.source)}>",
        "        <ssd:Connectors>",
        *(
            f"          <ssd:Connector name={quoteattr(c.name)} kind={quoteattr(c.kind)}>"
            f"<ssc:{c.type}/></ssd:Connector>"
            for c in component.connectors.values()
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
