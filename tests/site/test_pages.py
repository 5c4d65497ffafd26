"""Pages from templates: verbs, errors with the template's line; strips of modes;
series."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.pages import writing as pages
from benchmarks.pages.__main__ import main
from benchmarks.pages.series import Series
from desat.figures import plots
from desat.figures.plots import lines_of, series_figure
from desat.files.scenario import families, find, scenarios
from desat.language.scenario import Plot
from desat.numbers.statistics import median_interval
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from tests.conftest import ROOT

# --- strips ---------------------------------------------------------------------------


@given(st.lists(st.integers(0, 3), min_size=1, max_size=300))
def test_bands_cover_the_run(values):
    times = np.arange(len(values) + 1.0)
    spans = plots.bands(times, np.array(values), columns=10**6)
    durations = {
        value: sum(end - begin for begin, end in parts) for value, parts in spans
    }
    assert durations == {v: pytest.approx(values.count(v)) for v in set(values)}
    for value, parts in spans:
        assert all(values[int(begin)] == value for begin, _ in parts)
    assert [durations[v] for v, _ in spans] == sorted(durations.values(), reverse=True)


def test_a_short_mode_is_seen_and_a_chatter_is_few_spans():
    times = np.arange(100_001.0)
    values = np.arange(100_000) % 2
    values[50_000] = 4
    spans = dict(plots.bands(times, values))
    ((begin, end),) = spans[4]
    assert begin == 50_000.0
    assert end - begin == pytest.approx(100_000 / plots.COLUMNS)
    assert all(len(parts) <= plots.COLUMNS for parts in spans.values())
    assert list(spans)[-1] == 4  # on top of those that hold longer


def test_a_plot_shows_the_modes_under_it():
    run = execute("plant/reference", Options(blocks=True, stop=20.0))
    plot = find("plant/reference").content.plots["rate"]
    with_mode = series_figure(plot, [("", run.results, run.manifest.parameters)]).svg()
    assert "mode: idle" in with_mode
    bare = execute(
        "plant/reference", Options(blocks=True, stop=20.0, record=("spacecraft.*",))
    )
    assert (
        "mode"
        not in series_figure(plot, [("", bare.results, bare.manifest.parameters)]).svg()
    )


# --- series ---------------------------------------------------------------------------


def test_series_compute():
    a = Series(np.arange(5.0), np.array([[3.0, -4.0]] * 5))
    assert a.norm().values.tolist() == [5.0] * 5
    assert a.mean_size().values.tolist() == [3.5] * 5
    assert (a.sum_of_sizes() * 2.0 / 7.0).values.tolist() == [2.0] * 5
    assert a.element(2).largest() == 4.0
    assert a.every(2).times.tolist() == [0.0, 2.0, 4.0]
    averages = Series(
        np.arange(5.0), np.array([[4.0], [0.0], [2.0], [0.0], [9.0]])
    ).mean_over(2)
    assert (averages.times.tolist(), averages.values.tolist()) == (
        [0.5, 2.5],
        [[2.0], [1.0]],
    )
    assert a.until(2).times.tolist() == [0.0, 1.0, 2.0]
    assert (a - Series(np.arange(4.0), np.ones((4, 2)))).values.tolist() == [
        [2.0, -5.0]
    ] * 4
    with pytest.raises(DesatError, match="different times"):
        a - a.every(2)


# --- templates ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{{ value.__globals__['importlib'] }}", "is unsafe"),
        ("{{ ''.__class__.__mro__ }}", "is unsafe"),
        ("{{ plot.__self__ }}", "is unsafe"),
        (
            "{{ series('day-dipole', 'wheels.h_wheel').values.tofile('x') }}",
            "is unsafe",
        ),
        (
            "{{ law('margins', 'math') }}",
            "no function math in components/laws/margins.py",
        ),
        (
            "{{ law('..maths.vector', 'add') }}",
            "no module ..maths.vector in components/laws",
        ),
        ("{{ data('../../../etc/x.json') }}", "it is outside"),
    ],
)
def test_a_template_reaches_nothing_but_its_verbs(tmp_path, monkeypatch, text, message):
    """One ran commands: `os.popen` was three attributes away from any verb."""
    folder = tmp_path / "nadir_day"
    (folder / "scenarios").mkdir(parents=True)
    (folder / "page.md").write_text(f"# A page\n\n{text}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        pages, "templates", lambda family: {"README.md": folder / "page.md"}
    )
    with pytest.raises(DesatError, match=r"page\.md:3: ") as caught:
        pages.write("nadir_day", tmp_path / "out", draft=60.0)
    assert message in str(caught.value)
    assert not (tmp_path / "x").exists()


def with_paper(family):
    return any(s.content.paper for s in scenarios().values() if s.family == family)


def test_every_template_becomes_a_file_of_its_own():
    assert pages.families() == (
        "alsat1",
        "gyrostat",
        "hausat2",
        "integrated",
        "nadir_day",
        "space_telescope",
        "uosat12",
    )
    assert set(pages.templates("uosat12")) == {"README.md", "details.md", "flight.md"}
    assert all(
        pages.templates(f) == {} for f in set(families()) - set(pages.families())
    )


@pytest.mark.parametrize("family", pages.families())
def test_first_pages_are_short_and_answer_first(family):
    """Craft, question, answer, a figure, a table of at most ten rows, what does not
    hold; all else is a click away."""
    text = (ROOT / "docs" / "papers" / family / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    if "details.md" not in pages.templates(family):
        return
    parts = [
        "**Craft.**",
        "**Question.**",
        "**Answer.**",
        "](answer.svg)",
        "\n|---|",
        "**What does not hold.**",
        "](details.md)",
    ]
    if with_paper(family):
        parts.append("## The paper, item by item")
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    table = text[places[4] : places[5]].strip().splitlines()
    assert 4 <= len(table) - 1 <= 10


def test_the_interval_of_a_median_is_between_two_values():
    """Of ten values the second and ninth, of 200 the 86th and 115th: binomial tables."""
    assert median_interval(range(1, 11)) == (5.5, 2, 9)
    assert median_interval([*range(1, 201)][::-1]) == (100.5, 86, 115)
    assert median_interval([3.0, 1.0, 2.0]) == (2.0, 1.0, 3.0)
    inside = sum(
        low <= 0.0 <= high
        for seed in range(400)
        for _, low, high in [
            median_interval(np.random.default_rng(seed).normal(size=25))
        ]
    )
    assert 370 <= inside <= 400


@pytest.fixture
def write_page(monkeypatch, tmp_path):
    """Write a template as the page of `plant`, in little time; gives the page's text."""

    def write(text: str) -> str:
        file = tmp_path / "page.md"
        file.write_text(text, encoding="utf-8")
        monkeypatch.setattr(pages, "templates", lambda family: {"README.md": file})
        (result,) = pages.write("plant", tmp_path / "out", draft=20.0)
        return result.read_text(encoding="utf-8")

    return write


def test_verbs(write_page, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old.svg").write_text("<svg/>")
    text = write_page(
        """# Title
A paragraph
of two lines, {{ value("reference", "largest_speed")|fixed(3) }} rad/s.

| a | b |
|---|---|
{% for x in [1, 2] %}
{{ row(x, parameter("reference", "wheels.speed_limit * 2", "rad/s")) }}
{% endfor %}
After it {{ setting("reference", "step") }}.
{{ plot("rate", "reference", "rate", "Figure 1") }}
{% set h = series("reference", "wheels.h_wheel") %}
{{ compare("h", "Momentum", [("wheels", h.norm())], "[N m s]", limits=[("start", 0.09)]) }}
{% for bias, speed in sweep("reference", "wheels.torque_limit", [1e-2, 0.0], "largest_speed") %}
- {{ bias }}: {{ speed|fixed(1) }}
{% endfor %}
"""
    )
    run = execute("plant/reference", Options(stop=20.0))
    speed = run.manifest["numbers"]["largest_speed"]["value"]
    assert (
        f"# Title\n\nA paragraph of two lines, {speed:.3f} rad/s.\n\n| a | b |" in text
    )
    assert (
        "|---|---|\n| 1 | 2000.0 |\n| 2 | 2000.0 |\n\nAfter it 1.0.\n\n![Figure 1: ang"
        in text
    )
    still = np.abs(
        execute(
            "plant/reference", Options(stop=20.0, values={"wheels.torque_limit": 0.0})
        ).results.values("wheels.speed_wheel")
    ).max()
    assert f"- 0.01: {speed:.1f}\n- 0.0: {still:.1f}\n" in text
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "README.md",
        "h.svg",
        "rate.svg",
    ]
    assert "DRAFT: runs end after 20 s" in text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('{{ value("reference", "largest_sped") }}', "did you mean largest_speed?"),
        ('{{ value("refrence", "largest_speed") }}', "did you mean plant/reference?"),
        ('{{ value("reference") }}', "missing 1 required positional argument"),
        ('{{ valu("reference", "largest_speed") }}', "'valu' is undefined"),
        ('{{ value("reference", "largest_speed")|fixd }}', "No filter named 'fixd'"),
        ('{{ "a"|fixed(2) }}', "Unknown format code"),
        ("{{ 1 / 0 }}", "division by zero"),
        ("{% for x in [1] %}", "Unexpected end of template"),
        ('{{ plot("a", "reference", "rat") }}', "did you mean rate?"),
        (
            '{{ series("reference", "wheels.h_whel").norm() }}',
            "no series wheels.h_whel",
        ),
        ('{{ parameter("reference", "wheels.speed_limit", "kg") }}', "does not fit kg"),
        ('{{ spread("reference", "largest_speed") }}', "no samples of plant there"),
    ],
)
def test_what_is_wrong_names_the_line(write_page, line, message):
    with pytest.raises(DesatError) as error:
        write_page(f"# Title\n\n{line}\n")
    assert "page.md:3: " in str(error.value)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_draft_is_not_for_docs(monkeypatch, capsys):
    for words, answer in (
        (["plant"], "no page plant; there is alsat1, gyrostat, hausat2"),
        (["gyrostat", "--draft", "5"], "--into"),
    ):
        monkeypatch.setattr("sys.argv", ["pages", *words])
        assert main() == 2
        assert answer in capsys.readouterr().err


def test_a_derived_quantity_without_a_name_is_drawn():
    """Such as the pointing error: its one element has none. An empty name of the
    scenario's leaves an element out."""
    run = execute("integrated/mil-nadir", Options(stop=30.0))
    signals = ["spacecraft.q_bi", "guidance.q_ref_bi"]
    spec = {"title": "a", "signals": signals, "derive": "pointing", "unit": "deg"}
    (line,) = lines_of(Plot(**spec), run.results, "deg")
    assert len(line.values) == len(run.results.times("guidance.q_ref_bi"))
    three = {**spec, "derive": "euler", "components": ["yaw", "", "roll"]}
    assert [x.name for x in lines_of(Plot(**three), run.results, "deg")] == [
        "yaw",
        "roll",
    ]
