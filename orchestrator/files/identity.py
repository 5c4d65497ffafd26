"""Identify what a run computes: the digest of its system and options, and versions.

The digest covers what affects a bit. Beside it are the versions of all that computes.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Set
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from typing import Any

from ..system.digest import digest
from ..system.model import System
from ..system.options import Options
from . import library

PACKAGES = ("desat", "fmpy", "pythonfmu", "numpy", "scipy", "h5py")
# Versions that may affect a bit; the others only pass values on.
COMPUTING = ("desat", "numpy", "scipy", "python", "platform", "libm", "compiler")
# Keys of a scenario that change no number of a run, only its plots and checks.
JUDGED = frozenset(
    ("plots", "requirements", "residual_bound", "impulse_bound", "energy_bound")
)


def of_system(
    system: System,
    options: Options,
    conditions: Any = None,
    without: Set[str] = frozenset(),
) -> str:
    """Compute the digest of a resolved system that is run with these options.

    `conditions` and `without` are as for `digest`.
    """
    computes = {
        c.name: library.computes(c.model, c.fmu) for c in system.components.values()
    }
    return digest(system, computes, [options, conditions], without)


@cache
def versions() -> dict[str, str]:
    """Return what the bits of a run depend on besides its digest.

    These are packages, Python, platform, libm, and the compiler of our native FMUs if
    known.
    """
    compilers = {e["compiler"] for e in library.index().values() if "compiler" in e}
    return {
        **{name: version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "libm": " ".join(filter(None, (*platform.libc_ver(), _bits_of_libm()))),
        **({"compiler": ", ".join(sorted(compilers))} if compilers else {}),
    }


def _bits_of_libm() -> str:
    """Compute a short hash of results of libm's functions.

    They may differ on another processor.
    """
    points = [k / 64.0 + 1.0 / (k + 3.0) for k in range(1, 200)]
    functions = (
        math.sin,
        math.cos,
        math.tan,
        math.atan,
        math.exp,
        math.log,
        math.sqrt,
        math.tanh,
        math.log10,
        lambda x: math.asin(math.sin(x)),
        lambda x: math.acos(math.cos(x)),
        lambda x: math.pow(x, 1.7),
        lambda x: math.atan2(x, 3.1),
    )
    values = (f(x).hex() for f in functions for x in points)
    return sha256(" ".join(values).encode()).hexdigest()[:8]


def other(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Describe the first of the computing versions that differs from before.

    The text is empty if all are the same. A version that is unknown on one side counts
    as different.
    """
    for name in COMPUTING:
        was, is_now = (x.get(name, "not known") for x in (before, now))
        if was != is_now:
            return f"{name} was {was}, and is {is_now}"
    return ""
