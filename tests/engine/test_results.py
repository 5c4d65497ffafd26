"""Runs and what they leave behind: series, manifest, report; stopped, killed and failed
runs."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import zipfile
from dataclasses import FrozenInstanceError
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from isal import isal_zlib
from pyarrow import parquet
from scipy.io import loadmat

import desat as desat_package
from desat.analyses.manifest import Manifest
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.engine.ending import NEVER
from desat.engine.loop import run as step_on
from desat.engine.loop import stepping
from desat.engine.master import Master
from desat.engine.recording import recorder as recorder_module
from desat.engine.recording import results as results_module
from desat.engine.recording import series_file, shared_tables
from desat.engine.recording.recorder import Recorder
from desat.engine.recording.results import Results
from desat.export.series import export, no_formula
from desat.figures.plots import series_figure
from desat.files import library, paths
from desat.files.build import build
from desat.files.draft import Assignment, Draft
from desat.files.fmu import of_fmu
from desat.fmus import registry
from desat.language.scenario import Number
from desat.numbers import derived
from desat.numbers.derived import sample_rows
from desat.numbers.measures import MEASURES
from desat.numbers.numbers import evaluate, related, relative, scale
from desat.numbers.text import spell_unit
from desat.runs.checks import check_draft
from desat.runs.manifest import read_manifest
from desat.runs.prepare import read
from desat.runs.run import Options, execute, load_run
from desat.runs.validation import content_problems
from desat.system.errors import DesatError
from desat.system.interface import of_block
from desat.system.model import Component, Parameter
from tests.conftest import ROOT

NAME = "uosat12/table3-ocdc-ilqr-1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "out"
    execute(NAME, Options(), path).results.close()
    return path


def test_series(folder):
    with h5py.File(folder / "series.h5") as file:
        assert file["time"][:].tolist() == [10.0 * k for k in range(61)]
        assert file.attrs["scenario"] == NAME
        assert json.loads(file.attrs["versions"])["desat"]
        h = file["spacecraft/h_copy_wheel"]
        assert h.shape == (61, 4)
        assert h.compression == "gzip"
        assert h.dims[0].keys() == ["time"]
        assert np.array_equal(h.dims[0]["time"], file["time"])
        own_value = ("unit", "frame", "description", "class")
        assert {k: h.attrs[k] for k in own_value} == {
            "unit": "N.m.s",
            "frame": "wheel axes",
            "description": "own copy of the axial momentum of each wheel, absolute",
            "class": "state",
        }
        assert h[0].tolist() == [1, 2, -1, 0]
        m = file["torquers/m_mean_body"]
        assert m.shape == (60, 3), "an interval output has no last row"
        assert m.attrs["class"] == "interval"
        assert m.dims[0].keys() == ["interval"]
        assert np.array_equal(m.dims[0]["interval"], file["time"][:60])
        assert file["manager/mode"].dtype == np.int32
        assert "fault" not in file["manager"]
    assert sorted(p.name for p in folder.iterdir()) == ["manifest.json", "series.h5"]


@pytest.mark.parametrize("text", ["[]", "{}", '{"about": null}', "{"])
def test_what_is_no_manifest_is_said(tmp_path, text):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(
        DesatError, match=rf"^{re.escape(str(tmp_path))}/manifest\.json: "
    ):
        read_manifest(tmp_path)


def test_manifest(folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["status"] == "completed"
    assert manifest["steps_done"] == manifest["steps"] == 60
    assert set(manifest["fmus"]) == {
        "environment",
        "spacecraft",
        "magnetometer",
        "tachometers",
        "manager",
        "torquers",
        "thrusters",
    }
    assert all(len(f["sha256"]) == 64 for f in manifest["fmus"].values())
    manager = manifest["parameters"]["manager"]
    assert manager["split"] == {
        "value": "ocdc",
        "unit": "",
        "given": True,
        "text": manager["split"]["text"],
    }
    assert manager["g_rate"]["value"] == 0.0077
    assert manifest["parameters"]["spacecraft"]["h_start_body"]["value"] == [1, 2, -1]
    assert manifest["numbers"]["firing_time"]["unit"] == "s"
    assert manifest["versions"]["fmpy"]


def test_a_manifest_is_an_object_and_as_a_mapping_its_file(folder):
    run = load_run(folder)
    manifest, text = run.manifest, (folder / "manifest.json").read_text()
    run.results.close()
    assert (manifest.completed, manifest.steps_done, manifest.stopped_when) == (
        True,
        60,
        None,
    )
    assert manifest.parameters["manager"]["g_rate"] == Parameter(
        0.0077,
        manifest["parameters"]["manager"]["g_rate"]["unit"],
        True,
        manifest["parameters"]["manager"]["g_rate"]["text"],
    )
    assert (
        manifest.numbers["firing_time"].value
        == manifest["numbers"]["firing_time"]["value"]
    )
    assert manifest.parts["dumping"].torquers == manifest["dumping"]["torquers"]
    answer = json.loads(text)
    assert answer.pop("seal")  # of the file
    assert manifest.to_json() == answer
    assert manifest == answer
    with pytest.raises(FrozenInstanceError):
        manifest.status = "failed"


def test_a_manifest_of_another_version_is_read_and_keeps_what_it_says():
    results = {
        "scenario": "a",
        "about": {},
        "status": "running",
        "rigid_body": None,
        "later": [1],
    }
    manifest = Manifest.from_json(results)
    assert (manifest.parameters, manifest.parts, manifest.numbers) == (
        {},
        {"rigid_body": None},
        {},
    )
    assert manifest["later"] == [1]
    assert "numbers" not in manifest, "it has none before it is over"


def test_no_code_takes_a_manifest_apart_by_its_keys():
    texts = {
        p.name: p.read_text(encoding="utf-8")
        for p in (ROOT / "orchestrator").rglob("*.py")
    }
    assert [
        name for name, text in texts.items() if re.search(r"""manifest\[["']""", text)
    ] == []


def test_recording_less():
    run = execute(NAME, Options(record=("manager.*", "thrusters.on_time"), every=7))
    assert set(run.results.names()) == {
        "manager.m_cmd_body",
        "manager.mode",
        "manager.tau_cmd_thruster_body",
        "manager.tau_cmd_wheel",
        "thrusters.on_time",
    }
    assert run.results.times().tolist() == [70.0 * k for k in range(9)]
    full = execute(NAME, Options())
    every_seventh = full.results.values("manager.m_cmd_body")[::7]
    assert np.array_equal(run.results.values("manager.m_cmd_body"), every_seventh)
    assert set(run.manifest["numbers"]) == {"firing_time"}, (
        "the others' series are not recorded"
    )


def test_long_runs_are_written_in_pieces(tmp_path):
    run = execute(
        NAME, Options(stop=30000.0, record=("spacecraft.*",)), tmp_path / "long"
    )
    times = run.results.times()
    assert np.array_equal(times, 10.0 * np.arange(3001))
    assert len(run.results.values("spacecraft.q_bi")) == 3001
    assert np.allclose(np.linalg.norm(run.results.values("spacecraft.q_bi"), axis=1), 1)


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_memory_does_not_grow_with_the_steps(tmp_path, monkeypatch):
    """HDF5 would keep what it has written: 40 MB here; rows that fill no chunk yet are
    kept."""
    used, tick = {}, Recorder.tick

    def tell(self: Recorder) -> None:
        tick(self)
        status = Path("/proc/self/status").read_text()
        used[self.unwritten.written] = int(status.split("RssAnon:")[1].split()[0])

    monkeypatch.setattr(Recorder, "tick", tell)
    monkeypatch.setattr(recorder_module, "FLUSH_SECONDS", 0.0)
    execute(
        "nadir_day/day-dipole", Options(stop=50000.0), tmp_path / "a"
    ).results.close()
    early = min(kB for rows, kB in used.items() if rows > 20000)
    assert used[max(used)] - early < 13000


def test_many_variables_share_tables(tmp_path, monkeypatch):
    """The same names, values and attributes as with a data set each."""
    tables = []
    for many in (shared_tables.MANY, 3):
        monkeypatch.setattr(shared_tables, "MANY", many)
        with execute(
            "integrated/mil-nadir", Options(stop=20.0), tmp_path / str(many)
        ).results as r:
            tables.append(
                [
                    (
                        n,
                        r.values(n).tobytes(),
                        r.values(n).shape,
                        r.count(n),
                        r.times(n).tolist(),
                        r.choices(n),
                        *(r.attribute(n, a) for a in ("unit", "frame", "class")),
                    )
                    for n in r.names()
                ]
            )
        with h5py.File(tmp_path / str(many) / "series.h5") as file:
            assert (shared_tables.INDEX in file) == (many == 3)
    assert len(tables[0]) > 20
    assert tables[0] == tables[1]


def test_csv(folder, tmp_path):
    """A row has all: a state at the end, which no interval follows, is named instead."""
    (path,), note = export(folder, "csv", tmp_path)
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    assert head[0] == "time [s]"
    assert "spacecraft.h_copy_wheel[1] [N.m.s]" in head
    assert note == "states at t = 600 s have no interval after them, and no row"
    assert len(rows) == 60
    assert not any(cell in ("", "nan") for row in rows for cell in row)
    with Results.open(folder) as results:
        column = head.index("torquers.m_mean_body[2] [A.m2]")
        csv_values = [float(row[column]) for row in rows]
        assert csv_values == results.values("torquers.m_mean_body")[:, 1].tolist()
    names = {"=1": "'=1", "-a": "'-a", "+a": "'+a", "@a": "'@a", "a.b": "a.b"}
    assert {x: no_formula(x) for x in names} == names


def test_exports_hold_the_same_numbers(folder, tmp_path):
    (path,), _ = export(folder, "parquet", tmp_path)
    table = parquet.read_table(path)
    (mat,), _ = export(folder, "mat", tmp_path)
    structs = loadmat(mat, simplify_cells=True)
    with Results.open(folder) as results:
        for name in results.names():
            component, _, variable = name.partition(".")
            full = np.asarray(results.values(name))
            assert np.array_equal(structs[component][variable], full)
            assert structs[component]["units"][variable] == (
                results.attribute(name, "unit") or "1"
            )
            first = next(
                c for c in table.column_names if c.partition("[")[0].strip() == name
            )
            column = full if full.ndim == 1 else full[:, 0]
            assert np.array_equal(table[first].to_numpy(), column[:60])
    pictures, _ = export(folder, "png", tmp_path)
    assert all(p.read_bytes()[1:4] == b"PNG" for p in pictures)
    drawings, _ = export(folder, "svg", tmp_path)
    assert [p.stem for p in drawings] == [p.stem for p in pictures]
    assert all(p.read_text().startswith("<svg") for p in drawings)
    assert "management" in [p.stem for p in drawings]
    with pytest.raises(DesatError, match="--format xls: there are csv"):
        export(folder, "xls", tmp_path)


def test_a_run_is_a_data_set(folder, tmp_path):
    ds = desat_package.load(folder).data
    h = ds["spacecraft.h_copy_wheel"]
    assert h.dims[0] == "time"
    assert h.attrs == {
        "units": "N.m.s",
        "frame": "wheel axes",
        "class": "state",
        "long_name": "own copy of the axial momentum of each wheel, absolute",
    }
    assert ds["manager.mode"].attrs["choices"].startswith("idle, ")
    assert ds.time.attrs["units"] == ds.interval.attrs["units"] == "s"
    assert (ds.attrs["scenario"], ds.attrs["epoch"]) == (NAME, ""), (
        "none of it has an epoch"
    )
    assert json.loads(ds.attrs["versions"])["desat"]
    execute("nadir_day/day-dipole", Options(stop=5.0), tmp_path).results.close()
    assert (
        desat_package.load(tmp_path).data.attrs["epoch"] == "2026-01-01T00:00:00+00:00"
    )
    assert ds["torquers.m_mean_body"].dims[0] == "interval"
    assert float(ds.time[-1]) == 600.0
    assert float(ds.interval[-1]) == 595.0, "the middle of the last step"
    with Results.open(folder) as results:
        full = results.values("spacecraft.h_copy_wheel")
    assert np.array_equal(h.values, full)
    assert np.array_equal(h[5:50:7, 1].values, full[5:50:7, 1])
    assert h[-1, 0].item() == full[-1, 0]
    assert np.array_equal(h.sel(time=100.0).values, full[10])
    assert ds.attrs["scenario"] == NAME
    assert json.loads(ds.attrs["numbers"])["firing_time"]["unit"] == "s"


def test_a_failing_component_keeps_what_was_recorded(tmp_path):
    """A torque that turns the craft too far within a step."""
    values = {"spacecraft.tau_disturbance_body": [1e30, 0.0, 0.0]}
    run = execute("nadir_day/day-dipole", Options(values=values), tmp_path / "bad")
    assert run.manifest["status"] == "failed"
    assert (
        "spacecraft: in a step of 1 s body and nutation turn by"
        in run.manifest["message"]
    )
    start = run.manifest["parameters"]["wheels"]["h_start_wheel"]["value"]
    assert run.results.values("spacecraft.h_copy_wheel").tolist() == [start]
    assert len(run.results.values("wheels.tau_mean_wheel")) == 0
    assert (tmp_path / "bad" / "series.h5").exists()


LONG = [
    "run",
    NAME,
    "--stop",
    "2e8",
    "--no-baseline",
    "--record",
    "spacecraft.h_copy_wheel",
]


def _start(folder):
    process = subprocess.Popen(
        [sys.executable, "-m", "desat.cli", *LONG, "--out", str(folder)],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    part = folder / "series.h5.part"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        time.sleep(0.2)
        if part.exists() and part.stat().st_size > 60000:
            return process
    process.kill()
    raise AssertionError(process.communicate())


def test_ctrl_c_ends_cleanly(tmp_path):
    process = _start(tmp_path / "run")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in out + err
    assert "interrupted: stopped by the user at t = " in err
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["status"] == "interrupted"
    with Results.open(tmp_path / "run") as results:
        rows = results.values("spacecraft.h_copy_wheel")
        assert len(rows) == manifest["steps_done"] + 1
        assert len(results.times()) == len(rows)
    assert (tmp_path / "run" / "report.html").exists()
    assert not list((tmp_path / "run").glob("*.part"))


def test_a_killed_run_can_be_read(tmp_path, desat):
    process = _start(tmp_path / "run")
    time.sleep(0.5)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    with Results.open(tmp_path / "run") as results:
        rows = results.values("spacecraft.h_copy_wheel")
    assert len(rows) > 1000
    assert np.isfinite(rows).all()
    result = desat("report", str(tmp_path / "run"))
    assert result.returncode == 0, result.stderr
    assert "killed" in (tmp_path / "run" / "report.html").read_text()


def test_measures():
    times = np.arange(5.0)
    values = np.array([[3.0, 4.0], [0, 0], [-6, 8], [1, 0], [0, 2]])
    measures = {
        n: f(times, values)
        for n, f in MEASURES.items()
        if n
        in (
            "last",
            "norm_last",
            "largest",
            "norm_largest",
            "rms",
            "mean_size",
            "mean_size_last",
            "largest_mean",
        )
    }
    assert measures == {
        "last": 0,
        "norm_last": 2,
        "largest": 8,
        "norm_largest": 10,
        "rms": pytest.approx(np.sqrt(130 / 5)),
        "mean_size": pytest.approx(2.4),
        "mean_size_last": 1,
        "largest_mean": 3,
    }
    assert relative("saving", 30, 40) == 25
    assert relative("ratio", 30, 40) == 0.75
    assert [related(f, 30, 40) for f in ("saving", "ratio", "difference")] == [
        25,
        0.75,
        -10,
    ]
    assert related("difference", None, 40) is None


def test_each_number_of_a_series_that_is_not_there_is_said():
    draft = build(read("uosat12/table3-ocdc-ilqr-1"), Options(blocks=True))
    content = draft.about
    del draft.components["manager"], draft.components["spacecraft"]
    lines = [
        x for x in content_problems(content, draft.components) if x[0][0] == "numbers"
    ]
    absent_parts = ("manager.", "spacecraft.")
    lost_numbers = {
        n
        for n, x in content.numbers.items()
        if any(s.startswith(absent_parts) for s in x.signals)
    }
    assert lost_numbers
    assert {path[1] for path, _ in lines} == lost_numbers
    assert all(path[2:] == ("signal",) for path, _ in lines), lines
    assert all(
        re.match(r"no component (manager|spacecraft)", text) for _, text in lines
    ), lines


def test_scales_of_units():
    assert scale("N.m", "mN.m") == 1000
    with pytest.raises(DesatError):
        scale("N.m", "uT")


def test_modes_have_names_of_their_block(tmp_path):
    """They come with the FMU, and stand in the series, the manifest and nowhere in the
    role."""
    own_value = {
        "manager_integrated": (
            "idle",
            "dumping",
            "-",
            "-",
            "emergency",
            "velocity_dumping",
        ),
        "manager_receding_horizon": ("idle", "-", "receding_horizon", "fallback"),
        "manager_cross_product": ("idle", "dumping"),
    }
    for name, choices in own_value.items():
        fmu = of_fmu(paths.fmus() / f"{name}.fmu").signals["mode"]
        block = of_block(name, registry.block_class(name)).signals["mode"]
        assert fmu.choices == block.choices == choices
    run = execute("integrated/velocity-to-pointing", Options(stop=20.0), tmp_path)
    assert run.results.choices("manager.mode") == own_value["manager_integrated"]
    assert run.results.choices("manager.m_cmd_body") == ()
    assert read_manifest(tmp_path)["choices"] == {
        "manager.mode": list(own_value["manager_integrated"])
    }
    names = run.results.choices("manager.mode")
    assert {names[k] for k in run.results.values("manager.mode")} == {
        "velocity_dumping"
    }


@pytest.mark.parametrize(
    ("unit", "spelling"),
    [
        ("A2.m4.s", "A2 m4 s"),
        ("uN.m", "uN m"),
        ("rad/s2", "rad/s2"),
        ("um", "um"),
        ("1", ""),
    ],
)
def test_units_as_people_write_them(unit, spelling):
    assert spell_unit(unit) == spelling


def test_the_page_of_results_works_as_it_says(tmp_path, monkeypatch, capsys):
    """docs/results.md, its lines for Python, pandas and, where it is installed, Octave."""
    out = tmp_path / "runs" / "NAME"
    run = execute("nadir_day/day-dipole", Options(stop=60.0), out)
    largest = np.abs(run.results.values("wheels.h_wheel"))
    run.results.close()
    export(out, "parquet")
    page = (ROOT / "docs" / "results.md").read_text()
    snippets = re.findall(r"```python\n(.*?)```", page, re.S)
    assert len(snippets) == 2
    monkeypatch.chdir(tmp_path)
    for snippet in snippets:
        exec(snippet, {})
    first, second = capsys.readouterr().out.splitlines()
    assert first.endswith("] N.m.s")
    assert float(second) == largest[:60, 0].max()
    (snippet,) = re.findall(r"```matlab\n(.*?)```", page, re.S)
    if octave := shutil.which("octave-cli"):
        export(out, "mat")
        answer = subprocess.run(
            [octave, "--no-gui", "--quiet", "--eval", snippet],
            check=False,
            capture_output=True,
            text=True,
        ).stdout.split()
        assert answer == ["N.m.s", f"{largest.max():.17g}"]


@pytest.mark.parametrize(
    ("rows", "remaining"), [(200_000, 0.5), (200_000, 0.002), (20_000, 0.1)]
)
def test_one_that_was_not_closed_and_has_lost_its_end_is_refused(
    tmp_path, rows, remaining
):
    """At once: HDF5 would take what is missing for zeros, or look for it for hours."""
    with h5py.File(tmp_path / "whole", "w", libver="latest") as file:
        for name in ("time", "a/x", "a/y"):
            file.create_dataset(name, (0,), "f8", maxshape=(None,), chunks=(1000,))
        file.swmr_mode = True
        for name in ("time", "a/x", "a/y"):
            file[name].resize(rows, axis=0)
            file[name][:] = np.arange(1.0, rows + 1.0)
        file.flush()
        data = (tmp_path / "whole").read_bytes()
    part = tmp_path / "series.h5.part"
    part.write_bytes(data)
    with Results.open(tmp_path) as results:
        assert results.values("a.y")[-1] == rows
    part.write_bytes(data[: int(remaining * len(data))])
    with pytest.raises(DesatError, match=r"no readable series"):
        Results.open(tmp_path)


def test_nothing_is_packed_by_a_thread_that_steps(tmp_path, monkeypatch):
    """ISA-L would leave it slow (`packed.aside`)."""
    compress, threads = isal_zlib.compress, []

    def compress_on_thread(values: bytes, level: int) -> bytes:
        threads.append(threading.current_thread())
        return compress(values, level)

    monkeypatch.setattr(isal_zlib, "compress", compress_on_thread)
    monkeypatch.setattr(recorder_module, "ROWS", 16)
    execute(NAME, Options(checkpoint=200.0), tmp_path / "a").results.close()
    assert len(threads) > 100
    monkeypatch.setattr(
        series_file.Packing, "finish", lambda packing, last: packing.drop()
    )
    execute(NAME, Options(), tmp_path / "b").results.close()
    monkeypatch.undo()
    monkeypatch.setattr(isal_zlib, "compress", compress_on_thread)
    before = len(threads)
    series_file.pack(tmp_path / "b" / "series.h5")
    assert len(threads) > before
    assert threading.main_thread() not in threads


def test_numbers_of_the_same_series_derive_once(folder, monkeypatch):
    signals = ["environment.b_eci", "environment.r_eci"]
    number = {"signal": signals, "derive": "angle_between"}
    angle, calls = derived.QUANTITIES["angle_between"], []
    counting_angle = derived.DerivedQuantity(
        lambda a, b: calls.append(len(a)) or angle.function(a, b),
        angle.names,
        angle.unit,
    )
    monkeypatch.setitem(derived.QUANTITIES, "angle_between", counting_angle)
    with Results.open(folder) as results:
        evaluations = [
            evaluate(Number(**number, measure=m), results, {})
            for m in ("largest", "last")
        ]
        assert calls == [61]
        evaluate(Number(**{**number, "signal": signals[::-1]}), results, {})
        assert calls == [61, 61]
        angles = angle.function(*(results.values(s) for s in signals))
    assert [number.value for number in evaluations] == [angles.max(), angles[-1]]
    assert [number.samples for number in evaluations] == [61, 61]


def test_what_was_made_lately_is_kept_within_bounds(folder, monkeypatch):
    monkeypatch.setattr(results_module, "RECENT", 100)
    with Results.open(folder) as results:
        first = results.recent("a", lambda: np.zeros(10))
        assert results.recent("a", lambda: np.ones(10)) is first
        with pytest.raises(ValueError, match="read-only"):
            first += 1.0
        results.recent("b", lambda: np.ones(10))  # 80 bytes each
        assert results.recent("a", lambda: np.ones(10)) is not first
        large = results.recent("c", lambda: np.ones(100))
        assert results.recent("c", lambda: np.zeros(100)) is large


# --- names of foreign arrays ----------------------------------------------------------

ELEMENTS = [
    (["x[1]", "x[2]", "x[3]"], {"x": [0, 1, 2]}),
    (["x[3]", "x[5]", "x[6]"], {"x[3]": [0], "x[5]": [1], "x[6]": [2]}),
    (["x[0]", "x[1]", "x[2]"], {"x[0]": [0], "x[1]": [1], "x[2]": [2]}),
    (["x[2]", "x[1]", "y"], {"x[2]": [0], "x[1]": [1], "y": [2]}),
    (["x[1]", "y", "x[2]"], {"x[1]": [0], "y": [1], "x[2]": [2]}),
    (["x", "x[1]", "y"], {"x": [0], "x[1]": [1], "y": [2]}),
    (["x[1,1]", "x[1,2]", "y"], {"x": [0, 1], "y": [2]}),
    (["x[a]", "x[b]", "y"], {"x[a]": [0], "x[b]": [1], "y": [2]}),
]
"""Names of three outputs in the order of the description, and the series that they
make."""


@pytest.mark.parametrize(("names", "series"), ELEMENTS, ids=lambda x: " ".join(x))
def test_a_foreign_array_keeps_its_own_names(tmp_path, names, series):
    """They were numbered anew, in the order of the description, and what stood between
    them was one of them."""
    folder = tmp_path / "mine"
    with zipfile.ZipFile(ROOT / "fmus/dist/native/magnetometer.fmu") as archive:
        archive.extractall(folder)
    xml = folder / "modelDescription.xml"
    text = xml.read_text()
    for i, name in enumerate(names, 1):
        assert f'name="b_body[{i}]"' in text
        text = text.replace(f'name="b_body[{i}]"', f'name="{name}"')
    xml.write_text(text)
    b = {f"b_eci[{i + 1}]": 1e-5 * (i + 1) for i in range(3)}
    fmu = library.load(folder)
    component = Component("mine", "mine.fmu", fmu.interface, fmu=fmu)
    draft = Draft("here", "mine", components={"mine": component}, step=1.0, stop=3.0)
    draft.assign(Assignment("mine", name, value, "here") for name, value in b.items())
    case = check_draft(draft)
    with Master(*case.or_raise()) as m:
        m.initialise()
        recorder = Recorder(None, m)
        step_on(m, stepping(m, recorder, NEVER, "python"), 3, recorder)
        with recorder.finish(m) as results:
            saved_values = {
                n: results.values(n)[0] for n in results.names() if n != "mine.valid"
            }
    assert saved_values.keys() == {f"mine.{n}" for n in series}
    for name, places in series.items():
        assert np.atleast_1d(saved_values[f"mine.{name}"]).tolist() == [
            1e-5 * (i + 1) for i in places
        ]


def test_each_axis_of_a_series_has_a_scale(tmp_path):
    """Readers of netCDF-4 (xarray by h5netcdf) take a file for theirs only so."""
    execute("plant/light", Options(blocks=True, stop=10.0), tmp_path)
    with h5py.File(tmp_path / "series.h5") as file:
        matrix_count = 0
        for component in (c for c in file if c != "time" and not c.startswith(".")):
            for series in file[component].values():
                assert all(len(axis) == 1 for axis in series.dims), series.name
                matrix_count += series.ndim == 2
        assert matrix_count > 3
        assert file[".element.3"][()].tolist() == [1, 2, 3]


# --- attitudes that are compared with a sampled reference -----------------------------


@given(
    st.integers(1, 400),
    st.floats(0.05, 2.0),
    st.floats(0.01, 5.0),
    st.floats(-1e3, 1e3),
)
def test_rows_at_which_a_component_has_sampled(count, step, sample_time, start):
    """The first row, and the first at or after each sample."""
    times = start + step * np.arange(count)
    rows = np.flatnonzero(sample_rows(times, sample_time))
    if count < 2 or sample_time <= 1.001 * (times[1] - times[0]):
        assert len(rows) == count
        return
    assert rows[0] == 0
    since = times[rows] - start
    samples = np.floor(since / sample_time + 1e-9)
    assert (np.diff(samples) >= 1).all()
    assert (since - samples * sample_time < step * (1.0 + 1e-6)).all()


def test_a_pointing_error_does_not_depend_on_the_step(tmp_path):
    """The guidance samples once a second, while the craft goes on turning: the error is
    taken against what the guidance wants at each row."""
    write(tmp_path / "c", CraftFacts(size="6U"), "desat new craft")
    quiet = {
        "determination.noise": 0.0,
        "determination.markov_sigma": 0.0,
        "gyro.angle_random_walk": 0.0,
        "magnetometer.noise": 0.0,
        "tachometers.noise": 0.0,
    }
    numbers_by_step = {}
    for step in (1.0, 0.5, 0.25):
        options = Options(stop=1500.0, step=step, substeps=1, values=quiet)
        run = execute(str(tmp_path / "c"), options)
        numbers_by_step[step] = [
            run.manifest.numbers[n].value for n in ("pointing", "jitter")
        ]
        plot = run.manifest.content.plots["pointing"]
        (ax,) = series_figure(plot, [("", run.results, run.manifest.parameters)]).axes
        assert max(len(m.x) for m in ax.marks) == round(1500.0 / step)
    for values in numbers_by_step.values():
        assert values == pytest.approx(numbers_by_step[1.0], rel=0.02)
