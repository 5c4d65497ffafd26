"""Write native FMUs for hosts that know Reals only, by repacking.

The library stays; the description has each Integer, enumeration and Boolean as a Real
of the same reference, with its values 0, 1, ... in its text. It has a GUID of its own,
by which the library knows that such a host sets and gets them (c/fmi2.c): what is no
whole number, or of a Boolean neither 0 nor 1, is refused. It proposes no step, since
FMPy 0.3 gives that to its hosts as text, on which some stop; a block makes any step.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from lxml import etree

from .native import pack

DESCRIPTION = "modelDescription.xml"
SUFFIX = "-reals"  # of the GUID
_NUMBERS = {"true": "1.0", "false": "0.0"}


def repack(native: Path, target: Path) -> Path:
    """Write a native FMU (FMI 2.0) with all variables as Reals, and return its path."""
    with zipfile.ZipFile(native) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    root: Any = etree.fromstring(members[DESCRIPTION])
    root.set("guid", root.get("guid") + SUFFIX)
    root.find("DefaultExperiment").attrib.pop("stepSize", None)
    for scalar in root.find("ModelVariables"):
        for kind in ("Integer", "Boolean"):
            if (value := scalar.find(kind)) is not None:
                _make_real(scalar, value)
    members[DESCRIPTION] = etree.tostring(
        root, xml_declaration=True, encoding="UTF-8", pretty_print=True
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    return pack(members, target)


def _make_real(scalar: Any, value: Any) -> None:
    """Declare a variable as a Real, of an Integer or a Boolean."""
    if value.tag == "Boolean":
        value.set("min", "0")
        value.set("max", "1")
        scalar.set("description", f"{scalar.get('description')}: 0 = false, 1 = true")
    value.tag = "Real"
    for key in ("start", "min", "max"):
        if (text := value.get(key)) is not None:
            value.set(key, _NUMBERS.get(text) or repr(float(text)))
