"""Draw loop and craft of a system, or of a run from its manifest (`figures/`)."""

from __future__ import annotations

from pathlib import PurePath

from desat.fmus.registry import names

from ..analyses.manifest import Manifest
from ..engine.recording.results import Results
from ..figures.craft import Piece, pieces
from ..figures.diagram import DiagramPart, Wire, diagram
from ..system.interface import (
    base_name,
    interface_of_block,
    is_mean,
    role_classes,
)
from ..system.model import System


def loop_of_system(system: System, around: str | None = None) -> str:
    """Return the diagram of a system as SVG.

    Parameters
    ----------
    system
        Checked system.
    around
        Component to which the diagram is limited, with its neighbours; None: all.
    """
    wires: dict[tuple[str, str, str, str], Wire] = {}
    for c in system.connections:
        if around is not None and around not in (c.source, c.target):
            continue
        ends = (c.source, c.output_array, c.target, c.input_array)
        interface = system.components[c.source].interface
        signal = interface.signals[c.output]
        kind = "state" if signal.output_class == "state" else "sample"
        if signal.mean or is_mean(c.series):
            kind = "mean"
        wires[ends] = Wire(*ends, signal.unit_name, kind)
    wire_ends = {end for w in wires.values() for end in (w.source, w.target)}
    parts = {
        name: _part(c.interface.role)
        for name, c in system.components.items()
        if around is None or name in wire_ends | {around}
    }
    title = f"Loop of {system.name}" if around is None else f"{around} of {system.name}"
    return diagram(parts, list(wires.values()), title)


def loop_of_run(manifest: Manifest, results: Results) -> str:
    """Return the diagram of a run as SVG; "" where its manifest has no connections."""
    recorded = set(results.names())
    wires: dict[tuple[str, str, str, str], Wire] = {}
    for target, connection in manifest.connections.items():
        source, _, output = connection["source"].partition(".")
        component, _, variable = target.partition(".")
        ends = (source, base_name(output), component, base_name(variable))
        if ends in wires:  # of another element
            continue
        series = f"{source}.{ends[1]}"
        unit, kind = "", "state"
        if series in recorded:
            unit = results.attribute(series, "unit")
            is_state = results.attribute(series, "class") == "state"
            kind = "state" if is_state else "sample"
        if is_mean(series):
            kind = "mean"
        wires[ends] = Wire(*ends, unit, kind)
    if not wires:
        return ""
    parts = {name: _part(_role_of(manifest, name)) for name in manifest.step_ratio}
    return diagram(parts, list(wires.values()), f"Loop of {manifest.scenario}")


def components_by_role(manifest: Manifest) -> dict[str, str]:
    """Return the component of each role of a run; of several the first by name."""
    names: dict[str, str] = {}
    for name in sorted(manifest.step_ratio):
        if role := _role_of(manifest, name):
            names.setdefault(role, name)
    return names


# roles whose parameters give the shape of a craft
SHAPED = ("spacecraft", "wheels", "torquers", "thrusters")


def craft_of_run(manifest: Manifest) -> list[Piece]:
    """Return the parts of a run's craft; none without a spacecraft of ours."""
    roles = components_by_role(manifest)
    values = {r: manifest.values_of(roles[r]) for r in SHAPED if r in roles}
    return pieces(**values) if "spacecraft" in values else []


def craft_of_system(system: System) -> list[Piece]:
    """Return the parts of a system's craft; none without a spacecraft of ours."""
    values = {r: system.roles[r].values for r in SHAPED if r in system.roles}
    return pieces(**values) if "spacecraft" in values else []


def _part(role: str) -> DiagramPart:
    """Return a component's role with its title."""
    declared = role_classes().get(role)
    return DiagramPart(role, declared.role_title.partition(":")[0] if declared else "")


def _role_of(manifest: Manifest, component: str) -> str:
    """Return the role of a run's component; "" where its FMU is not ours."""
    fmu = manifest.fmus.get(component)
    model = PurePath(fmu["source"]).stem if fmu else component
    if model in names():
        return interface_of_block(model).role
    return component if component in role_classes() else ""
