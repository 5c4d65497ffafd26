"""`desat design`: what the laws of magnetic dumping need beforehand, for one scenario.

    [design]
    final_momentum = 0.05         # N m s: the one free number of the law is tuned to this |h_f|
    momentum_weight = [1, 1, 1]   # lqr, ilqr: diagonal of F; with final_momentum, its shape only
    final_momentum_body = [0, 0, 0]   # mec: the end; with final_momentum, the cheapest of that size
    end_of = "NAME"               # mec: the end of another scenario's run
    nodes = 61                    # lqr: rows of the tables
    of = "NAME"                   # no design of its own: that of another scenario
    [design.assume.spacecraft]    # what the design takes to be so, against the scenario
    inertia = [1, 0, 0, 0, 1, 0, 0, 0, 1]

The law is that of the scenario's manager; what is computed becomes parameters of the manager, in
ssp/FAMILY/design/NAME.toml, which the scenario loader merges below the scenario's own. The model is
the paper's (fixed attitude, ideal wheels): field, attitude and N_con come from the scenario's own
environment and spacecraft, and every end that is tuned or solved for is that of a run of the
scenario on bare blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from desat.components.attitude import normalised, product, rotate
from desat.components.block import Block, Vec3
from desat.components.blocks.manager_magnetic import CAPACITY
from desat.components.blocks.spacecraft_fixed_attitude import (
    SpacecraftFixedAttitude,
    constant_torque,
)
from desat.components.laws import magnetic_offline as offline
from desat.components.orbit import lvlh_attitude
from desat.components.vector import norm, scale
from desat.fmus.registry import block_class

from ..engine.instances import UnitError
from ..engine.master import Master
from ..engine.results import Recorder
from ..files import places
from ..files.scenario import ROOT, Scenario, find, scenarios
from ..system.check import check, steps_of, value_of
from ..system.errors import DesatError, nearest
from ..system.model import Component
from ..system.parameters import expand

Array = NDArray[np.floating[Any]]

PACKAGES = ("desat", "numpy", "scipy")
KEYS = {
    "final_momentum": "a number above 0",
    "momentum_weight": "three numbers, none below 0",
    "final_momentum_body": "three numbers",
    "nodes": f"a whole number from 2 to {CAPACITY}",
    "end_of": "the name of another scenario of the family",
    "of": "the name of another scenario of the family",
    "assume": "tables of parameters, one a component",
}
"""What [design] may hold, and what each needs."""
NODES = 61
MOMENTUM, DIPOLE = "spacecraft.h_copy_wheel", "torquers.m_mean_body"
ENERGY = "torquers.dipole_energy"
WEIGHT_UNIT, GAIN_UNIT = "1/(T2.s2)", "1/(T.s)"
SEARCH = (-1.0, 8.0, 0.1)
"""For a law's free number: least, largest and step of its decimal logarithm."""
LARGEST_MISS = 1e-9
"""Of an end that a costate was solved for (N m s)."""
REFINEMENTS = 3
"""Of a costate: the first solves the linear equations, the others take out their rounding."""


@dataclass(frozen=True)
class Flight:
    """What a run did: the wheels' momentum (rows, 3; N m s), the dipole over each step (steps, 3;
    A m2) and its energy (A2 m4 s)."""

    momentum: Array
    dipole: Array
    energy: float

    @property
    def size(self) -> float:
        """|h_f| (N m s)"""
        return float(np.linalg.norm(self.momentum[-1]))


class Plant:
    """A scenario that is flown on bare blocks with this or that parameter of its manager."""

    def __init__(self, scenario: Scenario, designed: bool = False) -> None:
        self.system, problems = scenario.system(blocks=True, designed=designed)
        self.about = scenario.data.get("design", {})
        for name, values in self.about.get("assume", {}).items() if not designed else ():
            for parameter, value in values.items():
                self._set(self._component(name), parameter, value)
        self._schedule = check(self.system, problems).or_raise()
        spacecraft = self._bare("spacecraft")
        if not isinstance(spacecraft, SpacecraftFixedAttitude):
            raise DesatError(
                f"{scenario.name}: a design is made in the paper's model, with the block "
                "spacecraft_fixed_attitude; [design] of = NAME takes that of another scenario"
            )
        self.manager = self._component("manager")
        self.horizon = steps_of(self.system) * (self.system.step or 0.0)
        self._environment = self._bare("environment")
        self._at(0.0)
        r, v = self._environment.r_eci, self._environment.v_eci
        spacecraft.r_eci, spacecraft.v_eci = r, v
        spacecraft.start()
        spacecraft.output(self.system.start)
        self._attitude = normalised(spacecraft.q_bo)
        self.omega: Vec3 = spacecraft.omega_bi_body
        nadir = rotate(spacecraft.q_bi, scale(-1.0 / norm(r), r))
        self.n_con = constant_torque(spacecraft.inertia, self.omega, nadir, norm(r))

    def _component(self, name: str) -> Component:
        if name not in self.system.components:
            known = nearest(name, self.system.components)
            raise DesatError(f"{self.system.name}: no component {name}{known}")
        return self.system.components[name]

    def _set(self, component: Component, parameter: str, value: Any) -> None:
        assert component.interface is not None
        where = f"{self.system.name}: {component.name}"
        component.parameters.update(expand(component.interface, parameter, value, where))

    def _bare(self, name: str) -> Any:
        """The block of a component with its parameters, started."""
        component = self._component(name)
        assert component.interface is not None
        block: Block = block_class(component.interface.model)()
        signals = component.interface.signals
        block.access([signals[n].reference for n in component.parameters]).write(
            list(component.parameters.values())
        )
        block.check()
        if name == "environment":
            block.start()
        return block

    def _at(self, t: float) -> None:
        self._environment.output(self.system.start + t)

    def field(self, t: float) -> Vec3:
        """B (T, body) in the fixed attitude, t (s) after the start."""
        self._at(t)
        e = self._environment
        return rotate(product(self._attitude, lvlh_attitude(e.r_eci, e.v_eci)), e.b_eci)

    def manager_value(self, name: str) -> Any:
        """A parameter of the manager; a choice by its name."""
        assert self.manager.interface is not None
        signals = self.manager.interface.elements(name)
        values = [value_of(self.manager, s.name) for s in signals]
        if signals[0].choices:
            return signals[0].choices[int(values[0])]  # type: ignore[call-overload]
        return values if signals[0].name != name else values[0]

    def fly(self, **parameters: Any) -> Flight:
        """Run it with these parameters of its manager."""
        kept = dict(self.manager.parameters)
        for name, value in parameters.items():
            self._set(self.manager, name, value)
        record = (MOMENTUM, DIPOLE, ENERGY)
        try:
            with Master(self.system, self._schedule, blocks=True) as master:
                master.initialise()
                recorder = Recorder(None, master, record)
                for _ in range(steps_of(self.system)):
                    master.advance(recorder.record)
                with recorder.finish(master) as results:
                    return Flight(
                        results.values(MOMENTUM)[:, :3], results.values(DIPOLE),
                        float(results.values(ENERGY)[-1]),
                    )  # fmt: skip
        finally:
            self.manager.parameters = kept


@dataclass(frozen=True)
class Design:
    """Parameters of the manager, the numbers tuned for them, and the run with them."""

    parameters: dict[str, Any]
    flight: Flight
    tuned: dict[str, tuple[float, str]] = field(default_factory=dict)
    """name -> value and unit"""
    notes: tuple[str, ...] = ()


# --- laws -------------------------------------------------------------------------------------


def _lqr(plant: Plant) -> Design:
    nodes = plant.about.get("nodes", NODES)
    times = np.linspace(0.0, plant.horizon, nodes)

    def parameters(scale_of_f: float) -> dict[str, Any]:
        gain, offset = offline.gains(
            plant.field, plant.omega, scale_of_f * _shape(plant),
            plant.manager_value("dipole_weight"), plant.n_con, times,
        )  # fmt: skip
        return {
            "horizon": plant.horizon,
            "table_nodes": nodes,
            "gain_table": _padded(gain),
            "offset_table": _padded(offset),
        }

    return _with_weight(plant, parameters)


def _ilqr(plant: Plant) -> Design:
    n_con = {"n_con_body": list(plant.n_con)} if norm(plant.n_con) > 1e-15 else {}

    def parameters(scale_of_f: float) -> dict[str, Any]:
        return {"momentum_weight": (scale_of_f * _shape(plant)).tolist(), **n_con}

    return _with_weight(plant, parameters)


def _with_weight(plant: Plant, parameters: Callable[[float], dict[str, Any]]) -> Design:
    """The design with F as given, or as large as the wanted end asks."""
    if "final_momentum" in plant.about:
        return _tuned(plant, parameters, "momentum_weight", WEIGHT_UNIT)
    if "momentum_weight" not in plant.about:
        raise DesatError(f"{plant.system.name}: design: momentum_weight or final_momentum needed")
    fixed = parameters(1.0)
    return Design(fixed, plant.fly(**fixed))


def _ccpl(plant: Plant) -> Design:
    return _tuned(plant, lambda gain: {"gain": gain}, "gain", GAIN_UNIT)


def _mec(plant: Plant) -> Design:
    if plant.manager_value("saturation"):
        raise DesatError(f"{plant.system.name}: design: mec needs manager.saturation = false")
    weight, about = np.asarray(plant.manager_value("dipole_weight")), plant.about
    fixed = {"horizon": plant.horizon, "omega_nominal_body": list(plant.omega)}

    def fly(p: Array) -> Flight:
        return plant.fly(costate=p.tolist(), **fixed)

    start = fly(np.zeros(3)).momentum[0]
    end = np.asarray(about.get("final_momentum_body", (0.0, 0.0, 0.0)), float)
    if "end_of" in about:
        other = find(f"{plant.system.name.partition('/')[0]}/{about['end_of']}")
        end = Plant(other, designed=True).fly().momentum[-1]
    p = offline.costate(
        plant.field, plant.omega, weight, plant.n_con, start, end, plant.horizon
    )  # fmt: skip
    # variation of extremals: the end is linear in p, also that of commands held over a sample
    flight, size = fly(p), float(np.linalg.norm(p))
    miss = np.linalg.norm(flight.momentum[-1] - end)
    note = f"The costate of the continuous problem would miss the end by {miss:.2e} N m s"
    varied = [fly(p + size * e) for e in np.eye(3)]
    effect = np.stack([(v.momentum[-1] - flight.momentum[-1]) / size for v in varied], axis=1)
    if (wanted := float(about.get("final_momentum", 0.0))) > 0.0:
        dipoles = [(v.dipole - flight.dipole) / size for v in varied]
        cost = np.array([[np.sum(a * weight * b) for b in dipoles] for a in dipoles])
        free = flight.momentum[-1] - effect @ p
        if wanted >= np.linalg.norm(free):
            raise _needless(plant, wanted)
        end = offline.cheapest_end(free, effect, cost, wanted)
    for _ in range(REFINEMENTS):
        p = p - np.linalg.solve(effect, flight.momentum[-1] - end)
        flight = fly(p)
    miss = np.linalg.norm(flight.momentum[-1] - end)
    if not miss <= LARGEST_MISS:
        raise DesatError(f"{plant.system.name}: design: the end is missed by {miss:.1e} N m s")
    return Design({**fixed, "costate": p.tolist()}, flight, notes=(note,))


LAWS: dict[tuple[str, str], Callable[[Plant], Design]] = {
    ("manager_magnetic", "lqr"): _lqr,
    ("manager_magnetic", "mec"): _mec,
    ("manager_magnetic_ilqr", ""): _ilqr,
    ("manager_cross_product", "ccpl"): _ccpl,
}


def _shape(plant: Plant) -> Array:
    return np.asarray(plant.about.get("momentum_weight", (1.0, 1.0, 1.0)), float)


def _padded(table: Array) -> list[list[float]]:
    rows = np.zeros((CAPACITY, table.shape[1]))
    rows[: len(table)] = table
    return [[float(x) for x in row] for row in rows]


def _tuned(
    plant: Plant, parameters: Callable[[float], dict[str, Any]], name: str, unit: str
) -> Design:
    """The least value of the law's one free number, from SEARCH up, with which the run ends at the
    wanted size. The size falls with the number, and rises again where a sample is too long for it.
    """
    where = f"{plant.system.name}: design"
    if "final_momentum" not in plant.about:
        raise DesatError(f"{where}: final_momentum is needed")
    wanted = plant.about["final_momentum"]
    best = inf

    def excess(log: float) -> float:
        nonlocal best
        try:
            size = plant.fly(**parameters(float(10.0**log))).size
        except UnitError:
            if best == inf:
                raise
            return inf  # it has diverged
        best = min(best, size)
        return size - float(wanted)

    lowest, highest, step = SEARCH
    low = high = lowest
    while (value := excess(high)) > 0.0:
        low, high = high, high + step
        if high > highest or value == inf:
            raise DesatError(
                f"{where}: final_momentum = {wanted:g} N m s: no {name} up to {10**low:.0e} {unit} "
                f"ends there; the least is {best:.3g} N m s"
            )
    if low == high and value < 0.0:
        raise _needless(plant, wanted)
    log = high if value == 0.0 else brentq(excess, low, high, xtol=1e-13, rtol=1e-14)
    found = 10.0 ** float(log)
    chosen = parameters(found)
    return Design(chosen, plant.fly(**chosen), {name: (found, unit)})


def _needless(plant: Plant, wanted: float) -> DesatError:
    return DesatError(
        f"{plant.system.name}: design: final_momentum = {wanted:g} N m s is reached without dumping"
    )


# --- command ----------------------------------------------------------------------------------


def designable(names: list[str]) -> list[Scenario]:
    """The scenarios of these names, or all that have a design of their own; one that ends where
    another ends comes after it. Raises DesatError for one that has none."""
    found = [find(n) for n in names] or [
        s for s in scenarios().values() if "of" not in s.data.get("design", {"of": ""})
    ]
    for s in found:
        if "design" not in s.data:
            raise DesatError(f"{s.name}: it has no [design]")
        for key, value in s.data["design"].items():
            if key not in KEYS:
                raise DesatError(f"{s.name}: design: unknown key {key}{nearest(key, KEYS)}")
            if not _fits(s, key, value):
                raise DesatError(f"{s.name}: design: {key} = {value!r}: {KEYS[key]} is needed")
        if "of" in s.data["design"]:
            other = f"{s.family}/{s.data['design']['of']}"
            raise DesatError(f"{s.name} uses the design of {other}: run `desat design {other}`")
    return sorted(found, key=lambda s: "end_of" in s.data["design"])


def _fits(scenario: Scenario, key: str, value: Any) -> bool:
    if key == "assume":
        return isinstance(value, dict) and all(isinstance(v, dict) for v in value.values())
    if key in ("of", "end_of"):
        return isinstance(value, str) and f"{scenario.family}/{value}" != scenario.name
    if key == "nodes":
        return type(value) is int and 2 <= value <= CAPACITY
    values = value if isinstance(value, list) else [value]
    if not all(type(x) in (int, float) and isfinite(x) for x in values):
        return False
    if key == "final_momentum":
        return values is not value and value > 0.0
    return len(values) == 3 and (key == "final_momentum_body" or min(values) >= 0.0)


def design(scenario: Scenario) -> Design:
    """Compute a scenario's design. Raises DesatError where it cannot be made."""
    plant = Plant(scenario)
    assert plant.manager.interface is not None
    model = plant.manager.interface.model
    law = plant.manager_value("law") if plant.manager.interface.elements("law") else ""
    if (model, law) not in LAWS:
        known = ", ".join(" ".join(filter(None, key)) for key in LAWS)
        raise DesatError(f"{scenario.name}: no design for {model} {law}; there is one for {known}")
    return LAWS[model, law](plant)


def text(scenario: Scenario, made: Design) -> str:
    """The file of a design. The same design with the same versions gives the same text."""
    versions = ", ".join(f"{p} {version(p)}" for p in PACKAGES)
    lines = [
        f"# Computed by `desat design {scenario.name}`, not kept by hand; {versions}.",
        "# `reached` is what the run on bare blocks that it was computed with ended with.",
        *(f"# {note}." for note in made.notes),
    ]
    if assumed := scenario.data["design"].get("assume"):
        lines.append(f"# Assumed, against the scenario: {assumed}.")
    if made.tuned:
        lines += ["", "[tuned]"]
        lines += [f"{name} = {value!r}  # {unit}" for name, (value, unit) in made.tuned.items()]
    units = ("N.m.s", "N.m.s", "A2.m4.s")
    lines += [
        "",
        "[reached]",
        *(f"{k} = {v!r}  # {u}" for (k, v), u in zip(reached(made).items(), units, strict=True)),
        "",
        "[parameters.manager]",
        *(_assignment(name, value) for name, value in made.parameters.items()),
    ]
    return "\n".join(lines) + "\n"


def _assignment(name: str, value: Any) -> str:
    if isinstance(value, list) and isinstance(value[0], list):
        return "\n".join([f"{name} = [", *(f"  {row!r}," for row in value), "]"])
    return f"{name} = {value!r}"


def as_json(scenario: Scenario, made: Design, path: Path) -> dict[str, Any]:
    """What `--json` prints of a design that was written to `path`."""
    return {
        "scenario": scenario.name,
        "file": str(path),
        "tuned": {name: {"value": v, "unit": u} for name, (v, u) in made.tuned.items()},
        "reached": reached(made),
    }


def reached(made: Design) -> dict[str, Any]:
    """What the run with a design ended with (SI)."""
    return {
        "final_momentum": made.flight.size,
        "final_momentum_body": [float(x) for x in made.flight.momentum[-1]],
        "dipole_energy": made.flight.energy,
    }


def write(scenario: Scenario, made: Design, folder: Path | None = None) -> Path:
    """Write a design's file into a folder (default: where the scenario looks) and return it."""
    if folder is None:
        places.writable("`desat design`")
        folder = ROOT / scenario.family / "design"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{scenario.name.partition('/')[2]}.toml"
    part = path.with_name(f"{path.name}.part")
    part.write_text(text(scenario, made), encoding="utf-8")
    part.replace(path)
    return path
