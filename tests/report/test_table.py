"""Tables: titles, values and units as `desat size` and `desat run` print them, and as
pages do."""

from __future__ import annotations

import json
import re
from math import inf, radians

import pytest

from desat.cli.commands import size as size_command
from desat.report.cases import Margin
from desat.report.table import ROW_UNIT, Cell, Column, Table, or_not_reached, share
from desat.sizing import dumps, page, tables
from desat.sizing.attitude import LeastAttitude
from desat.sizing.intervals import AssumptionShare, Interval
from desat.sizing.momentum import SourceShare
from desat.sizing.requirements import SizingRequirements
from desat.sizing.result import RodsByCondition, Sizing
from desat.sizing.rods import Best, SizingPoint
from desat.sizing.year import YearDate

QUANTITIES = [
    Column("", kind="text"),
    Column("value", ROW_UNIT),
    Column("unit", kind="unit"),
]


def texts(table: Table) -> list[list[str]]:
    return [[str(cell.value) for cell in row] for row in table.cells()]


@pytest.mark.parametrize(
    ("rows", "is_scaled", "cells"),
    [
        (
            [("a", 0.0584, "N.m.s"), ("b", 0.382, "N.m.s")],
            True,
            ["58.4 mN m s", "382 mN m s"],
        ),
        (
            [("a", 0.0373, "N.m.s"), ("b", 1.0, "N.m.s")],
            True,
            ["0.0373 N m s", "1 N m s"],
        ),
        (
            [("a", 1.157e-6, "N.m"), ("b", 3.171e-4, "N.m")],
            True,
            ["1.157 uN m", "317.1 uN m"],
        ),
        ([("a", 0.0, "N.m"), ("b", 0.2, "A.m2")], True, ["0 N m", "0.2 A m2"]),
        (
            [("a", inf, "N.m.s"), ("b", 0.002, "N.m.s")],
            True,
            ["inf mN m s", "2 mN m s"],
        ),
        ([("a", 0.0213, "kg"), ("b", 0.9, "kg")], True, ["21.3 g", "900 g"]),
        # units that somebody chose stay, unless a quantity has several
        ([("a", 0.001752, "N.m.s"), ("b", 2.0, "s")], False, ["0.001752 N m s", "2 s"]),
        (
            [("a", 2.213, "mN.m.s"), ("b", 0.001752, "N.m.s")],
            False,
            ["2.213 mN m s", "1.752 mN m s"],
        ),
        (
            [("a", or_not_reached(None), "N.m.s"), ("b", 0.5, "1")],
            False,
            ["not reached N m s", "0.5 "],
        ),
    ],
)
def test_a_quantity_has_one_unit_within_a_table(rows, is_scaled, cells):
    table = Table("", QUANTITIES, rows, is_scaled=is_scaled)
    assert [f"{value} {unit}" for _, value, unit in texts(table)] == cells


def test_a_heading_has_the_unit_of_its_column():
    columns = [
        Column("law", kind="text"),
        Column("rms", "N.m.s", ".3g"),
        Column("duty", "%"),
    ]
    table = Table(
        "",
        columns,
        [("b", 0.0123, 5.0), ("c", Cell(0.5, note="+1 %"), None)],
        True,
        True,
    )
    assert table.headings() == ["law", "rms, mN m s", "duty, %"]
    assert texts(table) == [["b", "12.3", "5"], ["c", "500 (+1 %)", ""]]


def test_limits_are_in_the_unit_of_their_row():
    limits = Cell("at least {}, at most {}: met", (0.001, 0.02))
    columns = [*QUANTITIES, Column("required", ROW_UNIT, kind="text")]
    rows = [("a", 0.0025, "N.m.s", limits), ("b", share(1.0, 4.0), "mN.m.s", None)]
    assert texts(Table("", columns, rows)) == [
        ["a", "2.5", "mN m s", "at least 1, at most 20: met"],
        ["b", "1 of 4", "mN m s", ""],
    ]


def test_a_part_has_the_units_of_the_whole():
    rows = [
        ("a", 3.0, "N.m.s"),
        ("b", 1.0, "mN.m.s"),
        ("c", "not checked", Cell("it is 0.5 s")),
    ]
    part = Table("", QUANTITIES, rows).part((0, 1, 2), (1, 2))
    assert texts(part) == [["b", "0.001", "N m s"], ["c", "not checked", "it is 0.5 s"]]


# --- desat size -----------------------------------------------------------------------


def sizing() -> Sizing:
    """A sizing whose numbers are all different."""
    return Sizing(
        target="mine",
        craft="",
        orbits=15,
        period=5700.0,
        attitude="nadir",
        secular=(0.0, 1.1e-6, 0.0),
        per_orbit=0.0062,
        cyclic=0.0043,
        sources=(SourceShare("drag", 2.1e-7, 0.25, 0.0012, 0.0009),),
        unexplained=3.0e-9,
        year=(
            YearDate("2026-01-01", "low", 9.0e-7, 0.0051, 0.0033, 0.018),
            YearDate("2026-07-01", "high", 2.8e-6, 0.0154, 0.0061, 0.059),
        ),
        wheel_needed=0.0107,
        slew_momentum=0.0475,
        slew_torque=0.000317,
        wheel_capacity=0.382,
        wheel_torque=0.005,
        body_rate=0.0625,
        bias_needed=0.0042,
        least_attitude=LeastAttitude((0.0, 0.05, 0.0), 0.0021, 0.0093),
        wheel_allowed=0.382,
        duty_allowed=0.5,
        wheel_lost=0.0,
        time_without=5.0 * 86400.0,
        least_formula=0.0232,
        least=0.0257,
        rod=0.36,
        best=(Best("cross product", 0.13), Best("ccpl", None)),
        conditions=(RodsByCondition("the day", {"cross product": 0.13, "ccpl": None}),),
        law="cross product",
        recommended=0.131,
        recommended_year=0.131,
        recommended_day=0.13,
        worst_day="2026-07-01, high solar activity",
        least_year=0.0626,
        worst_scenario="",
        weakest=(0.13, -0.14, 0.98),
        weakness=0.574,
        blind=180.0,
        tip_off_rate=radians(5.0),
        tip_off=0.9219,
        detumbling=5574.0,
        first_dump=9000.0,
        detumbling_recommended=212544.0,
        first_dump_recommended=307584.0,
        start_momentum=0.0341,
        start_dump=299.0,
        propellant=0.0123,
        propellant_least=0.0098,
        requirements=SizingRequirements(),
        recommended_share=0.131,
        intervals=(Interval("Momentum a day", "N.m.s", 0.09504, 0.04, 0.2),),
        assumptions=(AssumptionShare("the residual dipole", "--residual-dipole", 1.0),),
        curve=(
            SizingPoint(
                "cross product",
                0.0334,
                1.3,
                0.034,
                0.0463,
                0.0543,
                0.831,
                0.033,
                0.047,
                0.82,
            ),
        ),
        margins=(
            Margin("the day, any law", "rods", 0.0257, 0.36, "A.m2"),
            Margin("slew", "wheel torque", 0.000317, 0.005, "N.m"),
            Margin("the day, cyclic part", "wheels", 0.0107, 0.382, "N.m.s"),
        ),
        problems=(),
        change="",
        notes=("3 whole orbits",),
    )


SIZE_ROWS = [
    ["case", "of the", "used", "allowed", "unit", "margin, %"],
    ["the day, any law", "rods", "0.0257", "0.36", "A m2", "92.9"],
    ["slew", "wheel torque", "0.317", "5", "mN m", "93.7"],
    ["the day, cyclic part", "wheels", "10.7", "382", "mN m s", "97.2"],
    ["as described", "5 %", "95 %", "unit"],
    ["Momentum a day", "95.04", "40", "200", "mN m s"],
    ["assumption", "share, %", "given by"],
    ["the residual dipole", "100.0", "--residual-dipole"],
    ["Secular torque", "1.1", "uN m"],
    ["Secular momentum per orbit", "6.2", "mN m s"],
    ["Cyclic momentum, amplitude", "4.3", "mN m s"],
    ["Momentum of the fullest wheel without the secular part", "10.7", "mN m s"],
    [
        "Largest body rate that wheels at rest take over, about any axis",
        "3.581",
        "deg/s",
    ],
    ["Fullest wheel in a day, from rest", "9.3", "mN m s"],
    ["The same, turned by 2.86 deg about (0.00, 1.00, 0.00), body", "2.1", "mN m s"],
    [
        "Bias that is 1.2 times the fullest wheel's swing: none passes zero",
        "4.2",
        "mN m s",
    ],
    ["Time without dumping until a wheel is full", "5 d"],
    ["Smallest rod for any law (mean over the orbits)", "0.0232", "A m2"],
    ["Smallest rod for any law (linear programme)", "0.0257", "A m2"],
    [
        "The same on the worst day of the year (2026-07-01, high solar activity)",
        "0.0626",
        "A m2",
    ],
    [
        "Longest time during which 1.3 times this dipole cannot cancel the secular torque",
        "3 min",
    ],
    ["Control authority in the weakest direction, relative to the mean", "0.574"],
    ["Weakest direction (eci)", "0.13, -0.14, 0.98"],
    ["Rate after separation", "5", "deg/s"],
    ["Momentum after separation", "921.9", "mN m s"],
    ["Detumbling, minimum time with saturated rods", "92.9 min"],
    ["First dump of that momentum, minimum time", "2.5 h"],
    ["Detumbling with 0.131 A m2", "2.46 d"],
    ["First dump with these rods", "3.56 d"],
    ["Wheels at the start", "34.1", "mN m s"],
    ["Dump of the start momentum, minimum time", "4.98 min"],
    ["Slew: momentum of the fullest wheel, 2 I θ / T", "47.5", "mN m s"],
    ["Slew: torque of that wheel, 4 I θ / T²", "317", "uN m"],
    [
        "Propellant a year with thrusters alone, dumping when a wheel is full",
        "12.3",
        "g",
    ],
    ["The same, each dump at its cheapest attitude", "9.8", "g"],
    [
        "source",
        "secular, uN m",
        "along the total, %",
        "an orbit, mN m s",
        "cyclic, mN m s",
    ],
    ["drag", "0.21", "25.0", "1.2", "0.9"],
    ["of a year", "day", "solar activity", "secular, uN m", "least rod, A m2"],
    ["least", "2026-01-01", "low", "0.9", "0.018"],
    ["most", "2026-07-01", "high", "2.8", "0.059"],
    [
        "law",
        "rod, A m2",
        "times the smallest",
        "rms, mN m s",
        "largest, mN m s",
        "wheel, %",
        "duty, %",
        "closed loop: rms, mN m s",
        "largest, mN m s",
        "duty, %",
    ],
    [
        "cross product",
        "0.0334",
        "1.3",
        "34",
        "46.3",
        "5.43",
        "83.1",
        "33 (+3.0 %)",
        "47 (-1.5 %)",
        "82",
    ],
    ["smallest rods (A m2), duty 50 %, margin 1.3", "cross product", "ccpl"],
    ["the day", "0.13", "none"],
    ["note: 3 whole orbits"],
]


def split_cells(text: str) -> list[list[str]]:
    """The cells of the lines of a terminal."""
    lines = [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]
    return [cells for cells in lines if cells != [""]]


def test_size_prints_titles_values_and_units(capsys):
    result = sizing()
    size_command._print_sizing(result)
    rows = split_cells(capsys.readouterr().out)
    first = rows.index(SIZE_ROWS[0])
    assert " ".join(" ".join(row) for row in rows[:first]) == result.answer
    assert rows[first:] == SIZE_ROWS


def test_the_page_of_a_sizing_has_the_same_cells(tmp_path):
    text = page.write_sizing(sizing(), tmp_path / "size.html").read_text()
    for title, value, unit in (
        ("Secular torque", "1.1", "uN m"),
        ("Wheels at the start", "34.1", "mN m s"),
    ):
        assert (
            f'<td class="">{title}<td class="n">{value}<td class="k">{unit}</tr>'
            in text
        )
    assert (
        '<td class="n">10.7<td class="n">382<td class="k">mN m s<td class="n ok">97.2'
        in text
    )
    assert '<th class="n">secular, uN m<th class="n">along the total, %' in text
    assert '<td class="">of no source<td class="n">0.003' in text
    assert "A m²" not in text
    assert "µN" not in text


DUMPS = dumps.DumpSizing(
    target="geo",
    craft="",
    period=86164.0,
    attitude="nadir",
    secular=(7.6e-5, 0.0, 0.0),
    a_day=6.59,
    sources=(),
    year=(),
    begin=35.0,
    end=5.0,
    capacity=1000.0,
    steady=dumps.DumpRates(
        first=746922.0,
        interval=604800.0,
        momentum=49.4,
        impulse=46.0,
        net_impulse=0.0,
        propellant=0.0215,
        duration=600.0,
        pulses=60.0,
        on_time=0.3,
        firing=18.0,
        least_propellant=0.0154,
        least_a_week=0.95,
        most_a_week=0.97,
    ),
    a_year=1.079,
    range_a_year=(0.9, 1.2),
    by_activity={"low": 0.9},
    each_year=(1.079,),
    least_a_year=0.77,
    weekly=37.3,
    tank=15.0,
    pulse=0.6,
    slew_momentum=2.62,
    slew_torque=0.0087,
    wheel_torque=0.2,
    body_rate=0.0625,
    end_speed=60.0,
    loop={
        "first_dump": 700000.0,
        "dumps_a_week": 0.966,
        "dump_momentum": 49.2,
        "dump_propellant": 0.0214,
        "propellant_a_year": 1.078,
        "pointing_largest": 0.1425,
    },
    problems=(),
    notes=(),
)


def test_size_prints_dumps_with_their_units():
    table = tables.tabulate_dumps(DUMPS)
    assert table.headings() == ["dumps by thrusters", "sized", "closed loop", ""]
    assert texts(table) == [
        ["first dump, from wheels at rest", "8.64 d", "8.1 d", ""],
        ["dumps a week", "1", "0.966", ""],
        ["the same, thresholds 1 % apart", "0.95 to 0.97", "", ""],
        ["momentum of a dump", "49.4", "49.2", "N m s"],
        ["impulse of force of a dump", "46", "", "N s"],
        ["propellant of a dump", "0.0215", "0.0214", "kg"],
        ["time of a dump", "600", "", "s"],
        ["longest pulse", "0.3", "", "s"],
        ["pulses a year of the valve that opens most", "3,131", "", ""],
        ["propellant a year, from the simulated time", "1.122", "1.078", "kg"],
        ["propellant a year, mean over the days of the year", "1.079", "", "kg"],
        ["the same with low solar activity", "0.9", "", "kg"],
        ["the same, each dump at its cheapest attitude", "0.77", "", "kg"],
        ["momentum of a day", "6.59", "", "N m s"],
        [
            "largest body rate that wheels at rest take over, about any axis",
            "3.581",
            "",
            "deg/s",
        ],
        ["speed of the fullest wheel after a dump", "573", "", "rpm"],
        ["largest pointing error", "", "0.1425", "deg"],
        ["capacity for one dump a week", "37.3 of 1000", "", "N m s"],
        ["slew: momentum of the fullest wheel", "2.62 of 1000", "", "N m s"],
        ["slew: torque of that wheel", "8.7 of 200", "", "mN m"],
    ]


# --- desat run ------------------------------------------------------------------------

FACTORS = {"mN m s": 1e-3, "uN m s": 1e-6}
IN_SI = {"mN.m.s": 1e-3}


def test_run_prints_titles_values_and_units(desat, tmp_path):
    """Of a craft of one's own, whose numbers are in N m s and in mN m s."""
    desat("new", "craft", "mine", "--size", "12U", cwd=tmp_path, check=True)
    command = desat(
        "run", "mine", "--stop", "600", "--all", "--out", "run", cwd=tmp_path
    )
    numbers = json.loads((tmp_path / "run" / "manifest.json").read_text())["numbers"]
    rows = {row[0]: row[1:] for row in split_cells(command.stdout)}
    units = {entry["unit"] for entry in numbers.values()}
    assert {"N.m.s", "mN.m.s", "deg", "1"} <= units
    shown_units = set()
    for entry in numbers.values():
        title = (
            f"{entry['title']} ({entry['note']})" if "note" in entry else entry["title"]
        )
        value, *rest = rows[title]
        if entry["value"] is None:
            assert value == "not reached"
            continue
        unit = rest[0] if rest and entry["unit"] != "1" else ""
        if entry["unit"].endswith("N.m.s"):
            shown_units.add(unit)
        else:
            assert unit == (
                "" if entry["unit"] == "1" else entry["unit"].replace(".", " ")
            )
        inputs = entry["value"] * IN_SI.get(entry["unit"], 1.0)
        assert float(value.replace(",", "")) * FACTORS.get(unit, 1.0) == pytest.approx(
            inputs, rel=6e-4
        )
    assert len(shown_units) == 1, "a quantity has one unit"
    text = (tmp_path / "run" / "report.html").read_text()
    (duty,) = [row for title, row in rows.items() if title.startswith("Coil duty")]
    assert f'<td class="n">{duty[0]}<td class="k">%' in text
