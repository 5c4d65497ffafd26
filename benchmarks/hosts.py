"""`python -m benchmarks.hosts`: every FMU of ours in every host here, into
docs/hosts.md.

Each block, as Python FMU, native FMU, native FMU of Reals alone and FMI 3.0, is set up
with its start values and makes 20 steps of 1 s, alone in a system where a host wants
one. All Real outputs at the end are held against those that FMPy gets of the native
FMU, bit by bit. A host runs in a process of its own; an FMU that ends the process is
told by its name, and the others are tried in a new one. Hosts are those on the path of
Python.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import re
import subprocess
import sys
import tempfile
import zipfile
from collections import defaultdict
from datetime import date
from importlib.metadata import packages_distributions, version
from pathlib import Path
from textwrap import fill
from typing import Any

import fmpy
import numpy as np
from rich.progress import track

from desat.engine.instances.base import DTYPE, Clock
from desat.engine.instances.fmu import FmuInstance
from desat.files import library, paths
from desat.fmus.compiler import NoCompilerError, compiler
from desat.fmus.reals import repack
from desat.fmus.registry import names
from desat.system.interface import KINDS as KINDS_OF
from desat.system.model import Component

STEPS = 20
PAGE = Path(__file__).parents[1] / "docs" / "hosts.md"
BEGIN, END = "<!-- made by `python -m benchmarks.hosts` -->", "<!-- until here -->"
KINDS = {
    "native": "native",
    "reals": "native, Reals alone",
    "fmi3": "FMI 3.0",
    "python": "Python",
}
HOST_C = Path(__file__).parents[1] / "tests" / "host.c"
LIMIT = 600.0
"""s, that one host may take for one kind."""


def files(kind: str, folder: Path) -> list[Path]:
    """Return our FMUs of a kind; those of Reals alone are written into a folder."""
    if kind == "reals":
        return [repack(x, folder / x.name) for x in files("native", folder)]
    return sorted((paths.fmus() / ("" if kind == "python" else kind)).glob("*.fmu"))


# --- what runs in a process of its own: a host, and FMUs whose outputs it prints ------


def by_fmpy(fmu: Path) -> dict[str, float]:
    """All Real outputs at the end; before it the file is validated. Raises what fmpy
    raises."""
    described = fmpy.read_model_description(fmu)
    outputs = [
        v.name
        for v in described.modelVariables
        if v.causality == "output" and v.type in ("Real", "Float64")
    ]
    rows = fmpy.simulate_fmu(
        str(fmu),
        stop_time=float(STEPS),
        step_size=1.0,
        output_interval=1.0,
        output=outputs,
    )
    last = rows[-1]
    return {key: x for n in outputs for key, x in _elements(n, last[n])}


def _elements(name: str, value: Any) -> list[tuple[str, float]]:
    """An array of FMI 3.0 by the names that its elements have in FMI 2.0."""
    shape = getattr(value, "shape", ())
    if not shape:
        return [(name, float(value))]
    places = (
        [(i,) for i in range(shape[0])]
        if len(shape) == 1
        else [(i, j) for i in range(shape[0]) for j in range(shape[1])]
    )
    return [
        (f"{name}[{','.join(str(k + 1) for k in p)}]", float(value[p])) for p in places
    ]


def alone(fmu: Path, folder: Path) -> Path:
    """A system of one component as an .ssp."""
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<ssd:SystemStructureDescription version="1.0" '
        'name="alone" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
        'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"><ssd:System name="alone">'
        f'<ssd:Elements><ssd:Component name="it" source="resources/{fmu.name}"/></ssd:Elements>'
        f'</ssd:System><ssd:DefaultExperiment startTime="0" stopTime="{STEPS}"/>'
        "</ssd:SystemStructureDescription>"
    )
    archive_path = folder / f"{fmu.stem}.ssp"
    with zipfile.ZipFile(archive_path, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        archive.write(fmu, f"resources/{fmu.name}")
    return archive_path


def reals(fmu: Path) -> dict[str, int]:
    """The Real outputs of an FMU of FMI 2.0, and their value references."""
    described = fmpy.read_model_description(fmu, validate=False)
    return {
        v.name: v.valueReference
        for v in described.modelVariables
        if v.causality == "output" and v.type == "Real"
    }


def by_desat(fmu: Path) -> dict[str, float]:
    """Our own calls, those of the Python loop; a system of one component, of which
    nobody takes what it commands, is refused. Raises DesatError."""
    of = library.load(fmu)
    clock = Clock(0.0, 1.0)
    outputs = {k: [s for s in of.interface.outputs if s.kind == k] for k in KINDS_OF}
    into = {k: np.zeros(len(outputs[k]), DTYPE[k]) for k in KINDS_OF}
    it = FmuInstance(Component("it", fmu.name, of.interface), of)
    it.wire({k: [] for k in KINDS_OF}, outputs, into, clock)
    it.enter(0.0, {})
    it.exit()
    for k in range(STEPS):
        clock.t.value = float(k)
        if (status := it.step()) != 0:
            raise it.failed("step", status)
    it.pull()
    it.close()
    return dict(
        zip((s.name for s in outputs["Real"]), map(float, into["Real"]), strict=True)
    )


def by_libcosim(fmu: Path) -> dict[str, float]:
    """libcosim, by its Python interface."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    references = reals(fmu)
    execution = CosimExecution.from_step_size(1_000_000_000)
    execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name="it"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for _ in range(STEPS):
        if not execution.step():
            raise RuntimeError("a step failed")
    (info,) = execution.slave_infos()
    return dict(
        zip(
            references,
            observer.last_real_values(info.index, list(references.values())),
            strict=True,
        )
    )


def by_ecos(fmu: Path) -> dict[str, float]:
    """Ecos, by its Python interface."""
    import ctypes
    import sysconfig

    site = Path(sysconfig.get_paths()["purelib"])
    for found in [*site.glob("../../libtbb.so.12"), *site.glob("*/libtbb.so.12")]:
        ctypes.CDLL(str(found), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation

    with (
        tempfile.TemporaryDirectory() as folder,
        EcosSimulation(ssp_path=str(alone(fmu, Path(folder))), step_size=1.0) as it,
    ):
        it.init()
        it.step(STEPS)
        return {name: it.get_real(f"it::{name}") for name in reals(fmu)}


def starts(fmu: Path) -> dict[str, float]:
    """Return the start values of the inputs of an FMU, which some hosts set to 0."""
    description = fmpy.read_model_description(fmu, validate=False)
    return {
        v.name: float({"true": 1, "false": 0}.get(v.start, v.start))
        for v in description.modelVariables
        if v.causality == "input"
    }


def by_opensvf(fmu: Path) -> dict[str, float]:
    """Step an FMU as an equipment of opensvf."""
    from svf.core.fmu_equipment import FmuEquipment
    from svf.ground.shm_sync import SharedMemorySyncProtocol
    from svf.sim.simulation import SimulationMaster
    from svf.sim.software_tick import SoftwareTickSource
    from svf.stores.parameter_store import ParameterStore

    sync = SharedMemorySyncProtocol(["it"])
    equipment = FmuEquipment(fmu, "it", sync, ParameterStore())
    for name, value in starts(fmu).items():
        equipment.receive(name, value)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        SimulationMaster(
            SoftwareTickSource(), sync, [equipment], dt=1.0, stop_time=float(STEPS)
        ).run()  # which writes results/seed.json
    return {name: equipment.read_port(name) for name in reals(fmu)}


def by_pathsim(fmu: Path) -> dict[str, float]:
    """Step an FMU as a block of PathSim."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Constant
    from pathsim_fmi import CoSimulationFMU

    block = CoSimulationFMU(str(fmu), dt=1.0)
    sources = {name: Constant(value) for name, value in starts(fmu).items()}
    links = [Connection(source, block[name]) for name, source in sources.items()]
    simulation = Simulation([block, *sources.values()], links, dt=1.0, log=False)
    simulation.run(STEPS - 1.0)  # its last step is made at the end
    return {name: float(block.outputs[name]) for name in reals(fmu)}


def by_cofmupy(fmu: Path) -> dict[str, float]:
    """Step an FMU by the coordinator of CoFmuPy."""
    from cofmupy import Coordinator

    coordinator = Coordinator()
    one = {"id": "it", "path": str(fmu), "initialization": starts(fmu)}
    coordinator.start({"fmus": [one], "connections": []})
    for _ in range(STEPS):
        coordinator.do_step(1.0)
    return {name: coordinator.get_variable(("it", name))[0] for name in reals(fmu)}


def by_c(fmu: Path) -> None:
    """A plain C host in an empty environment: it steps, saves, restores and frees."""
    described = fmpy.read_model_description(fmu, validate=False)
    with tempfile.TemporaryDirectory() as folder:
        host = Path(folder) / "host"
        subprocess.run(
            [*compiler(), "-std=gnu11", "-w", str(HOST_C), "-ldl", "-o", str(host)],
            check=True,
        )
        fmpy.extract(fmu, folder)
        (library,) = Path(folder).glob("binaries/*linux*/*.so")
        done = subprocess.run(
            ["/usr/bin/env", "-i", str(host), str(library), described.guid],
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode != 0:
        messages = (done.stdout + done.stderr).strip().splitlines() or [
            f"ended by {done.returncode}"
        ]
        raise RuntimeError(messages[0].rpartition(": ")[2])


HOSTS = {
    "C": by_c,
    "FMPy": by_fmpy,
    "libcosim": by_libcosim,
    "Ecos": by_ecos,
    "opensvf": by_opensvf,
    "PathSim": by_pathsim,
    "CoFmuPy": by_cofmupy,
    "desat": by_desat,
}
NOT_FOR = {
    ("C", "fmi3"): "FMI 2.0 alone",
    ("libcosim", "fmi3"): "FMI 1.0 and 2.0 alone",
    ("Ecos", "fmi3"): "FMI 1.0 and 2.0 alone",
    ("opensvf", "fmi3"): "FMI 2.0 alone",
    ("PathSim", "fmi3"): "no arrays",
    ("CoFmuPy", "fmi3"): "no arrays",
}
NEEDS = {
    "libcosim": "libcosimpy",
    "Ecos": "ecospy",
    "opensvf": "svf",
    "PathSim": "pathsim_fmi",
    "CoFmuPy": "cofmupy",
}


def child(host: str, fmus: list[str]) -> None:
    """In the process of a host: a line for each FMU."""
    for name in fmus:
        try:
            outcome: dict[str, Any] = {"outputs": HOSTS[host](Path(name))}
        except Exception as error:  # whatever a host raises is what is told
            outcome = {
                "why": (str(error).strip().splitlines() or [type(error).__name__])[0]
            }
        print("TOLD " + json.dumps({"fmu": name, **outcome}), flush=True)


def tried(host: str, fmus: list[Path]) -> dict[str, Any]:
    """What a host makes of FMUs, by name."""
    outcomes: dict[str, Any] = {}
    remaining_fmus = [str(p) for p in fmus]
    while remaining_fmus:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.hosts", "--host", host, *remaining_fmus],
            capture_output=True,
            text=True,
            check=False,
            timeout=LIMIT,
        )
        lines = [
            json.loads(x[5:]) for x in done.stdout.splitlines() if x.startswith("TOLD ")
        ]
        for line in lines:
            outcomes[Path(line.pop("fmu")).stem] = line
        remaining_fmus = remaining_fmus[len(lines) :]
        if remaining_fmus:
            outcomes[Path(remaining_fmus.pop(0)).stem] = {
                "why": f"ends the process ({done.returncode})"
            }
    return outcomes


# --- the table ------------------------------------------------------------------------


def main() -> None:
    """Try all and write the table into the page."""
    if sys.argv[1:2] == ["--host"]:
        child(sys.argv[2], sys.argv[3:])
        return
    with tempfile.TemporaryDirectory() as folder:
        make_table({kind: files(kind, Path(folder)) for kind in KINDS})


def make_table(fmus: dict[str, list[Path]]) -> None:
    """Try FMUs, by their kinds, in all hosts and write the table into the page."""
    rows, failures = [], defaultdict(list)
    usual = tried("FMPy", fmus["native"])
    cells = [(kind, host) for kind in KINDS for host in HOSTS]
    found: dict[tuple[str, str], str] = {}
    for kind, host in track(
        cells, "hosts", transient=True, disable=not sys.stderr.isatty()
    ):
        if reason := NOT_FOR.get((host, kind)) or _missing(host):
            found[kind, host] = reason
            continue
        outcomes = tried(host, fmus[kind])
        alike = 0
        for name, line in outcomes.items():
            if "why" in line:
                failures[
                    host, kind, re.sub(r"\b" + name + r"\b", "NAME", line["why"])
                ].append(name)
            elif (
                line["outputs"] is None
                or name not in usual
                or same(line["outputs"], usual[name])
            ):
                alike += 1
            else:
                failures[host, kind, "other values"].append(name)
        found[kind, host] = f"{alike} of {len(outcomes)}"
    for kind, called in KINDS.items():
        rows.append(
            f"| {called} | " + " | ".join(found[kind, host] for host in HOSTS) + " |"
        )
    failure_lines = [
        f"- {host}, {KINDS[kind]}: {reason}: "
        + (
            ", ".join(block_names)
            if len(block_names) < 6
            else f"{len(block_names)} blocks"
        )
        for (host, kind, reason), block_names in failures.items()
    ]
    write(rows, failure_lines)


def same(some: dict[str, float], others: dict[str, Any]) -> bool:
    """Whether the outputs that both have are equal in every bit, and there are such."""
    both = some.keys() & others.get("outputs", {}).keys()
    return bool(both or not some) and all(some[k] == others["outputs"][k] for k in both)


def _missing(host: str) -> str:
    if host == "C":
        try:
            compiler()
        except NoCompilerError:
            return "no compiler here"
    package = NEEDS.get(host)
    return (
        "not installed here"
        if package and not importlib.util.find_spec(package)
        else ""
    )


def write(rows: list[str], failure_lines: list[str]) -> None:
    """Put the table between its marks on the page."""
    packages = packages_distributions()
    distributions = [packages.get(name) for name in ("fmpy", *NEEDS.values())]
    versions = ", ".join(f"{x[0]} {version(x[0])}" for x in distributions if x)
    table = [
        BEGIN,
        fill(
            f"{date.today()}, {fmpy.platform_tuple}, {versions}: FMUs of {len(names())} blocks "
            f"that are set up with their start values, make {STEPS} steps of 1 s and have, in all "
            "Real outputs, the bits that FMPy gets of the native one, where there is one (C: no "
            "failure; it saves, restores and frees, too; FMPy: validated before).",
            120,
        ),
        "",
        "| FMU | " + " | ".join(HOSTS) + " |",
        "|---" * (len(HOSTS) + 1) + "|",
        *rows,
        "",
        *failure_lines,
        END,
    ]
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    PAGE.write_text(
        before + "\n".join(table) + rest.partition(END)[2], encoding="utf-8"
    )


if __name__ == "__main__":
    main()
