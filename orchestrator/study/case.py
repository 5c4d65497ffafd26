"""`Options`, `Run`, `Case` and what makes them: import them from `desat`."""

import warnings

from ..runs.prepare import Case, prepare
from ..runs.run import Run, execute, load_run, run_or_load, simulate
from ..system.options import Options

__all__ = ["Case", "Options", "Run", "execute", "load_run", "prepare", "run_or_load", "simulate"]

warnings.warn(
    "desat.study.case goes with the next release: import Options, Run, ... from desat itself",
    DeprecationWarning,
    stacklevel=2,
)
