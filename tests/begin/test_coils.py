"""Coils by their making, rods by their dipole."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.components.physics import coil


def test_a_coil_by_its_making() -> None:
    """300 turns of 80 x 80 mm at 100 mA: 0.192 A m2; a core of infinite permeability
    multiplies by 1 + 1 / N_d."""
    result = coil.air(300, 0.08, 0.08, 0.2e-3, 0.1)
    assert result.dipole == pytest.approx(0.192)
    length = 300 * 4 * 0.08
    section = math.pi * 1e-4**2
    assert result.resistance == pytest.approx(1.72e-8 * length / section)
    assert result.power == pytest.approx(0.01 * result.resistance)
    assert result.mass == pytest.approx(8960.0 * length * section)
    slender = 20.0
    demagnetising = 4 * (math.log(slender) - 1) / (slender**2 - 4 * math.log(slender))
    assert coil.core_factor(0.1, 0.005, 1e12) == pytest.approx(
        1.0 + 1.0 / demagnetising, rel=1e-6
    )


def test_rods_by_their_dipole_have_the_turns_that_it_takes(tmp_path: Path) -> None:
    write(
        tmp_path / "mine",
        CraftFacts(size="3U", rods="rod 0.2Am2 60x8mm 0.2mm 100mA"),
        "",
    )
    rows = tomllib.loads((tmp_path / "mine" / "craft.toml").read_text())["parameters"][
        "torquers"
    ]
    assert float(rows["m_limit"].split()[0]) == pytest.approx(0.2, rel=0.01)
    assert rows["area_turns"] == pytest.approx(2.0, rel=0.01)


def test_a_rod_is_as_thick_as_it_says(tmp_path: Path) -> None:
    """60x8mm is a length of 60 mm and a diameter of 8 mm: dipole, power and mass by
    hand."""
    length, radius, wire = 0.06, 0.004, 0.2e-3
    write(
        tmp_path / "mine", CraftFacts(size="3U", rods="rod 800 60x8mm 0.2mm 100mA"), ""
    )
    text = (tmp_path / "mine" / "craft.toml").read_text()
    rows = tomllib.loads(text)["parameters"]["torquers"]
    slender = length / radius
    demagnetising = 4 * (math.log(slender) - 1) / (slender**2 - 4 * math.log(slender))
    core = 1 + 19_999 / (1 + 19_999 * demagnetising)
    area = 800 * math.pi * radius**2 * core
    assert rows["area_turns"] == pytest.approx(area, rel=1e-3)
    assert float(rows["m_limit"].split()[0]) == pytest.approx(0.1 * area, rel=1e-3)
    section, wound = math.pi * wire**2 / 4, 800 * 2 * math.pi * radius
    resistance = 1.72e-8 * wound / section
    mass = 8960 * wound * section + 8200 * math.pi * radius**2 * length
    assert rows["resistance"] == pytest.approx(resistance, rel=1e-3)
    assert f"{0.01 * resistance:.3g} W, {1e3 * mass:.3g} g each" in text
