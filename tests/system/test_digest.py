"""The digest of a system: another one for all that may move a bit, the same for all
else; campaigns and runs go on with the same system and the same versions alone."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import desat as api
from desat.campaign import cluster, coordinator, plan, report, store
from desat.engine import checkpoint
from desat.files import identity, library
from desat.files.build import build
from desat.files.scenario import find, scenarios
from desat.language.kinds import declared
from desat.language.scenario import ScenarioTable
from desat.runs.prepare import resolved
from desat.runs.run import Options, load_run, prepare, resume, simulate
from desat.system.digest import ASIDE, comparable, digest
from desat.system.errors import DesatError, Exit
from desat.system.model import Connection
from tests.conftest import ROOT, but, module_of
from tests.engine.test_checkpoint import broken
from tests.runs.test_checking import write_altitude

origin = module_of("desat.papers.designs.origin")
stored = module_of("desat.papers.stored")

# --- every field ----------------------------------------------------------------------

MOVES_NO_BIT = {
    "System": {"name", "place"},
    # the code that these name stands beside, by its hash
    "Component": {"source", "fmu", "connectors", "line", "origins", "references"},
    "Connection": {"line", "converts"},
    "Interface": {"title"},
    "Signal": {
        "description",
        "unit_name",
        "reference",
        "choices",
        "minimum",
        "maximum",
        "shared",
        "needed_by",
        "usual",
    },
}


USES = declared(ScenarioTable)


class Content(dict):
    """What a scenario says, right or wrong."""

    as_json = dict.copy

    def counted(self) -> dict[str, Any]:
        return {k: x for k, x in self.items() if k in USES and USES[k].use == "run"}


def other(value: Any) -> Any:
    """Something else than a value, of its kind; as near as there is."""
    match value:
        case bool():
            return not value
        case float():
            return float(np.nextafter(value, np.inf))
        case int():
            return value + 1
        case str():
            return f"{value}x"
        case None:
            return 0.5
        case Path():
            return value / "x"
        case tuple() if hasattr(value, "_replace"):  # a unit
            return value._replace(kg=value.kg + 1)
        case tuple():
            return value[:-1] if value else ("x",)
        case Mapping():
            return type(value)(list(value.items())[:-1] if value else [("x", 1.0)])
    raise AssertionError(f"{value!r}: no other one is known")


def changes(x: Any) -> Iterator[tuple[str, str, Any]]:
    """A dataclass with each field that it, or one within it, has made another one:
    class, field, and what comes of it. Of several things of a class in a table, the
    first and the last."""
    for f in fields(x):
        if not f.init:
            continue  # it follows from the others
        value = getattr(x, f.name)
        if is_dataclass(value):
            for kind, name, result in changes(value):
                yield kind, name, replace(x, **{f.name: result})
            continue
        yield type(x).__name__, f.name, replace(x, **{f.name: other(value)})
        items = list(value.items()) if isinstance(value, Mapping) else []
        items += list(enumerate(value)) if isinstance(value, tuple) else []
        for key, entry in {repr(k): (k, e) for k, e in items[:1] + items[-1:]}.values():
            if is_dataclass(entry):
                for kind, name, result in changes(entry):
                    yield kind, name, replace(x, **{f.name: _with(value, key, result)})
            elif isinstance(value, Mapping) and not isinstance(entry, Mapping):
                other_value = _with(value, key, other(entry))
                yield type(x).__name__, f.name, replace(x, **{f.name: other_value})


def _with(table: Any, key: Any, value: Any) -> Any:
    if isinstance(table, Mapping):
        return type(table)({**table, key: value})
    return (*table[:key], value, *table[key + 1 :])


def test_every_field_of_a_resolved_system_is_in_the_digest():
    """But for those that move no bit, which are these."""
    system, _ = prepare("integrated/mil-nadir", Options(blocks=True)).or_raise()
    numbers = Content(
        numbers=system.about.as_json()["numbers"]
    )  # of the rest of a content: below
    system = replace(system, about=numbers, output_classes={"manager.mode": "state"})
    computes = dict.fromkeys([*system.components, "x"], "1")
    before, fields, silent = digest(system, computes), set(), set()
    for kind, name, result in changes(system):
        fields.add((kind, name))
        if name == "components" and kind == "System":
            computes.update(dict.fromkeys(result.components, "1"))
        if digest(result, computes) == before:
            silent.add((kind, name))
    assert {"System", "Component", "Connection", "Interface", "Signal"} <= {
        k for k, _ in fields
    }
    assert len(fields) > 40
    assert silent - {
        ("Connector", f) for f in ("name", "kind", "type", "unit", "line")
    } == {(kind, name) for kind, names in MOVES_NO_BIT.items() for name in names}
    assert {k: set(v) for k, v in ASIDE.items()} == MOVES_NO_BIT


def test_what_computes_a_component_and_options_are_in_it():
    system, _ = prepare("plant/light", Options(blocks=True)).or_raise()
    one = dict.fromkeys(system.components, "1")
    before = digest(system, one, Options())
    assert digest(system, {**one, "spacecraft": "2"}, Options()) != before
    aside = {f.name for f in fields(Options) if f.metadata["aside"]}  # each must say
    for f in fields(Options):
        result = Options()
        value = "jacobi" if f.name == "algorithm" else object()
        object.__setattr__(
            result, f.name, 7 if f.name not in aside and value is not str else value
        )
        if f.name not in aside:
            assert digest(system, one, result) != before, f.name
        else:
            assert digest(system, one, result) == before, f.name
    assert {"algorithm", "halvings", "every"} <= {
        f.name for f in fields(Options)
    } - aside
    with pytest.raises(TypeError, match="object: a digest cannot tell it"):
        digest(system, one, object())


def test_neither_order_nor_texts_of_a_content_count_but_all_else_of_it():
    system, _ = prepare("integrated/mil-nadir", Options(blocks=True)).or_raise()
    one, about = dict.fromkeys(system.components, "1"), system.about.as_json()
    before = digest(system, one)

    def of(**content: Any) -> str:
        return digest(replace(system, about=Content({**about, **content})), one)

    reversed_components = dict(reversed(system.components.items()))
    result = replace(
        system, components=reversed_components, connections=system.connections[::-1]
    )
    assert digest(result, one) == before
    number = about["numbers"]["pointing"]
    assert of(title="x", description="x") == before
    assert (
        of(numbers={**about["numbers"], "pointing": {**number, "title": "x"}}) == before
    )
    for key in ("signal", "unit", "window", "measure"):
        with_other = {**about["numbers"], "pointing": {**number, key: "x"}}
        assert of(numbers=with_other) != before
    # a number may have any name, also that of a text
    assert of(numbers={**about["numbers"], "title": number}) != before
    for key in ("requirements", "dispersions", "stop_when", "plots", "residual_bound"):
        assert of(**{key: {}}) != before or key not in about, key
    assert of(stop_when={"signal": "manager.mode", "reaches": 1}) != before
    assert of(residual_bound=1.0) != before
    assert (
        digest(replace(system, about=Content(reversed(about.items()))), one) == before
    )


@pytest.mark.parametrize("name", ["integrated/mil-nadir", "uosat12/table3-ocdc-ilqr-1"])
def test_native_and_python_fmus_and_bare_blocks_are_one(name):
    """They give the same bits, and so have the same digest; packed, too."""
    results = {
        plan.digest_of(name, o)
        for o in (Options(), Options(fmus="python"), Options(blocks=True))
    }
    assert len(results) == 1
    assert comparable(results.pop())


def test_a_packed_system_has_the_digest_of_its_scenario(tmp_path):
    from desat.export.packing import pack_scenario

    file = pack_scenario(
        find("nadir_day/day-dipole"), tmp_path / "a.ssp", force=True, fmus="native"
    )
    assert plan.digest_of(str(file), Options()) == plan.digest_of(
        "nadir_day/day-dipole", Options()
    )


def test_it_is_of_what_an_fmu_was_built_of_not_of_the_sources_beside_it(monkeypatch):
    fmu = library.of_ours("wheels.fmu")
    before = library.computes("wheels", fmu)
    assert before.startswith("block ")
    assert library.computes("wheels", None) == before
    monkeypatch.setattr(library.meaning, "is_as", lambda entry: False)
    monkeypatch.setattr(
        library.meaning, "index_entry", lambda name: {"computes": "other"}
    )
    library._hash_of.cache_clear()
    assert library.computes("wheels", fmu) == before
    assert library.computes("wheels", None) == "block other"
    library._hash_of.cache_clear()


def test_a_foreign_fmu_is_its_file(tmp_path):
    copy = tmp_path / "wheels.fmu"
    shutil.copy(library.our_file("wheels.fmu"), copy)
    with copy.open("ab") as file:
        file.write(b"\0" * 8)
    assert (
        library.computes("wheels", library.load(copy)) == f"file {library.sha256(copy)}"
    )


# --- two systems in one data set ------------------------------------------------------

MINE = """
extends = "integrated/mil-nadir"
craft = "craft.toml"
stop = 20.0
"""
WIRING = """
[wiring]
"controller.q_bi" = "spacecraft.q_bi"
"controller.omega_bi_body" = "spacecraft.omega_bi_body"
"manager.q_bi" = "spacecraft.q_bi"
"""


@pytest.fixture
def mine(tmp_path) -> Path:
    """A scenario of a user's own, with a craft of its own."""
    folder = tmp_path / "mine"
    folder.mkdir()
    shutil.copy(ROOT / "ssp" / "integrated" / "craft.toml", folder)
    (folder / "mine.toml").write_text(MINE)
    return folder / "mine.toml"


def one_line(message: Any) -> bool:
    """Whether there is nothing but a line of error, after warnings."""
    lines = [x for x in message.stderr.splitlines() if not x.startswith("warning: ")]
    return len(lines) == 1 and lines[0].startswith("error: ")


def rewire(file: Path) -> None:
    """Wire the craft of a scenario otherwise."""
    with file.with_name("craft.toml").open("a") as craft:
        craft.write(WIRING)


def test_a_campaign_does_not_go_on_with_another_wiring(mine, tmp_path, desat):
    """Neither by more cases, nor by a case again; the report still reads it, and says
    so."""
    folder = tmp_path / "campaign"
    command_start = ("campaign", str(mine), "--out", str(folder), "--jobs", "1", "-n")
    assert desat(*command_start, "2").returncode in (0, 1)
    digest_text = store.digest(folder)
    rewire(mine)
    for command in ((*command_start, "4"), ("campaign", "case", str(folder), "1")):
        outcome = desat(*command)
        assert outcome.returncode == Exit.INPUT, command
        assert (
            "mine.toml is not what it was when the campaign began: wiring"
            in outcome.stderr
        )
        assert "--out ANOTHER` begins anew" in outcome.stderr
        assert one_line(outcome)
    assert store.digest(folder) == digest_text
    outcome = desat("campaign", "report", str(folder))
    assert outcome.returncode in (0, 1)
    assert (
        "mine.toml is not what it was when the campaign began: wiring" in outcome.stderr
    )
    assert "2 of 2 completed" in outcome.stdout


def test_a_worker_with_another_wiring_makes_no_case(mine):
    plan, _ = coordinator.planned(str(mine), 4)
    cluster._compared.clear()
    assert cluster.unfit(plan, False, identity.versions()) == ""
    cluster._compared.clear()
    rewire(mine)
    message = cluster.unfit(plan, False, identity.versions())
    assert "mine.toml: its wiring, times, content, parameters or FMUs differ" in message
    cluster._compared.clear()


def test_a_run_does_not_go_on_with_another_wiring(mine, tmp_path, monkeypatch):
    broken(str(mine), Options(checkpoint=5.0), tmp_path / "a", monkeypatch, 10)
    rewire(mine)
    with pytest.raises(
        DesatError,
        match=(
            r"connections\.controller\.omega_bi_body\[1\] was {'source': 'gyro.omega_meas_body\[1\]'}, "
            r"and is {'source': 'spacecraft.omega_bi_body\[1\]'}"
        ),
    ):
        resume(tmp_path / "a")


def test_a_manifest_says_wiring_and_versions(tmp_path):
    run = simulate(prepare("nadir_day/day-dipole", Options(stop=2.0)), tmp_path / "a")
    run_manifest = run.manifest
    system, _ = prepare("nadir_day/day-dipole", Options()).or_raise()
    assert len(run_manifest["connections"]) == len(system.connections)
    assert run_manifest["connections"]["manager.h_wheel[2]"] == {
        "source": "tachometers.h_meas_wheel[2]"
    }
    assert {"desat", "numpy", "scipy", "python", "platform", "libm"} <= run_manifest[
        "versions"
    ].keys()
    assert run_manifest["versions"]["compiler"]  # there are native FMUs
    assert comparable(run_manifest["digest"])
    run.results.close()


def test_a_transformation_is_in_digest_manifest_and_design():
    system, _ = prepare("plant/light", Options(blocks=True)).or_raise()
    one, first = dict.fromkeys(system.components, "1"), system.connections[0]
    assert isinstance(first, Connection)
    results = {}
    for factor, offset in ((1.0, 0.0), (1e3, 0.0), (1.0, 1e-3)):
        wire = replace(first, factor=factor, offset=offset)
        rewired_system = replace(system, connections=(wire, *system.connections[1:]))
        results[digest(rewired_system, one)] = (
            plan_of(rewired_system)[f"{first.target}.{first.input}"],
            origin._wire(wire),
        )
    assert len(results) == len({repr(x[0]) for x in results.values()}) == 3
    assert len({x[1] for x in results.values()}) == 3


def plan_of(system: Any) -> dict[str, Any]:
    from desat.system.digest import wiring

    return wiring(system.connections)


def test_the_unit_of_a_value_in_an_ssv_counts(tmp_path):
    """650 km, 650 nautical miles, and what is 650 km in metres."""
    results = {}
    for unit, value in (("km", "650"), ("league", "650"), ("m", "650000")):
        folder = tmp_path / unit
        folder.mkdir()
        write_altitude(folder, unit)
        file = folder / "e.ssv"
        file.write_text(file.read_text().replace('value="650"', f'value="{value}"'))
        results[unit] = plan.digest_of(str(folder), Options(step=10.0, stop=600.0))
    assert results["km"] == results["m"] != results["league"]


def test_stored_draws_are_of_wiring_and_blocks_too(monkeypatch):
    scenario = find("uosat12/starts-dct")
    before = stored.digest(scenario)
    assert before == stored.digest(find("uosat12/starts-dct"))
    text = replace(
        scenario, content=but(scenario.content, title="x", plots={}, paper={})
    )
    assert stored.digest(text) == before
    slower = replace(
        scenario, content=but(scenario.content, stop=scenario.content.stop + 10.0)
    )
    assert stored.digest(slower) != before
    with monkeypatch.context() as patch:

        def build_rewired(*values: Any) -> Any:
            draft = build(*values)
            draft.connections.pop()
            return draft

        patch.setattr(stored, "build", build_rewired)
        assert stored.digest(scenario) != before
    monkeypatch.setattr(library, "computes", lambda name, fmu: "other")
    assert stored.digest(scenario) != before


def test_a_design_made_for_each_draw_counts_where_it_is_used():
    each = [
        s
        for s in scenarios().values()
        if s.content.design and s.content.design.each_draw
    ]
    assert each
    before = stored.digest(each[0])
    design_text = each[0].content.design.written
    other = but(each[0].content, design={**design_text, "nodes": 7})
    assert stored.digest(replace(each[0], content=other)) != before
    assert resolved(each[0].name, Options(blocks=True))[1] == design_text


# --- versions beside it ---------------------------------------------------------------


def test_other_versions_are_refused_or_accepted(mine, tmp_path, desat, monkeypatch):
    """The cases that are there keep theirs; the report says which were made with which."""
    folder = tmp_path / "campaign"
    command_start = ("campaign", str(mine), "--out", str(folder), "--jobs", "1", "-n")
    assert desat(*command_start, "2").returncode in (0, 1)
    assert "different versions" not in desat("campaign", "report", str(folder)).stderr
    here = identity.versions()
    for name in ("desat", "numpy", "platform", "libm"):
        now = {**here, name: "0.1-other"}
        with monkeypatch.context() as patch:
            patch.setattr(plan, "versions", lambda now=now: now)
            outcome = desat(*command_start, "4")
            assert outcome.returncode == Exit.INPUT
            assert f"{name} was {here[name]}, and is 0.1-other" in outcome.stderr
            assert "--accept-versions continues" in outcome.stderr
            assert one_line(outcome)
            outcome = desat("campaign", "case", str(folder), "1")
            assert outcome.returncode == Exit.INPUT
            assert f"{name} was {here[name]}" in outcome.stderr
    assert store.read(folder).num_rows == 2
    before = store.read(folder).to_pylist()
    with monkeypatch.context() as patch:
        patch.setattr(plan, "versions", lambda: {**here, "numpy": "0.1-other"})
        outcome = desat(*command_start, "4", "--accept-versions")
    assert outcome.returncode in (0, 1), outcome.stderr
    version_line = (
        f"different versions: 2 with numpy 0.1-other; 2 with numpy {here['numpy']}"
    )
    assert version_line in outcome.stderr
    after = store.read(folder).to_pylist()
    assert [r["versions"] for r in after[:2]] == [r["versions"] for r in before]
    assert [json.loads(r["versions"])["numpy"] for r in after[2:]] == ["0.1-other"] * 2
    assert {v.cases for v in report.summary(folder).versions} == {2}
    assert "2 with numpy 0.1-other" in (folder / "report.html").read_text()


def test_a_worker_with_another_libm_makes_no_case(mine):
    plan, _ = coordinator.planned(str(mine), 4)
    here = identity.versions()
    for name in ("desat", "numpy", "platform", "libm"):
        message = cluster.unfit(plan, False, {**here, name: "0.1-other"})
        assert (
            message
            == f"has {name} {here[name]}, here it is 0.1-other; the same is needed"
        )


# --- folders of before ----------------------------------------------------------------


def test_a_campaign_of_before_is_read_but_does_not_go_on(mine, tmp_path, desat):
    folder = tmp_path / "campaign"
    command_start = ("campaign", str(mine), "--out", str(folder), "--jobs", "1", "-n")
    assert desat(*command_start, "2").returncode in (0, 1)
    file = folder / plan.PLAN
    answer = json.loads(file.read_text())
    answer["digest"] = "ab" * 32
    answer["versions"] = {
        k: answer["versions"][k] for k in ("desat", "numpy", "python")
    }
    file.write_text(json.dumps(answer))
    for command in ((*command_start, "4"), ("campaign", "case", str(folder), "1")):
        outcome = desat(*command)
        assert outcome.returncode == Exit.INPUT
        assert "the desat that the campaign began with kept no digest" in outcome.stderr
        count = "4" if command[-1] == "4" else "2"
        assert (
            f"`desat campaign {mine} -n {count} --seed 1 --out ANOTHER` begins"
            in outcome.stderr
        )
        assert one_line(outcome)
    outcome = desat("campaign", "report", str(folder))
    assert outcome.returncode in (0, 1)
    assert "2 of 2 completed" in outcome.stdout
    assert "kept no digest" in outcome.stderr
    assert api.load(folder).sizes["case"] == 2


def test_a_run_of_before_is_read_but_does_not_go_on(tmp_path, monkeypatch, desat):
    folder = tmp_path / "a"
    options = Options(stop=40.0, checkpoint=10.0, sets=["wheels.speed_limit=600.0"])
    tell = checkpoint.Checkpoints.save

    def of_before(self: checkpoint.Checkpoints) -> None:
        answer = self._tell

        def without() -> dict[str, Any]:
            state = dict(answer())
            drop = ("digest", "connections")
            state["manifest"] = {
                k: v for k, v in state["manifest"].items() if k not in drop
            }
            return state

        with monkeypatch.context() as patch:
            patch.setattr(self, "_tell", without)
            tell(self)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.Checkpoints, "save", of_before)
        broken("nadir_day/day-dipole", options, folder, monkeypatch, 30)
    for name in ("manifest.json", "manifest.json.part"):
        if (folder / name).exists():
            answer = json.loads((folder / name).read_text())
            answer.pop("digest")
            answer.pop("connections")
            (folder / name).write_text(json.dumps(answer))
    with pytest.raises(
        DesatError,
        match=(
            r"it cannot go on: the desat that it began with kept no digest .*`desat run "
            r"nadir_day/day-dipole --set wheels.speed_limit=600.0 --stop 40.0 --checkpoint 10.0` begins"
        ),
    ):
        resume(folder)
    load_run(folder).results.close()
    assert api.load(folder).data.sizes["time"] >= 30
    assert desat("report", str(folder)).returncode in (0, 1, 4)


# --- what it costs --------------------------------------------------------------------


def test_it_costs_some_milliseconds():
    """The most of eight is the machine's; the least is its own."""
    import time

    system, _ = prepare("nadir_day/day-dipole", Options()).or_raise()
    durations = []
    for _ in range(8):
        for c in system.components.values():
            vars(c.interface).pop("_digest", None)
        clock = time.perf_counter()
        identity.of_system(system, Options())
        durations.append(time.perf_counter() - clock)
    assert min(durations) < 0.02
