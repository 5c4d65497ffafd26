"""Write report.html: one self-contained page of a run, with its baseline beside it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from desat.components.contract.units import conversion

from ..analyses import analyses, management
from ..analyses.manifest import Manifest
from ..engine.recording.results import Results
from ..figures import craft, interactive
from ..figures.canvas import Figure
from ..figures.plots import Line, lines_of, series_figure, unit_of
from ..files.io import replace_text
from ..files.scenario import abbreviations
from ..language.scenario import Number, Plot
from ..numbers.limits import limits_of
from ..numbers.numbers import scale
from ..numbers.text import number, spell_unit
from ..numbers.verdicts import Verdict, describe_verdicts
from ..runs import drawings
from ..runs.run import Run
from ..runs.validation import describe_kept
from ..system import discovery
from ..system.parameters import unit_of as unit_named
from . import scene
from .cases import find_cases
from .policy import PLACEHOLDER, PageScripts, part
from .run_tables import tabulate_numbers, tabulate_verdicts

REPORT = "report.html"
GENERATOR = "desat"  # of a page, with its template after it


def render(template: str, **values: Any) -> str:
    """Render one of our templates to a page with its Content Security Policy."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    from ..files.templates import CompiledTemplates

    environment = Environment(
        loader=FileSystemLoader(discovery.folders("templates")),
        bytecode_cache=CompiledTemplates.in_cache(),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    scripts = PageScripts()
    environment.globals["run_script"] = scripts.element
    generator = f"{GENERATOR} {template.partition('.')[0]}"
    text = environment.get_template(template).render(
        policy=PLACEHOLDER, generator=generator, **values
    )
    return scripts.complete(text)


def write_page(path: Path, text: str) -> Path:
    """Write a page under a temporary name, then rename."""
    replace_text(path, text)
    return path


def versions() -> str:
    """Return the date and the versions that a page was made with."""
    return f"{datetime.now(UTC).date().isoformat()}, desat {version('desat')}, numpy {np.__version__}"


def label_of(manifest: Manifest) -> str:
    """Return the short name of a run: the labels of its cell, or its scenario."""
    labels = manifest.about.get("labels") or {}
    return ", ".join(labels.values()) or manifest.scenario.rpartition("/")[2]


def write_report(folder: Path, run: Run, baseline: Run | None = None) -> Path:
    """Write report.html of a run into its folder and return its path."""
    manifest = run.manifest
    about = manifest.content
    runs = [
        (label_of(r.manifest), r.results, r.manifest.parameters)
        for r in (run, baseline)
        if r
    ]
    plots = about.plots if "plots" in about.written else _default(run.results)
    figures = (
        management.figures(manifest, run.results)
        if manifest.parts.get(management.KEY)
        else []
    )
    has_management = bool(figures)
    lead = max(1, len(figures) + bool(manifest.verdicts))
    plot_figures = [
        (plot.title, figure)
        for plot in _deciding_first(plots, run)
        if (figure := series_figure(plot, runs, _bounds(plot, manifest)))
    ]
    # what is not met stands first
    count = int(not all(v.met for v in manifest.verdicts.values()))
    figures = [*plot_figures[:count], *figures, *plot_figures[count:]]
    for analysis in analyses():
        if analysis.KEY != management.KEY:
            figures += analysis.figures(manifest, run.results)
    labels = [label for label, _, _ in runs]
    numbers = tabulate_numbers(
        manifest, baseline.manifest if baseline else None, labels, has_references=True
    )
    text = render(
        "report.html",
        title=about.title or manifest.scenario,
        answer=describe_verdicts(manifest.verdicts, len(manifest.unmet)),
        description=about.description,
        spelt=abbreviations(
            manifest.scenario.partition("/")[0],
            " ".join([about.title, *labels]),
        ),
        source=about.source,
        manifest=manifest,
        numbers=numbers,
        cases=find_cases(folder.parent, [manifest.parameters]),
        verdicts=tabulate_verdicts(manifest.verdicts),
        baseline_label=runs[1][0] if baseline else "",
        baseline_name=baseline.manifest.scenario if baseline else "",
        lead=lead,
        has_management=has_management,
        law=_law(manifest),
        thinning=describe_kept(run.results),
        **_pictures(manifest, run.results),
        files=_files(folder),
        **figures_of(figures),
        number=number,
        unit=spell_unit,
        value=lambda v: (
            ", ".join(number(x) for x in v) if isinstance(v, list) else number(v)
        ),
    )
    return write_page(folder / REPORT, text)


class Drawn(NamedTuple):
    """Figure of the page, with its place among them."""

    place: int
    caption: str
    svg: Markup


def _law(manifest: Manifest) -> str:
    """Return the file name of the manager that flew; empty where there is none."""
    return Path(manifest.fmus.get("manager", {}).get("source", "")).stem


def _pictures(manifest: Manifest, results: Results) -> dict[str, Any]:
    """Return the view of orbit and attitude, the diagram of the loop and the craft."""
    seen = scene.view_of_run(manifest, results)
    parts = drawings.craft_of_run(manifest)
    return {
        "view_data": data_element(seen, "seen") if seen else "",
        "diagram": Markup(drawings.loop_of_run(manifest, results)),
        "craft": Markup(craft.sketch(parts, "Craft, seen obliquely") if parts else ""),
    }


def _files(folder: Path) -> dict[str, str]:
    """Return what the files beside a report hold, by their names."""
    titles = {
        "series.h5": "all series (HDF5)",
        "manifest.json": "values, versions and numbers of the run",
    }
    return {name: text for name, text in titles.items() if (folder / name).exists()}


def _deciding_first(plots: Mapping[str, Plot], flight: Run) -> list[Plot]:
    """Order the plots so that the one of the deciding requirement comes first.

    Where requirements are not met, it is the plot that is the first to pass what one
    allows: what gives later may only follow from it. Else it is that of the tightest.
    """
    if not flight.manifest.verdicts:
        return [*plots.values()]
    times = {name: _first_beyond(plot, flight) for name, plot in plots.items()}
    names = {x for k, v in flight.manifest.verdicts.items() for x in (k, v.number)}
    first = min(times, key=lambda name: (times[name], name not in names), default="")
    if math.isinf(times.get(first, math.inf)):
        first = _tightest(plots, flight.manifest)
    return [plots[name] for name in sorted(plots, key=lambda name: name != first)]


def _first_beyond(plot: Plot, flight: Run) -> float:
    """Return the time (s) at which a plot passes what an unmet requirement allows.

    It is infinite where the plot passes nothing.
    """
    unmet = [x for x in _requirements(plot, flight.manifest) if not x[0].met]
    unit = unit_of(plot, flight.results)
    if not unmet or unit is None:
        return math.inf
    numbers = flight.manifest.content.numbers
    times = [
        line.times[_beyond(line, limit, numbers[verdict.number])]
        for line in lines_of(plot, flight.results, unit)
        for verdict, _, limit in unmet
    ]
    return min((float(t[0]) for t in times if len(t)), default=math.inf)


def _beyond(line: Line, limit: float, number: Number) -> Any:
    """Return where a line has passed the limit of a number.

    That of an rms, a mean or a level, which part of the time is below, is passed once
    what there was so far is too much for all of the number's window.
    """
    begin, end = number.window or (-math.inf, math.inf)
    span = np.diff(line.times, append=line.times[-1:])
    span = span * ((begin <= line.times) & (line.times <= end))
    sizes, duration = np.abs(line.values), span.sum()
    if "rms" in number.measure:
        return np.cumsum(sizes**2 * span) > limit**2 * duration
    if "mean" in number.measure:
        return np.cumsum(sizes * span) > limit * duration
    level = number.options.get("level", 95.0)
    if "level" in number.measure and isinstance(level, int | float):
        share = 1.0 - level / 100.0
        return np.cumsum((sizes > limit) * span) > share * duration
    return (sizes > limit) & (span > 0.0)


def _tightest(plots: Mapping[str, Plot], manifest: Manifest) -> str:
    """Return the name of the plot of the tightest requirement.

    It is the plot with most of the series of the requirement that is nearest to its
    limit, or furthest beyond; of several the one with its name.
    """
    tightest, verdict = min(
        manifest.verdicts.items(),
        key=lambda e: (e[1].met, math.inf if e[1].margin is None else e[1].margin),
    )
    number = manifest.content.numbers.get(verdict.number)
    series = set(number.signals) if number else set()
    if verdict.number in management.OF_COILS:
        torquers = drawings.components_by_role(manifest).get("torquers")
        series = {f"{torquers}.m_mean_body"}

    def weight(name: str) -> tuple[int, bool]:
        """Return how many of the series a plot shows, and whether its name matches."""
        return len(series & set(plots[name].signals)), name in (
            tightest,
            verdict.number,
        )

    return max(plots, key=weight, default="")


def _bounds(plot: Plot, manifest: Manifest) -> list[tuple[str, float]]:
    """Return the largest values that requirements allow of what a plot shows."""
    return [(name, value) for _, name, value in _requirements(plot, manifest)]


def _requirements(
    plot: Plot, manifest: Manifest
) -> Iterator[tuple[Verdict, str, float]]:
    """Yield the requirements of what a plot shows, with name and largest value.

    A share is one of the plot's limit: of the one that the number is a share of, or of
    its only one.
    """
    numbers = manifest.content.numbers
    for v in manifest.verdicts.values():
        number = numbers.get(v.number)
        if v.max is None or number is None or set(number.signals) != set(plot.signals):
            continue
        if v.unit != "%":
            units = unit_named(v.unit or "1"), unit_named(plot.unit or "1")
            if conversion(*units) is not None:
                limit = v.max * scale(v.unit, plot.unit)
                yield v, f"required: {number.title}", limit
        else:
            full_scale = [x for x in plot.limits if x.value == number.percent_of]
            limits = limits_of(
                full_scale or plot.limits, manifest.parameters, plot.unit
            )
            if len(limits) == 1:
                yield v, f"required: {v.max:g} %", v.max / 100.0 * limits[0][1]


def figures_of(drawn: Sequence[tuple[str, Figure]]) -> dict[str, Any]:
    """Collect the values for a page that includes `figures.html`.

    These are its `figures` with captions, and for those that its script draws the data,
    the styles of uPlot and its licence.
    """
    figures = [Drawn(i, c, Markup(figure.svg())) for i, (c, figure) in enumerate(drawn)]
    data = interactive.data_of([figure for _, figure in drawn])
    if not any(data["plots"]):
        return {"figures": figures, "plots": False, "uplot_css": "", "most": 0}
    return {
        "figures": figures,
        "plots": True,
        "uplot_css": part("uplot/uPlot.min.css"),
        "licence": part("uplot/LICENSE"),
        "plot_data": data_element(data, "drawn"),
        "most": data["most"],
    }


def data_element(content: Any, name: str = "told") -> Markup:
    """Return the element with the data (JSON) that a page's script finds by its name."""
    # a user's name must not end the element
    data = json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
    element = Markup('<script type="application/json" id="{}">{}</script>')
    return element.format(name, Markup(data))


def _default(results: Results) -> dict[str, Plot]:
    """Return plots of the first dozen series, one each, for a system without plots."""
    return {name: Plot(title=name, signals=(name,)) for name in results.names()[:12]}
