"""The example of docs/hosts.md: a loop as an equipment of opensvf."""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np
import pytest

from desat.export.loop_fmu import LoopEnds, export
from desat.runs.run import Options, execute
from desat.system.interface import base_name
from tests.conftest import ROOT
from tests.export.test_loop_fmu import columns

SCENARIO = "integrated/mil-nadir"


def test_the_loop_of_the_page_gives_the_series_of_a_run(
    tmp_path, monkeypatch, capsys
) -> None:
    stores = pytest.importorskip("svf.stores.parameter_store")
    page = (ROOT / "docs" / "hosts.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(from svf.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    export(SCENARIO, Options(), LoopEnds(reals=True), None)
    series = defaultdict(list)
    write = stores.ParameterStore.write

    def record(store, name, value, **context) -> None:
        series[name].append(value)
        write(store, name, value, **context)

    monkeypatch.setattr(stores.ParameterStore, "write", record)
    exec(code, {})
    run_columns = columns(execute(SCENARIO, Options(stop=100.0)))
    places: dict[str, int] = defaultdict(int)
    for port, values in series.items():
        name = base_name(port) if port[:4] != "aocs" else "torquers.m_mean_body"
        of_run, is_interval = run_columns[name, places[name]]
        places[name] += 1
        assert np.array_equal(values, of_run if is_interval else of_run[1:]), port
    assert len(series) == 28
    assert (
        float(capsys.readouterr().out.splitlines()[-1])
        == series["aocs.mtq.dipole_1"][-1]
    )
