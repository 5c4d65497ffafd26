"""Draw the diagram of a loop: components by role, and the signals between them.

A component is a box with its wired inputs and outputs, each with its unit. Boxes stand
in columns in the order of the loop, from the environment to the actuators. An output is
one line to all its inputs: straight across a gap, above the boxes where it passes
columns, and below them where it goes back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

from ..numbers.text import spell_unit
from .style import COLOURS, INK

# columns of the roles; a component of another role stands right of what feeds it
COLUMNS = (
    ("environment", "disturbance"),
    ("spacecraft",),
    ("magnetometer", "sun_sensor", "star_tracker", "gyro", "tachometers"),
    ("determination", "guidance"),
    ("controller",),
    ("manager",),
    ("torquers", "thrusters", "wheels"),
)
PLACES = {role: k for k, roles in enumerate(COLUMNS) for role in roles}
ORDER = [role for roles in COLUMNS for role in roles]

# the colours of figures that stand out on light and on dark paper
LINES = [colour for colour in COLOURS if colour != INK]

# sizes in px
ROW, TITLE, LETTER, PAD = 15.0, 38.0, 5.7, 10.0
SLOT, EDGE, SPACE, LEGEND = 7.0, 14.0, 26.0, 34.0

STYLE = """
.diagram { --ink: #1c2330; --soft: #5b6675; --face: #f4f6f9; --paper: #ffffff; --line: #b8c1cc;
  font: 10px system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
@media screen and (prefers-color-scheme: dark) { .diagram { --ink: #e8ecf2; --soft: #a4afbd;
  --face: #232a35; --paper: #161b22; --line: #465263; }
  .diagram [stroke^="#"], .diagram [fill^="#"] { filter: brightness(1.6); } }
.diagram .paper { fill: var(--paper); } .diagram .box { fill: var(--face); stroke: var(--line); }
.diagram text { fill: var(--ink); } .diagram .soft { fill: var(--soft); }
.diagram .name { font-size: 12px; font-weight: 600; }
.diagram .halo { fill: none; stroke: var(--paper); stroke-width: 4; }
.diagram .wire { fill: none; stroke-width: 1.3; }
.diagram .open { fill: var(--paper); stroke-width: 1.3; }
"""


@dataclass(frozen=True)
class DiagramPart:
    """Role of a component, and what it is called; both "" where it has none."""

    role: str
    title: str


@dataclass(frozen=True)
class Wire:
    """Connection of an output to an input, both whole variables."""

    source: str
    output: str
    target: str
    input: str
    unit: str  # of the output
    kind: str  # of the output: "state", "sample" or "mean"


@dataclass
class _Box:
    """Component with its ports and its place (px)."""

    name: str
    role: str
    title: str
    inputs: list[tuple[str, str]] = field(default_factory=list)  # name, unit
    outputs: dict[str, Wire] = field(default_factory=dict)
    column: int = 0
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0

    @property
    def height(self) -> float:
        """Return the height (px)."""
        return TITLE + ROW * (len(self.inputs) + len(self.outputs)) + PAD

    def input_y(self, name: str) -> float:
        """Return the height of an input's row (px)."""
        return self.y + TITLE + ROW * ([n for n, _ in self.inputs].index(name) + 0.5)

    def output_y(self, name: str) -> float:
        """Return the height of an output's row (px)."""
        row = len(self.inputs) + list(self.outputs).index(name)
        return self.y + TITLE + ROW * (row + 0.5)


def diagram(parts: Mapping[str, DiagramPart], wires: Sequence[Wire], title: str) -> str:
    """Return the diagram as SVG.

    Parameters
    ----------
    parts
        Components by their names.
    wires
        Connections.
    title
        Title for those who cannot see it.
    """
    order = sorted(parts, key=lambda n: (_rank(parts[n].role), n))
    boxes = {name: _Box(name, parts[name].role, parts[name].title) for name in order}
    wires = sorted(  # the picture does not depend on the order of a file
        wires,
        key=lambda w: (order.index(w.source), w.output, order.index(w.target), w.input),
    )
    for wire in wires:
        boxes[wire.source].outputs.setdefault(wire.output, wire)
        ports = boxes[wire.target].inputs
        if wire.input not in [name for name, _ in ports]:
            ports.append((wire.input, wire.unit))
    columns = _columns(boxes, wires)
    nets: dict[tuple[str, str], list[Wire]] = {}
    for wire in wires:
        nets.setdefault((wire.source, wire.output), []).append(wire)
    return _Drawing(boxes, columns, nets).svg(title)


def _rank(role: str) -> int:
    """Return the place of a role in the loop; unknown ones come last."""
    return ORDER.index(role) if role in ORDER else len(ORDER)


def _columns(boxes: Mapping[str, _Box], wires: Sequence[Wire]) -> list[list[_Box]]:
    """Put the boxes into columns, and return those that are not empty."""
    for box in boxes.values():
        box.column = PLACES.get(box.role, 0)
    for _ in boxes:  # others stand right of what feeds them
        for wire in wires:
            source, target = boxes[wire.source], boxes[wire.target]
            if target.role not in PLACES and target.column <= source.column:
                target.column = min(source.column + 1, len(boxes))
    found: dict[int, list[_Box]] = {}
    for box in boxes.values():
        found.setdefault(box.column, []).append(box)
    columns = [found[k] for k in sorted(found)]
    for k, column in enumerate(columns):
        column.sort(key=lambda b: (_rank(b.role), b.name))
        for box in column:
            box.column = k
    return columns


class _Drawing:
    """Boxes at their places, and the lines between them."""

    def __init__(
        self,
        boxes: Mapping[str, _Box],
        columns: Sequence[Sequence[_Box]],
        nets: Mapping[tuple[str, str], Sequence[Wire]],
    ) -> None:
        self._boxes, self._columns, self._nets = boxes, columns, nets
        # vertical lines in the gap right of each column (-1: left of the first)
        self._slots: dict[int, list[tuple[str, str]]] = {
            k: [] for k in range(-1, len(columns))
        }
        self._above: list[tuple[str, str]] = []  # nets with a line above the boxes
        self._below: list[tuple[str, str]] = []
        for net in nets:
            self._reserve(net)
        self._gap_at: dict[int, float] = {}
        self._place()

    def _reserve(self, net: tuple[str, str]) -> None:
        """Reserve the lines of a net."""
        column = self._boxes[net[0]].column
        self._slots[column].append(net)
        for wire in self._nets[net]:
            target = self._boxes[wire.target].column
            if target == column + 1:
                continue
            lane = self._above if target > column else self._below
            if net not in lane:
                lane.append(net)
            if net not in self._slots[target - 1]:
                self._slots[target - 1].append(net)

    def _gap(self, k: int) -> float:
        """Return the width of the gap right of column k (px)."""
        return 2.0 * EDGE + SLOT * max(len(self._slots[k]) - 1, 0)

    def _place(self) -> None:
        """Place boxes and gaps."""
        top = EDGE + SLOT * len(self._above) + EDGE
        heights = [sum(b.height + SPACE for b in c) - SPACE for c in self._columns]
        self._bottom = top + max(heights, default=0.0)
        x = 0.0
        self._gap_at[-1] = x
        x += self._gap(-1)
        for k, column in enumerate(self._columns):
            width = max(_width(box) for box in column)
            y = top + 0.5 * (max(heights) - heights[k])
            for box in column:
                box.x, box.y, box.width = x, y, width
                y += box.height + SPACE
            self._gap_at[k] = x + width
            x += width + self._gap(k)
        self._width = x
        self._height = self._bottom + EDGE + SLOT * len(self._below) + LEGEND

    def _slot(self, gap: int, net: tuple[str, str]) -> float:
        """Return x of the line of a net in a gap (px)."""
        return self._gap_at[gap] + EDGE + SLOT * self._slots[gap].index(net)

    def svg(self, title: str) -> str:
        """Return the text of the picture."""
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" class="diagram" role="img" '
            f'viewBox="0 0 {self._width:.0f} {self._height:.0f}" width="{self._width:.0f}">',
            f"<title>{escape(title)}</title>",
            f"<style>{STYLE}</style>",
            f'<rect class="paper" width="{self._width:.0f}" height="{self._height:.0f}"/>',
        ]
        colours = {name: LINES[k % len(LINES)] for k, name in enumerate(self._boxes)}
        for net in self._nets:
            lines += self._net(net, colours[net[0]])
        for box in self._boxes.values():
            lines += self._box(box, colours[box.name])
        return "\n".join([*lines, *self._legend(), "</svg>"]) + "\n"

    def _net(self, net: tuple[str, str], colour: str) -> Iterator[str]:
        """Yield the lines of an output to all its inputs."""
        source = self._boxes[net[0]]
        x, y = source.x + source.width, source.output_y(net[1])
        trunk = self._slot(source.column, net)
        paths = []
        for wire in self._nets[net]:
            target = self._boxes[wire.target]
            end = target.input_y(wire.input)
            start = f"M{x:.1f} {y:.1f}H{trunk:.1f}"
            if target.column == source.column + 1:
                paths.append(f"{start}V{end:.1f}H{target.x:.1f}")
                continue
            lane = self._lane(net, target.column > source.column)
            entry = self._slot(target.column - 1, net)
            paths.append(f"{start}V{lane:.1f}H{entry:.1f}V{end:.1f}H{target.x:.1f}")
        path = "".join(dict.fromkeys(paths))
        yield f'<path class="halo" d="{path}"/>'
        name = f"{net[0]}.{net[1]}"
        yield (
            f'<path class="wire" stroke="{colour}" d="{path}"><title>{escape(name)}'
            "</title></path>"
        )
        for wire in self._nets[net]:
            target = self._boxes[wire.target]
            end = target.input_y(wire.input)
            yield (
                f'<path fill="{colour}" d="M{target.x:.1f} {end:.1f}l-6 -3.2v6.4z"/>'
            )

    def _lane(self, net: tuple[str, str], forward: bool) -> float:
        """Return y of the line of a net above or below the boxes (px)."""
        if forward:
            return EDGE + SLOT * self._above.index(net)
        return self._bottom + EDGE + SLOT * self._below.index(net)

    def _box(self, box: _Box, colour: str) -> Iterator[str]:
        """Yield a component with its ports."""
        yield (
            f'<rect class="box" x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" '
            f'height="{box.height:.1f}" rx="4"/>'
        )
        yield (
            f'<rect fill="{colour}" x="{box.x:.1f}" y="{box.y:.1f}" '
            f'width="{box.width:.1f}" height="3"/>'
        )
        yield _text(box.x + PAD, box.y + 18.0, box.name, "name")
        yield _text(box.x + PAD, box.y + 31.0, box.title, "soft")
        for name, unit in box.inputs:
            yield _text(box.x + PAD, box.input_y(name) + 3.5, _label(name, unit))
        for name, wire in box.outputs.items():
            x, y = box.x + box.width, box.output_y(name)
            yield _text(x - PAD, y + 3.5, _label(name, wire.unit), "", "end")
            yield _mark(x, y, wire.kind, colour)

    def _legend(self) -> Iterator[str]:
        """Yield what the marks of outputs mean."""
        x, y = EDGE, self._height - 12.0
        meanings = (
            ("state", "at each step, continuous"),
            ("sample", "sampled: holds until the next step"),
            ("mean", "mean over each step"),
        )
        for kind, text in meanings:
            yield _mark(x, y, kind, "#5b6675")
            yield _text(x + 9.0, y + 3.5, text, "soft")
            x += 30.0 + LETTER * len(text)


def _width(box: _Box) -> float:
    """Return the width that a box's texts need (px)."""
    texts = [_label(name, unit) for name, unit in box.inputs]
    texts += [_label(name, wire.unit) for name, wire in box.outputs.items()]
    longest = max([*map(len, texts), int(1.4 * len(box.name)), len(box.title), 14])
    return LETTER * longest + 2.0 * PAD


def _label(name: str, unit: str) -> str:
    """Return a variable's name with its unit."""
    spelt = spell_unit(unit) if unit not in ("", "1") else ""
    return f"{name} [{spelt}]" if spelt else name


def _text(x: float, y: float, text: str, kind: str = "", anchor: str = "") -> str:
    """Return a text."""
    of = (f' class="{kind}"' if kind else "") + (
        f' text-anchor="{anchor}"' if anchor else ""
    )
    return f'<text x="{x:.1f}" y="{y:.1f}"{of}>{escape(text)}</text>'


def _mark(x: float, y: float, kind: str, colour: str) -> str:
    """Return the mark of an output: a dot, an open square or a bar."""
    if kind == "state":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.2" fill="{colour}"/>'
    if kind == "mean":
        return f'<rect x="{x - 4.5:.1f}" y="{y - 2:.1f}" width="9" height="4" fill="{colour}"/>'
    return (
        f'<rect class="open" x="{x - 3:.1f}" y="{y - 3:.1f}" width="6" height="6" '
        f'stroke="{colour}"/>'
    )
