"""Run a system: check, initialise, step, record, and leave a run folder behind."""

from __future__ import annotations

import json
import platform
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from math import inf
from pathlib import Path
from types import ModuleType
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from ..analyses import analyses
from ..engine.instances import UnitError
from ..engine.master import Algorithm, Master
from ..engine.results import SERIES, Recorder, Results, selects
from ..files import library, scenario, ssp
from ..system.check import Checked, check, steps_of
from ..system.codes import Exit
from ..system.errors import DesatError, RunError, nearest
from ..system.expression import Table
from ..system.interface import base_name
from ..system.model import System
from ..system.parameters import assign, parse_assignment, table
from ..system.replace import drop_unwanted
from . import meaning, stopping
from .numbers import OPEN_END, evaluate, problems, relative, signals_of

MANIFEST = "manifest.json"
PACKAGES = ("desat", "fmpy", "pythonfmu", "numpy", "scipy", "h5py")


@dataclass
class Options:
    """What the command line may change about a run."""

    sets: list[str] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)
    """`component=FMU`: a file, or one of ours by its name, in a component's place"""
    stop: float | None = None
    step: float | None = None
    algorithm: Algorithm = "conserving"
    blocks: bool = False
    record: tuple[str, ...] = ("*",)
    every: int = 1
    output_classes: dict[str, Any] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    """`component.variable` -> value, beside `sets`, for callers that are programs."""
    design: str | None = None
    """Of a scenario with a [design]: a file with another one, or `now`: made for these values."""
    time_limit: float | None = None
    """Wall time (s) that stepping may take; the run ends between two steps"""


@dataclass
class Run:
    """A finished (or stopped) run: its manifest and its series."""

    manifest: dict[str, Any]
    results: Results

    @property
    def ok(self) -> bool:
        """True when it reached its stop time."""
        return bool(self.manifest["status"] == "completed")

    @property
    def code(self) -> Exit:
        """The exit code that says how it ended."""
        if self.ok:
            return Exit.COMPLETED
        if self.manifest["status"] == stopping.LATE:
            return Exit.TIMEOUT
        if self.manifest["status"] == "interrupted":
            return Exit(self.manifest.get("exit", Exit.INTERRUPTED))
        return Exit.COMPONENT

    def or_raise(self, target: str) -> Run:
        """Itself where it completed. Raises RunError, which names the target, where not."""
        if self.ok:
            return self
        status, message = self.manifest["status"], self.manifest["message"]
        raise RunError(f"{target}: {status}: {message}", self.code)


def load(target: str, blocks: bool = False) -> tuple[System, list[str]]:
    """The system of a scenario name, a scenario file, a .ssp, an .ssd or a folder, and its
    problems so far."""
    path = Path(target)
    if path.suffix in (".ssp", ".ssd") or path.is_dir():
        return ssp.read(path)
    if path.suffix == ".toml":
        return scenario.own(path).system(blocks)
    return scenario.find(target).system(blocks)


def prepare(target: str, options: Options) -> tuple[System, Checked]:
    """Load a system, apply the options, and check it; warns of a design made for other values."""
    from ..designs import making, origin

    known = _scenario_of(target)
    if options.design is None:
        system, problems = load(target, options.blocks)
        problems += _wrong_words(known, system)
        warnings = modify(system, problems, options)
        # of a packed one, the scenario that it was packed from
        name = system.about.get("name", "")
        if known is None and name.partition("/")[0] in scenario.families():
            known = scenario.scenarios(name.partition("/")[0]).get(name)
        warnings += origin.warnings(known, options) if known else []
    elif known is None:
        raise DesatError(f"--design {options.design}: {target} is no scenario with a [design]")
    else:
        system, problems = known.system(options.blocks, designed=False)
        problems += _wrong_words(known, system)
        designed = making.parameters_for(known, options)
        warnings = modify(system, problems, options, designed, known.parameters(designed=False))
    checked = check(system, problems)
    checked.warnings[:0] = warnings
    if checked.schedule is not None:
        checked.problems += [f"{system.where}: {text}" for text in stopping.problems(system)]
        what = problems_of_numbers(system)
        # another FMU may lack what the scenario's numbers are made of: it runs without them
        (checked.warnings if options.sources else checked.problems).extend(what)
    return system, checked


def _wrong_words(described: scenario.Scenario | None, system: System) -> list[str]:
    """What a scenario names that is not there, in the language or in its system."""
    if described is None:
        return []
    return meaning.words(described) or meaning.names(described, system)


def _scenario_of(target: str) -> scenario.Scenario | None:
    path = Path(target)
    if path.suffix in (".ssp", ".ssd") or path.is_dir():
        return None
    return scenario.own(path) if path.suffix == ".toml" else scenario.find(target)


def modify(
    system: System,
    problems: list[str],
    options: Options,
    designed: dict[str, dict[str, Any]] | None = None,
    own: dict[str, dict[str, Any]] | None = None,
) -> list[str]:
    """Apply the options to a system, in place, and return warnings; problems are added to the list.

    `designed`: parameters, a table a component, below those of the options and below `own`, the
    scenario's. Raises DesatError for what is unknown.
    """
    if options.stop is not None:
        system.stop = options.stop
    if options.step is not None:
        system.step = options.step
    system.output_classes.update(options.output_classes)
    problems += library.load_interfaces(system, options.blocks)
    warnings = []
    for text in options.sources:
        problem, warning = _replace(system, text, options.blocks)
        problems += [problem] if problem else []
        warnings += [warning] if warning else []
    assignments = [
        (f"--design: {name}.{variable}", name, variable, value)
        for name, table in (designed or {}).items() for variable, value in table.items()
        if variable not in (own or {}).get(name, {})
    ]  # fmt: skip
    assignments += [(f"--set {t}", *parse_assignment(t)) for t in options.sets]
    assignments += [(k, *k.split(".", 1), v) for k, v in options.values.items()]
    for text, name, variable, value in assignments:
        if name == "shared" and name not in system.components:
            problems += scenario.set_shared(system, {variable: value}, text)
            continue
        component = system.components.get(name)
        if component is None:
            raise DesatError(f"{text}: no component {name}{nearest(name, system.components)}")
        if component.interface is not None:
            assign(component, variable, value, name)
    return warnings


def problems_of_numbers(system: System) -> list[str]:
    """What is wrong with the numbers that a scenario wants of a checked system."""
    units = {
        f"{c.name}.{base_name(s.name)}": s.unit_name
        for c in system.components.values() if c.interface for s in c.interface.of("output")
    }  # fmt: skip
    name = system.about.get("name", system.name)
    return [f"{name}: {text}" for text in problems(system.about, units, table(system))]


def _replace(system: System, text: str, blocks: bool) -> tuple[str, str]:
    """Another FMU in a component's place, with those parameters of the old one that it declares
    alike; what is wrong with that, and what was left out."""
    name, _, source = text.partition("=")
    component = system.components.get(name)
    if not source:
        raise DesatError(f"--source {text}: the form is COMPONENT=FMU")
    if component is None:
        raise DesatError(f"--source {text}: no component {name}{nearest(name, system.components)}")
    file = Path(source)
    component.source = source if file.suffix == ".fmu" else f"resources/{source}.fmu"
    component.fmu = file if file.is_file() else library.built(component.source)
    old, component.interface = component.interface, None
    if problem := library.load_interface(system, component, blocks):
        return problem, ""
    drop_unwanted(system, component)
    assert component.interface is not None
    new, given = component.interface.signals, component.parameters

    def alike(key: str) -> bool:
        was, now = old.signals.get(key) if old else None, new.get(key)
        return was is not None and now is not None and all(
            getattr(was, what) == getattr(now, what)
            for what in ("causality", "kind", "unit", "choices")
        )  # fmt: skip

    component.parameters = {key: value for key, value in given.items() if alike(key)}
    component.references = {
        name: text for name, text in component.references.items()
        if all(alike(s.name) for s in (old.elements(name) if old else ()))
    }  # fmt: skip
    lost = dict.fromkeys(base_name(key) for key in given if key not in component.parameters)
    if not lost:
        return "", ""
    return "", f"{name}: {source} does not take {', '.join(lost)} of the FMU that it replaces"


def execute(
    target: str,
    options: Options,
    folder: Path | None = None,
    progress: bool = False,
) -> Run:
    """Run a scenario, an .ssp or a folder; `folder` None keeps the series in memory.

    A component that fails, Ctrl-C, SIGTERM and the time limit end the run early: what was recorded
    is kept, and the manifest's status says which. A run that its scenario's `stop_when` ends is
    completed, and the manifest's `stopped_when` says when.
    Raises DesatError where the run cannot begin.
    """
    system, checked = prepare(target, options)
    schedule = checked.or_raise()
    steps = steps_of(system)
    began, clock = datetime.now(UTC), time.perf_counter()
    manifest = describe(system, options, target)
    manifest.update(started=began.isoformat(timespec="seconds"), steps=steps, status="running",
                    warnings=checked.warnings)  # fmt: skip

    def watched(component: str, signal: Any) -> bool:
        ends_it = ends is not None and ends.reads(component, signal)
        return ends_it or selects(options.record, component, signal)

    ends = stopping.condition(system)
    with Master(
        system, schedule, algorithm=options.algorithm, blocks=options.blocks, watched=watched
    ) as master:
        master.initialise()
        recorder = Recorder(folder and folder / SERIES, master, options.record, options.every)
        if folder is not None:
            write_json(folder / f"{MANIFEST}.part", manifest)
        if options.algorithm == "jacobi":
            recorder.record(0, master.live)
        status, message, loop = "completed", "", time.perf_counter()
        finished, stopped = stopping.watch(master, ends, options.time_limit), None
        try:
            with _interruptible() as interrupted, _bar(system.name, steps, progress) as report:
                reason = _loop(master, steps, recorder, interrupted, finished, report)
            if number := interrupted():
                status, message = "interrupted", f"stopped by the user at t = {master.t:g} s"
                manifest["exit"] = int(Exit(128 + number))
            elif reason == stopping.LATE:
                status = reason
                message = f"{options.time_limit:g} s of wall time over at t = {master.t:g} s"
            elif reason:
                stopped = {"condition": reason, "time": master.t}
        except UnitError as error:
            status, message = "failed", str(error)
        seconds = time.perf_counter() - loop
        done = master.k
        results = recorder.finish(master)
    manifest.update(
        status=status,
        message=message,
        steps_done=done,
        end_time=master.t,
        stopped_when=stopped,
        wall_seconds=round(time.perf_counter() - clock, 6),
        us_per_step=round(1e6 * seconds / max(done, 1), 3),
        numbers=numbers(system.about, results, manifest["parameters"]),
    )
    for analysis in analyses():
        if manifest[analysis.KEY] is not None:
            manifest["numbers"].update(analysis.numbers(manifest, results))
    if folder is not None:
        write_json(folder / MANIFEST, manifest)
        (folder / f"{MANIFEST}.part").unlink(missing_ok=True)
    return Run(manifest, results)


def _loop(
    master: Master, steps: int, recorder: Recorder, interrupted: Callable[[], int],
    finished: Callable[[], str], report: Callable[[int], None],
) -> str:  # fmt: skip
    """Step to the end, to the first signal to stop, or until `finished`, called after each step,
    says why it is; look at the clock twenty times a second."""
    advance, record = master.advance, recorder.record
    chunk, reason = 1, ""
    while master.k < steps and not reason and not interrupted():
        began = time.perf_counter()
        for _ in range(min(chunk, steps - master.k)):
            advance(record)
            if (reason := finished()) or interrupted():
                break
        seconds = time.perf_counter() - began
        chunk = max(1, min(2 * chunk, int(chunk * 0.05 / max(seconds, 1e-6))))
        recorder.tick()
        report(master.k)
    return reason


@contextmanager
def _interruptible() -> Iterator[Callable[[], int]]:
    """Within: Ctrl-C and SIGTERM only leave their number, for an exception inside an FMU would
    crash the process."""
    got = [0]

    def handler(number: int, frame: Any) -> None:
        got[0] = number

    try:
        previous = {n: signal.signal(n, handler) for n in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not the main thread: nobody can interrupt us
        yield lambda: 0
        return
    try:
        yield lambda: got[0]
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


@contextmanager
def _bar(name: str, steps: int, wanted: bool) -> Iterator[Callable[[int], None]]:
    if not (wanted and sys.stderr.isatty()):
        yield lambda k: None
        return
    from rich.console import Console

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"),
               TimeRemainingColumn())  # fmt: skip
    with Progress(*columns, transient=True, console=Console(stderr=True)) as bar:
        task = bar.add_task(name, total=steps)
        yield lambda k: bar.update(task, completed=k)


# --- manifest ---------------------------------------------------------------------------------


def describe(system: System, options: Options, target: str) -> dict[str, Any]:
    """The manifest of a system before it runs."""
    path = Path(target)
    return {
        "scenario": system.about.get("name", system.name),
        "about": system.about,
        "algorithm": options.algorithm,
        "components_as": "bare blocks" if options.blocks else "FMUs",
        "start": system.start,
        "stop": system.stop,
        "step": system.step,
        "output_classes": system.output_classes,
        "versions": {
            **{name: version(name) for name in PACKAGES},
            "python": platform.python_version(),
        },
        "platform": platform.platform(),
        "ssp": {"file": path.name, "sha256": library.sha256(path)}
        if path.suffix == ".ssp" else None,
        "fmus": {
            c.name: {"source": c.source, "sha256": library.load(c.fmu).sha256}
            for c in system.components.values() if c.fmu is not None and not options.blocks
        },
        **{a.KEY: a.applies(system) for a in analyses()},
        "choices": {
            f"{c.name}.{s.name}": list(s.choices)
            for c in system.components.values() if c.interface is not None
            for s in c.interface.of("output") if s.choices
        },
        "parameters": table(system),
    }  # fmt: skip


def numbers(
    about: dict[str, Any], results: Results, parameters: Table
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """The scenario's numbers that need no other run, where their series are recorded.

    `value` is None, and shown as "not reached", where the run does not reach a number's window;
    `note` says how much of the window it has.
    """
    rows: dict[str, dict[str, Any]] = {}
    known, end = set(results.names()), results.times()[-1:].tolist()
    for name, number in about.get("numbers", {}).items():
        if "reference" in number or not known.issuperset(signals_of(number)):
            continue
        rows[name] = {
            "title": number.get("title", name),
            "value": evaluate(number, results, parameters),
            "unit": number.get("unit", ""),
        }
        until = number.get("window", (0.0, inf))[1]
        if rows[name]["value"] is not None and until < OPEN_END and end[0] < until - 1e-6:
            rows[name]["note"] = f"only to {end[0]:g} s of {until:g} s"
    return rows


def relate(manifest: dict[str, Any], others: dict[str, dict[str, Any]]) -> None:
    """Add the numbers that compare a run with others (by scenario name, without the family)."""
    for name, number in manifest["about"].get("numbers", {}).items():
        other = others.get(number.get("reference", ""))
        of = number.get("of", "")
        if other is None or of not in manifest["numbers"] or of not in other["numbers"]:
            continue
        manifest["numbers"][name] = {
            "title": number.get("title", name),
            "value": relative(
                number["form"],
                manifest["numbers"][of]["value"],
                other["numbers"][of]["value"],
            ),
            "unit": number.get("unit", ""),
            "reference": number["reference"],
        }


def write_json(path: Path, data: Any) -> None:
    """Write JSON under a temporary name, then rename."""
    part = path.with_name(path.name + ".tmp")
    path.parent.mkdir(parents=True, exist_ok=True)
    part.write_text(json.dumps(data, indent=1), encoding="utf-8")
    part.replace(path)


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run folder, also of a run that was killed. Raises DesatError."""
    for name in (MANIFEST, f"{MANIFEST}.part"):
        if (folder / name).exists():
            try:
                manifest: dict[str, Any] = json.loads((folder / name).read_text(encoding="utf-8"))
                return manifest
            except ValueError as error:
                raise DesatError(f"{folder / name}: {error}") from error
    raise DesatError(f"{folder}: no run folder (it has no {MANIFEST})")


def load_run(folder: Path) -> Run:
    """A run from its folder. Raises DesatError where it is none."""
    manifest = read_manifest(folder)
    manifest.setdefault("numbers", {})
    manifest.setdefault("message", "")
    for key in ("steps_done", "us_per_step", "wall_seconds"):
        manifest.setdefault(key, "?")
    if manifest["status"] == "running":
        manifest["status"] = "killed (or still running)"
    return Run(manifest, Results.open(folder))


def run_or_load(target: str, analysis: ModuleType | None = None) -> Run:
    """The run of a run folder; or of a scenario, .ssp or folder, run now.

    Raises RunError where that run does not complete, and DesatError before it begins where
    `analysis` does not apply to the system.
    """
    folder = Path(target)
    if any((folder / f"{MANIFEST}{end}").exists() for end in ("", ".part")):
        return load_run(folder)
    if analysis is not None and analysis.applies(load(target)[0]) is None:
        raise DesatError(analysis.NOT_APPLICABLE.format(target))
    return execute(target, Options()).or_raise(target)
