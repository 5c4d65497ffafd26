"""Read where a new craft points: its guidance and that guidance's parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from desat.components.blocks import guidance_plan
from desat.components.maths.attitude import normalise
from desat.components.physics import earth
from desat.fmus.registry import block_class

from ..files import io
from ..files.columns import unit_factor
from ..system.errors import DesatError, choices
from ..system.quantity import Quantity, is_float

POINTINGS = ("nadir", "inertial", "sun", "yaw")
FORMS = (*POINTINGS, "spin", "target", "plan.csv")
MODES = ("inertial", "nadir", "sun", "target")
AXES = {"roll": 0, "pitch": 1, "yaw": 2, "x": 0, "y": 1, "z": 2}
ANGLE = Quantity("--pointing", "deg", -180.0, 180.0, bare=False)
SPIN = Quantity("--pointing spin", "rad/s", 1e-5, 0.3, bare=False)
ALIKE = 0.02  # relative difference of moments of inertia that count as equal
# of what all wheels give, for slews of a plan; and the largest rate, by their momentum
TORQUE_SHARE, MOMENTUM_SHARE = 0.3, 0.3


@dataclass(frozen=True)
class NewPointing:
    """Guidance of a new craft."""

    kind: str  # nadir, inertial, sun, yaw or plan
    words: str
    values: dict[str, Any]  # parameters of the block, in its units
    notes: dict[str, str]  # a comment for each
    spin: float = 0.0  # rad/s
    axis: int = 2  # of the body, about which it spins
    turns: bool = True  # whether the craft turns against the stars

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """Return the lines of a craft file: name, value and comment."""
        return [
            (k, _toml(x), self.notes.get(k, "given")) for k, x in self.values.items()
        ]

    def block(self) -> Any:
        """Return the guidance's block with these parameters."""
        block = block_class(f"guidance_{self.kind}")()
        for name, value in self.values.items():
            flat = _flat(value)
            if name == "plan":
                rows = guidance_plan.ROWS * guidance_plan.COLUMNS
                flat += [0.0] * (rows - len(flat))
            setattr(block, name, tuple(flat) if isinstance(value, list) else value)
        return block


def pointing_of(
    text: str | None,
    of_sun: bool,
    epoch: float,
    inertia: Sequence[float],
) -> NewPointing:
    """Read where a craft points.

    Parameters
    ----------
    text
        As typed; None: nadir, or with `of_sun` the Sun.
    of_sun
        Whether it orbits the Sun.
    epoch
        Seconds since J2000, of t = 0.
    inertia
        (3,) kg m2.

    Raises
    ------
    DesatError
        If the form is none of FORMS, or the craft cannot point so.
    """
    text = text or ("sun" if of_sun else "nadir")
    word, _, rest = text.strip().partition(" ")
    if text.strip().endswith(".csv"):
        return _by_plan(_read_plan(text.strip()), text.strip())
    if word == "spin" and rest:
        return _spin(rest, inertia)
    if word == "target" and rest:
        return _target(rest, epoch)
    if word == "nadir" and rest:
        return _tilt(rest)
    if word == "sun" and rest:
        angle = math.radians(ANGLE(rest))
        second = [-math.sin(angle), math.cos(angle), 0.0]
        note = {"second_body": f"turned by {rest} about the Sun line; given"}
        return NewPointing(
            "sun", f"sun, turned by {rest}", {"second_body": second}, note
        )
    if text not in POINTINGS:
        raise DesatError(
            f"--pointing {text}: no such pointing{choices(text, FORMS)}; also 'nadir 16deg pitch', "
            "'sun 90deg', 'spin 0.5rpm z', 'target 48.1N 11.6E'"
        )
    return NewPointing(text, text, {}, {}, turns=text in ("nadir", "yaw"))


def _tilt(rest: str) -> NewPointing:
    """Return nadir with a tilt, as `16deg pitch`."""
    size, _, name = rest.partition(" ")
    axis = AXES.get(name.strip() or "pitch")
    if axis is None:
        raise DesatError(
            f"--pointing nadir {rest}: roll, pitch or yaw is needed, as 'nadir 16deg pitch'"
        )
    half = math.radians(ANGLE(size)) / 2.0
    q = [math.sin(half) if k == axis else 0.0 for k in range(3)]
    note = {"q_bo": f"turned by {rest} from lvlh; given"}
    return NewPointing(
        "nadir", f"nadir, turned by {rest}", {"q_bo": [*q, math.cos(half)]}, note
    )


def _spin(rest: str, inertia: Sequence[float]) -> NewPointing:
    """Return a spin about an axis that points to the Sun, as `0.5rpm z`.

    Raises DesatError about the axis of the intermediate moment of inertia.
    """
    size, _, name = rest.partition(" ")
    name = name.strip() or "z"
    if name not in ("x", "y", "z"):
        raise DesatError(
            f"--pointing spin {rest}: x, y or z is needed, as 'spin 0.5rpm z'"
        )
    axis = AXES[name]
    rate = SPIN(size)
    about, others = inertia[axis], [x for k, x in enumerate(inertia) if k != axis]
    low, high = sorted(others)
    if low * (1.0 + ALIKE) < about < high * (1.0 - ALIKE):
        raise DesatError(
            f"--pointing spin {rest}: {about:.4g} kg m2 about {name} is between {low:.4g} and "
            f"{high:.4g}: a spin about the intermediate axis is unstable; the axis of "
            f"{high:.4g} kg m2 is stable"
        )
    product = (about - low) * (about - high)
    nutation = rate * math.sqrt(max(product, 0.0) / (low * high))
    axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    values = {
        "axis_body": axes[axis],
        "second_body": axes[(axis + 1) % 3],
        "spin_rate": rate,
    }
    notes = {
        "axis_body": "to the Sun, and about it the craft spins",
        "second_body": "class",
        "spin_rate": f"rad/s, {size}; it would nutate at {nutation:.3g} rad/s; given",
    }
    words = f"spin at {size} about {name}, to the Sun"
    return NewPointing("sun", words, values, notes, rate, axis)


def _target(rest: str, epoch: float) -> NewPointing:
    """Return the guidance to a target on the ground, as `48.1N 11.6E`."""
    match = re.fullmatch(
        r"([\d.]+)\s*([NS])[\s,]+([\d.]+)\s*([EW])", rest.strip(), re.IGNORECASE
    )
    if match is None or not is_float(match[1]) or not is_float(match[3]):
        raise DesatError(
            f"--pointing target {rest}: latitude and longitude are needed, as 'target 48.1N 11.6E'"
        )
    latitude = Quantity("--pointing target", "deg", 0.0, 90.0)(match[1])
    longitude = Quantity("--pointing target", "deg", 0.0, 360.0)(match[3])
    latitude = -latitude if match[2].upper() == "S" else latitude
    longitude = -longitude if match[4].upper() == "W" else longitude
    new = _by_plan([[0.0, 3.0, 0.0, 0.0, 0.0, 1.0]], "")
    values = {
        **new.values,
        "target_latitude": math.radians(latitude),
        "target_longitude": math.radians(longitude),
        "earth_angle_start": earth.earth_angle(epoch),
    }
    notes = {
        **new.notes,
        "target_latitude": f"{latitude:g} deg north; given",
        "target_longitude": f"{longitude:g} deg east; given",
        "earth_angle_start": "rad, of the epoch; below 5 deg of elevation it points to nadir",
    }
    return NewPointing("plan", f"target {rest}, else nadir", values, notes)


def _by_plan(rows: list[list[float]], words: str) -> NewPointing:
    """Return the guidance by a plan."""
    note = "s, mode (0 inertial, 1 nadir, 2 Sun, 3 target), quaternion; given"
    return NewPointing("plan", words, {"plan": rows}, {"plan": note})


def limit_slews(
    pointing: NewPointing, inertia: Sequence[float], torque: float, momentum: float
) -> NewPointing:
    """Return the pointing with slews that wheels (N m, N m s each) can give."""
    if pointing.kind != "plan":
        return pointing
    values = {
        **pointing.values,
        "rate_limit": float(f"{MOMENTUM_SHARE * momentum / max(inertia):.3g}"),
        "acceleration_limit": float(f"{TORQUE_SHARE * torque / max(inertia):.3g}"),
    }
    notes = {
        **pointing.notes,
        "rate_limit": f"rad/s: {100.0 * MOMENTUM_SHARE:g} % of a wheel's momentum",
        "acceleration_limit": f"rad/s2: {100.0 * TORQUE_SHARE:g} % of a wheel's torque",
    }
    return replace(pointing, values=values, notes=notes)


def _read_plan(name: str) -> list[list[float]]:
    """Read the rows of a plan: time, mode or quaternion.

    Raises DesatError for a row that is neither, times that do not grow, or too many.
    """
    place = f"--pointing {name}"
    factor, rows = 1.0, list[list[float]]()
    for number, line in enumerate(io.text(Path(name), place).splitlines(), 1):
        fields = [x.strip(' "') for x in line.replace(";", ",").split(",")]
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if not rows and not is_float(fields[0]):
            unit = re.search(r"[\[(](.*?)[\])]", fields[0])
            factor = unit_factor(unit and unit[1], "s", f"{place}:{number}")
            continue
        rows.append(_plan_row(fields, factor, f"{place}:{number}"))
        if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
            raise DesatError(
                f"{place}:{number}: its time {rows[-1][0]:g} s is not after that of the row "
                f"before, {rows[-2][0]:g} s"
            )
    if not rows or rows[0][0] > 0.0:
        raise DesatError(f"{place}: a row at 0 s, or before, is needed")
    if len(rows) > guidance_plan.ROWS:
        raise DesatError(
            f"{place}: {len(rows)} rows; {guidance_plan.ROWS} are taken at most"
        )
    return rows


def _plan_row(fields: list[str], factor: float, place: str) -> list[float]:
    """Return time (s), mode and quaternion of a line."""
    rest = [x for x in fields[1:] if x]
    numbers = [float(x) for x in rest if is_float(x)]
    mode = next((x.casefold() for x in rest if not is_float(x)), "inertial")
    if not is_float(fields[0]) or mode not in MODES or len(numbers) not in (0, 4):
        raise DesatError(
            f"{place}: a time, and a mode ({', '.join(MODES)}) or a quaternion x, y, z, w are "
            f"needed; got {', '.join(fields)[:60]}"
        )
    if mode == "inertial" and not any(numbers):
        raise DesatError(
            f"{place}: inertial needs a quaternion x, y, z, w other than 0"
        )
    if mode == "target":
        raise DesatError(
            f"{place}: a target is given by --pointing 'target 48.1N 11.6E'"
        )
    x, y, z, w = numbers or (0.0, 0.0, 0.0, 1.0)
    q = normalise((x, y, z, w)) if any((x, y, z, w)) else (0.0, 0.0, 0.0, 1.0)
    time = factor * float(fields[0])
    return [time, float(MODES.index(mode)), *(float(f"{c:.12g}") for c in q)]


def _toml(value: Any) -> str:
    """Format a number or list of numbers."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{float(value):.12g}" if value else "0.0"


def _flat(value: Any) -> list[float]:
    """Flatten a table."""
    if isinstance(value, list):
        return [x for item in value for x in _flat(item)]
    return [float(value)]
