"""Write the Content Security Policy of a page: it runs only our own scripts."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence

from markupsafe import Markup

from ..figures.style import DARK
from ..system import discovery

# Place of the policy in page.html; the scripts of a page are known only at its end.
PLACEHOLDER = "POLICY-OF-THIS-PAGE"
# Part of the policy that all pages share. Styles are inline, also as attributes of SVG.
FIXED = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'none'; script-src"
)


def part(name: str) -> Markup:
    """Read a part of pages from a folder `templates/` as it is."""
    paths = (folder / name for folder in discovery.folders("templates"))
    path = next(path for path in paths if path.exists())
    return Markup(path.read_text(encoding="utf-8"))


class PageScripts:
    """Script elements of one page, with their hashes for its policy.

    The hash of a script enters the policy only when a template requests that script by
    the names of its parts. So a script that a user's text brings into the page does not
    run.
    """

    def __init__(self) -> None:
        self._sources: list[str] = []

    def element(self, names: Sequence[str]) -> Markup:
        """Return a script element made of these parts of templates/."""
        palette = Markup(json.dumps(DARK))
        code = Markup("\n").join(map(part, names)).replace("@PALETTE@", palette)
        digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
        source = f"'sha256-{digest}'"
        if source not in self._sources:
            self._sources.append(source)
        return Markup("<script>{}</script>").format(code)

    def complete(self, page: str) -> str:
        """Return the page with its policy in place of the placeholder.

        Raises
        ------
        ValueError
            If the page has no place for a policy: its template does not extend page.html.
        """
        before, placeholder, after = page.partition(PLACEHOLDER)
        if not placeholder:
            raise ValueError(
                "a page without a policy: its template has to extend page.html"
            )
        return f"{before}{' '.join([FIXED, *self._sources])}{after}"
