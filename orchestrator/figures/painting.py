"""Paint figures with matplotlib, for files other than SVG."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..files import io, paths
from ..system.errors import DesatError
from .canvas import INCH, INK, Dots, Figure, Words

ANCHORS = {"start": "left", "middle": "center", "end": "right"}


def save(figure: Figure, file: Path) -> None:
    """Write a figure as .svg, .png or .pdf; raise DesatError for another suffix."""
    form = file.suffix.removeprefix(".")
    if form not in ("svg", "png", "pdf"):
        raise DesatError(f"{file}: a plot is written as .svg, .png or .pdf")
    if form == "svg":
        io.replace_text(file, figure.svg())
        return
    with io.replacing(file) as part:
        paint(figure, part, form)


def paint(figure: Figure, path: Path, form: str) -> None:
    """Paint a figure's shapes into a file with matplotlib, as they are."""
    if paths.no_home():  # otherwise matplotlib prints where its font cache is
        os.environ.setdefault("MPLCONFIGDIR", str(paths.cache() / "matplotlib"))
    backend = os.environ.pop(
        "MPLBACKEND", None
    )  # none is needed, and an unknown one is an error
    try:
        from matplotlib import figure as painter
        from matplotlib.patches import PathPatch, Rectangle
        from matplotlib.path import Path as Outline
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    page = painter.Figure(figsize=(figure.width, figure.height))
    width, height = INCH * figure.width, INCH * figure.height
    ax = page.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(height, 0.0))
    ax.set_axis_off()
    for layer, shape in enumerate(figure.shapes()):
        if isinstance(shape, Words):
            ax.text(
                *shape.at,
                shape.text,
                fontsize=shape.size / 10.0,
                color=INK,
                va="baseline",
                ha=ANCHORS[shape.anchor],
                rotation=90.0 * shape.turned,
                zorder=layer,
                rotation_mode="anchor",
                parse_math=False,
            )
        elif isinstance(shape, Dots):
            ax.plot(
                *shape.at.T,
                "o",
                color=shape.colour,
                alpha=shape.alpha,
                zorder=layer,
                markersize=shape.width,
                markeredgewidth=0.0,
            )
        elif shape.parts:
            outline = Outline.make_compound_path(
                *(Outline(p, closed=False) for p in map(np.asarray, shape.parts))
            )
            patch = PathPatch(
                outline,
                facecolor=shape.fill or "none",
                edgecolor=shape.colour or "none",
                linewidth=shape.width,
                alpha=shape.alpha,
                zorder=layer,
                linestyle=(0, [d / shape.width for d in shape.dash])
                if shape.dash
                else "-",
            )
            ax.add_patch(patch)
            if shape.within is not None:
                x0, top, across, down = shape.within
                patch.set_clip_path(
                    Rectangle((x0, top), across, down, transform=ax.transData)
                )
    page.savefig(path, format=form, dpi=150)
