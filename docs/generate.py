"""`make papers`: all generated pages, or those named (`python -m docs.generate uosat12`)."""

from __future__ import annotations

import sys

from . import exchange, integrated, uosat12

PAGES = {"uosat12": uosat12.main, "exchange": exchange.main,
         "integrated": integrated.main}  # fmt: skip


def main() -> int:
    """Write the pages named on the command line, or all."""
    for name in sys.argv[1:] or list(PAGES):
        if name not in PAGES:
            print(f"error: no page {name}; there is {', '.join(PAGES)}", file=sys.stderr)
            return 2
        PAGES[name]()
    return 0


if __name__ == "__main__":
    sys.exit(main())
