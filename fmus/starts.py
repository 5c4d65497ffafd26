"""Give an FMU of ours other start values: a copy with its own GUID.

A host that reads no parameter set starts it with them. The values are in its model
description, and in a file of its resources that the FMU reads when it is instantiated.
All else is the same, byte by byte, so that the copy is known as one of ours.
"""

from __future__ import annotations

import io
import struct
import uuid
import zipfile
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from lxml import etree

from desat.components.contract.block import Scalar

from .description import start_value

MEMBER = "resources/start.txt"
_DESCRIPTION = "modelDescription.xml"
_HEAD = "desat start values 1"


class Start(NamedTuple):
    """Start value of the scalar with a value reference; `kind` is R, I or B."""

    kind: str
    reference: int
    value: Scalar


class Starts(NamedTuple):
    """Start values of a copy, and the sha256 of the FMU that it was made of."""

    origin: str
    guid: str
    values: tuple[Start, ...]


def read(text: str) -> Starts:
    """Parse the file of start values.

    Raises
    ------
    ValueError
        If it has another form.
    """
    head, origin, guid, *lines = text.splitlines()
    if head != _HEAD or not origin.startswith("of ") or not guid.startswith("guid "):
        raise ValueError("no file of start values")
    values = []
    for line in lines:
        kind, reference, number = line.split()
        value: Scalar
        if kind == "R":
            (value,) = struct.unpack(">d", bytes.fromhex(number))
        else:
            value = number == "1" if kind == "B" else int(number)
        values.append(Start(kind, int(reference), value))
    return Starts(origin[3:], guid[5:], tuple(values))


def _text_of(starts: Starts) -> str:
    """Return the file of start values."""
    lines = [_HEAD, f"of {starts.origin}", f"guid {starts.guid}"]
    for kind, reference, value in starts.values:
        bits = struct.pack(">d", float(value)).hex()  # in any locale the same
        number = bits if kind == "R" else str(int(value))
        lines.append(f"{kind} {reference} {number}")
    return "\n".join(lines) + "\n"


def members_of(data: bytes) -> dict[str, bytes]:
    """Return the members of an FMU."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def with_starts(
    members: Mapping[str, bytes], origin: str, values: Iterable[Start]
) -> dict[str, bytes]:
    """Return the members of a copy with other start values.

    Parameters
    ----------
    members
        Those of an FMU of ours, of FMI 2.0 or 3.0.
    origin
        The sha256 of its file.
    values
        The start values.
    """
    sorted_starts = tuple(sorted(values, key=lambda start: start.reference))
    root = etree.fromstring(members[_DESCRIPTION])
    key = "guid" if root.get("fmiVersion") == "2.0" else "instantiationToken"
    text = _text_of(Starts(origin, "", sorted_starts))
    guid = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, (root.get(key) or '') + text)}}}"
    root.set(key, guid)
    _describe(root, {start.reference: start.value for start in sorted_starts})
    description: bytes = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    member_text = _text_of(Starts(origin, guid, sorted_starts)).encode()
    return {**members, _DESCRIPTION: description, MEMBER: member_text}


def _describe(root: etree._Element, values: Mapping[int, Scalar]) -> None:
    """Write start values into a model description, those of arrays as lists."""
    for variable in root.iterfind("ModelVariables/*"):
        element = variable[0] if variable.tag == "ScalarVariable" else variable
        if (text := element.get("start")) is None:
            continue
        first, texts = int(variable.get("valueReference") or 0), text.split()
        new = [
            start_value(values[first + i]) if first + i in values else old
            for i, old in enumerate(texts)
        ]
        element.set("start", " ".join(new))


def pack(members: Mapping[str, bytes]) -> bytes:
    """Return an archive whose bytes follow from its contents alone."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for member, data in sorted(members.items()):
            info = zipfile.ZipInfo(member)
            info.create_system, info.external_attr = 3, 0o644 << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, data)
    return buffer.getvalue()
