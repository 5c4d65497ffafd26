"""report.html: one self-contained page of a run, its twin beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from markupsafe import Markup

from ..analyses import analyses
from ..analyses.manifest import Manifest
from ..engine.recording.results import Results
from ..figures.plots import series_plot
from ..figures.style import pretty_unit
from ..files.io import replace_text
from ..language.scenario import Plot
from ..numbers.text import number
from ..runs.run import Run

REPORT = "report.html"


def render(template: str, **values: Any) -> str:
    """A page from one of our templates."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("desat"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True,
    )  # fmt: skip
    return environment.get_template(template).render(**values)


def write_page(path: Path, text: str) -> Path:
    """Write a page under a temporary name, then rename."""
    replace_text(path, text)
    return path


def label_of(manifest: Manifest) -> str:
    """The short name of a run: its cell's labels, or its scenario."""
    labels = manifest.about.get("labels") or {}
    return ", ".join(labels.values()) or manifest.scenario.rpartition("/")[2]


def write_report(folder: Path, run: Run, twin: Run | None = None) -> Path:
    """Write report.html of a run into its folder and return its path."""
    manifest = run.manifest
    about = manifest.content
    runs = [(label_of(r.manifest), r.results, r.manifest.parameters) for r in (run, twin) if r]
    figures = [
        (plot.title, Markup(image))
        for plot in (about.plots.values() if "plots" in about.written else _default(run.results))
        if (image := series_plot(plot, runs))
    ]
    for analysis in analyses():
        extra = analysis.figures(manifest, run.results)
        figures += [(caption, Markup(image)) for caption, image in extra]
    rows = [
        {
            "title": n.said,
            "value": number(n.value),
            "twin": number(twin.manifest.numbers[name].value)
            if twin and name in twin.manifest.numbers
            else "",
            "unit": pretty_unit(n.unit),
            "reference": n.reference,
        }
        for name, n in manifest.numbers.items()
    ]
    text = render(
        "report.html",
        title=about.title or manifest.scenario,
        story=about.story,
        source=about.source,
        manifest=manifest,
        rows=rows,
        label=runs[0][0],
        twin_label=runs[1][0] if twin else "",
        twin_name=twin.manifest.scenario if twin else "",
        figures=figures,
        number=number,
        unit=pretty_unit,
        value=lambda v: ", ".join(number(x) for x in v) if isinstance(v, list) else number(v),
    )
    return write_page(folder / REPORT, text)


def _default(results: Results) -> list[Plot]:
    """For a system that says nothing about plots: the first dozen series, one each."""
    return [Plot(title=name, signals=(name,)) for name in results.names()[:12]]
