"""Native FMUs: made of the same Python, the same bits as blocks and Python FMUs, in any
host."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import itertools
import json
import math
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.validation import validate_fmu
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from desat.components.contract.block import Block
from desat.files import library, paths
from desat.fmus import build, fmi3, native, registry, subset
from desat.fmus.compiler import NoCompilerError, compiler
from desat.fmus.translate import program
from desat.fmus.translate.types import SubsetError
from desat.runs.run import Options, execute
from tests.conftest import ROOT, description_of
from tests.contract.test_block import randomise_inputs

NATIVE = tuple(n for n in registry.names() if n not in native.PINNED)
KINDS = ["native", "python"]
"""Of the FMUs beside a block; builds.py adds those of another build."""


def path(name: str, kind: str = "native") -> Path:
    file = library.our_file(f"{name}.fmu", kind)
    assert file is not None
    return file


def field_with_noise(kind: str, instance: str) -> list[float]:
    """The first sample of a magnetometer with noise, of an instance of this name."""
    fmu = path("magnetometer", kind)
    description = description_of(fmu)
    of = {v.name: v.valueReference for v in description.modelVariables}
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=str(library.extract(fmu)),
        modelIdentifier=description.modelName,
        instanceName=instance,
    )
    slave.instantiate()
    slave.setReal([of["noise"]], [1e-7])
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.doStep(0.0, 1.0)
    field: list[float] = slave.getReal([of[f"b_body[{i}]"] for i in (1, 2, 3)])
    slave.freeInstance()
    return field


@pytest.mark.parametrize("kind", KINDS)
def test_noise_is_that_of_the_stem_of_a_file_name(kind):
    """Ecos names an instance by a path, fmucontainer by `CONTAINER.FILE`."""
    field = field_with_noise(kind, "field")
    for name in ("a/b.c/field.fmu", "a\\field.fmu", "loop.field.fmu", "field.fmu"):
        assert field_with_noise(kind, name) == field
    assert field_with_noise(kind, "loop.field") != field


# --- an FMU beside its block ----------------------------------------------------------


class Pair:
    """An FMU through fmpy, beside the block that it is made of."""

    def __init__(self, fmu: Path, block: Block, folder: Path | None = None) -> None:
        self.block, self.messages = block, []
        description = description_of(fmu)
        self.references: dict[str, list[int]] = {}
        for v in description.modelVariables:
            self.references.setdefault(v.name.partition("[")[0], []).append(
                v.valueReference
            )
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(folder or library.extract(fmu)),
            modelIdentifier=description.modelName,
            instanceName=block.instance,
        )
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(
            lambda *values: self.messages.append(values[-1].decode())
        )
        self.fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def give(self, *causalities: str) -> None:
        for v in self.block.variables:
            if v.causality in causalities:
                value = getattr(self.block, v.name)
                if isinstance(value, float) and not math.isfinite(
                    value
                ):  # which only the block's own arithmetic could give it
                    self.poke(self.references[v.name][0], value)
                    continue
                set_them = getattr(self.fmu, f"set{v.type}")
                set_them(self.references[v.name], list(value) if v.shape else [value])

    def poke(self, reference: int, value: float) -> None:
        """Put a Real where it lies, past the wrapper."""
        place = (ctypes.c_void_p * 1)()
        find = self.fmu.dll.desat_places
        find.restype = ctypes.c_bool
        assert find(
            ctypes.c_void_p(self.fmu.component),
            ctypes.c_char(b"R"),
            (ctypes.c_uint * 1)(reference),
            ctypes.c_size_t(1),
            place,
        )
        ctypes.c_double.from_address(place[0]).value = value

    def outputs(self) -> dict[str, list[Any]]:
        return {
            v.name: [
                _bits(x)
                for x in getattr(self.fmu, f"get{v.type}")(self.references[v.name])
            ]
            for v in self.block.variables
            if v.causality == "output" and v.name != "fault"
        }

    def failed(self) -> bool:
        return bool(self.fmu.getBoolean(self.references["fault"])[0])

    def step(self, t: float, dt: float) -> None:
        with contextlib.suppress(fmpy.fmi1.FMICallException):
            self.fmu.doStep(t, dt)

    def restore(self) -> None:
        """Go on from the saved state, as it comes back from its bytes."""
        state = self.fmu.getFMUstate()
        data = self.fmu.serializeFMUstate(state)
        self.fmu.freeFMUstate(state)
        self.fmu.setFMUstate(self.fmu.deSerializeFMUstate(data))

    def free(self) -> None:
        self.fmu.fmi2FreeInstance(self.fmu.component)


def restore(block: Block) -> None:
    """Let a block go on from its saved state, which has the types of its values."""
    values = block.decode(block.encode(vars(block)))
    assert repr(values) == repr(vars(block))  # a named tuple shows its type
    vars(block).update(values)


def _bits(x: Any) -> Any:
    if isinstance(x, float):
        return struct.pack("<d", math.nan if math.isnan(x) else x)
    return int(x)


def outputs(block: Block) -> dict[str, list[Any]]:
    values = {
        v: getattr(block, v.name) for v in block.variables if v.causality == "output"
    }
    return {
        v.name: [_bits(x) for x in (value if v.shape else (value,))]
        for v, value in values.items()
        if v.name != "fault"
    }


def randomise_parameters(block: Block, rng: random.Random) -> None:
    """Some parameters near their start value, some choices and switches anyhow."""
    for v in block.variables:
        if v.causality != "parameter" or rng.random() < 0.6:
            continue
        new: list[Any] = []
        for x in v.flat_start():
            low = -math.inf if v.minimum is None else v.minimum
            high = math.inf if v.maximum is None else v.maximum
            if v.type == "Boolean":
                new.append(rng.random() < 0.5)
            elif v.type == "Integer":
                new.append(rng.randint(int(max(low, -5)), int(min(high, 50))))
            else:
                y = (
                    x * math.exp(rng.gauss(0, 0.3))
                    if x
                    else rng.choice([0.0, rng.gauss(0, 1e-3)])
                )
                new.append(min(max(y, low), high))
        setattr(block, v.name, tuple(new) if v.shape else new[0])


def _error(call: Any) -> str:
    """What a block says as it fails; nothing where it does not."""
    try:
        call()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


@pytest.mark.parametrize("name", NATIVE)
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32))
def test_block_and_both_fmus_are_bitwise_alike(name, seed):
    """Parameters, inputs and steps anyhow: outputs, failures and their texts.

    In the midst of it each goes on from its saved state.
    """
    rng = random.Random(seed)
    block = registry.block_class(name)()
    block.instance = rng.choice(["a", "wheels", "Käfer.1"])
    if rng.random() < 0.7:
        randomise_parameters(block, rng)
    randomise_inputs(block, rng)
    both = [Pair(path(name, kind), block) for kind in KINDS]
    try:
        for i in both:
            i.fmu.setupExperiment(startTime=0.0)
            i.fmu.enterInitializationMode()
            i.give("parameter", "input")
            i.fmu.exitInitializationMode()
        message = _error(lambda: (block.check(), block.start(), block.output(0.0)))
        t, dt = 0.0, rng.choice([1.0, 0.5, 0.1, 5.0])
        for _ in range(15):
            for i in both:
                assert i.failed() == bool(message), message
                if message:
                    assert i.messages[-1].rpartition(f": {message}")[1], (
                        i.messages,
                        message,
                    )
                else:
                    assert i.outputs() == outputs(block)
            if message:
                return
            if rng.random() < 0.2:
                restore(block)
                for i in both:
                    i.restore()
            if rng.random() < 0.7:
                randomise_inputs(block, rng)
            for v in block.variables:
                if (
                    v.causality == "input"
                    and v.type == "Boolean"
                    and rng.random() < 0.1
                ):
                    setattr(block, v.name, rng.random() < 0.7)
            for i in both:
                i.give("input")
                i.step(t, dt)
            now = t
            message = _error(lambda: (block.advance(now, dt), block.output(now + dt)))  # noqa: B023
            t += dt
    finally:
        for i in both:
            i.free()


@pytest.mark.parametrize("name", NATIVE)
def test_a_saved_state_goes_on_in_another_library(name, tmp_path):
    """Saved, serialised and loaded in a second copy of the library: the same bits."""
    block = registry.block_class(name)()
    with zipfile.ZipFile(path(name)) as archive:
        archive.extractall(tmp_path)
    a, b = Pair(path(name), block), Pair(path(name), block, tmp_path)
    rng = random.Random(5)
    try:
        for i in (a, b):
            i.fmu.setupExperiment(startTime=0.0)
            i.fmu.enterInitializationMode()
            i.fmu.exitInitializationMode()
        for k in range(4):
            a.step(float(k), 1.0)
        state = a.fmu.getFMUstate()
        state_bytes = a.fmu.serializeFMUstate(state)
        b.fmu.setFMUstate(b.fmu.deSerializeFMUstate(state_bytes))
        for k in range(4, 10):
            randomise_inputs(block, rng)
            for i in (a, b):
                i.give("input")
                i.step(float(k), 1.0)
            assert a.outputs() == b.outputs()
            assert not a.failed()
        with pytest.raises(fmpy.fmi1.FMICallException):
            b.fmu.deSerializeFMUstate(b"x" + state_bytes[1:])
        a.fmu.freeFMUstate(state)
    finally:
        a.free()
        b.free()


# --- what is built --------------------------------------------------------------------


def test_every_block_is_native_but_the_pinned_ones():
    index = json.loads((paths.fmus() / build.INDEX).read_text(encoding="utf-8"))
    index_entries = {(e["kind"], e["name"]): e for e in index}
    assert {n for kind, n in index_entries if kind == "python"} == set(registry.names())
    assert {n for kind, n in index_entries if kind == "native"} == set(NATIVE), [
        e["why"] for e in index if "why" in e
    ]
    for (kind, name), e in index_entries.items():
        data = (paths.fmus() / e["file"]).read_bytes()
        assert e["bytes"] == len(data)
        assert e["sha256"] == hashlib.sha256(data).hexdigest()
        here = (
            fmi3.PLATFORMS[native.platform()]
            if kind == "fmi3"
            else (native.platform(),)
        )
        assert {*here} <= {*e["platforms"]}
        assert ("why" in e) == (kind == "python" and name in native.PINNED)
    assert len(native.PINNED) <= 4


@pytest.mark.parametrize("name", NATIVE)
def test_it_validates_and_is_described_as_the_python_one(name):
    # of the same description the Python FMUs are validated, all of them
    if name in NATIVE[1::6] and name != "manager_preview_learning":  # 18 s
        assert validate_fmu(str(path(name))) == []
    texts = []
    for kind in ("native", "python"):
        with zipfile.ZipFile(path(name, kind)) as archive:
            files = set(archive.namelist())
            root = etree.fromstring(
                archive.read("modelDescription.xml"),
                etree.XMLParser(remove_blank_text=True),
            )
        simulation = root.find("CoSimulation")
        if kind == "native":
            source_files = simulation.find("SourceFiles")
            sources = [f.get("name") for f in source_files]
            assert sources == sorted(("fmi2.c", "fmi3.c", "runtime.c", f"{name}.c"))
            assert {f"sources/{f}" for f in (*sources, "block.h", "fmi2.h")} <= files
            simulation.remove(source_files)
            assert simulation.get("needsExecutionTool") == "false"
        for element, key in (
            (root, "guid"),
            (root, "generationTool"),
            (simulation, "needsExecutionTool"),
        ):
            del element.attrib[key]
        texts.append(etree.tostring(root))
    assert texts[0] == texts[1]


def test_the_same_sources_give_the_same_bytes(tmp_path):
    assert build.build_native(("tachometers",), tmp_path) == {}
    again = (tmp_path / "native" / "tachometers.fmu").read_bytes()
    assert again == path("tachometers").read_bytes()


def test_without_a_compiler_it_says_so(tmp_path, monkeypatch):
    def none(*_: object) -> tuple[str, ...]:
        raise NoCompilerError("no C compiler")

    monkeypatch.setattr(native, "compiler", none)
    monkeypatch.setattr(native, "made_of", none)
    index = build.update(("tachometers",), tmp_path)
    assert [(e["kind"], e["why"]) for e in index] == [
        ("python", "no C compiler where it was built")
    ]
    assert not (tmp_path / "native").exists()


def test_what_is_there_is_not_built_again(tmp_path, monkeypatch):
    first = build.update(("tachometers",), tmp_path)
    monkeypatch.setattr(build, "build_all", None)
    monkeypatch.setattr(build, "build_native", None)
    assert build.update(("tachometers",), tmp_path) == first


# --- hosts ----------------------------------------------------------------------------


def test_a_plain_c_host_runs_all_of_them_in_an_empty_environment(tmp_path):
    host = tmp_path / "host"
    subprocess.run(
        [
            *compiler(),
            "-std=gnu11",
            "-w",
            str(ROOT / "tests" / "host.c"),
            "-ldl",
            "-o",
            str(host),
        ],
        check=True,
    )
    inputs = []
    for name in NATIVE:
        folder = library.extract(path(name))
        inputs.append(str(folder / "binaries" / native.platform() / f"{name}.so"))
        inputs.append(fmpy.read_model_description(folder).guid)
    host_run = subprocess.run(
        ["/usr/bin/env", "-i", str(host), *inputs],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        cwd=tmp_path,
    )
    assert host_run.stdout.splitlines()[-1:] == [f"{len(NATIVE)} FMUs"], (
        host_run.stdout + host_run.stderr
    )
    libraries = subprocess.run(
        ["ldd", inputs[0]], capture_output=True, text=True, check=False
    ).stdout
    if libraries:
        assert "python" not in libraries


def _twice(fmu):
    fmu.terminate()
    fmu.terminate()


OUT_OF_ORDER = {
    "setup": (
        lambda fmu, of: fmu.setupExperiment(startTime=1.0),
        "set up the experiment: RuntimeError: it has begun",
    ),
    "enter": (
        lambda fmu, of: fmu.enterInitializationMode(),
        "enter initialisation: RuntimeError: it was entered before",
    ),
    "terminate": (
        lambda fmu, of: _twice(fmu),
        "terminate: RuntimeError: it was before",
    ),
    "output": (
        lambda fmu, of: fmu.setReal([of["m_mean_body"]], [1.0]),
        "set Real: ValueError: m_mean_body[1]: an output is not set",
    ),
    "nan": (
        lambda fmu, of: fmu.setReal([of["m_cmd_body"] + 1], [math.nan]),
        "set Real: ValueError: m_cmd_body[2]: nan is no number",
    ),
    "infinity": (
        lambda fmu, of: fmu.setReal([of["m_cmd_body"] + 1], [-math.inf]),
        "set Real: ValueError: m_cmd_body[2]: -inf is no number",
    ),
}
"""What FMI forbids while a simulation runs, and what an FMU of ours says."""


TIMES = {
    "a start at t = nan s": (math.nan, None),
    "a start at t = inf s": (math.inf, None),
    "a stop at t = 1.0 s, with a start at t = 2.0 s": (2.0, 1.0),
    "a stop at t = nan s, with a start at t = 0.0 s": (0.0, math.nan),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("message", TIMES)
def test_times_that_cannot_be_are_refused(kind, message):
    i = Pair(path("torquers", kind), registry.block_class("torquers")())
    start, stop = TIMES[message]
    with contextlib.suppress(fmpy.fmi1.FMICallException):
        i.fmu.setupExperiment(startTime=start, stopTime=stop)
    assert i.messages[-1].endswith(f"set up the experiment: RuntimeError: {message}")
    i.free()


@pytest.mark.parametrize("kind", KINDS)
def test_no_step_goes_beyond_the_stop(kind):
    """But for rounding; after a reset there is no stop."""
    i = Pair(path("torquers", kind), registry.block_class("torquers")())
    i.fmu.setupExperiment(startTime=0.0, stopTime=0.3)
    i.fmu.enterInitializationMode()
    i.fmu.exitInitializationMode()
    for k in range(3):
        i.fmu.doStep(0.1 * k, 0.1)
    with pytest.raises(fmpy.fmi1.FMICallException):
        i.fmu.doStep(0.1 * 3, 0.1)
    assert "s, beyond the stop at t = 0.3 s" in i.messages[-1]
    i.free()


def test_wrong_calls_are_answered():
    block = registry.block_class("torquers")()
    i = Pair(path("torquers"), block)
    try:
        with pytest.raises(fmpy.fmi1.FMICallException):
            i.fmu.doStep(0.0, 1.0)  # before initialisation
        assert "a step outside step mode" in i.messages[-1]
        for call in (
            lambda: i.fmu.getReal([9999]),
            lambda: i.fmu.setReal([9999], [1.0]),
            lambda: i.fmu.getInteger([1]),
            lambda: i.fmu.setString([0], ["x"]),
        ):
            with pytest.raises(fmpy.fmi1.FMICallException):
                call()
        i.fmu.reset()
        assert not i.failed()
    finally:
        i.free()
    for call, message in OUT_OF_ORDER.values():
        i = Pair(path("torquers"), block)
        i.fmu.setupExperiment(startTime=0.0)
        i.fmu.enterInitializationMode()
        i.fmu.exitInitializationMode()
        i.step(0.0, 1.0)
        assert not i.failed()
        with pytest.raises(fmpy.fmi1.FMICallException):
            call(i.fmu, {name: of[0] for name, of in i.references.items()})
        assert message in i.messages[-1]
        i.fmu.reset()
        assert not i.failed()
        i.free()
    description = fmpy.read_model_description(path("torquers"))
    other = FMU2Slave(
        guid="{another}",
        unzipDirectory=str(library.extract(path("torquers"))),
        modelIdentifier="torquers",
        instanceName="x",
    )
    with pytest.raises(Exception, match="instantiate"):
        other.instantiate()
    assert description.coSimulation.canSerializeFMUstate


@pytest.mark.parametrize(
    ("scenario", "stop"),
    [
        ("integrated/mil-nadir", 60.0),
        ("uosat12/robust-receding_horizon-noise", None),  # sixty linear programmes
    ],
)
def test_a_scenario_runs_alike_with_both_kinds(scenario, stop):
    runs = [
        execute(scenario, Options(stop=stop, fmus=kind))
        for kind in ("native", "python")
    ]
    a, b = (run.results for run in runs)
    assert len(a.names()) > 30
    assert a.names() == b.names()
    for name in a.names():
        assert a.values(name).tobytes() == b.values(name).tobytes(), name


# --- arithmetic and refusals, on blocks of their own ----------------------------------


HEAD = """from __future__ import annotations

import math
from bisect import bisect_right
from functools import lru_cache
from typing import NamedTuple

from desat.components.contract.block import Block, BlockError, Input, Output, Parameter, Vec3

TABLE = (-2.0, -0.5, 0.0, 0.5, 3.0)


class Place(NamedTuple):
    at: int
    share: float


@lru_cache
def kept(k: int) -> tuple[float, ...]:
    # more than a kilobyte
    return tuple(float(i * k) for i in range(200))


def through(rows: tuple[float, ...]) -> float:
    return rows[1] + kept(2)[1]


def one(v: float, gain: float = 1.0) -> float:
    return v * gain


def two(v: float, gain: float = 2.0) -> float:
    return v + gain


def same(rows: list[float]) -> list[float]:
    return rows


def guarded(v: float, n: int) -> float:
    s = 0.0
    for i in range(4):
        try:
            if i == n:
                continue
            s += 1.0 / v
        except ZeroDivisionError:
            raise BlockError("substeps")
    return s


class Tried(Block):
    \"\"\"A block for tests\"\"\"

    role = "tried"
    x: float = Input("1", "a number")
    y: float = Input("1", "another")
    n: int = Input("1", "an integer")
    a: Vec3 = Output("1", "what comes out", interval=True)
    k: int = Output("1", "an integer that comes out", interval=True)

    def start(self) -> None:
        self._k = 0
        self._u = 0.0
        self._t = (1.0, 2.0, 3.0)
        self.a, self.k = (0.0, 0.0, 0.0), 0

    def bump(self) -> int:
        self._k += 1
        return self._k

    def eat(self, v: float) -> float:
        self._t = (self.x, self.x, self.x)
        return v

    def total(self) -> float:
        return self._u + 10.0 * self.x

    def maybe(self, v: float) -> float | None:
        return 1.0 / v if v < 5.0 else None

    def slot(self, n: int) -> float:
        if n > 1:
            n = n % 5
        return TABLE[n]

    def cut(self, v: float, n: int) -> float:
        if v > 0.0:
            n = 4
        return max(TABLE[:n])

    def inverse(self, given: float) -> float:
        try:
            return 1.0 / given
        except ZeroDivisionError as error:
            raise BlockError(error)

    def deep(self, n: int) -> float:
        if n <= 0:
            return 0.0
        return 1.0 + self.deep(n - 1)

"""


@pytest.fixture
def write_block(tmp_path):
    """A block of source text, as a file of somebody's own."""
    count = 0

    def make(body: str) -> type[Block]:
        nonlocal count
        count += 1
        file = tmp_path / f"tried{count}.py"
        text = HEAD + "    def advance(self, t: float, dt: float) -> None:\n"
        file.write_text(
            text + "".join(f"        {line}\n" for line in body.splitlines())
        )
        return registry.block_class(str(file))

    return make


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("rows = {1: self.x}", "a dict"),
        ("rows = {self.x}", "a set"),
        ("rows = [self.x]\nrows.append(1.0)", ".append"),
        ("self.a = (math.hypot(self.x, self.y), 0.0, 0.0)", "hypot"),
        ("self.a = (sum(v for v in TABLE), 0.0, 0.0)", "sum"),
        ("import numpy", "a import statement"),
        ("self.a = tuple(self.x for k in range(self.n))", "any length"),
        ("self._k = TABLE[: self.n]\nself._k = 1", "self._k is"),
        ("self.a = (self._never, 0.0, 0.0)", "self._never is never assigned"),
        ("with open('x'):\n    pass", "a with statement"),
        ("self.a = (self.x, 0.0)", "for"),
        ("self.a = ('text', 0.0, 0.0)", "str where float is needed"),
        ("x = 1.0\nx = (1.0, 2.0)", "x is"),
        ("self.a = (TABLE[7], 0.0, 0.0)", "index 7 of a tuple of 5"),
        ("print(self.x)", "print()"),
        ("yield self.x", "yield"),
        (
            "def f(u: float) -> float:\n    return u * k\nk = 2.0\nself.a = (f(1.0), 0.0, 0.0)",
            "k",
        ),
        ("self.a = (kept(1)[0] + kept(2)[0], 0.0, 0.0)", "kept is called again"),
        ("self.a = (through(kept(1)), 0.0, 0.0)", "kept is called again"),
        # an int where another way gives a float: -0 is 0, and -0.0 is not
        ("self.a = (-max(self.x, 0), 0.0, 0.0)", "float and int"),
        ("self.a = (1 if self.n else self.x, 0.0, 0.0)", "int and float"),
        (
            "self.a = (min((0.5, 1, 2), key=lambda v: abs(v - self.x)), 0.0, 0.0)",
            "float and int",
        ),
        (
            "self.a = (next(v for v in (1, 2.5) if v > self.x), 0.0, 0.0)",
            "int and float",
        ),
        ("self.a = (self.x / (2**64 + 5), 0.0, 0.0)", "a power of integers"),
        ("self.a = (self.x / 18446744073709551621, 0.0, 0.0)", "18446744073709551621"),
        ("self.a = (math.pow(self.x, 2.0), 0.0, 0.0)", "math.pow"),
        ("self._mode = f'{self.x}'", "keeps text"),
        ("self._late = self.x", "start does not assign self._late"),
        ("self.fail(f'{self.instance!r}')", "!r of text"),
        # an order, or a loop over what changes
        (
            "rows = [0.0, 0.0]\nrows[self.bump() - 1] += 1.0",
            "a call that changes something",
        ),
        (
            "rows = [0.0, 0.0]\nrows[self.bump() - 1] = 1.0",
            "a call that changes something",
        ),
        ("self.a = (self._t[self.bump()], 0.0, 0.0)", "a call that changes something"),
        ("rows = [0.0, 0.0]\nk = rows[k] = 1.0", "an element among several targets"),
        (
            "self.a = (float(0 < self.n < self.bump()), 0.0, 0.0)",
            "a chained comparison",
        ),
        (
            "s = 0.0\nfor v in (self._u, self.x):\n    self._u = 100.0\n    s += v",
            "self._u changes in a loop over it",
        ),
        (
            "s = 0.0\nfor i, v in enumerate(self._t):\n    self._t = (0.0, 0.0, 0.0)\n    s += v",
            "self._t changes in a loop over it",
        ),
        (
            "n = 1\ns = 0.0\nfor i in range(n, 4):\n    n = 5\n    s += float(i)",
            "n changes in a",
        ),
        (
            "self.a = tuple(self.eat(v) for v in self._t)",
            "self._t changes in a loop over it",
        ),
        (
            "k = 0\ntry:\n    k = self.n\n    s = 1.0 / self.x\nexcept ZeroDivisionError:\n"
            "    self.fail(f'{k}')",
            "k is assigned in the try",
        ),
        # a list with two names
        (
            "rows = [self.x]\nother = [1.0]\nb = rows if self.n else other\nb[0] = 2.0",
            "another list",
        ),
        ("rows = [self.x]\nb = same(rows)\nb[0] = 2.0", "another list"),
        ("rows = [self.x]\nrows[0] = 1.0\npair = (rows, 1.0)", "within another one"),
        (
            "rows = [self.x]\ndef f(v: float) -> float:\n    return v + rows[0]\nrows[0] = 1.0\n"
            "self.a = (f(1.0), 0.0, 0.0)",
            "f uses rows, a list that changes",
        ),
    ],
)
def test_what_leaves_the_subset_is_refused_with_its_place(write_block, body, fault):
    with pytest.raises(SubsetError) as caught:
        program.translate(write_block(body), "tried", "")
    text = str(caught.value)
    assert text.startswith("tried1.py:"), text
    assert fault in text
    assert text.count(": ") >= 2, "the place, what, and what to write instead"


@pytest.fixture(scope="session")
def shared(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wrapper")
    native.compile_wrapper(folder)
    return folder


def compile_block(
    block: type[Block], folder: Path, shared: Path, guid: str = "{x}"
) -> Path:
    """A block of a test as an unpacked FMU."""
    files = {
        "block.h": (native.WRAPPER / "block.h").read_text(),
        "tried.c": program.translate(block, "tried", guid),
    }
    root = folder / "fmu"
    binaries = root / "binaries" / native.platform()
    binaries.mkdir(parents=True)
    work = folder / "work"
    work.mkdir()
    shutil.copy(native.compile_block(files, "tried", work, shared), binaries)
    (root / "modelDescription.xml").write_bytes(
        native.model_description(
            block, "tried", guid, native.DATE, "0", sources=["tried.c"]
        )
    )
    return root


ARITHMETIC = """if self.n == 0:
    self.a = (self.x % self.y, self.x // self.y, self.x**self.y)
elif self.n == 1:
    self.a = (self.x * round(self.y), math.remainder(self.x, self.y), float(math.floor(self.x)))
elif self.n == 2:
    k = math.floor(self.x)
    self.a = (float(k % 7), float(k // -3), TABLE[bisect_right(TABLE, self.y) - 1])
elif self.n == 3:
    self.a = (math.exp(self.x), math.log(self.y), self.x / self.y)
elif self.n == 4:
    self.a = (max(self.x, self.y), min(self.x, self.y), max(TABLE, key=lambda v: -v * v))
elif self.n == 5:
    self.a = (math.sqrt(self.x), math.asin(self.y), self.x**2)
elif self.n == 6:
    self.a = (TABLE[math.floor(self.x)], math.sin(self.y), math.atan2(self.x, self.y))
else:
    self.fail(f"{self.x} {self.y:g} {self.y:.3g} {self.x:.2f} {(self.x, 1.0)} {self.n}")
"""

NUMBERS = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    1.5,
    2.5,
    7.0,
    1e16,
    1e-5,
    123456789.0,
    5e-324,
    1e308,
    -1e300,
    0.1,
    1e22,
    2.0**53,
    math.pi,
    -math.pi,
    math.inf,
    -math.inf,
    math.nan,
)


ALIKE = (
    "rows = [1.0, 2.0, self.x]\ns = 0.0\nfor i, v in enumerate(rows):\n    rows[i] = 0.0\n"
    "    s += v\nself.a = (s, rows[2], 0.0)",
    "rows = [1.0, 2.0, self.x]\ns = 0.0\nfor v in rows:\n    rows[0] = 7.0\n    s = 2.0 * s + v\n"
    "self.a = (s, 0.0, 0.0)",
    "s = 0.0\nfor v in self._t:\n    s += v * self.eat(v)\nself.a = (s, 0.0, 0.0)",
    "self._u, s = self._u + 1.0, self.total() + self._u\nself.a = (self._u, s, 0.0)",
    "part_1 = self.x\nk_1 = self.y\ns = 0.0\nfor v in TABLE:\n    s += v * k_1\n"
    "self.a = (s, part_1, 0.0)",
    "f = one if self.n > 1 else two\nself.a = (f(self.x, gain=3.0), f(self.x), 0.0)",
    "self.a = (self.slot(self.n), self.cut(self.x, 2), 0.0)",
    "k = 0.0\nfor v, f in ((0, one), (1, two), (2, one)):\n    if v == self.n:\n"
    "        k = f(self.x, 5.0)\nself.a = (k, 0.0, 0.0)",
    "s = 0.0\nfor i in range(5 + self.n % 6, self.n % 4, -1):\n    s = s * 1.5 + TABLE[i - 5]\n"
    "self.a = (s, 0.0, 0.0)",
    "self.a = (guarded(self.x, self.n), self.inverse(self.y), 0.0)",
    "k = 0\nfor i in range(5):\n    try:\n        if i == self.n:\n            break\n"
    "        k = i\n    except ZeroDivisionError:\n        self.fail('never')\n"
    "self.a = (float(k), self.inverse(self.x), 0.0)",
    "self.a = (1.0 if self.x != 0.0 and self.maybe(self.x) else 2.0, 0.0, 0.0)",
    "s = tuple(v for v in TABLE if v > self.x if self.bump() > 1)\n"
    "self.a = (float(self._k), float(len(s)), 0.0)",
    "self.fail(f'{self._k} {self.bump()} {self.x} {2.0**-24 * self.y}')",
    "_ = 1.0 / self.x\n(1.0 / self.y, 2.0)\nself.a = (1.0, 2.0, 3.0)",
    "h = 6364136223846793005 * (self.n + 5) & (1 << 64) - 1\nself.fail(f'{h}')",
    "self.a = (self.deep(self.n), 0.0, 0.0)",
    "p = Place(abs(self.n) % 5, 1)\nself.a = (TABLE[p.at], 0.5 * p.share, 0.0)\nself.k = p.at",
)
"""What was, or might be, done otherwise in C."""


@pytest.mark.parametrize("body", ALIKE)
def test_order_and_objects_are_pythons(write_block, tmp_path, shared, body):
    block = write_block(body)()
    folder = compile_block(type(block), tmp_path, shared)
    i = Pair(folder, block, folder)
    i.fmu.setupExperiment(startTime=0.0)
    i.fmu.enterInitializationMode()
    i.fmu.exitInitializationMode()
    state = i.fmu.getFMUstate()
    for x, y, n in itertools.product(
        (0.0, -0.0, 1.5, -2.0, 7.0), (1.0, 0.0), (-1, 0, 1, 2, 3, 10)
    ):
        block.x, block.y, block.n = x, y, n
        block.start()
        i.fmu.setFMUstate(state)
        i.messages.clear()
        i.give("input")
        i.step(0.0, 1.0)
        message = _error(lambda: block.advance(0.0, 1.0))
        assert i.failed() == bool(message), (x, y, n, message, i.messages)
        if message:
            assert i.messages[-1].endswith(message), (x, y, n)
        else:
            assert i.outputs() == outputs(block), (x, y, n)
    i.free()


def test_states_and_phases_of_another_kind_are_refused(write_block, tmp_path, shared):
    """A state of another FMU; a step without initialisation, by which nothing has
    started; an integer that FMI 2.0 does not have; no strings at all are no failure."""
    instances = []
    for k, body in enumerate(
        ("self.k = 1 << 40", "self.a = (self.x, self._u, 1.0)\nself.k = 2")
    ):
        block = write_block(body)()
        place = tmp_path / str(k)
        place.mkdir()
        folder = compile_block(type(block), place, shared, guid=f"{{{k}}}")
        instances.append(Pair(folder, block, folder))
    one, other = instances
    assert other.fmu.getString([]) == []
    for i in instances:
        i.fmu.setupExperiment(startTime=0.0)
    with pytest.raises(fmpy.fmi1.FMICallException):
        other.fmu.exitInitializationMode()
    assert other.messages[-1].endswith(
        "leave initialisation: RuntimeError: it was not entered"
    )
    other.fmu.reset()
    for i in instances:
        i.fmu.enterInitializationMode()
        i.fmu.exitInitializationMode()
    with pytest.raises(fmpy.fmi1.FMICallException):
        other.fmu.setFMUstate(one.fmu.getFMUstate())
    assert "this is no state of this FMU" in other.messages[-1]
    one.step(0.0, 1.0)
    with pytest.raises(fmpy.fmi1.FMICallException):
        one.fmu.getInteger(one.references["k"])
    assert "beyond 32 bits" in one.messages[-1]
    for i in instances:
        i.free()


def test_what_has_no_end_is_ended(write_block, tmp_path, shared):
    """Recursion, before it takes the host's stack; integers that no double has."""
    for body, n, message in (
        (
            "self.a = (self.deep(self.n), 0.0, 0.0)",
            10**8,
            "maximum recursion depth exceeded",
        ),
        (
            "k = self.n * 9007199254740993\nself.a = (float(k > self.x), 0.0, 0.0)",
            1,
            "64 bits",
        ),
        ("k = self.n * 9007199254740993\nself.a = (k / 3, 0.0, 0.0)", 1, "64 bits"),
    ):
        block = write_block(body)()
        place = tmp_path / str(len(list(tmp_path.iterdir())))
        place.mkdir()
        folder = compile_block(type(block), place, shared)
        i = Pair(folder, block, folder)
        i.fmu.setupExperiment(startTime=0.0)
        i.fmu.enterInitializationMode()
        i.fmu.exitInitializationMode()
        block.n = n
        i.give("input")
        i.step(0.0, 1.0)
        assert i.failed()
        assert message in i.messages[-1]
        i.free()


def test_arithmetic_and_texts_are_pythons(write_block, tmp_path, shared):
    """Powers, remainders, roundings, roots, indices, formats: values, failures and
    their texts."""
    block_class = write_block(ARITHMETIC)
    folder = compile_block(block_class, tmp_path, shared)
    rng = random.Random(11)
    cases = [(x, y) for x in NUMBERS for y in NUMBERS]
    cases += [
        (rng.gauss(0, 1) * 10.0 ** rng.randint(-8, 20), rng.gauss(0, 3))
        for _ in range(400)
    ]
    block = block_class()
    i = Pair(folder, block, folder)
    i.fmu.setupExperiment(startTime=0.0)
    i.fmu.enterInitializationMode()
    i.fmu.exitInitializationMode()
    state = i.fmu.getFMUstate()
    refusal_count = 0
    for x, y in cases:
        for n in range(8):
            block.x, block.y, block.n = x, y, n
            i.fmu.setFMUstate(state)
            i.messages.clear()
            i.give("input")
            i.step(0.0, 1.0)
            message = _error(lambda: block.advance(0.0, 1.0))
            if n == 0 and -math.inf < x < 0.0 and abs(y) < 1e15 and y != math.floor(y):
                # Python goes on with a complex number
                message = "ValueError: a negative number to a fractional power"
            if i.failed() and i.messages[-1].endswith(
                "OverflowError: an integer beyond 64 bits"
            ):
                assert not -(2**62) < x < 2**62  # refused, never wrong
                refusal_count += 1
                continue
            assert i.failed() == bool(message), (x, y, n, message, i.messages)
            if message:
                assert i.messages[-1].endswith(message), (x, y, n)
            else:
                assert i.outputs() == outputs(block), (x, y, n)
    assert 0 < refusal_count < len(cases)
    i.free()


def test_the_blocks_are_within_and_a_new_one_is_told(monkeypatch):
    monkeypatch.setattr(subset, "names", lambda: ("environment_tle", "tachometers"))
    monkeypatch.setattr(subset, "PINNED", {"tachometers": "", "gone": ""})
    stale_pin, out, needless = subset.problems()
    assert stale_pin == "fmus/native.py: PINNED has gone, which is no block"
    assert out.startswith("components/physics/tle.py:")
    assert (
        needless == "fmus/native.py: tachometers translates and need not be in PINNED"
    )
    assert subset.main() == 1


SANE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def run_sanitizers(names: Sequence[str], folder: Path) -> dict[str, str]:
    """What AddressSanitizer and UBSan, or the host of the other test, say of the C of
    blocks."""
    release_flags = [f for f in native.FLAGS if f not in ("-O3", "-fvisibility=hidden")]
    build = [*compiler(), *release_flags, "-g", "-w", "-std=gnu11", *SANE]
    host = (
        (ROOT / "tests" / "host.c")
        .read_text()
        .replace("dlopen(path, RTLD_NOW)", "dlopen(0, RTLD_NOW)")
    )
    (folder / "host.c").write_text("#define _GNU_SOURCE\n" + host)
    reports = {}
    for name in names:
        files, guid = native.sources(name)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        for unit in ("host", *native.UNITS, name):
            if unit == name or not (folder / f"{unit}.o").exists():
                subprocess.run([*build, "-c", f"{unit}.c"], cwd=folder, check=True)
        units = [f"{unit}.o" for unit in ("host", *native.UNITS, name)]
        subprocess.run(
            [*build, "-rdynamic", *units, "-lm", "-ldl", "-o", name],
            cwd=folder,
            check=True,
        )
        ran = subprocess.run(
            [str(folder / name), "itself", guid],
            capture_output=True,
            text=True,
            check=False,
        )
        if ran.stdout.splitlines()[-1:] != ["1 FMUs"]:
            reports[name] = ran.stdout + ran.stderr
    return reports


@pytest.mark.skipif(sys.platform != "linux", reason="the sanitizers of gcc or clang")
def test_no_sanitizer_complains(tmp_path):
    """Of a block; `python -m tests.fmus.test_native` tries all."""
    assert run_sanitizers(["thrusters"], tmp_path) == {}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as write_block:
        complaints = run_sanitizers(NATIVE, Path(write_block))
        print(
            f"{len(NATIVE) - len(complaints)} of {len(NATIVE)} blocks without a complaint"
        )
        print(
            *(f"{name}: {text[:2000]}" for name, text in complaints.items()), sep="\n"
        )
