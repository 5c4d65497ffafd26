"""Magnets and hysteresis rods."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import desat as library
from tests.conftest import started


def test_a_saturating_cycle_loses_four_times_coercive_field_and_saturation() -> None:
    """The area between the branches, each the other moved by 2 H_c: 4 H_c B_s."""
    rods = started(
        "torquers_passive",
        rod_volume=(1e-6, 0.0, 0.0),
        coercive_field=12.0,
        remanence=0.004,
        saturation=0.025,
    )
    mu_0 = 4e-7 * math.pi
    h = 40_000.0 * np.sin(np.linspace(0.0, 4.0 * math.pi, 400_001))
    flux = []
    for k, x in enumerate(h[::50]):
        rods.b_eci = (mu_0 * x, 0.0, 0.0)
        rods.advance(float(k), 1.0)
        rods.output(float(k))
        flux.append(rods.flux_body[0])
    second = slice(len(flux) // 2, None)
    area = abs(np.trapezoid(np.array(flux)[second], h[::50][second]))
    assert area == pytest.approx(4.0 * 12.0 * 0.025, rel=0.02)
    assert max(flux) < 0.025
    assert rods.m_body[0] == pytest.approx(flux[-1] * 1e-6 / mu_0)


def test_rods_brake_a_tumble_and_a_magnet_alone_does_not(tmp_path: Path) -> None:
    craft = """
title = "passive"
[components]
environment = "environment_kepler"
spacecraft = "spacecraft_rigid"
torquers = "torquers_passive"
[wiring]
"spacecraft.sun_eci" = false
"spacecraft.sunlight" = false
"spacecraft.density" = false
[parameters.environment]
semi_major_axis = "6978.137 km"
inclination = "55 deg"
[parameters.spacecraft]
inertia = [0.0222, 0, 0, 0, 0.0218, 0, 0, 0, 0.005]
inertia_wheel = [0, 0, 0, 0]
omega_start_body = ["10 deg/s", "5 deg/s", "5 deg/s"]
[parameters.torquers]
magnet_body = [0, 0, 0.55]
rod_volume = [2.24e-7, 2.24e-7, 0]
"""
    (tmp_path / "craft.toml").write_text(craft)
    (tmp_path / "nominal.toml").write_text(
        'craft = "craft.toml"\ntitle = "passive"\nstep = 1.0\nstop = 40000.0\n'
        "epoch = 2010-06-01T00:00:00Z\n"
    )
    energy = {}
    for volume in (2.24e-7, 0.0):
        run = library.run(str(tmp_path), {"torquers.rod_volume": [volume, volume, 0.0]})
        omega = run.results.values("spacecraft.omega_bi_body")
        each = 0.5 * (omega**2 @ [0.0222, 0.0218, 0.005])
        energy[volume] = each[-4000:].mean() / each[:4000].mean()
    assert energy[2.24e-7] < 0.95
    assert energy[0.0] == pytest.approx(1.0, abs=0.02)
