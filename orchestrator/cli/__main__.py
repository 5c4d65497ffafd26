"""`python -m desat.cli`: the command `desat`."""

from . import main

if __name__ == "__main__":
    main()
