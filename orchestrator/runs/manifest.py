"""Compute a run's numbers, write its manifest, and check a run that is resumed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from datetime import timedelta
from math import inf
from pathlib import Path
from typing import Any

from ..analyses.manifest import Manifest
from ..engine.recording.results import MANIFEST, Results
from ..files import paths
from ..files.io import contents, replace_text
from ..language.content import Content
from ..numbers.numbers import OPEN_END, evaluate, related
from ..numbers.text import Value
from ..system.digest import comparable
from ..system.errors import DesatError
from ..system.expression import Table
from ..system.model import J2000
from ..system.typed import JsonObject

SEAL = "seal"  # key of a manifest: the sha256 of its other keys
RUN_ID = "run"  # attribute of a file of series: the identity of its run
_RESERVED_OCTETS = (
    64_000  # bytes by which the manifest of a run under way is longer than it needs
)


def attributes(manifest: Manifest) -> dict[str, str]:
    """Return the attributes that series share with a manifest.

    These are scenario, title, UTC of t = 0 (empty where no component has an epoch) and
    versions (JSON).
    """
    epochs = [
        p["epoch_j2000"].value
        for p in manifest.parameters.values()
        if "epoch_j2000" in p
    ]
    return {
        "scenario": manifest.scenario,
        "title": manifest.about.get("title", ""),
        "epoch": (J2000 + timedelta(seconds=epochs[0])).isoformat() if epochs else "",
        "versions": json.dumps(manifest.versions),
        RUN_ID: run_id_of(manifest),
    }


def run_id_of(manifest: Manifest) -> str:
    """Return the identity of a run, which its series and its manifest have in common.

    Empty for a run of an older version, whose manifest has no digest.
    """
    return f"{manifest.digest} {manifest.started or ''}" if manifest.digest else ""


def resumed(now: Manifest, before: JsonObject, folder: str, again: str) -> Manifest:
    """Return the manifest of a run that is resumed, which is its previous one.

    `again` is the command that begins again.

    Raises
    ------
    DesatError
        If target, wiring, an FMU, a package or this machine has changed, or that cannot
        be compared.
    """
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
            raise DesatError(
                f"{folder}: it cannot go on with the same bits: {key} was {was}, and "
                f"is {is_now}"
            )
    return Manifest.from_json(before)


def numbers(content: Content, results: Results, parameters: Table) -> dict[str, Value]:
    """Compute the scenario's numbers that need no other run.

    Their series must be recorded. `value` is None, and shown as "not reached", where
    the run does not reach a number's window.
    """
    rows: dict[str, Value] = {}
    series_names, end = set(results.names()), results.times()[-1:].tolist()
    for name, number in content.numbers.items():
        if not number.signals or not series_names.issuperset(number.signals):
            continue
        value, samples, is_of_reference = evaluate(number, results, parameters)
        note = f"at {samples} samples of the reference" if is_of_reference else ""
        until = (number.window or (0.0, inf))[1]
        if value is not None and until < OPEN_END and end[0] < until - 1e-6:
            note = f"only to {end[0]:g} s of {until:g} s"
        title = number.title or name
        rows[name] = Value(title, value, number.unit, note, samples=samples)
    return rows


def unrecorded(content: Content, results: Results) -> dict[str, str]:
    """Return the reason why a scenario's number could not be computed, by its name."""
    series_names = set(results.names())
    lacking = {
        name: [s for s in number.signals if s not in series_names]
        for name, number in content.numbers.items()
    }
    return {
        name: f"not recorded: {', '.join(dict.fromkeys(x))}"
        for name, x in lacking.items()
        if x
    }


def related_to(manifest: Manifest, others: Mapping[str, Manifest]) -> Manifest:
    """Return a manifest with the numbers that compare its run with others.

    The others are by scenario name, without the family.
    """
    numbers_related = dict(manifest.numbers)
    for name, number in manifest.content.numbers.items():
        other, of = others.get(number.reference), number.of
        if other is not None and of in numbers_related and of in other.numbers:
            value = related(
                str(number.form), numbers_related[of].value, other.numbers[of].value
            )
            title = number.title or name
            numbers_related[name] = Value(
                title, value, number.unit, reference=number.reference
            )
    return replace(manifest, numbers=numbers_related)


def write_json(path: Path, data: Any) -> None:
    """Write JSON under a temporary name, then rename it."""
    replace_text(path, json.dumps(data, indent=1))


def check_identity(folder: Path, manifest: Manifest, results: Results) -> None:
    """Check that series are those of the run of a manifest.

    Raises
    ------
    DesatError
        If they are of another run. Those of older versions do not say of which they are.
    """
    run_id, expected = results.about(RUN_ID), run_id_of(manifest)
    if run_id and expected and run_id != expected:
        raise DesatError(
            f"{folder}: its series are of another run (of {run_id.partition(' ')[2]}; its "
            f"{MANIFEST} is of {expected.partition(' ')[2]})"
        )


def seal_of(document: JsonObject) -> str:
    """Return the sha256 of a manifest's JSON without its seal."""
    bare = {key: x for key, x in document.items() if key != SEAL}
    return hashlib.sha256(json.dumps(bare, sort_keys=True).encode()).hexdigest()


def changed_manifest(folder: Path) -> str:
    """Return the path of a run folder's manifest that was changed since it was written.

    Empty where there is none, it is as it was written, or it has no seal: it is of an
    older version, or of a run under way.
    """
    file = folder / MANIFEST
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return ""
    is_sealed = isinstance(document, dict) and SEAL in document
    return str(file) if is_sealed and document[SEAL] != seal_of(document) else ""


def begin_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest of a run under way, with room for that of its end."""
    replace_text(
        folder / f"{MANIFEST}.part",
        json.dumps(manifest.to_json(), indent=1) + _RESERVED_OCTETS * " ",
    )
    (folder / MANIFEST).unlink(missing_ok=True)  # left by an earlier run that was ended


def end_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest of a run that is over.

    Where the disk is full, it goes into the room of the earlier one.
    """
    document = manifest.to_json()
    document[SEAL] = seal_of(document)
    part, text = (
        folder / f"{MANIFEST}.part",
        json.dumps(document, indent=1).encode(),
    )
    try:
        write_json(folder / MANIFEST, document)
    except OSError:
        if not part.exists() or part.stat().st_size < len(text):
            raise
        with part.open("r+b") as file:
            file.write(text)
            file.truncate()
        part.replace(folder / MANIFEST)
    part.unlink(missing_ok=True)


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a run folder, also of a run that was killed.

    Raises
    ------
    DesatError
        If there is none, or it is damaged.
    """
    for name in (MANIFEST, f"{MANIFEST}.part"):
        if (folder / name).exists():
            place = str(folder / name)
            try:
                document = json.loads(contents(folder / name, place))
            except (ValueError, RecursionError) as error:
                raise DesatError(f"{place}: {error}") from error
            for key, kind in (("status", str), ("about", dict)):
                if not isinstance(document, dict) or not isinstance(
                    document.get(key), kind
                ):
                    raise DesatError(f"{place}: no manifest of a run (it has no {key})")
            try:
                return Manifest.from_json(
                    {key: x for key, x in document.items() if key != SEAL}
                )
            except ValueError as error:
                raise DesatError(f"{place}: no manifest of a run: {error}") from error
    if (folder / paths.NOMINAL).is_file():
        runs = Path("runs") / folder.resolve().name
        there = f"; its run is {runs}" if (runs / MANIFEST).is_file() else ""
        raise DesatError(f"{folder}: the folder of a craft, not of a run{there}")
    raise DesatError(f"{folder}: no run folder (it has no {MANIFEST})")
