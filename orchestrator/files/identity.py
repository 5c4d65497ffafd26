"""What a run is of: the digest of its system with what of the options moves a bit; and
what stands beside it, the versions of all that computes."""

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
COMPUTING = ("desat", "numpy", "scipy", "python", "platform", "libm", "compiler")
"""Those of the versions that may move a bit: the others pass values on."""
JUDGED = frozenset(
    ("plots", "requirements", "residual_bound", "impulse_bound", "energy_bound")
)
"""What of a scenario changes no number of a run, but what is drawn of it and held
against it."""


def of_system(
    system: System,
    options: Options,
    beside: Any = None,
    without: Set[str] = frozenset(),
) -> str:
    """The digest of a resolved system that is run with these options; `beside`,
    `without`: as `digest` takes them."""
    computes = {
        c.name: library.computes(c.interface.model, c.fmu)
        for c in system.components.values()
    }
    return digest(system, computes, [options, beside], without)


@cache
def versions() -> dict[str, str]:
    """What the bits of a run depend on beside its digest: packages, Python, platform,
    libm, and the compiler of our native FMUs, where it is known."""
    compilers = {e["compiler"] for e in library.index().values() if "compiler" in e}
    return {
        **{name: version(name) for name in PACKAGES},
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "libm": " ".join(filter(None, (*platform.libc_ver(), _bits_of_libm()))),
        **({"compiler": ", ".join(sorted(compilers))} if compilers else {}),
    }


def _bits_of_libm() -> str:
    """A short hash of what its functions give: it may take another way on another
    processor."""
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
    """The first of what computes that is another one than before, and what the two are;
    empty where all are the same. What is not known of one of them counts as another."""
    for name in COMPUTING:
        was, is_now = (x.get(name, "not known") for x in (before, now))
        if was != is_now:
            return f"{name} was {was}, and is {is_now}"
    return ""
