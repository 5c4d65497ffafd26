"""Run the command `desat` (`python -m desat.cli`)."""

import sys

import desat

# in the parent of a checkout the folder `desat` shadows the package
if getattr(desat, "__file__", None) is None:
    there = ", ".join(dict.fromkeys(desat.__path__))
    print(
        f"error: {there}: a folder of this name hides the package from `python -m`; run `desat`, "
        "or python from another folder",
        file=sys.stderr,
    )
    sys.exit(2)

from . import main

if __name__ == "__main__":
    main()
