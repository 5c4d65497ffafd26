"""`make bench`: microseconds per macro step, ours and others in turn, and what commands
cost, into benchmarks/latest.json.

Every measurement is a process of its own; the tools take turns, so that a slow spell of
the machine hits all of them; medians over the rounds are written.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.progress import track

from desat.engine.ending import NEVER
from desat.engine.loop import run, stepping
from desat.engine.master import Master
from desat.engine.operations import Call
from desat.engine.recording.recorder import Recorder
from desat.engine.recording.results import SERIES
from desat.export.packing import pack_scenario
from desat.files import paths
from desat.files.scenario import find
from desat.runs.run import Options, prepare
from desat.system.choices import Loop
from desat.system.interface import KINDS

from . import campaign, commands, plants, scaling

HERE = Path(__file__).parent
LATEST = HERE / "latest.json"
ROUNDS = 5
BASILISK = HERE.parent / ".venv-basilisk" / "bin" / "python"


# --- one measurement, in its own process ----------------------------------------------


def _master(path: str, blocks: bool, watched: bool = False) -> Master:
    system, schedule = prepare(path, Options(blocks=blocks)).or_raise()
    master = Master(system, schedule, watched=lambda c, s: watched)
    master.initialise()
    return master


def _timed(master: Master, steps: int, loop: Loop = "compiled") -> float:
    """Microseconds a step, nothing recorded; the first 200 are left out."""
    stepper = stepping(master, None, NEVER, loop)
    for many in (200, steps):
        until, began = master.k + many, time.perf_counter()
        while master.k < until:
            stepper.some(until - master.k)
    return 1e6 * (time.perf_counter() - began) / steps


def desat(path: str, steps: int) -> dict[str, Any]:
    """Our master on the FMUs."""
    with _master(path, blocks=False) as master:
        return {"us": _timed(master, steps)}


def blocks(path: str, steps: int) -> dict[str, Any]:
    """Our master on the bare blocks of the scenario that the file was packed from."""
    file = Path(path)
    with _master(
        f"{file.parent.name}/{file.name.partition('.')[0]}", blocks=True
    ) as master:
        return {"us": _timed(master, steps)}


def libcosim(path: str, steps: int) -> dict[str, Any]:
    """libcosim on the same file; its base step is the file's."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_ssp_file(path)
    execution.step(200)
    began = time.perf_counter()
    execution.step(steps)
    return {"us": 1e6 * (time.perf_counter() - began) / steps}


def fmpy(path: str, steps: int) -> dict[str, Any]:
    """The loop one writes first: fmpy's own calls, a dictionary of values, jacobi."""
    import fmpy as fmpy_package
    from fmpy.fmi2 import FMU2Slave

    system, _ = prepare(path, Options()).or_raise()
    fmus: dict[str, Any] = {}
    for c in system.components.values():
        assert c.fmu is not None
        folder = c.fmu.folder
        description = fmpy_package.read_model_description(folder)
        fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=c.name,
        )
        fmu.instantiate()
        fmus[c.name] = fmu
        for name, value in c.parameters.items():
            signal = c.interface.signals[name]
            getattr(fmu, f"set{signal.kind}")([signal.reference], [value])
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()

    def of_kind(
        name: str, connectors: Iterable[str], kind: str
    ) -> list[tuple[str, int]]:
        signals = system.components[name].interface.signals
        return [
            (c, signals[c].reference) for c in connectors if signals[c].kind == kind
        ]

    outputs = {
        n: sorted({c.output for c in system.connections if c.source == n}) for n in fmus
    }
    sources = {(c.target, c.input): (c.source, c.output) for c in system.connections}
    inputs = {n: [i for target, i in sources if target == n] for n in fmus}
    gets, sets = [], []
    for n, fmu in fmus.items():
        for kind in KINDS:
            if found := of_kind(n, outputs[n], kind):
                keys, references = zip(*(((n, c), r) for c, r in found), strict=True)
                gets.append((getattr(fmu, f"get{kind}"), keys, list(references)))
            if found := of_kind(n, inputs[n], kind):
                keys, references = zip(
                    *((sources[n, c], r) for c, r in found), strict=True
                )
                sets.append((getattr(fmu, f"set{kind}"), keys, list(references)))
    values: dict[tuple[str, str], Any] = {}

    def read() -> None:
        for get, keys, references in gets:
            values.update(zip(keys, get(references), strict=True))

    def write() -> None:
        for put, keys, references in sets:
            put(references, [values[key] for key in keys])

    for _ in range(len(fmus)):
        read()
        write()
    for fmu in fmus.values():
        fmu.exitInitializationMode()
    k, step = 0, system.step
    assert step is not None

    def advance() -> None:
        nonlocal k
        write()
        for fmu in fmus.values():
            fmu.doStep(k * step, step)
        read()
        k += 1

    for _ in range(200):
        advance()
    began = time.perf_counter()
    for _ in range(steps):
        advance()
    result = 1e6 * (time.perf_counter() - began) / steps
    for fmu in fmus.values():
        fmu.dll.finalizePythonInterpreter()
    return {"us": result}


def day(path: str, steps: int) -> dict[str, Any]:
    """So many steps of a scenario from its start, nothing recorded."""
    with _master(path, blocks=False) as master:
        stepper, began = stepping(master, None), time.perf_counter()
        while master.k < steps:
            stepper.some(steps - master.k)
        seconds = time.perf_counter() - began
    return {
        "wall_seconds": round(seconds, 3),
        "us_per_step": round(1e6 * seconds / steps, 2),
    }


def recorded(path: str, steps: int, loop: Loop = "compiled") -> dict[str, Any]:
    """So many steps of a scenario from its start, all outputs recorded in a file."""
    with (
        _master(path, blocks=False, watched=True) as master,
        TemporaryDirectory() as folder,
    ):
        stepper_of = partial(stepping, master, ending=NEVER, loop=loop)
        began = time.perf_counter()
        recorder = Recorder(Path(folder) / SERIES, master)
        stepper = stepper_of(recorder)
        assert stepper.name == loop, stepper.reason
        run(master, stepper, steps, recorder)
        recorder.finish(master).close()
        seconds = time.perf_counter() - began
    return {"us": 1e6 * seconds / steps}


def command(path: str, steps: int) -> dict[str, Any]:
    """The whole of `desat run`, which a user types: wall and processor seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with TemporaryDirectory() as folder:
        began = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "desat.cli", "run", path, "--out", f"{folder}/run"],
            check=True,
            capture_output=True,
        )
        seconds = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"seconds": seconds, "cpu_seconds": cpu}


def shares(path: str, steps: int) -> dict[str, Any]:
    """Where our microseconds go, in the loop in Python: the calls of each component,
    and the loop itself."""
    with _master(path, blocks=False) as master:
        clock, spent = time.perf_counter, {name: [0.0, 0.0] for name in master.members}

        def wrapped(
            call: Callable[[], int], cell: list[float], kind: int
        ) -> Callable[[], int]:
            def timed() -> int:
                began = clock()
                result = call()
                cell[kind] += clock() - began
                return result

            return timed

        full = _timed(master, steps, "python")
        for call in _calls(master):
            cell = spent[call.instance.name]
            call.call = wrapped(call.call, cell, int(call.verb == "step"))
        _timed(master, steps, "python")
        total = steps + 200
        parts = {n: round(1e6 * sum(cell) / total, 2) for n, cell in spent.items()}
        steps_alone = {n: round(1e6 * cell[1] / total, 2) for n, cell in spent.items()}
        return {
            "us": full,
            "us_per_component": parts,
            "of_which_in_do_step": steps_alone,
        }


def memory(path: str, steps: int) -> dict[str, Any]:
    """Resident memory (MiB) after a tenth and after all of the steps."""
    page = resource.getpagesize()

    def resident() -> float:
        return int(Path("/proc/self/statm").read_text().split()[1]) * page / 2**20

    with _master(path, blocks=False) as master:
        stepper = stepping(master, None)
        while master.k < steps // 10:
            stepper.some(steps // 10 - master.k)
        early = resident()
        while master.k < steps:
            stepper.some(steps - master.k)
        return {
            "steps": steps,
            "mib_after_a_tenth": early,
            "mib_at_the_end": resident(),
        }


def law(path: str, runs: int, *sets: str) -> dict[str, Any]:
    """One manager FMU's updates in so many runs of 60 samples: microseconds in its
    do_step, the mean over a run and the first update, medians of the runs."""
    means, firsts = [], []
    for _ in range(runs + 1):  # the first run is for what is made once
        system, schedule = prepare(path, Options(sets=list(sets))).or_raise()
        with Master(system, schedule, watched=lambda c, s: False) as master:
            master.initialise()
            took: list[float] = []
            for call in _calls(master):
                if (call.instance.name, call.verb) == ("manager", "step"):
                    call.call = _watched(call.call, took)
            for _ in range(60):
                master.advance()
        means.append(1e6 * statistics.mean(took))
        firsts.append(1e6 * took[0])
    return {
        "us": statistics.median(means[1:]),
        "first_us": statistics.median(firsts[1:]),
    }


def _calls(master: Master) -> Iterator[Call]:
    """The calls of components in a cycle of an initialised master."""
    for operations in chain.from_iterable(master.cycle):
        yield from (o for o in operations if isinstance(o, Call))


def _watched(call: Callable[[], int], took: list[float]) -> Callable[[], int]:
    """A call that writes down how long it took (s)."""

    def timed() -> int:
        began = time.perf_counter()
        result = call()
        took.append(time.perf_counter() - began)
        return result

    return timed


def numpy_loop(path: str, steps: int, tuned: bool = False) -> dict[str, Any]:
    """The loop over numpy arrays of the same model; the path is not needed."""
    from . import monolith

    began = time.perf_counter()
    monolith.run(steps, [], ops=monolith.Tuned if tuned else monolith.Plain)
    seconds = time.perf_counter() - began
    return {
        "wall_seconds": round(seconds, 3),
        "us_per_step": round(1e6 * seconds / steps, 2),
    }


def numpy_loop_tuned(path: str, steps: int) -> dict[str, Any]:
    """The same with cross product and rotations written out in floats."""
    return numpy_loop(path, steps, tuned=True)


def agreement(path: str, steps: int) -> dict[str, Any]:
    """How far apart they are without noise, over so many steps of 0.5 s."""
    from . import monolith

    return monolith.compare(0.5 * steps)


MEASUREMENTS: dict[str, Callable[..., dict[str, Any]]] = {
    f.__name__: f
    for f in (
        desat,
        blocks,
        libcosim,
        fmpy,
        shares,
        memory,
        day,
        recorded,
        command,
        law,
        agreement,
        numpy_loop,
        numpy_loop_tuned,
    )
}


# --- all of them ----------------------------------------------------------------------


def _measure(tool: str, path: str, steps: int, *more: str) -> dict[str, Any]:
    return _result(
        [sys.executable, "-m", "benchmarks.run", tool, path, str(steps), *more]
    )


def _result(command: list[str]) -> dict[str, Any]:
    result = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=HERE.parent
    )
    lines = [x for x in result.stdout.splitlines() if x.startswith("RESULT ")]
    if result.returncode or not lines:
        raise SystemExit(f"{' '.join(command)}: {result.stderr[-2000:]}")
    measured: dict[str, Any] = json.loads(lines[0][7:])
    return measured


def packed(scenario: str, fmus: str = "python") -> str:
    """The path of a scenario's .ssp, packed now if needed; of native FMUs beside that
    of others."""
    target = (
        paths.packed_folder() / f"{scenario}.native.ssp" if fmus == "native" else None
    )
    return str(pack_scenario(find(scenario), target, fmus=fmus))


def uosat12() -> dict[str, Any]:
    """All tools in turn on one scenario of the paper's tables: ours on native FMUs
    where they are built, the others on Python ones."""
    scenario, steps = "uosat12/table3-ocdc-ilqr-1", 20000
    path = packed(scenario)
    tools = ["desat", "blocks", "fmpy"]
    if importlib.util.find_spec("libcosimpy"):
        tools.insert(1, "libcosim")
    files = dict.fromkeys(tools, path) | {"desat": packed(scenario, "native")}
    rounds: dict[str, list[float]] = {t: [] for t in tools}
    for _ in track(range(ROUNDS), scenario, disable=not sys.stderr.isatty()):
        for tool in tools:
            rounds[tool].append(_measure(tool, files[tool], steps)["us"])
    result: dict[str, Any] = {
        f"{t}_us_per_step": round(statistics.median(rounds[t]), 2)
        if t in rounds
        else None
        for t in ("desat", "blocks", "libcosim", "fmpy")
    }
    if "libcosim" in rounds:
        pairs = [
            a / b for a, b in zip(rounds["desat"], rounds["libcosim"], strict=True)
        ]
        result["desat_over_libcosim"] = round(statistics.median(pairs), 3)
    result.update(where_the_time_goes(files["desat"], steps))
    result["memory"] = _measure("memory", files["desat"], 1_000_000)
    return {"scenario": scenario, "steps": steps, "rounds": ROUNDS, **result}


def where_the_time_goes(path: str, steps: int) -> dict[str, Any]:
    """Microseconds per step of each component's calls, and of the master's own loop."""
    share = _measure("shares", path, steps)
    alone = share["us"] - sum(share["us_per_component"].values())
    return {
        "us_per_component": share["us_per_component"],
        "of_which_in_do_step": share["of_which_in_do_step"],
        "master_alone_us": round(alone, 2),
    }


# name: (scenario, what is set in it); every scenario's step is a sample of its manager
LAWS: dict[str, tuple[str, tuple[str, ...]]] = {
    "ILQR, thrusters only": ("uosat12/table2-dct-ilqr-1", ()),
    "ILQR, CCCP": ("uosat12/table2-cccp-ilqr-1", ()),
    "ILQR, CRCP": ("uosat12/table2-crcp-ilqr-1", ()),
    "ILQR, OCDC": ("uosat12/table2-ocdc-ilqr-1", ()),
    "LQR, OCDC": ("uosat12/table2-ocdc-ilqr-1", ("manager.law=lqr",)),
    "MEC, OCDC": ("uosat12/table2-ocdc-mec-1", ()),
    "ILQR, OCDC with eq. 34": ("uosat12/table3-ocdc-ilqr-1", ()),
    "ILQR, bounded quadratic": ("uosat12/beyond-bounded_quadratic-ilqr-1", ()),
    "ILQR, bounded 1-norm": ("uosat12/beyond-bounded_one_norm-ilqr-1", ()),
    "receding horizon": ("uosat12/beyond-receding_horizon-ilqr-1", ()),
    "torquers alone, LQR": ("uosat12/fig2-lqr-1", ()),
    "torquers alone, ILQR": ("uosat12/fig2-ilqr-1", ()),
    "torquers alone, MEC": ("uosat12/fig2-mec-1", ()),
    "torquers alone, CCPL": ("uosat12/fig2-ccpl-1", ()),
}


def laws() -> dict[str, Any]:
    """Microseconds per update of each law's manager, as an FMU in CPython and as a
    native one: the mean over 60 samples, and the first, which for LQR and MEC prepares
    and for the receding horizon has all to plan."""
    result: dict[str, Any] = {}
    for name in track(list(LAWS), "laws", disable=not sys.stderr.isatty()):
        scenario, sets = LAWS[name]
        for kind, prefix in (("python", ""), ("native", "native_")):
            measured = _measure("law", packed(scenario, kind), 5, *sets)
            result.setdefault(name, {}).update(
                {
                    f"{prefix}us_per_update": round(measured["us"], 1),
                    f"{prefix}first_us": round(measured["first_us"], 1),
                }
            )
    return result


def nadir_day() -> dict[str, Any]:
    """24 h of nadir pointing, four wheels, three coils, 1 s steps, all components as
    FMUs; and a day of the same kind in Basilisk, which has 15 modules for it. Ours and
    Basilisk's record at every step; libcosim, whose file of all variables would cost
    more than its steps, does not."""
    result: dict[str, Any] = {}
    full, igrf = 86400, HERE.parent / "components" / "physics" / "igrf14.json"
    for field in ("dipole", "igrf"):
        python, fast = (
            packed(f"nadir_day/day-{field}", kind) for kind in ("python", "native")
        )
        theirs = field if field == "dipole" else str(igrf)
        tools: dict[str, tuple[str, Callable[[], dict[str, Any]]]] = {
            "python": ("us", partial(_measure, "recorded", python, 4000, "python")),
            "native": ("us", partial(_measure, "recorded", fast, 20000, "python")),
            "loop": ("us", partial(_measure, "recorded", fast, full)),
            "libcosim_native": ("us", partial(_measure, "libcosim", fast, full)),
            "basilisk": ("us_per_step", partial(_basilisk_day, theirs, full)),
            "command": ("seconds", partial(_measure, "command", fast, full)),
            "basilisk_command": ("seconds", partial(_basilisk_command, theirs, full)),
        }
        if not importlib.util.find_spec("libcosimpy"):
            del tools["libcosim_native"]
        if not BASILISK.exists():
            del tools["basilisk"], tools["basilisk_command"]
        rounds: dict[str, list[float]] = {t: [] for t in tools}
        for _ in track(range(ROUNDS), field, disable=not sys.stderr.isatty()):
            for tool, (key, measured) in tools.items():
                rounds[tool].append(measured()[key])
        row: dict[str, Any] = {}
        for tool, found in rounds.items():
            key = f"{tool}_{'seconds' if tool.endswith('command') else 'us_per_step'}"
            row[key] = round(statistics.median(found), 2)
        if "basilisk" in rounds:
            pairs = zip(rounds["loop"], rounds["basilisk"], strict=True)
            row["loop_over_basilisk"] = round(
                statistics.median(a / b for a, b in pairs), 3
            )
        result[field] = {**row, **where_the_time_goes(fast, 10000)}
    return result


def _basilisk_day(field: str, steps: int, *file: str) -> dict[str, Any]:
    return _result(
        [str(BASILISK), str(HERE / "basilisk_day.py"), field, str(steps), *file]
    )


def _basilisk_command(field: str, steps: int) -> dict[str, Any]:
    """Wall seconds of the whole of a day in Basilisk, its series kept."""
    with TemporaryDirectory() as folder:
        began = time.perf_counter()
        _basilisk_day(field, steps, f"{folder}/series.npz")
        return {"seconds": time.perf_counter() - began}


def integrated_day() -> dict[str, Any]:
    """24 h of paper 004 at 0.5 s with all components as native FMUs, once; and slices
    of it in turn by these, by Python FMUs and by a loop over numpy arrays of the same
    model, plain and tuned: a whole day of one of the last three takes minutes and says
    no more."""
    scenario, steps, slice_ = "integrated/mil-nadir", 172800, 4000
    native, path = packed(scenario, "native"), packed(scenario)
    tools = {
        "native": ("day", native),
        "python": ("day", path),
        "numpy_loop": ("numpy_loop", path),
        "numpy_loop_tuned": ("numpy_loop_tuned", path),
    }
    rounds: dict[str, list[float]] = {name: [] for name in tools}
    for _ in track(range(3), scenario, disable=not sys.stderr.isatty()):
        for name, (tool, file) in tools.items():
            rounds[name].append(_measure(tool, file, slice_)["us_per_step"])
    result: dict[str, Any] = {
        "scenario": scenario,
        "steps": steps,
        "day": _measure("day", native, steps),
        "steps_of_slices": slice_,
    }
    for name, found in rounds.items():
        result[f"{name}_us_per_step"] = round(statistics.median(found), 2)
        if name != "native":
            pairs = [b / a for a, b in zip(rounds["native"], found, strict=True)]
            result[f"{name}_over_native"] = round(statistics.median(pairs), 2)
    result["agreement_without_noise"] = _measure("agreement", path, 7200)
    result.update(where_the_time_goes(native, 10000))
    result["memory"] = _measure("memory", native, steps)
    return result


def start_up() -> dict[str, Any]:
    """250 min of paper 003 at 1 s, all components as FMUs, native and Python ones: a
    body that tumbles takes more substeps, so its first 20 min by themselves too; over
    the day's step of the same rounds."""
    result: dict[str, Any] = {}
    for kind in ("native", "python"):
        path = packed("hausat2/start-up-conventional", kind)
        day = packed("nadir_day/day-dipole", kind)
        parts = {
            "mission": (path, 15000),
            "tumbling": (path, 1200),
            "day": (day, 15000),
        }
        rounds: dict[str, list[float]] = {name: [] for name in parts}
        for _ in track(
            range(ROUNDS), f"start-up, {kind}", disable=not sys.stderr.isatty()
        ):
            for name, (file, steps) in parts.items():
                rounds[name].append(_measure("day", file, steps)["us_per_step"])
        row = {
            name: round(statistics.median(found), 2) for name, found in rounds.items()
        }
        for name in ("mission", "tumbling"):
            pairs = [a / b for a, b in zip(rounds[name], rounds["day"], strict=True)]
            row[f"{name}_over_day"] = round(statistics.median(pairs), 2)
        result[kind] = row
    path = packed("hausat2/start-up-conventional", "native")
    return result | {"memory": _measure("memory", path, 15000)}


def start_up_draws() -> dict[str, Any]:
    """20 draws of 600 min of paper 003 by one process and by two."""
    scenario, count, before = "hausat2/start-up-conventional", 20, os.getloadavg()[0]
    found = draws_over_cores(scenario, count)
    return {
        "scenario": scenario,
        "draws": count,
        "load_before": round(before, 1),
        **found,
    }


def boom() -> dict[str, Any]:
    """20 orbits of paper 002 at 1 s, control every 10 s, by the published law and by
    ours, all components as native FMUs, and 4,000 steps as Python FMUs; over the day's
    step of the same rounds."""
    names = {
        "z_wheel": "alsat1/firing-z-wheel",
        "ours": "alsat1/firing-ours",
        "day": "nadir_day/day-dipole",
    }
    steps = {"day": 86400}
    parts = {n: (packed(s, "native"), steps.get(n, 122570)) for n, s in names.items()}
    parts |= {f"{n}_python": (packed(s), 4000) for n, s in names.items()}
    rounds: dict[str, list[float]] = {name: [] for name in parts}
    for _ in track(range(ROUNDS), "alsat1", disable=not sys.stderr.isatty()):
        for name, (file, count) in parts.items():
            rounds[name].append(_measure("day", file, count)["us_per_step"])
    result: dict[str, Any] = {
        n: round(statistics.median(r), 1) for n, r in rounds.items()
    }
    for kind in ("", "_python"):
        for name in ("z_wheel", "ours"):
            pairs = zip(rounds[name + kind], rounds[f"day{kind}"], strict=True)
            result[f"{name}{kind}_over_day"] = round(
                statistics.median(a / b for a, b in pairs), 2
            )
    result["memory"] = _measure("memory", parts["ours"][0], 122570)
    return result | {"draws": draws_over_cores("alsat1/firing-z-wheel", 8)}


def draws() -> dict[str, Any]:
    """20 draws of 24 h of paper 004 by one process and by two, once."""
    scenario, count, before = "integrated/mil-nadir", 20, os.getloadavg()[0]
    found = draws_over_cores(scenario, count, rounds=1)
    return {
        "scenario": scenario,
        "draws": count,
        "load_before": round(before, 1),
        **found,
    }


def draws_over_cores(scenario: str, count: int, rounds: int = 3) -> dict[str, Any]:
    """So many draws of a scenario by one process and by two, in turns: wall and
    processor time (s), and how many cores were at work, medians."""
    taken: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
    for _ in track(range(rounds), "draws", disable=not sys.stderr.isatty()):
        for jobs, saved in taken.items():
            before, began = os.times(), time.perf_counter()
            command = [
                sys.executable,
                "-m",
                "desat.cli",
                "campaign",
                scenario,
                "-n",
                str(count),
            ]
            with TemporaryDirectory() as folder:
                subprocess.run(
                    [*command, "--jobs", str(jobs), "--json", "--out", f"{folder}/c"],
                    check=False,
                    stdout=subprocess.DEVNULL,
                )
            wall, after = time.perf_counter() - began, os.times()
            used = after.children_user + after.children_system
            saved.append((wall, used - before.children_user - before.children_system))
    return {
        f"jobs_{jobs}": {
            "seconds": round(statistics.median(w for w, _ in saved), 1),
            "cores": round(statistics.median(c / w for w, c in saved), 2),
        }
        for jobs, saved in taken.items()
    } | {
        "times_as_fast": round(
            statistics.median(
                a / b for (a, _), (b, _) in zip(taken[1], taken[2], strict=True)
            ),
            2,
        )
    }


def telescope() -> dict[str, Any]:
    """Eight orbits of paper 001 in steps of 5 s, over the day's step of the same
    rounds."""
    parts = {
        "mission": packed("space_telescope/mixed-me-nominal", "native"),
        "day": packed("nadir_day/day-dipole", "native"),
    }
    rounds: dict[str, list[float]] = {name: [] for name in parts}
    for _ in track(range(ROUNDS), "telescope", disable=not sys.stderr.isatty()):
        for name, file in parts.items():
            rounds[name].append(_measure("day", file, 9120)["us_per_step"])
    pairs = [a / b for a, b in zip(rounds["mission"], rounds["day"], strict=True)]
    result: dict[str, Any] = {
        n: round(statistics.median(r), 1) for n, r in rounds.items()
    }
    return result | {"mission_over_day": round(statistics.median(pairs), 2)}


def both_plants() -> dict[str, Any]:
    """Error over CPU time of two plants: ours and Basilisk's, its RK4 and its RKF78, in
    turn; and what each takes at the goal."""
    result: dict[str, Any] = {"goal": plants.GOAL}
    tools: dict[str, tuple[float, ...]] = {
        "desat": (10.0, 5.0, 2.0, 1.0),
        "basilisk_rk4": (2.0, 1.0, 0.5, 0.2, 0.1),
        "basilisk_rkf78": (10.0, 5.0, 2.0, 1.0, 0.5, 0.2),
    }
    for plant in plants.PLANTS:
        rounds: dict[tuple[str, float], list[dict[str, Any]]] = {}
        for _ in track(range(3), f"plant: {plant}", disable=not sys.stderr.isatty()):
            for tool, steps in tools.items():
                for step in steps:
                    if tool == "desat":
                        command = [
                            sys.executable,
                            "-m",
                            "benchmarks.plants",
                            plant,
                            str(step),
                        ]
                        measured = _result(command)
                    elif BASILISK.exists():
                        command = plants.basilisk(
                            str(BASILISK), plant, step, tool.split("_")[1]
                        )
                        measured = plants.judged(plant, _result(command))
                    else:
                        continue  # not installable here
                    rounds.setdefault((tool, step), []).append(measured)
        result[plant] = {tool: _at_the_goal(tool, rounds) for tool in tools}
    return result


def _at_the_goal(
    tool: str, rounds: dict[tuple[str, float], list[dict[str, Any]]]
) -> Any:
    rows = [
        {"step": step, **sorted(runs, key=lambda r: r["seconds"])[len(runs) // 2]}
        for (name, step), runs in rounds.items()
        if name == tool
    ]
    good = [r for r in rows if r["attitude_error"] < plants.GOAL]
    return (
        {
            "rows": rows,
            "at_the_goal": min(good, key=lambda r: r["seconds"]) if good else None,
        }
        if rows
        else None
    )


CASES: dict[str, Callable[[], dict[str, Any]]] = {
    "uosat12": uosat12,
    "day": nadir_day,
    "integrated": integrated_day,
    "draws": draws,
    "start_up": start_up,
    "start_up_draws": start_up_draws,
    "alsat1": boom,
    "telescope": telescope,
    "plants": both_plants,
    "laws": laws,
    "scaling": scaling.measure,
    "campaign": campaign.measure,
    "commands": lambda: commands.measure(commands.commands()),
}


def main() -> int:
    """Measure every case, or run one measurement when arguments name it."""
    if len(sys.argv) >= 4 and sys.argv[1] in MEASUREMENTS:
        tool, path, steps, *more = sys.argv[1:]
        print(
            "RESULT " + json.dumps(MEASUREMENTS[tool](path, int(steps), *more)),
            flush=True,
        )
        return 0
    names = sys.argv[1:] or list(CASES)
    data = json.loads(LATEST.read_text()) if LATEST.exists() else {}
    for name in names:
        data[name] = CASES[name]()
    packages = ("desat", "fmpy", "pythonfmu", "numpy", "libcosimpy")
    data["about"] = {
        "date": datetime.now(UTC).isoformat(timespec="minutes"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "versions": {
            p: version(p)
            for p in packages
            if importlib.util.find_spec(p) or p == "desat"
        },
    }
    LATEST.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(data, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
