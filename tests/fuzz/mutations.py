"""Mutations of bytes: of bits and pieces, quoted values, lines, JSON, archives."""

from __future__ import annotations

import io
import json
import random
import re
import warnings
import zipfile
from typing import Any

STRANGE = (
    b"",
    b"0",
    b"-1",
    b"1",
    b"nan",
    b"inf",
    b"-inf",
    b"1e400",
    b"1e17",
    b"0x10",
    b"1_0",
    b"true",
    b"None",
    b"null",
    b"\xd9\xa1",
    b"\xff\xfe",
    b"\x00",
    b"\x1b[31m",
    b"../../../etc/passwd",
    b"/dev/zero",
    b"/etc/passwd",
    b"%2e%2e/outside.ssv",
    b"a.b",
    b"a/b",
    b"time",
    b"[1]",
    b"[]",
    b"{}",
    b"{axis}",
    b"{",
    b"99999999999999999999",
    b"x" * 300,
    b"2026-13-45T99:99:99Z",
    b"=1+1",
    b"1979-05-27",
    b"body.q",
    b"'",
    b'"',
    b"&lt;",
    b"&x;",
    b"<!DOCTYPE x>",
    b"<?x y?>",
    b"[[",
)
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1e308,
    "",
    "x",
    "body.q",
    [],
    {},
    [1],
    {"a": 1},
    [[["x"]]],
    10**30,
    float("nan"),
    "\u0000",
    "{axis}",
)


def mutate(kind: str, seed: bytes, rng: random.Random) -> bytes:
    """A seed with one to four mutations."""
    data = seed
    for _ in range(rng.choice((1, 1, 2, 4))):
        if kind in ("ssp", "fmu") and rng.random() < 0.6:
            data = _archive(data, rng)
        elif kind == "json" and rng.random() < 0.7:
            data = _json(data, rng)
        else:
            data = rng.choice((_bits, _piece, _value, _value, _value, _line, _line))(
                data, rng
            )
    return data


def _place(data: bytes, rng: random.Random) -> int:
    return rng.randrange(len(data) + 1)


def _bits(data: bytes, rng: random.Random) -> bytes:
    if not data:
        return b"\xff"
    mutation = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        mutation[rng.randrange(len(mutation))] = rng.randrange(256)
    return bytes(mutation)


def _piece(data: bytes, rng: random.Random) -> bytes:
    """A piece removed, doubled, put elsewhere, or something strange put in."""
    a, b = sorted((_place(data, rng), min(len(data), _place(data, rng))))
    b = min(b, a + rng.choice((1, 8, 64, 512)))
    piece, at = data[a:b], _place(data, rng)
    way = rng.randrange(4)
    if way == 0:
        return data[:a] + data[b:]
    if way == 1:
        return data[:a] + piece * rng.choice((2, 3, 50)) + data[b:]
    return data[:at] + (piece if way == 2 else rng.choice(STRANGE)) + data[at:]


def _value(data: bytes, rng: random.Random) -> bytes:
    """A quoted value, or what follows an equals sign, replaced."""
    matches = list(re.finditer(rb'"([^"\n]*)"|= *([^"\n\[{]+)$', data, re.M))
    if not matches:
        return data
    match = rng.choice(matches)
    group = 1 if match[1] is not None else 2
    new = (
        rng.choice(STRANGE)
        if rng.random() < 0.7
        else rng.choice(matches)[0].strip(b'"= ')
    )
    return data[: match.start(group)] + new + data[match.end(group) :]


def _line(data: bytes, rng: random.Random) -> bytes:
    """A line, or an element, removed, doubled or moved."""
    lines = re.split(rb"(?<=[\n>])", data)
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(3)
    line = lines[i] if way == 1 else lines.pop(i)
    if way:
        lines.insert(j, line)
    return b"".join(lines)


def _json(data: bytes, rng: random.Random) -> bytes:
    """A value of a tree replaced, or a key removed or renamed."""
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return data
    places: list[tuple[Any, Any]] = []
    todo = [tree]
    while todo:
        node = todo.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node))
        for key in keys:
            places.append((node, key))
            if isinstance(node[key], (dict, list)):
                todo.append(node[key])
        if len(places) > 500:
            break
    if not places:
        return json.dumps(rng.choice(VALUES)).encode()
    node, key = rng.choice(places)
    if isinstance(node, dict) and rng.random() < 0.25:
        value = node.pop(key)
        if rng.random() < 0.5:
            node[rng.choice(("x", "", "unit", "of", "signal", "time"))] = value
    else:
        node[key] = rng.choice(VALUES)
    return json.dumps(tree).encode()


def _archive(data: bytes, rng: random.Random) -> bytes:
    """One entry of an archive mutated, renamed, doubled, or left out."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as old:
            entries = [(name, old.read(name)) for name in old.namelist()]
    except Exception:  # it is none any more
        return data
    if not entries:
        return data
    i = rng.randrange(len(entries))
    name, substeps = entries[i]
    way = rng.randrange(6)
    if way == 0:
        entries.pop(i)
    elif way == 1:
        entries[i] = (
            rng.choice(("../x", "/x", "a/../../b", "x", name.upper(), "a" * 300)),
            substeps,
        )
    elif way == 2:
        entries.append((name, substeps))
    else:
        kind = (
            "json"
            if name.endswith("json")
            else "ssp"
            if name.endswith("fmu")
            else "xml"
        )
        entries[i] = (name, mutate(kind, substeps, rng))
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w") as new:
        warnings.simplefilter("ignore")
        for entry, content in entries:
            new.writestr(entry, content)
    return buffer.getvalue()
