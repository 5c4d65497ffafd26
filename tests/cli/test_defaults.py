"""What commands take by default, and options that do not go together."""

from __future__ import annotations

import inspect
from pathlib import Path
from types import SimpleNamespace

import pytest

from desat.system.errors import Exit


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sweep", "plant/spin", "spacecraft.x=1", "--samples", "-1"), "--samples"),
        (("campaign", "case", "nowhere", "--", "-1"), "'number'"),
    ],
)
def test_numbers_below_the_least_are_refused(arguments, message, desat):
    outcome = desat(*arguments)
    assert outcome.returncode == Exit.INPUT
    assert message in outcome.stderr
    assert "greater than or equal to 0" in outcome.stderr


def test_what_size_recommends_by_default():
    """As its page says: a duty of 50 %, a margin of 1.3, its own tip-off, other laws, a
    year's extremes and closed loops."""
    from desat.cli.commands.size import size

    usual = {name: p.default for name, p in inspect.signature(size).parameters.items()}
    assert (usual["duty"], usual["margin"], usual["tip_off"]) == (50.0, 1.3, None)
    assert (usual["laws"], usual["year"], usual["loop"], usual["as_map"]) == (
        None,
        True,
        True,
        False,
    )


@pytest.mark.parametrize(
    ("values", "wish", "page"),
    [
        ((), True, "size-nadir_day-day-dipole.html"),
        (("--laws",), True, "size-nadir_day-day-dipole.html"),
        (("--own-law",), False, "size-nadir_day-day-dipole.html"),
        (("--map",), False, "size-map-nadir_day-day-dipole.html"),
        (("--map", "--laws"), True, "size-map-nadir_day-day-dipole.html"),
        (("--map", "--own-law"), False, "size-map-nadir_day-day-dipole.html"),
    ],
)
def test_other_laws_than_the_crafts_by_default_but_of_maps(
    values, wish, page, monkeypatch, tmp_path, desat
):
    from desat.sizing import map as sizing_map
    from desat.sizing import page as sizing_page
    from desat.sizing import sizing

    requests: dict[str, object] = {}
    result = SimpleNamespace(problems=[], as_json=dict)
    monkeypatch.setattr(
        sizing,
        "size",
        lambda target, options, wishes, progress, tell: (
            requests.update(laws=wishes.laws) or result
        ),
    )
    monkeypatch.setattr(
        sizing_map,
        "map_of",
        lambda target, options, axes, *rest: requests.update(laws=axes.laws) or result,
    )
    monkeypatch.setattr("desat.cli.commands.size._print_sizing", lambda result: None)
    monkeypatch.setattr("desat.cli.commands.size._print_map", lambda result: None)
    for name in ("write_sizing", "write_map"):
        monkeypatch.setattr(
            sizing_page, name, lambda result, page: requests.update(page=page) or page
        )
    monkeypatch.chdir(tmp_path)
    assert desat("size", "nadir_day/day-dipole", *values).returncode == 0
    assert requests["laws"] is wish
    assert requests["page"] == Path("runs") / page


def test_the_first_option_that_belongs_to_a_map_is_named(desat):
    outcome = desat("size", "nadir_day/day-dipole", "--dipoles", "0.1", "--rods", "1,2")
    assert outcome.returncode == Exit.INPUT
    assert "--rods: it belongs to --map" in outcome.stderr


def test_check_is_as_run_by_default():
    """It takes an FMU's faults as warnings, and nothing from outside a system's folder."""
    from desat.cli.commands.check import check

    usual = inspect.signature(check).parameters
    assert (usual["strict"].default, usual["outside"].default) == (False, False)
