"""Draw a craft to scale: its body or plates, wheels, coils and nozzles, and its axes.

Lengths are relative to the longest side of the body. A craft without plates is drawn
as the homogeneous box that has its moments of inertia.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..system.typed import JsonObject
from ..system.wheels import axes_of, existing
from .style import COLOURS, LIMIT

Array = NDArray[np.float64]
Values = Mapping[str, Any]

AXES = (COLOURS[1], COLOURS[2], COLOURS[0])  # of the body axes x, y, z
BODY, PLATE = "#8b98a8", "#5b7f95"
WHEEL, COIL, NOZZLE = COLOURS[0], COLOURS[4], LIMIT
# of the directions in the view of orbit and attitude
DIRECTIONS = {"b": COLOURS[2], "sun": COLOURS[4], "h": COLOURS[0], "orbit": BODY}
# sizes relative to the longest side
DISC, OFFSET, ROD, PLUME, AXIS = 0.13, 0.24, 0.42, 0.22, 0.95
SIDES = 20  # of the polygon that stands for a circle
# direction to the viewer of the still picture
VIEW = np.array([0.78, 0.5, 0.38])


@dataclass(frozen=True)
class Piece:
    """Part of a craft: faces (n, 3) and lines (n, 3), in its body axes."""

    kind: str  # "body", "plate", "wheel", "coil", "nozzle" or "axis"
    colour: str
    faces: tuple[Array, ...] = ()
    lines: tuple[Array, ...] = ()
    label: str = ""
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the label

    def to_json(self) -> JsonObject:
        """Return it for a page's script."""
        return {
            "kind": self.kind,
            "colour": self.colour,
            "faces": [np.round(f, 4).tolist() for f in self.faces],
            "lines": [np.round(line, 4).tolist() for line in self.lines],
            "label": self.label,
            "place": [round(float(x), 4) for x in self.place],
        }


def pieces(
    spacecraft: Values,
    wheels: Values | None = None,
    torquers: Values | None = None,
    thrusters: Values | None = None,
) -> list[Piece]:
    """Return the parts of a craft from the parameters of its components.

    Parameters
    ----------
    spacecraft
        With `inertia` (kg m2), and `plates` where it has them.
    wheels, torquers, thrusters
        With `axes_wheel`, `axes_coil`, `position_nozzle` and `direction_nozzle`; None
        where the craft has none.
    """
    strokes, scale = _body(spacecraft)
    if wheels is not None:
        strokes += _wheels(wheels)
    if torquers is not None:
        strokes += _coils(torquers)
    if thrusters is not None:
        strokes += _nozzles(thrusters, scale)
    reach = max(
        [AXIS, *(1.15 * float(np.abs(f).max()) for p in strokes for f in p.faces)]
    )
    for axis, (name, colour) in enumerate(zip("xyz", AXES, strict=True)):
        end = np.zeros(3)
        end[axis] = reach
        strokes.append(_arrow("axis", colour, np.zeros(3), end, name))
    return strokes


def _body(values: Values) -> tuple[list[Piece], float]:
    """Return the body, and the length (m) of its longest side; 0 where unknown."""
    plates = np.reshape(np.array(values.get("plates", ()), float), (-1, 9))
    plates = plates[plates[:, 3] > 0.0]
    if not len(plates):
        return [Piece("body", BODY, _box(_sides(values.get("inertia"))))], 0.0
    faces = [_square(row[:3], row[4:7], row[3]) for row in plates]
    scale = float(np.ptp(np.concatenate(faces), axis=0).max())
    return [Piece("plate", PLATE, tuple(f / scale for f in faces))], scale


def _sides(inertia: Any) -> Array:
    """Return the sides (3,) of the homogeneous box with these moments, longest 1."""
    if inertia is None:
        return np.ones(3)
    moments = np.diag(np.reshape(np.array(inertia, float), (3, 3)))
    squares = moments.sum() - 2.0 * moments
    sides = np.sqrt(np.maximum(squares, 0.0025 * squares.max()))
    return np.asarray(sides / sides.max())


def _box(sides: Array) -> tuple[Array, ...]:
    """Return the faces of a box."""
    faces = []
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        for sign in (-1.0, 1.0):
            face = np.zeros((4, 3))
            face[:, axis] = sign
            face[:, a] = (-1.0, 1.0, 1.0, -1.0)
            face[:, b] = (-1.0, -1.0, 1.0, 1.0)
            faces.append(0.5 * face * sides)
    return tuple(faces)


def _across(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors across a direction and each other."""
    n = direction / np.linalg.norm(direction)
    first = np.cross(n, np.eye(3)[int(np.abs(n).argmin())])
    first /= np.linalg.norm(first)
    return first, np.cross(n, first)


def _square(normal: Array, centre: Array, area: float) -> Array:
    """Return a square of an area (m2) about a centre (m), across a normal."""
    a, b = (0.5 * np.sqrt(area) * v for v in _across(normal))
    return np.array([centre + a + b, centre + a - b, centre - a - b, centre - a + b])


def _wheels(values: Values) -> list[Piece]:
    """Return a disc for each wheel, beside the centre along its axis."""
    axes, there = axes_of(values), existing(values)
    strokes = []
    for k in np.flatnonzero(there):
        n = axes[:, k] / np.linalg.norm(axes[:, k])
        a, b = _across(n)
        turns = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)[:, None]
        disc = OFFSET * n + DISC * (np.cos(turns) * a + np.sin(turns) * b)
        axle = np.array([np.zeros(3), 1.35 * OFFSET * n])
        label = f"w{k + 1}"
        strokes.append(
            Piece("wheel", WHEEL, (disc,), (axle,), label, tuple(1.7 * OFFSET * n))
        )
    return strokes


def _coils(values: Values) -> list[Piece]:
    """Return a rod along the axis of each coil, through the centre."""
    axes = np.reshape(np.array(values.get("axes_coil", np.eye(3)), float), (3, -1))
    strokes = []
    for k in range(axes.shape[1]):
        size = float(np.linalg.norm(axes[:, k]))
        if size > 0.0:
            end = ROD * axes[:, k] / size
            line = np.array([-end, end])
            strokes.append(
                Piece("coil", COIL, (), (line,), f"m{k + 1}", tuple(-1.12 * end))
            )
    return strokes


def _nozzles(values: Values, scale: float) -> list[Piece]:
    """Return the plume of each nozzle; none where positions are not parameters."""
    if not {"position_nozzle", "direction_nozzle"} <= values.keys():
        return []
    positions = np.reshape(np.array(values["position_nozzle"], float), (-1, 3))
    directions = np.reshape(np.array(values["direction_nozzle"], float), (-1, 3))
    there = np.linalg.norm(directions, axis=1) > 0.0
    unit = scale or 2.0 * float(np.abs(positions[there]).max(initial=0.0)) or 1.0
    strokes = []
    for k in np.flatnonzero(there):
        start = positions[k] / unit
        end = start - PLUME * directions[k] / np.linalg.norm(directions[k])
        strokes.append(_arrow("nozzle", NOZZLE, start, end, f"n{k + 1}"))
    return strokes


def _arrow(kind: str, colour: str, start: Array, end: Array, label: str) -> Piece:
    """Return an arrow; its head is two strokes."""
    along = end - start
    a, _ = _across(along)
    size = float(np.linalg.norm(along))
    back = end - 0.12 * along
    head = np.array([back + 0.05 * size * a, end, back - 0.05 * size * a])
    place = tuple(end + 0.08 * along / size)
    return Piece(kind, colour, (), (np.array([start, end]), head), label, place)


MEANINGS = {
    "body": "box with the moments of inertia",
    "plate": "plates, to scale",
    "wheel": "reaction wheels w",
    "coil": "coils m",
    "nozzle": "nozzles n, with their plumes",
}


def sketch(parts: Sequence[Piece], title: str, size: float = 420.0) -> str:
    """Return the parts of a craft as SVG, seen obliquely.

    Parameters
    ----------
    parts
        From `pieces`.
    title
        Title for those who cannot see it.
    size
        Width of the picture (px).
    """
    right, up, toward = _camera(VIEW)
    points = np.concatenate([p for part in parts for p in (*part.faces, *part.lines)])
    zoom = 0.44 * size / float(np.abs(points @ right).max())
    heights = zoom * (points @ up)
    middle = 24.0 + float(heights.max())
    bottom = middle - float(heights.min()) + 24.0
    strokes: list[tuple[float, str]] = []

    def place(p: Array) -> tuple[float, float]:
        """Return x and y of a point (px)."""
        return 0.5 * size + zoom * float(p @ right), middle - zoom * float(p @ up)

    def path(line: Array) -> str:
        """Return the path of a line."""
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in map(place, line))

    for part in parts:
        for face in part.faces:
            alpha = 0.22 if part.kind in ("body", "plate") else 0.75
            strokes.append(
                (
                    float((face @ toward).mean()),
                    f'<path d="{path(face)}Z" fill="{part.colour}" fill-opacity="{alpha}" '
                    f'stroke="{part.colour}"/>',
                )
            )
        for line in part.lines:
            width = 4 if part.kind == "coil" else 1.8
            strokes.append(
                (
                    float((line @ toward).mean()),
                    f'<path d="{path(line)}" fill="none" stroke="{part.colour}" '
                    f'stroke-width="{width}" stroke-linecap="round"/>',
                )
            )
    lines = [drawn for _, drawn in sorted(strokes, key=lambda s: s[0])]
    for part in parts:
        if part.label:
            x, y = place(np.array(part.place))
            lines.append(
                f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" '
                f'fill="{part.colour}">{escape(part.label)}</text>'
            )
    kinds = {part.kind: part.colour for part in parts if part.kind in MEANINGS}
    height = bottom + 18.0 * len(kinds) + 8.0
    for k, (kind, colour) in enumerate(kinds.items()):
        y = bottom + 10.0 + 18.0 * k
        lines += [
            f'<rect x="12" y="{y - 5:.0f}" width="10" height="10" fill="{colour}"/>',
            f'<text class="ink" x="28" y="{y + 4:.0f}">{escape(MEANINGS[kind])}</text>',
        ]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" class="craft" role="img" '
            f'viewBox="0 0 {size:.0f} {height:.0f}" width="{size:.0f}">',
            f"<title>{escape(title)}</title>",
            f"<style>{STYLE}</style>",
            *lines,
            "</svg>",
        ]
    )


STYLE = """
.craft { font: 12px system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
.craft .ink { fill: #1c2330; }
@media screen and (prefers-color-scheme: dark) { .craft .ink { fill: #e8ecf2; } }
"""


def _camera(view: Array) -> tuple[Array, Array, Array]:
    """Return the directions to the right, up and toward a viewer; z is up."""
    toward = view / np.linalg.norm(view)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    return right, np.cross(toward, right), toward
