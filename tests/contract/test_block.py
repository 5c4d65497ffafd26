"""The contract that every block keeps, over all blocks of the registry."""

from __future__ import annotations

import copy
import inspect
import json
import math
import random
import re

import pytest

from desat.components.blocks.manager_threshold import ManagerThreshold
from desat.components.contract.block import (
    Block,
    BlockError,
    Input,
    Output,
    Parameter,
    Sampled,
    Vec3,
)
from desat.fmus import registry
from desat.fmus.description import title
from desat.numbers.derived import pointing
from desat.runs.run import Options, execute

BLOCKS = registry.names()


def fresh(name: str) -> Block:
    return registry.block_class(name)()


def randomise_inputs(block: Block, rng: random.Random) -> None:
    """Plausible inputs: near the start value, by unit."""
    size = {
        "T": 3e-5,
        "N.m.s": 0.1,
        "N.m": 1e-3,
        "rad/s": 1e-3,
        "A.m2": 5.0,
        "1": 0.3,
        "kg/m3": 1e-12,
    }
    for v in block.variables:
        if v.causality != "input" or v.type != "Real":
            continue
        if v.name.startswith("q_"):
            q = [rng.gauss(0, 1) for _ in range(4)]
            n = math.sqrt(sum(x * x for x in q))
            setattr(block, v.name, tuple(x / n for x in q))
            continue
        s = size.get(v.unit, 0.0)
        new = tuple(x + rng.gauss(0, s) for x in v.flat_start())
        setattr(block, v.name, new if v.shape else new[0])


def drive(
    block: Block, rng: random.Random, steps: int, k0: int = 0, dt: float = 1.0
) -> list:
    """Outputs over some steps with random inputs."""
    rows = []
    for k in range(k0, k0 + steps):
        randomise_inputs(block, rng)
        block.advance(k * dt, dt)
        block.output((k + 1) * dt)
        rows.append(outputs(block))
    return rows


def outputs(block: Block, interval: bool | None = None) -> dict:
    return {
        v.name: getattr(block, v.name)
        for v in block.variables
        if v.causality == "output" and (interval is None or v.interval == interval)
    }


def begin(block: Block, rng: random.Random | None = None) -> Block:
    if rng:
        randomise_inputs(block, rng)
    block.check()
    block.start()
    block.output(0.0)
    return block


# words and signs that cannot end a title
OPEN_ENDS = re.compile(
    r"(\b(a|an|and|as|at|by|for|from|in|it|of|on|or|that|the|to|which|while|with)"
    r"|[-,:;(])$"
)


@pytest.mark.parametrize("name", BLOCKS)
def test_a_title_is_a_whole_phrase_on_one_line(name):
    block = registry.block_class(name)
    first, second = inspect.getdoc(block).splitlines()[:2]
    assert title(block) == first
    assert not second, f"the title goes on: {first} | {second}"
    assert not OPEN_ENDS.search(first), first


@pytest.mark.parametrize("name", BLOCKS)
def test_page(name):
    block = registry.block_class(name)
    text = inspect.getdoc(block)
    assert text
    assert len(title(block)) < 100
    assert len(text.splitlines()) > 2, "a block's page needs its equations"
    for v in block.variables:
        assert v.description
        assert not v.description.endswith(".")
        assert v.name == v.name.lower()


@pytest.mark.parametrize("name", BLOCKS)
def test_role_interface(name):
    """A block adds no connector to the loop that its role does not have."""
    block = registry.block_class(name)
    role = block.__mro__[1]
    assert role.role == block.role
    assert block.role
    extra_names = {v.name for v in block.variables} - {v.name for v in role.variables}
    assert not [
        v.name
        for v in block.variables
        if v.name in extra_names and v.causality == "input"
    ]


@pytest.mark.parametrize("name", BLOCKS)
def test_start_is_repeatable(name):
    block = begin(fresh(name), random.Random(1))
    once = copy.deepcopy(vars(block))
    begin(block)
    assert vars(block) == once
    drive(block, random.Random(2), 5)
    for v in block.variables:
        if v.causality == "input":
            setattr(block, v.name, once[v.name])
    begin(block)
    assert vars(block) == once


@pytest.mark.parametrize("name", BLOCKS)
def test_state_is_its_attributes(name):
    """A copy of `__dict__`, through JSON, continues with the same bits."""
    block = begin(fresh(name), random.Random(3))
    drive(block, random.Random(4), 7)

    def frozen(x):
        assert isinstance(x, (float, int, str, tuple, type(None))), (
            f"{x!r} is not immutable"
        )
        return tuple(frozen(y) for y in x) if isinstance(x, tuple) else x

    state = {k: frozen(v) for k, v in vars(block).items()}
    text = json.dumps(state)
    baseline = fresh(name)
    vars(baseline).clear()
    vars(baseline).update({k: _tuples(v) for k, v in json.loads(text).items()})
    a = drive(block, random.Random(5), 20, k0=7)
    b = drive(baseline, random.Random(5), 20, k0=7)
    assert repr(a) == repr(b)


def _tuples(x):
    return tuple(_tuples(y) for y in x) if isinstance(x, list) else x


@pytest.mark.parametrize("name", BLOCKS)
def test_output_reads_no_input_and_changes_no_state(name):
    block = begin(fresh(name), random.Random(6))
    drive(block, random.Random(7), 3)
    before = copy.deepcopy(vars(block))
    randomise_inputs(block, random.Random(8))
    inputs = {v.name for v in block.variables if v.causality == "input"}
    block.output(3.0)
    assert {k: v for k, v in vars(block).items() if k not in inputs} == {
        k: v for k, v in before.items() if k not in inputs
    }


@pytest.mark.parametrize("name", BLOCKS)
def test_state_outputs_belong_to_output_and_interval_outputs_to_advance(name):
    block = begin(fresh(name), random.Random(9))
    drive(block, random.Random(10), 2)
    state = outputs(block, interval=False)
    block.advance(2.0, 1.0)
    assert outputs(block, interval=False) == state, (
        "advance() must not set state outputs"
    )
    interval = outputs(block, interval=True)
    block.output(3.0)
    assert outputs(block, interval=True) == interval, (
        "output() must not set interval outputs"
    )


@pytest.mark.parametrize("name", BLOCKS)
def test_starts_from_names_every_input_that_start_reads(name):
    """The initial dependencies that the FMU declares are complete."""
    base = begin(fresh(name), random.Random(11))
    for v in base.variables:
        if v.causality != "input":
            continue
        other = fresh(name)
        vars(other).update({w.name: getattr(base, w.name) for w in base.variables})
        random_block = fresh(name)
        randomise_inputs(random_block, random.Random(12))
        setattr(
            other,
            v.name,
            getattr(random_block, v.name)
            if v.type == "Real"
            else not getattr(base, v.name),
        )
        begin(other)
        for w in base.variables:
            if w.causality == "output" and getattr(other, w.name) != getattr(
                base, w.name
            ):
                assert v.name in w.starts_from, f"{w.name} starts from {v.name}"


@pytest.mark.parametrize("name", BLOCKS)
def test_bounds_are_checked(name):
    for v in registry.block_class(name).variables:
        if v.causality == "parameter" and v.minimum is not None:
            block = fresh(name)
            low = v.minimum - 1
            setattr(block, v.name, (low,) * v.size if v.shape else low)
            with pytest.raises(BlockError, match=rf"{v.name}.*outside"):
                block.check()


def test_not_a_number_is_refused():
    block = fresh("magnetometer")
    block.noise = math.nan
    with pytest.raises(BlockError, match="noise = nan is not a finite"):
        block.check()


def test_samples_fall_on_the_grid():
    class Counter(Sampled):
        """x"""

    for step in (0.1, 0.25, 1.0, 10.0):
        block = Counter()
        block.sample_time = 10 * step
        block.start()
        due = [k for k in range(100000) if block.due(k * step)]
        assert due == list(range(0, 100000, 10))


def test_declarations_are_refused():
    with pytest.raises(TypeError, match="furlong is no unit"):
        type(
            "B",
            (Block,),
            {"__annotations__": {"x": "float"}, "x": Input("furlong", "x")},
        )
    with pytest.raises(TypeError, match="annotate"):
        type("B", (Block,), {"__annotations__": {"x": "list"}, "x": Input("m", "x")})
    with pytest.raises(TypeError, match="needs 3"):
        type(
            "B",
            (Block,),
            {"__annotations__": {"x": "Vec3"}, "x": Input("m", "x", start=(1, 2))},
        )

    class Base(Block):
        x: Vec3 = Output("m", "x")

    with pytest.raises(TypeError, match="changes what its role declares"):

        class Derived(Base):
            x: float = Parameter("m", "x")


NAN = math.nan
# without law; those that detumble, whose losses are in test_hausat2.py: a phase is
# another law; and those whose coils keep an attitude as well, whose losses are in
# test_alsat1.py
OTHERS = (
    "manager_test_signal",
    "manager_b_dot",
    "manager_start_up",
    "manager_boom",
    "manager_detumbling_optimal",
    "manager_detumbling_rollout",
    "manager_boom_feedforward",
)
MANAGERS = [n for n in BLOCKS if n.startswith("manager_") and n not in OTHERS]
CONTROLLERS = [n for n in BLOCKS if n.startswith("controller_")]


def give_law(block: Block) -> None:
    """Tables that the ground computes, and no limit for a costate near the equator."""
    if hasattr(block, "gain_table"):
        block.gain_table = (9e5, 0.0, 0.0, 9e5, 0.0, 9e5) * 64
    if hasattr(block, "feedback_table"):
        block.feedback_table = (9e5, 0.0, 0.0, 9e5, 0.0, 9e5) * (
            len(block.feedback_table) // 6
        )
    if isinstance(block, ManagerThreshold):  # which dumps what there is, by coils
        block.by, block.begin, block.end = 1, 1e-3, 0.0
    if hasattr(block, "condition_limit"):
        block.condition_limit, block.table_nodes = 1e29, 64


def at_work(name: str) -> Block:
    """A manager or controller in the middle of something, sampled at every step of 10
    s."""
    block = fresh(name)
    give_law(block)
    for input, value in (
        ("b_body", (2e-5, -3e-5, 1e-5)),
        ("h_wheel", (0.1, -0.08, 0.05, 0.0)),
        ("omega_bi_body", (1e-3, -2e-3, 5e-4)),
        ("tau_ctrl_body", (1e-4, 2e-4, -3e-4)),
        ("q_bi", (0.1, 0.2, -0.1, math.sqrt(0.94))),
    ):
        if hasattr(block, input):
            setattr(block, input, value)
    block.sample_time = 10.0
    begin(block)
    for k in range(3):
        block.advance(10.0 * k, 10.0)
    return block


def all_finite(block: Block) -> bool:
    values = [
        getattr(block, v.name) for v in block.variables if v.causality == "output"
    ]
    return all(
        math.isfinite(x) for v in values for x in (v if isinstance(v, tuple) else (v,))
    )


@pytest.mark.parametrize("name", MANAGERS)
def test_a_field_that_is_not_valid_makes_no_dipole(name):
    block = at_work(name)
    assert any(block.m_cmd_body)
    block.valid_b, block.b_body = False, (NAN,) * 3
    block.advance(30.0, 10.0)
    assert not any(block.m_cmd_body)
    assert all_finite(block)
    block.valid_b, block.b_body = True, (2e-5, -3e-5, 1e-5)
    block.advance(40.0, 10.0)
    assert any(block.m_cmd_body)


@pytest.mark.parametrize("name", MANAGERS)
def test_a_momentum_that_is_not_valid_is_not_dumped(name):
    """What is left is what the manager does where it is not enabled (or the coils'
    share)."""
    block, idle = at_work(name), at_work(name)
    block.valid_h, block.h_wheel = False, (NAN,) * 4
    block.advance(30.0, 10.0)
    assert all_finite(block)
    assert not any(block.tau_cmd_thruster_body)
    if name == "manager_integrated":
        assert not any(block.tau_des_body)
    else:
        assert not any(block.m_cmd_body)
        idle.enable, idle.h_wheel = False, (0.0,) * 4
        idle.advance(30.0, 10.0)
        assert block.tau_cmd_wheel == idle.tau_cmd_wheel
        assert block.mode == idle.mode == 0


@pytest.mark.parametrize("name", MANAGERS)
def test_a_rate_that_is_not_valid_is_not_used(name):
    block, still = at_work(name), at_work(name)
    block.valid_omega, block.omega_bi_body = False, (NAN,) * 3
    block.advance(30.0, 10.0)
    assert all_finite(block)
    assert any(block.tau_cmd_wheel)
    if name != "manager_magnetic_ilqr":  # without a rate it has no law
        still.omega_bi_body = (0.0, 0.0, 0.0)
        still.advance(30.0, 10.0)
        assert outputs(block) == outputs(still)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize(
    ("flag", "input"), [("valid_q", "q_bi"), ("valid_omega", "omega_bi_body")]
)
def test_a_controller_rests_while_a_measurement_is_not_valid(name, flag, input):
    block = at_work(name)
    torque, integral = block.tau_ctrl_body, getattr(block, "_xi", None)
    measurement = getattr(block, input)
    assert any(torque)
    assert integral is None or any(integral)
    setattr(block, flag, False)
    setattr(block, input, (NAN,) * len(measurement))
    block.advance(30.0, 10.0)
    assert not any(block.tau_ctrl_body)
    assert getattr(block, "_xi", None) == integral
    setattr(block, flag, True)
    setattr(block, input, measurement)
    block.advance(40.0, 10.0)
    assert any(block.tau_ctrl_body)


# --- when commands are made, and when they leave --------------------------------------

COMMANDS = {
    "manager": ("tau_cmd_wheel", "m_cmd_body", "tau_cmd_thruster_body"),
    "controller": ("tau_ctrl_body",),
}
COMPUTERS = [*MANAGERS, "manager_test_signal", *CONTROLLERS]


def commands(block: Block) -> tuple:
    return tuple(getattr(block, name) for name in COMMANDS[block.role])


def compute_rows(name: str, rng: random.Random, steps: int, **values) -> list:
    """The commands in each of some steps of 1 s, with inputs that change in every one."""
    block = fresh(name)
    give_law(block)
    if name == "manager_test_signal":
        block.amplitude, block.period = (1e-3,) * 4, (7.0,) * 4
    for key, value in values.items():
        assert hasattr(block, key)
        setattr(block, key, value)
    begin(block)
    rows = []
    for k in range(steps):
        randomise_inputs(block, rng)
        block.advance(float(k), 1.0)
        rows.append(commands(block))
    return rows


@pytest.mark.parametrize("name", COMPUTERS)
def test_commands_obey_the_sample_time(name):
    """Once a manager's command to the wheels was made anew at every step."""
    rows = compute_rows(name, random.Random(1), 21, sample_time=10.0)
    assert rows[0:10] == [rows[0]] * 10
    assert rows[10:20] == [rows[10]] * 10
    assert len({rows[0], rows[10], rows[20]}) == 3


@pytest.mark.parametrize("name", MANAGERS)
def test_wheels_may_be_commanded_more_often(name):
    rows = compute_rows(
        name, random.Random(1), 20, sample_time=10.0, wheel_sample_time=2.0
    )
    wheels = [row[0] for row in rows]
    assert wheels[::2] == wheels[1::2]
    assert len(set(wheels)) == 10
    assert len({row[1:] for row in rows}) == 2, (
        "dipole and thrusters wait for their sample"
    )
    for time, period in ((3.0, 10.0), (20.0, 10.0), (1.0, 0.0)):
        with pytest.raises(
            BlockError, match=f"wheel_sample_time = {time} s does not divide"
        ):
            compute_rows(
                name, random.Random(1), 1, sample_time=period, wheel_sample_time=time
            )


@pytest.mark.parametrize("name", COMPUTERS)
@pytest.mark.parametrize(
    ("sample_time", "delay"), [(5.0, 2.0), (5.0, 15.0), (5.0, 8.0), (0.0, 3.0)]
)
def test_commands_leave_after_the_delay(name, sample_time, delay):
    """Part of a sample, whole ones, and in between."""
    if name == "manager_receding_horizon" or fresh(name).sample_time:  # laws of samples
        sample_time = sample_time or 1.0
    # a plan of 600 samples takes seconds in Python
    few = {"horizon": 60.0} if name == "manager_receding_horizon" else {}
    at_once = compute_rows(name, random.Random(1), 40, sample_time=sample_time, **few)
    late = compute_rows(
        name, random.Random(1), 40, sample_time=sample_time, delay=delay, **few
    )
    start = commands(begin(fresh(name)))
    assert late == [start] * int(delay) + at_once[: -int(delay)]


def test_a_delay_that_cannot_be_kept_is_refused():
    with pytest.raises(
        BlockError, match=r"delay = 0.5 s is not a multiple of the step of 1.0 s"
    ):
        compute_rows("controller_pd", random.Random(1), 2, sample_time=2.0, delay=0.5)
    with pytest.raises(
        BlockError, match=r"delay = 100.0 s holds more than 16 commands back"
    ):
        compute_rows(
            "controller_pd", random.Random(1), 40, sample_time=2.0, delay=100.0
        )


def test_gyroscopic_feed_forward_does_not_depend_on_the_step(tmp_path):
    """Once 1.8e-3 rad: the samples' command was made anew at every step."""
    file = tmp_path / "gyroscopic.toml"
    file.write_text(
        'extends = "gyrostat/full"\ntitle = "With gyroscopic feed-forward"\n'
        'description = "The same."\n'
        "stop = 60.0\n[parameters.manager]\ngyroscopic = true\n"
    )

    def attitudes(step: float, **options):
        options = {"record": ("spacecraft.q_bi",), "blocks": True, **options}
        run = execute(str(file), Options(step=step, **options))
        return run.results.values("spacecraft.q_bi")[:: round(1.0 / step)]

    assert math.radians(pointing(attitudes(1.0), attitudes(0.25)).max()) < 2e-7
    every_step = [attitudes(s, sets=["manager.sample_time=0"]) for s in (1.0, 0.25)]
    assert math.radians(pointing(*every_step).max()) > 5e-4, "as it was"
