"""The manifest of a run: what was run, with which values, and the numbers that came out."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from math import inf
from pathlib import Path
from typing import Any

from ..analyses import analyses
from ..engine.recording.results import MANIFEST, Results
from ..files import library
from ..files.identity import of_system, versions
from ..files.io import contents, replace_text
from ..language.content import Content, said
from ..numbers.numbers import OPEN_END, evaluate, related
from ..system.digest import comparable, wiring
from ..system.errors import DesatError
from ..system.expression import Table
from ..system.model import System
from ..system.options import Options
from ..system.parameters import table

_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)

_ROOM = 64_000
"""Bytes that the manifest of a run under way is longer than it needs."""


def attributes(manifest: Mapping[str, Any]) -> dict[str, str]:
    """What of a manifest its series say themselves: scenario, title, UTC of t = 0 (empty where no
    component has an epoch), versions (JSON)."""
    epochs = [p["epoch_j2000"]["value"] for p in manifest["parameters"].values()
              if "epoch_j2000" in p]  # fmt: skip
    return {
        "scenario": manifest["scenario"], "title": manifest["about"].get("title", ""),
        "epoch": (_J2000 + timedelta(seconds=epochs[0])).isoformat() if epochs else "",
        "versions": json.dumps(manifest["versions"]),
    }  # fmt: skip


def describe(system: System, options: Options, target: str) -> dict[str, Any]:
    """The manifest of a system before it runs."""
    path = Path(target)
    return {
        "scenario": said(system.about).name or system.name,
        "about": system.about.as_json() if system.about else {},
        "algorithm": options.algorithm,
        "components_as": "bare blocks" if options.blocks else "FMUs",
        "start": system.start,
        "stop": system.stop,
        "step": system.step,
        "inner": system.inner,
        "decimation": {c.name: c.decimation for c in system.components.values()},
        "output_classes": system.output_classes,
        "connections": wiring(system.connections),
        "versions": versions(),
        "platform": platform.platform(),
        "ssp": {"file": path.name, "sha256": library.sha256(path)}
        if path.suffix == ".ssp" else None,
        "fmus": {
            c.name: {"source": c.source, "sha256": library.load(c.fmu).sha256}
            for c in system.components.values() if c.fmu is not None
        },
        **{a.KEY: a.applies(system) for a in analyses()},
        "choices": {
            f"{c.name}.{s.name}": list(s.choices)
            for c in system.components.values()
            for s in c.interface.of("output") if s.choices
        },
        "parameters": table(system.components.values()),
        "digest": of_system(system, options),
    }  # fmt: skip


def gone_on(now: dict[str, Any], before: dict[str, Any], folder: str, again: str) -> dict[str, Any]:
    """The manifest of a run that goes on, which is the one that it had. Raises DesatError where
    the target, its wiring, an FMU, a package or this machine is not what it was, or where that
    cannot be told; `again`: the command that begins anew."""
    if not comparable(before.get("digest", "")):
        raise DesatError(
            f"{folder}: it cannot go on: the desat that it began with kept no digest "
            f"of the system that this one can compare; `{again}` begins anew"
        )
    for key in now:
        is_now, was = (json.loads(json.dumps(x.get(key))) for x in (now, before))
        if is_now != was and key not in ("started", "warnings"):
            if isinstance(was, dict) and isinstance(is_now, dict):
                names = sorted(was.keys() | is_now.keys())
                name = next(n for n in names if was.get(n) != is_now.get(n))
                key, was, is_now = f"{key}.{name}", was.get(name), is_now.get(name)
            raise DesatError(f"{folder}: it cannot go on with the same bits: {key} was {was}, and "
                             f"is {is_now}")  # fmt: skip
    return dict(before)


def numbers(
    content: Content, results: Results, parameters: Table
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """The scenario's numbers that need no other run, where their series are recorded.

    `value` is None, and shown as "not reached", where the run does not reach a number's window;
    `note` says how much of the window it has.
    """
    rows: dict[str, dict[str, Any]] = {}
    known, end = set(results.names()), results.times()[-1:].tolist()
    for name, number in content.numbers.items():
        if not number.signals or not known.issuperset(number.signals):
            continue
        rows[name] = {
            "title": number.title or name,
            "value": evaluate(number, results, parameters),
            "unit": number.unit,
        }
        until = (number.window or (0.0, inf))[1]
        if rows[name]["value"] is not None and until < OPEN_END and end[0] < until - 1e-6:
            rows[name]["note"] = f"only to {end[0]:g} s of {until:g} s"
    return rows


def relate(manifest: dict[str, Any], others: dict[str, dict[str, Any]]) -> None:
    """Add the numbers that compare a run with others (by scenario name, without the family)."""
    for name, number in said(manifest["about"]).numbers.items():
        other = others.get(number.reference)
        of = number.of
        if other is None or of not in manifest["numbers"] or of not in other["numbers"]:
            continue
        manifest["numbers"][name] = {
            "title": number.title or name,
            "value": related(
                str(number.form), manifest["numbers"][of]["value"], other["numbers"][of]["value"]
            ),
            "unit": number.unit,
            "reference": number.reference,
        }


def write_json(path: Path, data: Any) -> None:
    """Write JSON under a temporary name, then rename."""
    replace_text(path, json.dumps(data, indent=1))


def begin_manifest(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest of a run that is under way, with room for that of its end."""
    replace_text(folder / f"{MANIFEST}.part", json.dumps(manifest, indent=1) + _ROOM * " ")
    (folder / MANIFEST).unlink(missing_ok=True)  # of a run that was ended


def end_manifest(folder: Path, manifest: dict[str, Any]) -> None:
    """Write the manifest of a run that is over; where the disk is full, into the room it has."""
    part, text = folder / f"{MANIFEST}.part", json.dumps(manifest, indent=1).encode()
    try:
        write_json(folder / MANIFEST, manifest)
    except OSError:
        if not part.exists() or part.stat().st_size < len(text):
            raise
        with part.open("r+b") as file:
            file.write(text)
            file.truncate()
        part.replace(folder / MANIFEST)
    part.unlink(missing_ok=True)


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a run folder, also of a run that was killed. Raises DesatError."""
    for name in (MANIFEST, f"{MANIFEST}.part"):
        if (folder / name).exists():
            where = str(folder / name)
            try:
                manifest: dict[str, Any] = json.loads(contents(folder / name, where))
            except ValueError as error:
                raise DesatError(f"{where}: {error}") from error
            for key, kind in (("status", str), ("about", dict)):
                if not isinstance(manifest, dict) or not isinstance(manifest.get(key), kind):
                    raise DesatError(f"{where}: no manifest of a run (it has no {key})")
            return manifest
    raise DesatError(f"{folder}: no run folder (it has no {MANIFEST})")
