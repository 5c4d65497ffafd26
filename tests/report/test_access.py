"""Our pages for keyboards and screen readers: axe finds nothing critical or serious."""

from __future__ import annotations

from pathlib import Path

import pytest

COMMANDS = (
    "new craft six --size 6U --altitude 500km --rods 0.1",
    "size six",
    "run six --stop 2orbits --out runs/six",
    "sweep six manager.gain=0.001,0.002,0.003 torquers.m_limit=0.05,0.1 --stop 600",
    "compare six six/worst.toml --stop 600 --html runs/compare.html",
    "campaign six -n 12 --stop 600 --out runs/campaign",
    "budget six --out runs/budget.html",
    "export web six --out live.html",
    "list --html",
)


@pytest.mark.study
def test_pages_are_for_keyboards_and_screen_readers_too(browser, desat, tmp_path):
    """A page of each kind, light and dark, all of it opened and as it comes."""
    axe = pytest.importorskip("axe_playwright_python", reason="no axe-core")
    script = (Path(axe.__file__).parent / "axe.min.js").read_text("utf-8")
    for line in COMMANDS:
        desat(*line.split(), cwd=tmp_path)
    pages = sorted(tmp_path.rglob("*.html"))
    assert len(pages) == len(COMMANDS) - 1
    for scheme in ("light", "dark"):
        context = browser.new_context(color_scheme=scheme, bypass_csp=True)
        tab = context.new_page()
        for page in pages:
            tab.goto(page.as_uri())
            tab.evaluate(
                "document.querySelectorAll('details').forEach(d => d.open = true)"
            )
            tab.evaluate(script)
            result = tab.evaluate("axe.run(document, { resultTypes: ['violations'] })")
            grave = [
                (page.name, scheme, v["id"], v["nodes"][0]["html"])
                for v in result["violations"]
                if v["impact"] in ("critical", "serious")
            ]
            assert not grave
        context.close()
