"""Blocks have the same bits under another Python."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from desat.fmus import registry
from desat.fmus.meaning import sources
from tests.conftest import ROOT

DIGEST = """
import hashlib, importlib, json, random, sys
sys.path.insert(0, sys.argv[1])
from components.contract.block import Block
from components.physics.wheel_array import pseudo_inverse

def value(v, rng):
    flat = tuple(x + rng.uniform(-1.0, 1.0) * (abs(x) or SIZE.get(v.unit, 1.0)) * 0.1
                 for x in v.flat_start())
    return flat if v.shape else flat[0]

SIZE = {"T": 3e-4, "N.m.s": 1.0, "N.m": 1e-2, "rad/s": 1e-2, "A.m2": 50.0, "kg/m3": 1e-11}
digests = {}
rng = random.Random(1)
axes = (tuple(rng.uniform(-1.0, 1.0) for _ in range(12)) for _ in range(1000))
digests["pseudo_inverse"] = repr([pseudo_inverse(a) for a in axes])
for name in json.loads(sys.argv[2]):
    module = importlib.import_module("components.blocks." + name)
    (kind,) = (x for x in vars(module).values() if isinstance(x, type)
               and issubclass(x, Block) and x.__module__ == module.__name__)
    block, rng, rows = kind(), random.Random(2), []
    for v in block.variables:  # everything that draws, rubs or drifts
        if v.causality == "parameter" and v.name in ("noise", "bias_walk", "markov_sigma",
                "viscous", "compensation", "unbalance", "motor_lag", "lag"):
            setattr(block, v.name, 1e-5 if v.unit != "s" else 0.1)
    block.start()
    block.output(0.0)
    for k in range(50):
        for v in block.variables:
            if v.causality == "input" and v.type == "Real":
                setattr(block, v.name, value(v, rng))
        block.advance(float(k), 1.0)
        block.output(k + 1.0)
        rows.append([getattr(block, v.name) for v in block.variables if v.causality == "output"])
    digests[name] = repr(rows)
digests = {k: hashlib.sha256(v.encode()).hexdigest() for k, v in digests.items()}
print(json.dumps([list(sys.version_info[:2]), digests]))
"""

COMPENSATED_FROM = (3, 12)
"""The Python from which on `sum` of floats is compensated."""


def other_python() -> str | None:
    """A Python on the other side of that, where there is one."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    candidates = [shutil.which(f"python3.{minor}") for minor in range(11, 16)]
    candidates += [str(p) for p in sorted(pyenv.glob("versions/3.*/bin/python3"))]
    for path in filter(None, candidates):
        says = subprocess.run(
            [path, "-c", "import sys; print(*sys.version_info[:2])"],
            capture_output=True,
            text=True,
            check=False,
        ).stdout
        version = tuple(map(int, says.split()))
        compensates = version >= COMPENSATED_FROM
        if version >= (3, 11) and compensates != (sys.version_info >= COMPENSATED_FROM):
            return path
    return None


def test_blocks_have_the_same_bits_under_another_python():
    """Once `pseudo_inverse` differed in 74 % of its values between 3.11 and 3.12."""
    other = other_python()
    if other is None:
        pytest.skip("no Python on the other side of 3.12 here")
    foreign = ("import numpy", "import scipy", "sgp4")
    names = [
        name
        for name in registry.names()
        if not any(
            word in path.read_text() for path in sources(name) for word in foreign
        )
    ]
    assert len(names) > 20
    (ours, digests), (theirs, other_digests) = (
        json.loads(
            subprocess.run(
                [path, "-B", "-c", DIGEST, str(ROOT), json.dumps(names)],
                capture_output=True,
                text=True,
                check=True,
                cwd=ROOT,
            ).stdout
        )
        for path in (sys.executable, other)
    )
    assert ours != theirs
    assert digests == other_digests
