"""Run a system of the suite in a host; each returns the numbers at the end."""

from __future__ import annotations

import ctypes
import sysconfig
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import fmpy

import desat

from .files import System, Variable

CALL_LIMIT = 2.0  # s: of a call in our own run
Numbers = dict[str, float]


def _outputs(system: System) -> Iterator[tuple[str, str, Variable]]:
    """Yield name, component and variable of each number that is expected."""
    for component in system.components:
        for variable in component.variables:
            name = f"{component.name}.{variable.name}"
            if name in system.numbers:
                yield name, component.name, variable


def by_desat(system: System, path: Path) -> Numbers:
    """Run in our own master; a run that does not complete raises its message."""
    run = desat.run(
        str(path), stop=system.stop, step=1.0, call_limit=CALL_LIMIT, isolate="foreign"
    )
    if run.manifest.status != "completed":
        raise RuntimeError(run.manifest.message)
    series = run.results.names()
    numbers = {}
    for name in system.numbers:
        base, _, index = name.rpartition("[")
        if name in series:
            numbers[name] = float(run.results.values(name)[-1])
        else:
            numbers[name] = float(run.results.values(base)[-1][int(index[:-1]) - 1])
    return numbers


def by_fmpy(system: System, path: Path) -> Numbers:
    """Run in fmpy.ssp, and the FMU of a lone component in fmpy itself, validated."""
    if len(system.components) > 1 or system.inside or system.components[0].inside:
        from fmpy.ssp.simulation import simulate_ssp

        rows = simulate_ssp(str(path), stop_time=system.stop, step_size=1.0)
        return {name: float(rows[name][-1]) for name in system.numbers}
    (component,) = system.components
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(path) as archive:
            fmu = archive.extract(f"resources/{component.name}.fmu", folder)
        rows = fmpy.simulate_fmu(
            fmu, stop_time=system.stop, step_size=1.0, output_interval=1.0
        )
    numbers = {}
    for name in system.numbers:
        base, _, index = name.partition(".")[2].partition("[")
        value = rows[base][-1]
        numbers[name] = float(value[int(index[:-1]) - 1] if index else value)
    return numbers


def by_libcosim(system: System, path: Path) -> Numbers:
    """Run in libcosim, by its Python interface."""
    from libcosimpy._internal import get_last_error_message
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    try:
        execution = CosimExecution.from_ssp_file(str(path))
    except AssertionError:
        raise RuntimeError(get_last_error_message()) from None
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for _ in range(int(system.stop)):
        if not execution.step():
            raise RuntimeError(get_last_error_message())
    places = {i.name.decode(): i.index for i in execution.slave_infos()}
    read = {
        "Real": observer.last_real_values,
        "Boolean": observer.last_boolean_values,
    }
    numbers = {}
    for name, component, variable in _outputs(system):
        values = read.get(variable.type, observer.last_integer_values)
        numbers[name] = float(values(places[component], [variable.reference])[0])
    return numbers


def by_ecos(system: System, path: Path) -> Numbers:
    """Run in Ecos, by its Python interface."""
    site = Path(sysconfig.get_paths()["purelib"])
    for library in [*site.glob("../../libtbb.so.12"), *site.glob("*/libtbb.so.12")]:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation

    with EcosSimulation(ssp_path=str(path), step_size=1.0) as simulation:
        simulation.init(parameter_set="p")
        simulation.step(int(system.stop))
        read = {"Real": simulation.get_real, "Boolean": simulation.get_bool}
        numbers = {}
        for name, component, variable in _outputs(system):
            value = read.get(variable.type, simulation.get_integer)
            numbers[name] = float(value(f"{component}::{variable.name}"))
    return numbers


HOSTS: dict[str, Callable[[System, Path], Numbers]] = {
    "desat": by_desat,
    "FMPy": by_fmpy,
    "libcosim": by_libcosim,
    "Ecos": by_ecos,
}
PACKAGES = {
    "desat": "desat",
    "FMPy": "fmpy",
    "libcosim": "libcosimpy",
    "Ecos": "ecospy",
}


def is_for(host: str, system: System) -> bool:
    """Return whether a host knows the FMI version of a system's components."""
    lone = len(system.components) == 1
    reads_3 = host == "desat" or (host == "FMPy" and lone)
    return reads_3 or system.version == "2.0"
