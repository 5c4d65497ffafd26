"""A block alone as C: it makes the bits that the same block makes within a run."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from desat.export.block_c import export
from desat.files import paths
from desat.fmus import alone
from desat.fmus.compiler import compiler
from desat.runs.prepare import prepare
from desat.runs.run import simulate
from desat.system.errors import DesatError
from desat.system.interface import base_name
from desat.system.options import Options
from tests.conftest import slow_value

STRICT = [
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-O1",
    "-ffp-contract=off",
]
STEPS = 150
NATIVE = sorted(p.stem for p in (paths.fmus() / "native").glob("*.fmu"))


def place(component, signal):
    """A variable as C, of the struct `s`."""
    base = base_name(signal.name)
    elements = component.interface.elements.get(base, ())
    if signal.name == base:
        return f"s->{base}"
    return f"s->{base}.e[{[e.name for e in elements].index(signal.name)}]"


def library(component, folder, inputs, outputs, samples=None):
    """The block of a component, compiled, with its parameters and three functions
    around it."""
    name = component.interface.model
    (header, source), sizes = export(name, folder, samples=samples)
    assert [header.name, source.name] == [f"{name}.h", f"{name}.c"]
    assert sizes
    assert str(sizes[0]) in header.read_text()
    signals = component.interface.signals
    values = [
        f"{place(component, signals[n])} = {str(v).lower() if isinstance(v, bool) else repr(v)};"
        for n, v in component.parameters.items()
    ]
    assignments = [
        f"{place(component, signals[n])} = x[{i}];" for i, n in enumerate(inputs)
    ]
    get = [
        f"y[{i}] = (double){place(component, signals[n])};"
        for i, n in enumerate(outputs)
    ]
    (folder / "around.c").write_text(
        f'#include "{name}.h"\nstatic {name} it, *const s = &it;\n'
        f'void set(void) {{ {name}_init(s); s->instance = "{component.name}"; '
        f"{' '.join(values)} }}\n"
        f"void put(const double *x) {{ (void)x; {' '.join(assignments)} }}\n"
        f"void get(double *y) {{ (void)y; {' '.join(get)} }}\n"
        f"int start(double t) {{ return {name}_start(s, t); }}\n"
        f"int step(double t, double dt) {{ return {name}_step(s, t, dt); }}\n"
    )
    shared_library = folder / "it.so"
    subprocess.run(
        [
            *compiler(),
            *STRICT,
            "-shared",
            "-fPIC",
            "-o",
            str(shared_library),
            str(source),
            str(folder / "around.c"),
            "-lm",
        ],
        check=True,
    )
    c_library = ctypes.CDLL(str(shared_library))
    c_library.start.argtypes, c_library.step.argtypes = (
        [ctypes.c_double],
        [ctypes.c_double] * 2,
    )
    return c_library


@pytest.mark.parametrize(
    ("target", "user", "samples"),
    [
        ("nadir_day/day-dipole", "", None),
        ("uosat12/table3-ocdc-ilqr-1", "manager", None),
        slow_value(("uosat12/beyond-receding_horizon-ilqr-1", "manager", 60)),
        slow_value(("hausat2/start-up-ours", "manager", None), "study"),
        slow_value(("integrated/mil-nadir", "manager", None), "study"),
        slow_value(("space_telescope/ours-nominal", "manager", None), "study"),
    ],
)
def test_it_replays_a_run_with_its_bits(tmp_path, target, user, samples):
    """Fed with what was recorded of the run."""
    system, _ = prepare(target, Options()).or_raise()
    stop = system.start + min(STEPS, system.steps) * system.step
    case = prepare(target, Options(stop=stop))
    system, schedule = case.or_raise()
    run = simulate(case)
    results, sample_count = run.results, 0

    def series(component, name):
        base, arrays = base_name(name), system.components[component].interface.arrays
        values = results.values(f"{component}.{base}")
        index = [e.name for e in arrays[base]].index(name)
        return values if values.ndim == 1 else values[:, index]

    for component in system.components.values():
        if user not in ("", component.name):
            continue
        feeds = [c for c in system.connections if c.target == component.name]
        outputs = [s.name for s in component.interface.outputs if s.name != "fault"]
        it = library(
            component,
            tmp_path / component.name,
            [c.input for c in feeds],
            outputs,
            samples,
        )
        rows = (
            np.column_stack(
                [
                    series(c.source, c.output)[: system.steps] * c.factor + c.offset
                    for c in feeds
                ]
            )
            if feeds
            else np.zeros((system.steps, 0))
        )
        buffer = np.zeros((system.steps + 1, len(outputs)))
        it.set()
        for k in range(system.steps):
            row, out = np.ascontiguousarray(rows[k]), buffer[k + 1]
            it.put(ctypes.c_void_p(row.ctypes.data))
            if k == 0:
                assert it.start(system.start) == 0
                it.get(ctypes.c_void_p(buffer[0].ctypes.data))
            assert it.step(system.start + k * system.step, system.step) == 0
            it.get(ctypes.c_void_p(out.ctypes.data))
        for i, name in enumerate(outputs):
            interval = schedule.classes[component.name, name] == "interval"
            there = series(component.name, name)
            mine = buffer[1:, i] if interval else buffer[:, i]
            # at the start a block has settled inputs, here those of the first step
            first = 0 if interval else 1
            assert np.array_equal(mine[first:], there[first : len(mine)]), (
                component.name,
                name,
            )
            sample_count += len(mine)
    assert sample_count > 1000 or user


@pytest.mark.study
def test_a_plan_has_room_for_the_samples_that_are_asked_for(tmp_path, desat):
    """The stack follows, and a longer horizon is refused."""
    name, stacks = "manager_receding_horizon", []
    for samples in (20, 60, None):
        option = ["--samples", str(samples)] if samples else []
        place = ["--out", str(tmp_path / str(samples)), "--json"]
        command = desat("export", "c", name, *option, *place, check=True)
        stacks.append(json.loads(command.stdout)["sizes"][0]["stack"])
    if stacks[0] is not None:  # another compiler than gcc
        assert stacks[0] < stacks[1] < 100_000 < stacks[2]
    header = (tmp_path / "60" / f"{name}.h").read_text()
    assert "room for plans of at most 60 samples" in header
    case = prepare("uosat12/beyond-receding_horizon-ilqr-1", Options(stop=200.0))
    component = case.or_raise()[0].components["manager"]
    for count, is_refused in ((20, True), (60, False)):
        it = library(component, tmp_path / f"lib{count}", [], [], count)
        it.set()
        assert bool(it.start(0.0)) is is_refused


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (["manager_receding_horizon", "--samples", "0"], "has room for 1 to 600"),
        (["manager_receding_horizon", "--samples", "601"], "has room for 1 to 600"),
        (["manager_b_dot", "--samples", "9"], "manager_b_dot makes no plan of samples"),
    ],
)
def test_samples_that_do_not_fit_are_refused(desat, tmp_path, inputs, message):
    command = desat("export", "c", *inputs, "--out", str(tmp_path))
    assert command.returncode == 2
    assert message in " ".join(command.stderr.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", NATIVE)
def test_every_native_block_compiles_alone(tmp_path, name):
    """By a strict C99 compiler; nothing of it takes memory from the heap or writes."""
    sources = alone.sources_of(paths.fmus() / "native" / f"{name}.fmu")
    files, _ = alone.alone(name, sources)
    for file, text in files.items():
        (tmp_path / file).write_text(text)
    result = tmp_path / "it.o"
    subprocess.run(
        [
            *compiler(),
            *STRICT,
            "-O0",
            "-c",
            "-o",
            str(result),
            str(tmp_path / f"{name}.c"),
        ],
        check=True,
    )
    if (nm := shutil.which("nm")) is None:
        pytest.skip("there is no nm")
    nm_output = subprocess.run(
        [nm, "-u", str(result)], capture_output=True, text=True, check=True
    )
    names = set(re.findall(r"U (\w+)", nm_output.stdout))
    assert not names & {
        "malloc",
        "calloc",
        "realloc",
        "free",
        "printf",
        "snprintf",
        "strtod",
    }


def test_failures_come_back_as_numbers(tmp_path):
    system, _ = prepare("nadir_day/day-dipole", Options()).or_raise()
    manager = system.components["manager"]
    it = library(manager, tmp_path, ["b_body[1]"], ["fault"])
    message = (tmp_path / "manager_cross_product.h").read_text()
    kinds = re.findall(r"MANAGER_CROSS_PRODUCT_(\w+)", message.partition("enum {")[2])
    x, y = np.array([np.nan]), np.zeros(1)
    it.set()
    assert it.start(0.0) == 0
    it.put(ctypes.c_void_p(x.ctypes.data))
    assert kinds[it.step(0.0, 1.0)] == "NOT_FINITE"
    it.get(ctypes.c_void_p(y.ctypes.data))
    assert y == 1.0
    x[0] = 2e-5
    it.put(ctypes.c_void_p(x.ctypes.data))
    assert kinds[it.step(1.0, 1.0)] == "FAILED_BEFORE"
    assert it.start(0.0) == 0
    assert it.step(0.0, 1.0) == 0
    broken = system.components["manager"].parameters | {"m_limit": -1.0}
    it = library(replace(manager, parameters=broken), tmp_path / "b", [], ["fault"])
    it.set()
    assert kinds[it.start(0.0)] == "OUT_OF_BOUNDS"


def test_the_command_writes_a_law_of_ones_own(tmp_path, desat):
    desat("new", "law", "mine", cwd=tmp_path, check=True)
    command = desat(
        "export", "c", "mine.py", "--out", "c", "--json", cwd=tmp_path, check=True
    )
    answer = json.loads(command.stdout)
    assert len(answer["files"]) == 2
    assert all((tmp_path / x).exists() for x in answer["files"])
    assert answer["sizes"][0]["struct"] > 1000
    assert answer["sizes"][0]["stack"] > 100


@pytest.mark.parametrize(
    ("block", "compilers", "message"),
    [
        (
            "manager_bdot",
            None,
            "manager_bdot: no such block; did you mean manager_b_dot?",
        ),
        (
            "environment_tle",
            None,
            "environment_tle: there is no C of it, it runs as Python",
        ),
        (
            "manager_b_dot",
            ["nowhere -O9"],
            "--compiler nowhere -O9: there is no such command",
        ),
        ("manager_b_dot", ["gcc -march=nothing"], "bad value"),
    ],
)
def test_what_cannot_be_written_is_a_line(tmp_path, block, compilers, message):
    if compilers and compilers[0].startswith("gcc") and shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    with pytest.raises(DesatError) as error:
        export(block, tmp_path / "o", compilers)
    assert message in str(error.value)
    assert not (tmp_path / "o").exists()


def test_a_field_model_has_room_for_its_degrees_alone(tmp_path):
    """The rows of IGRF's 15 orders had room for 225."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    _, (size,) = export("environment_kepler", tmp_path, ["gcc"])
    assert size.static is not None
    assert size.stack is not None
    assert 20_000 < size.static < 30_000
    assert size.stack < 60_000


def test_for_a_small_processor(tmp_path):
    """Sizes for a Cortex-M7; where its compiler is installed."""
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("arm-none-eabi-gcc is not installed")
    cross = "arm-none-eabi-gcc -mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard"
    _, (size,) = export("manager_cross_product", tmp_path, [cross])
    assert size.stack is not None
    assert size.stack < 8192
    assert "-mcpu=cortex-m7" in (tmp_path / "manager_cross_product.h").read_text()


def test_stacks_of_graphs():
    graph = """node: { title: "a" label: "a\\nx.c:1\\n100 bytes (static)\\n0 dynamic" }
node: { title: "b" label: "b\\nx.c:2\\n30 bytes (static)\\n0 dynamic" }
node: { title: "sin" label: "sin\\n<built-in>" }
edge: { sourcename: "a" targetname: "b" label: "x" }
edge: { sourcename: "b" targetname: "sin" label: "x" }"""
    assert alone._deepest(graph) == 130
    again = graph + '\nedge: { sourcename: "b" targetname: "a" label: "x" }'
    assert alone._deepest(again) is None
    assert (
        alone._deepest(graph.replace("30 bytes (static)", "30 bytes (dynamic)")) is None
    )
