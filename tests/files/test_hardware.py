"""Classes of hardware and products, and what a craft makes of them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from desat.analyses.flight import hardware_of, values_of
from desat.files import craft
from desat.files.completion import complete
from desat.files.hardware import KINDS, figures, known_figures, quantity, values
from desat.fmus.registry import block_class
from desat.runs.prepare import prepare
from desat.system.errors import DesatError
from desat.system.options import Options

CRAFT = """
title = "Of classes and products"
[components]
environment = "environment_kepler"
spacecraft = "spacecraft_rigid"
wheels = "wheels"
gyro = "rate_gyro"
determination = "attitude_determination"
manager = "manager_combined"
torquers = "torquers"
thrusters = "thrusters"
"""
UNITS = {
    "wheels": {"capacity": "N.m.s", "torque": "N.m", "speed": "rad/s"},
    "rods": {"dipole": "A.m2"},
    "thrusters": {"force": "N", "impulse": "s", "pulse": "s"},
    "gyros": {"walk": "rad"},
    "star_trackers": {"noise": "rad"},
    "requirements": {"pointing": "rad", "dumping": "rad", "detumbling": "s"},
    "spreads": {"inertia": "1", "coil": "1"},
}
RPM = math.pi / 30.0


def components_of(folder, text: str, base: str = CRAFT):
    (folder / "mine.toml").write_text(base + text, encoding="utf-8")
    draft = craft.read(folder / "mine.toml", Options())
    complete(draft)
    return draft.components


def test_a_class_gives_what_is_typical(tmp_path):
    parts = components_of(
        tmp_path,
        """
[hardware]
wheels = "class:30mNms"
torquers = "class:0.2Am2"
gyro = "class:mems"
determination = "class:cubesat"
thrusters = "class:50mN"
[shared]
axes_wheel = [[1, 0, 0, 0.6], [0, 1, 0, 0.8], [0, 0, 1, 0]]
[parameters.thrusters]
arm = "0.25 m"
""",
    )
    wheels = parts["wheels"].parameters
    rotor = 0.03 / (6500 * RPM)
    for k in range(1, 5):
        assert wheels[f"inertia_wheel[{k}]"] == pytest.approx(rotor)
        assert parts["spacecraft"].parameters[f"inertia_wheel[{k}]"] == pytest.approx(
            rotor
        )
    assert wheels["torque_limit"] == pytest.approx(2e-3)
    assert wheels["speed_limit"] == pytest.approx(6500 * RPM)
    assert wheels["coulomb"] == pytest.approx(2e-5)
    assert wheels["viscous"] == pytest.approx(8e-5 / (6500 * RPM))
    assert wheels["motor_lag"] == pytest.approx(0.05)
    assert parts["torquers"].parameters == pytest.approx({"m_limit": 0.2, "lag": 0.02})
    assert parts["gyro"].parameters == pytest.approx(
        {"angle_random_walk": math.radians(0.002)}
    )
    assert parts["determination"].parameters["markov_sigma"] == pytest.approx(
        math.radians(0.01)
    )
    assert parts["thrusters"].parameters["tau_level[2]"] == pytest.approx(
        2 * 0.05 * 0.25
    )
    assert (
        parts["wheels"]
        .origins["torque_limit"]
        .endswith("mine.toml:14: hardware.wheels")
    )


def test_a_product_gives_its_figures_and_no_more_and_a_craft_goes_before(tmp_path):
    parts = components_of(
        tmp_path,
        """
[hardware]
wheels = "product:RW0"
torquers = "product:UoSAT-12"
thrusters = "product:MONARC-1"
[parameters.wheels]
torque_limit = "2 mN.m"
""",
        CRAFT.replace('"thrusters"', '"thrusters_nozzles"').replace(
            '"wheels"', '"wheels_motor"'
        ),
    )
    wheels = parts["wheels"].parameters
    rotor = 0.02 / (6500 * RPM)
    assert [wheels[f"inertia_wheel[{k}]"] for k in range(1, 5)] == pytest.approx(
        [rotor] * 3 + [0]
    )
    assert wheels["torque_limit"] == pytest.approx(2e-3)
    assert not {"viscous", "coulomb", "motor_lag", "compensation"} & set(wheels)
    assert parts["torquers"].parameters == {"m_limit": 40.0}
    thrusters = parts["thrusters"].parameters
    assert thrusters["thrust[1]"] == thrusters["thrust[8]"] == 0.9
    assert thrusters["specific_impulse"] == 227.5


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            'wheels = "class:30mNm"',
            r"wheels = class:30mNm: no such class; did you mean 30mNms\?",
        ),
        ('wheels = "product:RW"', r"no such product.*there is RWP015, RW0, HR12-12"),
        (
            'wheels = "30mNms"',
            r'wheels = 30mNms: the form is "class:NAME" or "product:NAME"',
        ),
        ("wheels = 3", r'wheels = 3: "class:NAME" or "product:NAME" is needed'),
        (
            'wheel = "class:30mNms"',
            r"hardware.wheel: no component wheel; did you mean wheels\?",
        ),
        (
            'manager = "class:x"',
            r"manager = class:x: there is no hardware of this role; there is",
        ),
    ],
)
def test_hardware_that_is_not_known_is_refused(tmp_path, line, message):
    with pytest.raises(DesatError, match=message) as refusal:
        components_of(tmp_path, f"[hardware]\n{line}\n")
    assert "mine.toml:13: hardware." in str(refusal.value)


def test_every_product_has_its_source_and_figures_that_can_be():
    products = known_figures("product")
    assert sum(map(len, products.values())) >= 10
    assert (
        set(products)
        == set(KINDS.values())
        == set(known_figures("class"))
        - {
            "requirements",
            "spreads",
            "surfaces",
            "dipoles",
            "assumed",
            "electric",
        }
    )
    for variant in ("class", "product"):
        for kind, of_kind in known_figures(variant).items():
            if kind not in UNITS:  # surfaces, and what is assumed
                continue
            for name, its in of_kind.items():
                for figure, unit in UNITS[kind].items():
                    assert quantity(name, its[figure], unit) > 0.0
                if variant == "product":
                    assert len(its["source"]) > 30
                    assert its["maker"]
    # a wheel is filled by its torque in 2 s to some minutes
    for its in products["wheels"].values():
        assert (
            2.0
            < quantity("", its["capacity"], "N.m.s")
            / quantity("", its["torque"], "N.m")
            < 300
        )
    assert figures("gyro", "product:STIM210")[1]["maker"] == "Sensonor"


@pytest.mark.parametrize("kind", ["class", "product"])
def test_a_gyros_figure_is_the_same_angle_after_an_hour_at_any_sample_time(kind):
    """Its white noise sums up to the sheet's deg/sqrt(h), whatever the time between
    samples."""
    for name, its in known_figures(kind)["gyros"].items():
        walk = values(
            "gyro", True, figures("gyro", f"{kind}:{name}")[1], frozenset(), {}
        )
        for period in (1.0, 0.1, 0.01):
            gyro = block_class("rate_gyro")()
            gyro.sample_time, gyro.angle_random_walk = period, walk["angle_random_walk"]
            gyro.start()
            rates = []
            for k in range(4000):
                gyro.advance(k * period, period)
                rates += gyro.omega_meas_body
            hourly = math.degrees(np.std(rates)) * math.sqrt(period) * math.sqrt(3600.0)
            assert hourly == pytest.approx(float(its["walk"].split()[0]), rel=0.03)


@pytest.mark.parametrize("role", sorted(KINDS))
@pytest.mark.parametrize("kind", ["class", "product"])
def test_what_a_figure_makes_of_a_component_does_not_depend_on_the_step(role, kind):
    """What depends on the time between samples is said where that is the step's."""
    model = {"gyro": "rate_gyro", "determination": "attitude_determination"}.get(
        role, role
    )
    block = block_class(model)()
    has = frozenset(v.name for v in block.variables)
    present = {"axes_wheel": list(getattr(block, "axes_wheel", ())), "arm": 0.3}
    for name in known_figures(kind)[KINDS[role]]:
        figure_values = values(
            role, kind == "class", figures(role, f"{kind}:{name}")[1], has, present
        )
        assert figure_values.keys() <= has
        if white := figure_values.keys() & set(getattr(block, "white", ())):
            fresh = block_class(model)()
            fresh.noise = quantity(name, figure_values["noise"], "rad")
            assert white == {"noise"}
            assert any(
                "depends on the step" in x for x in fresh.foresee(0.0, 1.0, frozenset())
            )
            fresh.sample_time = 0.5
            assert not list(fresh.foresee(0.0, 1.0, frozenset()))


def test_the_page_is_made_of_what_was_flown():
    """docs/hardware.md is what its template, the stored flights, classes and products
    make."""
    from benchmarks import hardware

    store = json.loads(hardware.STORE.read_text(encoding="utf-8"))
    assert (hardware.DOCS / "hardware.md").read_text(encoding="utf-8") == hardware.page(
        store
    )
    for variant in hardware.VARIANTS:
        for name in variant.flights:
            assert f"{name} {variant.title}" in store, (
                "fly it: python -m benchmarks.hardware"
            )


@pytest.mark.parametrize(
    ("lines", "dipole", "share"),
    [
        ("", 1.0, 1.0),
        ("supply_voltage = 0.075", 0.5, 1.0),  # V 200 m2 / 30 Ohm
        (
            'supply_voltage = 3.0\nregulation = "voltage"\ntemperature = 393.15',
            1 / 1.393,
            1.0,
        ),
        ("supply_voltage = 3.0", 1.0, 0.4),
    ],
)
def test_what_a_supply_leaves_is_what_a_craft_is_sized_by(
    tmp_path, lines, dipole, share
):
    name = "nadir_day/day-dipole"
    plain = hardware_of(prepare(name, Options(blocks=True)).or_raise()[0])
    file = tmp_path / "mine.toml"
    speed = plain_speed(name)
    file.write_text(
        f'extends = "{name}"\ntitle = "Supplied"\n'
        'sources = { torquers = "torquers_rods", wheels = "wheels_motor" }\n'
        f"[parameters.wheels]\nmotor_constant = 0.01\ntorque_constant = 0.01\n"
        f"supply_voltage = {share * 0.01 * speed if share < 1.0 else 0.0}\n"
        f"[parameters.torquers]\nlag = 0.0\nresistance = 30.0\narea_turns = 200.0\n"
        f"m_limit = 1.0\n{lines}\n",
        encoding="utf-8",
    )
    hardware = hardware_of(prepare(str(file), Options(blocks=True)).or_raise()[0])
    assert hardware.m_limit == pytest.approx(dipole)
    assert hardware.capacity == pytest.approx(share * plain.capacity)


def plain_speed(name: str) -> float:
    system, _ = prepare(name, Options(blocks=True)).or_raise()
    return float(values_of(system)["wheels"]["speed_limit"])
