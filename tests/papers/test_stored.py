"""Stored samples: when they are stale, and that they come out again."""

from __future__ import annotations

import math
import shutil

import pytest

from desat.campaign import draws
from desat.campaign.spread import spreads
from desat.files import library, paths
from desat.files.scenario import families, find
from desat.fmus import meaning
from desat.fmus.slave import _name
from desat.system.errors import DesatError
from tests.conftest import ROOT, module_of

pages = module_of("benchmarks.pages.verbs")
stored = module_of("desat.papers.stored")


# --- stored draws ---------------------------------------------------------------------


def test_stored_draws_are_stale_when_their_code_changes(monkeypatch, tmp_path):
    """That of a block, of what it uses of others, of the engine; not a comment."""
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    stored_samples["scenarios"][name] |= {
        "sha256": stored.digest(find(name)),
        "code_sha256": stored.code(find(name)),
    }
    assert name not in stored.outdated(stored_samples)
    shutil.copytree(ROOT / "components", tmp_path / "components")
    monkeypatch.setattr(meaning, "COMPONENTS", tmp_path / "components")
    for file, text, stale in (
        ("blocks/manager_combined.py", "# a comment", False),
        ("maths/vector.py", "# a comment", False),
        ("maths/vector.py", "ONE_MORE = 1.0", False),
        ("maths/vector.py", "def norm(a: Vec3) -> float:\n    return 1.0", True),
        ("blocks/manager_combined.py", "ONE_MORE = 1.0", True),
    ):
        library._hash_of.cache_clear()
        path = tmp_path / "components" / file
        before = path.read_text()
        path.write_text(f"{before}\n{text}\n")
        assert (name in stored.outdated(stored_samples)) is stale, (file, text)
        path.write_text(before)
    library._hash_of.cache_clear()


CODE = """\"\"\"What it is.\"\"\"


def f(x: float) -> float:
    \"\"\"Twice.\"\"\"
    return 2.0 * x  # a comment
"""


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("What it is.", "What it was.", True),
        ("Twice.", "Two times.", True),
        ('    """Twice."""\n', "", True),
        ("# a comment", "", True),
        ("2.0 * x", "(2.0\n    * x)", True),
        ("2.0 * x", "x * 2.0", False),
        ("2.0", "2", False),
        ("f(x", "g(x", False),
        ("2.0 * x", "None", False),
    ],
)
def test_texts_and_layout_of_code_do_not_count(old, new, same):
    assert old in CODE
    assert (
        meaning.definitions(CODE.replace(old, new)) == meaning.definitions(CODE)
    ) is same


def test_draws_are_stamped_only_if_they_come_out_again(monkeypatch, tmp_path):
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    monkeypatch.setattr(stored, "with_draws", lambda family: {name: find(name)})
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    stored_samples["scenarios"] = {name: stored_samples["scenarios"][name]}
    stored_samples["scenarios"][name].pop("code_sha256", None)
    stored.write(stored_samples)
    assert stored.outdated(stored.read("uosat12")) == [name]
    assert stored.confirm("uosat12", 1, 1) == []
    assert stored.outdated(stored.read("uosat12")) == []
    row = stored_samples["scenarios"][name]["draws"][0].numbers
    row["firing_time"] *= 1.0 + 1e-6
    stored.write(stored_samples)
    assert stored.confirm("uosat12", 1, 1) == [name]


def test_stale_samples_are_told_with_cause_and_command(monkeypatch):
    stored_samples = stored.read("uosat12")
    monkeypatch.setattr(stored, "outdated", lambda _: ["uosat12/starts-dct"])
    stored_samples["scenarios"]["uosat12/starts-dct"]["code_sha256"] = "another"
    with pytest.raises(
        DesatError, match="of other code of engine, measures or sampling"
    ) as error:
        stored.require_current(stored_samples)
    assert "python -m desat.papers.stored uosat12" in str(error.value)


def test_a_block_is_of_what_it_uses_of_other_files(monkeypatch, tmp_path):
    """A class more in the file of roles made all stored samples stale."""
    copy = tmp_path / "components"
    shutil.copytree(
        meaning.COMPONENTS, copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    monkeypatch.setattr(meaning, "COMPONENTS", copy)
    names = ("wheels", "magnetometer", "manager_predictive", "spacecraft_rigid")

    def computes():
        return {name: meaning.index_entry(name)["computes"] for name in names}

    before = computes()
    roles, vector = copy / "contract" / "roles.py", copy / "maths" / "vector.py"
    text = roles.read_text(encoding="utf-8")
    roles.write_text(
        text + "\n\nclass EarthSensor(Sampled):\n    role = 'earth_sensor'\n"
    )
    assert computes() == before
    roles.write_text(
        text.replace('"measured field, body"', '"the measured field, body"')
    )
    assert {n for n, x in computes().items() if x != before[n]} == {"magnetometer"}
    roles.write_text(text)
    text = vector.read_text(encoding="utf-8")
    assert "def norm(" in text
    vector.write_text(text.replace("def norm(", "EXTRA = 1.0\n\n\ndef norm("))
    assert computes() == before
    new_text = text.replace(
        "def norm(a: Vec3) -> float:", "def norm(a: Vec3) -> float:\n    a = a"
    )
    assert new_text != text
    vector.write_text(new_text)
    assert "spacecraft_rigid" in {n for n, x in computes().items() if x != before[n]}


def test_what_is_imported_counts_for_a_block_but_not_from_which_folder():
    text = "from ..maths.vector import cross as c\n\n\ndef f(x):\n    return c(x, x)\n"
    of = meaning.definitions
    assert (
        of(text)
        == of(text.replace("..maths.", "..elsewhere."))
        != of(text.replace("cross", "dot"))
    )
    assert of(text) != of(text.replace("vector", "other"))
    assert of(text, imports=False) == of(text.replace("vector", "other"), imports=False)
    assert of(text) == of(text + "\nif TYPE_CHECKING:\n    from x import y\n")


def test_moved_joined_and_split_files_leave_code_as_it_is(monkeypatch, tmp_path):
    """The place of a definition, and what is imported to reach it, are no part of the
    code's hash; a file in a new folder of the engine is."""
    scenario, before = (
        find("uosat12/starts-dct"),
        stored.code(find("uosat12/starts-dct")),
    )
    home = tmp_path / "desat"
    shutil.copytree(ROOT / "orchestrator", home)
    engine, recording = home / "engine", home / "engine" / "recording"
    monkeypatch.setattr(stored, "__file__", str(home / "papers" / "stored.py"))
    assert stored.code(scenario) == before
    (engine / "further").mkdir()
    (engine / "instances" / "fmu.py").rename(engine / "further" / "of_fmu.py")
    text = (engine / "node.py").read_text()
    (engine / "node.py").write_text(
        text.replace("from .instances", "from ..engine.instances")
    )
    joined_text = (engine / "current_call.py").read_text() + (
        recording / "shared_tables.py"
    ).read_text()
    head, _, rest = joined_text.rpartition("from __future__ import annotations")
    (engine / "current_call.py").write_text(head + rest)
    (recording / "shared_tables.py").unlink()
    assert stored.code(scenario) == before
    (engine / "instances" / "new.py").write_text("STEP = 2.0\n")
    assert stored.code(scenario) != before


def test_stored_draws_come_back(monkeypatch, tmp_path):
    """All bits, and the same bytes again; a line of stamps a scenario; a number that a
    draw has not is None; a family leaves the others as they are."""
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    rows = [
        stored.row_of_draw(0, {"a": 0.1, "b": None}),
        stored.row_of_draw(2, {"a": None, "b": 1e-300}),
    ]
    units = {"a": "s", "b": "1"}
    of_x = spreads([r.numbers for r in rows], units, set())
    x = {"sha256": "1", "units": units, "summary": of_x, "draws": rows}
    y = {
        "sha256": "2",
        "units": {"a": "s"},
        "draws": [stored.row_of_draw(0, {"a": -0.0})],
    }
    y["summary"] = spreads([r.numbers for r in y["draws"]], y["units"], set())
    for family in ("f", "e"):
        scenarios = {f"{family}/x": x, f"{family}/y": y}
        sample_file = {"family": family, "seed": 1, "scenarios": scenarios}
        file = stored.write(sample_file)
        before = file.read_bytes()
        assert stored.write(sample_file).read_bytes() == before
    assert len(stored.provenance_file().read_text().splitlines()) == 2 + 2 * 4
    back = stored.read("e")
    assert back == sample_file
    assert math.copysign(1.0, back["scenarios"]["e/y"]["draws"][0].numbers["a"]) == -1.0
    assert stored.read("f")["scenarios"]["f/x"] == x
    file.write_bytes(stored.file_of("f").read_bytes())
    with pytest.raises(
        DesatError, match=r"e/draws.parquet: not the file that .*draws.json is of"
    ):
        stored.read("e")


def test_stored_draws_are_small_and_have_what_rows_are_made_of():
    files = [*paths.DRAWS.rglob("draws.*")]
    assert {p.name for p in files} == {"draws.json", "draws.parquet"}
    assert sum(p.stat().st_size for p in files) < 2_000_000
    for family in filter(stored.with_draws, families()):
        stored_samples = stored.read(family)["scenarios"]
        lacking = {
            n: x - stored_samples[n]["units"].keys()
            for n, x in stored.needed(family).items()
            if n in stored_samples
        }
        assert not any(lacking.values()), lacking


def test_a_page_has_draws_made_anew_for_a_number_that_is_not_stored(
    monkeypatch, tmp_path
):
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    assert "null_rms" not in stored_samples["scenarios"][name]["units"]
    monkeypatch.setattr(stored, "with_draws", lambda family: {name: find(name)})
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    stored_samples["scenarios"] = {name: stored_samples["scenarios"][name]}
    stored.write(stored_samples)
    requests = []

    def make_samples(target, count, *rest, first=0):
        requests.append((target, count, first))
        had = [r.numbers for r in stored_samples["scenarios"][name]["draws"]]
        rows = [
            stored.row_of_draw(i, {**had[i], "null_rms": float(i), "x": 1.0})
            for i in range(first, count)
        ]
        units = {
            **stored_samples["scenarios"][name]["units"],
            "null_rms": "N.m.s",
            "x": "1",
        }
        return draws.Draws(
            name, 1, rows, spreads([r.numbers for r in rows], units, set()), []
        )

    monkeypatch.setattr(stored, "draws", make_samples)
    with pytest.raises(
        DesatError, match="null_rms of its draws is not stored; without --draft"
    ):
        pages.Verbs(pages.Sources("uosat12", [], 1, 60.0)).drawn(
            "starts-dct", "null_rms"
        )
    verbs = pages.Verbs(pages.Sources("uosat12", [], 1, None))
    with pytest.raises(
        DesatError, match="draws have no number nul_rms; did you mean null_rms"
    ):
        verbs.drawn("starts-dct", "nul_rms")
    assert verbs.drawn("starts-dct", "null_rms") == [float(i) for i in range(200)]
    assert requests == [(name, 200, 0)]
    assert "x" not in stored.read("uosat12")["scenarios"][name]["units"]
    assert {"null_rms", "firing_time"} <= stored.read("uosat12")["scenarios"][name][
        "units"
    ].keys()


def test_more_draws_are_flown_after_those_that_are_kept(monkeypatch, tmp_path):
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    scenario = find(name)
    full = stored_samples["scenarios"][name]
    full["sha256"], full["code_sha256"] = (
        stored.digest(scenario),
        stored.code(scenario),
    )
    monkeypatch.setattr(stored, "with_draws", lambda family: {name: scenario})
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    firing_time = full["draws"][0].numbers["firing_time"]
    first = full["draws"][:-1]
    first[0] = stored.row_of_draw(0, dict.fromkeys(first[0].numbers, 1.0))
    stored_samples["scenarios"] = {name: {**full, "draws": first}}
    stored.write(stored_samples)
    assert stored.outdated(stored.read("uosat12")) == [name]
    result = stored.renew("uosat12", 1)["scenarios"][name]
    assert result["draws"][1:] == full["draws"][1:]
    assert result["draws"][0] == first[0] != firing_time, (
        "a draw that is kept is not flown again"
    )
    assert result["summary"]["firing_time"].n == scenario.content.samples
    assert result["summary"]["firing_time"].levels["min"] == 1.0


def test_an_instance_that_is_named_by_its_file_has_the_components_name():
    """As Ecos does; its folder is another one in every run."""
    assert _name("gyro") == "gyro"
    assert _name("/somewhere/ecos_ssp_667c8ae5/resources/gyro.fmu") == "gyro"
    assert _name("C:\\somewhere\\resources\\gyro.fmu") == "gyro"
