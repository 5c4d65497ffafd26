"""The index of a folder has its crafts and pages, and no page of others."""

from __future__ import annotations

import re

import pytest

from desat.report.index import write_index
from desat.system.errors import DesatError


def test_an_index_has_crafts_and_pages_with_verdict_and_picture(desat, tmp_path):
    """A craft that was sized and flown, one that cannot be read, a page of others."""
    for line in (
        "new craft six --size 6U --altitude 500km",
        "size six",
        "run six --stop 100 --out runs/short",
    ):
        desat(*line.split(), cwd=tmp_path)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "nominal.toml").write_text("title = ")
    (tmp_path / "other.html").write_text("<title>Not ours</title>")
    assert "4 entries" in desat("list", "--html", cwd=tmp_path).stdout
    text = (tmp_path / "index.html").read_text("utf-8")
    assert text.count("<article>") == 4
    assert re.findall("<h2>(.*?)</h2>", text) == ["Crafts", "Runs", "Sizings"]
    assert text.count("data:image/svg+xml;base64,") == 3
    assert 'href="six/nominal.toml"' in text
    assert "Not ours" not in text
    assert 'class="bad">broken/nominal.toml' in text
    assert len(re.findall('<p class="(ok|bad)">(?:Sized: )?six', text)) == 3
    assert write_index(tmp_path)[1] == 4, "it lists itself"


def test_what_an_index_refuses(tmp_path):
    with pytest.raises(DesatError, match="no such folder"):
        write_index(tmp_path / "none")
    with pytest.raises(DesatError, match="neither crafts nor pages"):
        write_index(tmp_path)
    (tmp_path / "index.html").write_text("my own page")
    with pytest.raises(DesatError, match="none of desat's, and stays as it is"):
        write_index(tmp_path)
    assert (tmp_path / "index.html").read_text() == "my own page"
