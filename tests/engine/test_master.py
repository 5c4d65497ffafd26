"""The master: both semantics, order, failures; with instances made of functions, and
with FMUs."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import same_bits
from desat.components.contract.units import unit_of
from desat.engine import master as master_module
from desat.engine.ending import Ending
from desat.engine.instances.base import ComponentError
from desat.engine.loop import run, stepping
from desat.engine.master import Master
from desat.engine.recording.recorder import Recorder
from desat.files.build import build
from desat.files.completion import system_of
from desat.files.draft import Draft
from desat.files.scenario import find, scenarios
from desat.runs.checks import check_draft
from desat.runs.prepare import read
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from desat.system.interface import KINDS, Interface, Signal
from desat.system.model import Component, Connection, System
from desat.system.schedule import schedule
from tests.conftest import one_of_each_craft, slow_value

SPECS: dict[str, dict] = {}
"""What the functions of each component are."""


class FunctionInstance:
    """An instance made of functions: inputs u, state x; y_state = x, y_interval = f(u,
    x)."""

    def __init__(self, component: Component) -> None:
        self.name = component.name
        self.spec = SPECS[component.name]
        self.x = self.spec.get("x0", 0.0)
        self.interval = self.spec.get("interval0", 0.0)
        self.log: list[tuple[float, float, list[float]]] = []

    def wire(self, inputs, outputs, into, clock) -> None:
        self.clock = clock
        self.inputs = {k: np.zeros(len(inputs[k])) for k in KINDS if inputs[k]}
        self.names = [s.name for s in outputs["Real"]]
        self.into = into["Real"]

    def enter(self, start, parameters) -> None:
        pass

    def exit(self) -> None:
        pass

    def push(self) -> int:
        return 0

    def pull(self) -> int:
        values = {"state": self.x, "interval": self.interval}
        self.into[:] = [values[n.partition("_")[0]] for n in self.names]
        return 0

    def step(self) -> int:
        t, dt = self.clock.t.value, self.clock.dt.value
        u = self.inputs["Real"].tolist() if self.inputs else []
        self.log.append((t, dt, u))
        self.interval = self.spec.get("f", lambda u, x, t: 0.0)(u, self.x, t)
        self.x = self.spec.get("g", lambda u, x, t, dt: x)(u, self.x, t, dt)
        return self.spec.get("status", lambda t: 0)(t)

    def failed(self, fault: str, status: int) -> ComponentError:
        return ComponentError(f"{self.name}: {fault}: {status}")

    def close(self) -> None:
        pass


def real(name, causality, output_class="state", unit="1") -> Signal:
    return Signal(
        name, causality, "Real", 0, unit, unit_of(unit), output_class=output_class
    )


def component(
    name, inputs=0, step_ratio=1, outputs=("state", "interval"), **spec
) -> Component:
    signals = [real(f"u{i}", "input") for i in range(inputs)]
    signals += [
        real(f"{o}_y", "output", o if o in ("state", "interval") else "undeclared")
        for o in outputs
    ]
    SPECS[name] = spec
    interface = Interface(name, name, {s.name: s for s in signals})
    return Component(name, f"{name}.fmu", interface, step_ratio=step_ratio)


def draft(components, wires, **more) -> Draft:
    connections = [Connection(*w[:4], **(w[4] if len(w) > 4 else {})) for w in wires]
    times = {"step": 1.0, "stop": 10.0}
    return Draft(
        "test.ssd",
        "test",
        components={c.name: c for c in components},
        connections=connections,
        **{"substeps": 1, **times, **more},
    )


def system(components, wires, **more) -> System:
    return system_of(draft(components, wires, **more))


@pytest.fixture(autouse=True)
def _function_instances(monkeypatch, request):
    if "real_units" not in request.keywords:
        monkeypatch.setattr(master_module, "instance_for", FunctionInstance)


def rows(sys: System, steps: int, algorithm="gauss_seidel"):
    live_rows = []
    with Master(sys, schedule(sys), algorithm=algorithm) as m:
        m.initialise()
        names = {(s.component, s.signal.name): s.index for s in m.slots}
        for _ in range(steps):
            m.advance(lambda k, live: live_rows.append((k, live["Real"].copy())))
        units = {n: member.instance for n, member in m.members.items()}
    return [(k, {n: v[i] for n, i in names.items()}) for k, v in live_rows], units


def chain() -> System:
    """source (state = t) -> sensor -> actuator -> integrator"""
    return system(
        [
            component("source", x0=0.0, g=lambda u, x, t, dt: t + dt),
            component("sensor", 1, f=lambda u, x, t: 10 * u[0]),
            component("actuator", 1, f=lambda u, x, t: u[0] + 1),
            component("integrator", 1, g=lambda u, x, t, dt: x + dt * u[0]),
        ],
        [
            ("source", "state_y", "sensor", "u0"),
            ("sensor", "interval_y", "actuator", "u0"),
            ("actuator", "interval_y", "integrator", "u0"),
        ],
    )


def test_conserving_has_no_delay():
    chain_rows, units = rows(chain(), 5)
    for k, row in chain_rows:
        assert row["source", "state_y"] == k
        assert row["sensor", "interval_y"] == 10 * k, (
            "the interval value over [t_k, t_k+1)"
        )
        assert row["actuator", "interval_y"] == 10 * k + 1
    assert [u for _, _, u in units["integrator"].log] == [
        [10 * k + 1] for k in range(5)
    ]
    assert chain_rows[-1][1]["integrator", "state_y"] == sum(
        10 * k + 1 for k in range(4)
    )


def test_jacobi_delays_by_a_step_a_link():
    chain_rows, _units = rows(chain(), 6, "jacobi")
    assert [k for k, _ in chain_rows] == [1, 2, 3, 4, 5, 6], (
        "a row has the outputs of its time"
    )
    for k, row in chain_rows:
        assert row["source", "state_y"] == k
        assert row["sensor", "interval_y"] == 10 * (k - 1)
        assert row["actuator", "interval_y"] == (10 * (k - 2) + 1 if k >= 2 else 1)


def test_listing_order_does_not_matter():
    reference, _ = rows(chain(), 6)
    for order in itertools.permutations(chain().components):
        components = {n: chain().components[n] for n in order}
        reordered_system = replace(
            chain(), components=components, connections=chain().connections[::-1]
        )
        reordered_rows, _ = rows(reordered_system, 6)
        assert [(k, sorted(r.items())) for k, r in reordered_rows] == [
            (k, sorted(r.items())) for k, r in reference
        ]


def test_time_comes_from_an_integer():
    sys = replace(chain(), step=0.1, start=5.0)
    _, units = rows(sys, 1000)
    assert [t for t, _, _ in units["sensor"].log] == [
        5.0 + k * 0.1 for k in range(1000)
    ]


@pytest.mark.parametrize("algorithm", ["gauss_seidel", "jacobi"])
def test_step_ratios(algorithm):
    sys = system(
        [
            component("a", step_ratio=2, g=lambda u, x, t, dt: t + dt),
            component("b", 1, step_ratio=3, f=lambda u, x, t: u[0]),
        ],
        [("a", "state_y", "b", "u0")],
    )
    rate_rows, units = rows(sys, 12, algorithm)
    assert [(t, dt) for t, dt, _ in units["b"].log] == [(0, 3), (3, 3), (6, 3), (9, 3)]
    inputs_of_b = [u[0] for _, _, u in units["b"].log]
    if (
        algorithm == "jacobi"
    ):  # an output moves when both are due: every lcm(2, 3) = 6 steps
        assert inputs_of_b == [0, 0, 6, 6]
    else:  # the latest state at t_k
        assert inputs_of_b == [0, 2, 6, 8]
    a = [row["a", "state_y"] for _, row in rate_rows]
    assert a == (
        [0, 0, 2, 2, 4, 4, 6, 6, 8, 8, 10, 10]
        if algorithm == "gauss_seidel"
        else [0, 2, 2, 4, 4, 6, 6, 8, 8, 10, 10, 12]
    )


def test_conversion_of_units_and_values():
    sys = system(
        [
            component("a", x0=180.0),
            component("b", 2, f=lambda u, x, t: u[0] + 100 * u[1]),
        ],
        [
            ("a", "state_y", "b", "u0", {"factor": 2.0, "offset": 1.0}),
            ("a", "state_y", "b", "u1"),
        ],
    )
    converted_rows, _ = rows(sys, 1)
    assert converted_rows[0][1]["b", "interval_y"] == 361 + 18000


def test_a_cycle_is_named():
    sys = system(
        [component("a", 1), component("b", 1), component("c", 1)],
        [
            ("a", "interval_y", "b", "u0"),
            ("b", "interval_y", "c", "u0"),
            ("c", "interval_y", "a", "u0"),
        ],
    )
    with pytest.raises(
        DesatError, match=r"cycle over the step: .*a.interval_y -> b.interval_y"
    ) as e:
        schedule(sys)
    assert "declare no dependencies" not in str(e.value), "all do"
    broken = replace(sys, output_classes={"c.interval_y": "state"})
    assert schedule(broken).order == ("a", "b", "c")


def test_undeclared_outputs_in_a_circle_are_late_with_a_warning():
    parts = draft(
        [component("a", 1, outputs=("undeclared",)), component("b", 1)],
        [("a", "undeclared_y", "b", "u0"), ("b", "interval_y", "a", "u0")],
    )
    case = check_draft(parts)
    assert not case.problems
    assert (
        "a declares no dependencies: undeclared_y may depend on every input and are taken one "
        "step late, as they close a circle" in (case.warnings[0])
    )
    assert {moment for _, moment in case.schedule.timing} == {
        "one step late",
        "over the step",
    }
    parts.output_classes["a.undeclared_y"] = "interval"
    parts.warnings.clear()
    case = check_draft(parts)
    assert "cycle" in case.problems[0]
    assert not case.warnings


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_not_finite_outputs_stop_the_run(bad):
    sys = system([component("a", f=lambda u, x, t: bad if t >= 3 else 1.0)], [])
    with Master(sys, schedule(sys)) as m:
        m.initialise()
        for _ in range(3):
            m.advance()
        with pytest.raises(ComponentError, match=r"a.interval_y = .* at t = 4 s"):
            m.advance()


def test_a_failing_step_names_component_and_time():
    sys = system([component("a", status=lambda t: 3 if t >= 2 else 0)], [])
    with Master(sys, schedule(sys)) as m:
        m.initialise()
        m.advance()
        m.advance()
        with pytest.raises(ComponentError, match="a: the step from t = 2 s: 3"):
            m.advance()


def test_the_loop_ends_where_a_condition_says():
    sys = chain()
    with Master(sys, schedule(sys)) as m:
        m.initialise()
        recorder = Recorder(None, m)
        (time,) = [
            s for s in m.slots if (s.component, s.signal.name) == ("source", "state_y")
        ]

        def give_reason() -> str:
            return "three" if m.live[time.kind][time.index] >= 3.0 else ""

        ending = Ending(give_reason)
        steps = stepping(m, recorder, ending)
        assert (steps.name, steps.reason) == ("python", "sensor is not run as an FMU")
        reason = run(m, steps, 10, recorder, ending)
        assert (reason, m.k) == ("three", 3)
        assert run(m, steps, 10, recorder) == ""
        assert m.k == 10
        with recorder.finish(m) as results:
            assert results.times().tolist() == [float(k) for k in range(11)]


def test_initialisation_that_does_not_settle():
    sys = system(
        [component("a", 1), component("b", 1)],
        [("a", "state_y", "b", "u0"), ("b", "state_y", "a", "u0")],
    )

    class Growing(FunctionInstance):
        def pull(self) -> int:
            self.x = 1 + (self.inputs["Real"][0] if self.inputs else 0)
            return super().pull()

    master_module.instance_for = Growing
    with (
        Master(sys, schedule(sys)) as m,
        pytest.raises(DesatError, match=r"a.state_y.*b.state_y"),
    ):
        m.initialise()


@given(
    st.permutations(range(6)),
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=12),
)
def test_schedule_is_topological_and_independent_of_listing(order, pairs):
    edges = {(a, b) for a, b in pairs if a < b}  # no cycle

    def make(sequence):
        parts = [component(f"c{i}", 6) for i in sequence]
        wires = [(f"c{a}", "interval_y", f"c{b}", f"u{a}") for a, b in edges]
        return system(parts, wires)

    order_of_schedule = schedule(make(order)).order
    assert order_of_schedule == schedule(make(range(6))).order
    assert all(
        order_of_schedule.index(f"c{a}") < order_of_schedule.index(f"c{b}")
        for a, b in edges
    )


# --- with FMUs ------------------------------------------------------------------------


def bits(run) -> dict[str, bytes]:
    return {name: run.results.values(name).tobytes() for name in run.results.names()}


# of the telescope's laws, and of what is not as assumed, one case each: the others
# differ in parameters alone, and make a design or a bound
MANY = ("space_telescope/", "uosat12/robust-")
BITWISE = [
    n
    for n in scenarios()
    if not n.startswith(MANY) or n.endswith(("ours-nominal", "me-nominal"))
][::4]  # neighbours differ in values; `make builds` compares the blocks of all


def looked_at(name: str, algorithm: str) -> int:
    """Steps of a scenario: a bare block that searches by flights of a model takes 10 s
    for 300 on a quiet machine; of those one with a gyro and one without are flown over
    ten searches, the others, which differ from these in parameters alone, over
    two."""
    searches = name.startswith("hausat2/rollout-")
    full = ("hausat2/rollout-gyro", "hausat2/rollout-no-gyro")
    is_whole = name in full and algorithm == "gauss_seidel"
    return (100 if is_whole else 20) if searches else 120


# what jacobi changes is the way of the values alone
@pytest.mark.real_units
@pytest.mark.parametrize(
    ("name", "algorithm"),
    [
        (n, "gauss_seidel") if k % 3 == 0 else slow_value((n, "gauss_seidel"))
        for k, n in enumerate(BITWISE)
    ]
    + [(n, "jacobi") for n in one_of_each_craft()],
)
def test_fmus_equal_bare_blocks_bitwise(name, algorithm):
    data = scenarios()[name].content.written
    stop = min(data["stop"], looked_at(name, algorithm) * data["step"])
    options = Options(algorithm=algorithm, stop=stop)
    with_fmus, with_blocks = (
        execute(name, options),
        execute(name, replace(options, blocks=True)),
    )
    assert with_fmus.ok
    assert with_blocks.ok
    assert bits(with_fmus) == bits(with_blocks)


@pytest.mark.real_units
def test_same_bits_again_and_from_the_packed_file():
    name = "uosat12/table3-ocdc-mec-2"
    first = execute(name, Options())
    assert bits(first) == bits(execute(name, Options()))
    from desat.export.packing import pack_scenario

    packed_run = execute(str(pack_scenario(find(name))), Options())
    assert bits(first) == bits(packed_run)
    assert packed_run.manifest["numbers"] == first.manifest["numbers"]
    assert packed_run.manifest["ssp"]["sha256"]


def test_same_bits_in_other_processes():
    """`python -m benchmarks.same_bits` makes a whole day, in more ways."""
    ways = ("components and connections permuted", "PYTHONHASHSEED=0")
    assert (
        same_bits.differing({w: same_bits.WAYS[w] for w in ways}, {"stop": 60.0}) == []
    )


@pytest.mark.real_units
def test_same_bits_under_permuted_components():
    name = "uosat12/table3-ocdc-ilqr-2"
    reference = None
    for seed in range(4):
        permuted_system = build(read(name), Options())
        rng = np.random.default_rng(seed)
        names = list(permuted_system.components)
        rng.shuffle(names)
        permuted_system.components = {n: permuted_system.components[n] for n in names}
        rng.shuffle(permuted_system.connections)
        with Master(*check_draft(permuted_system).or_raise()) as m:
            m.initialise()
            for _ in range(60):
                m.advance()
            values = {
                (s.component, s.signal.name): m.live[s.kind][s.index].tobytes()
                for s in m.slots
            }
        reference = reference or values
        assert values == reference
