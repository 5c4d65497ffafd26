"""Store a campaign: full blocks of cases as Parquet files, other rows in journals.

    campaign.json            the plan (plan.py), versions
    cases/part-00012.parquet  cases 12 BLOCK to 13 BLOCK - 1, a row each, in their order
    cases/part-00012.jsonl   while that block is incomplete: its journal, a line a row
    curves/part-00012.parquet their envelopes
    numbers.json             title and unit of numbers, drawn parameters and envelopes
    status.json              progress
    kept/000123/             run folder of a case that is kept

Rows depend on plan and number alone, except for the columns `BOOKKEEPING`. The same holds for
the files, wherever the cases ran and however often the campaign was stopped.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from ..analyses.manifest import Stopped
from ..files.io import naming, replace_text
from ..runs.manifest import write_json
from ..system.errors import DesatError
from ..system.typed import JsonObject
from .draws import RunRow

# --- Reading files; the error of a damaged one says what to do ------------------------


def signature(path: Path) -> Path:
    """Return the path of the sha256 of a Parquet file.

    Its name begins with _, so that readers of the whole folder skip it.
    """
    return path.with_name(f"_{path.stem}.sha256")


def replace(part: Path, path: Path, octets: bytes) -> None:
    """Move a written file to the path of a Parquet file, and keep its sha256 beside it.

    During the replacement the signature has the sha256 of the old file, too, because a
    reader may find either file.
    """
    digest = hashlib.sha256(octets).hexdigest()
    replace_text(
        signature(path), f"{_signed(path)}\n{digest}" if path.exists() else digest
    )
    part.replace(path)
    replace_text(signature(path), digest)


def _signed(path: Path) -> str:
    """Return the sha256 that a file was written with, or "" where there is none.

    While the file is replaced, that of the new one follows.
    """
    try:
        return signature(path).read_text(encoding="ascii", errors="replace")
    except FileNotFoundError:
        return ""


def _check(path: Path) -> None:
    """Raise DesatError if a file is not as it was written, or its sha256 is missing."""
    state = path.stat()
    if not (signed := _signed(path)):
        raise _summary(
            path, ValueError(f"{signature(path).name}, its sha256, is missing")
        )
    _as_signed(path, signed, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=4096)
def _as_signed(path: Path, signatures: str, *_: int) -> None:
    """Raise DesatError if the sha256 of a file is not among those in `signatures`.

    Errors are not cached, because a file may be repaired within a tick of the clock.
    """
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if (
        digest not in signatures.split() and _signed(path) == signatures
    ):  # otherwise it has been replaced meanwhile
        raise _summary(path, ValueError("its sha256 is another"))


@contextmanager
def _open_parquet(path: Path) -> Iterator[BinaryIO]:
    """Open a Parquet file.

    Raises DesatError if it, or what is read of it, is damaged.
    """
    try:
        _check(path)
        with path.open("rb") as file:  # pyarrow accepts UTF-8 names only
            yield file
    except (pa.ArrowException, OSError) as error:
        raise _summary(path, error) from error


def columns(path: Path) -> pa.Schema:
    """Return the schema of a Parquet file; raise DesatError if it is damaged."""
    with _open_parquet(path) as file:
        return pq.read_schema(file)


def count(path: Path) -> int:
    """Return the number of rows of a Parquet file, from its footer.

    Raises
    ------
    DesatError
        If the file is damaged.
    """
    with _open_parquet(path) as file:
        return int(pq.read_metadata(file).num_rows)


def rows_in(path: Path, selection: Sequence[str] | None = None) -> pa.Table:
    """Read the rows of a Parquet file, with those of the `selection` columns that it has.

    Raises
    ------
    DesatError
        If the file is damaged.
    """
    with _open_parquet(path) as opened, pq.ParquetFile(opened) as file:
        names = file.schema_arrow.names
        return file.read(columns=selection and [c for c in selection if c in names])


def _summary(path: Path, error: Exception) -> DesatError:
    """Build the error of a damaged file, which says how its cases are made again."""
    cases = (
        path.parent.parent / "cases" / path.name
    )  # without its file of cases a block does not exist
    return DesatError(
        f"{path}: damaged ({' '.join(str(error).split())}); without {cases} the same "
        "command makes its cases again"
    )


def table(path: Path) -> JsonObject:
    """Read a JSON file that holds a table; raise DesatError if it does not."""
    try:
        if isinstance(content := json.loads(path.read_text(encoding="utf-8")), dict):
            return content
        raise DesatError(f"{path}: damaged (no table)")
    except ValueError as error:
        raise DesatError(f"{path}: damaged ({error})") from error


BLOCK = 256  # cases in a file
CASES, CURVES, NUMBERS = "cases", "curves", "numbers.json"
# Columns that may differ when a case is made again.
BOOKKEEPING = ("seconds", "worker", "attempts", "versions")


@dataclass(frozen=True)
class CaseRow(RunRow):
    """Row of a case, with the columns `BOOKKEEPING`."""

    # envelopes; None: there are none
    curves: Mapping[str, Sequence[float | None]] | None = None
    seconds: float | None = None
    worker: str = ""
    attempts: int = 1
    versions: str = ""

    @property
    def case(self) -> int:
        """Return the number of the case."""
        assert self.number is not None
        return self.number

    def to_line(self) -> str:
        """Return the row as a line of a journal."""
        curves = {} if self.curves is None else {"curves": dict(self.curves)}
        bookkeeping = {name: getattr(self, name) for name in BOOKKEEPING}
        entry = self.to_json()
        return (
            json.dumps({"case": entry.pop("draw"), **entry, **curves, **bookkeeping})
            + "\n"
        )

    @classmethod
    def from_json(cls, entry: JsonObject) -> CaseRow:
        """Build the row from an entry of a journal or of the columns of a file."""
        stopped = entry["stopped_when"]
        ending = stopped and Stopped(stopped.get("condition", ""), stopped["time"])
        fields_given = {name: entry[name] for name in _FIELDS if name in entry}
        return cls(**{**fields_given, "number": entry["case"], "stopped_when": ending})


_FIELDS = tuple(f.name for f in fields(CaseRow))


@dataclass(frozen=True)
class Batch:
    """Cases that were made together, as the coordinator keeps them."""

    lines: Sequence[str]  # rows, as the journal has them
    described: Mapping[str, dict[str, str]]  # title and unit of the values in the rows

    @classmethod
    def of(cls, rows: Iterable[CaseRow]) -> Batch:
        """Build a batch of rows of at most one block."""
        lines: list[str] = []
        descriptions: dict[str, dict[str, str]] = {}
        for row in rows:
            lines.append(row.to_line())
            descriptions.update(row.described)
        return cls(lines, descriptions)


class Store:
    """Rows of a campaign that exist, and the place where further rows go."""

    def __init__(self, folder: Path, cases: int) -> None:
        """Open a campaign's folder for this number of cases, with the rows it has so far."""
        self.folder, self._count = folder, cases
        self._described = described(folder)
        self._open: dict[int, dict[int, CaseRow]] = {}
        for kind in (CASES, CURVES):
            (folder / kind).mkdir(parents=True, exist_ok=True)
        self._complete = _parts(folder)
        for row in _journal(folder):
            if row.case // BLOCK not in self._complete and row.case < cases:
                self._open.setdefault(row.case // BLOCK, {})[row.case] = row
        # of blocks that are complete, or that no longer exist
        for path in _journals(folder):
            path.unlink()
        for block in self._open:
            self._write_journal(block)
        for block in sorted(self._complete):
            curves = _part(folder, CURVES, block)
            if curves.exists():
                count(curves)  # verifies its sha256
            if count(_part(folder, CASES, block)) < self._size(block):
                self._reopen(block)

    def _reopen(self, block: int) -> None:
        """Move the rows of a block back to its journal.

        This is for a block that is incomplete because the campaign has more cases now,
        or because some of its rows are discarded.
        """
        self._open[block] = {row.case: row for row in _of_block(self.folder, block)}
        self._complete.discard(block)
        self._write_journal(block)
        for kind in (CASES, CURVES):
            _part(self.folder, kind, block).unlink(missing_ok=True)

    def _write_journal(self, block: int) -> None:
        """Rewrite the journal of an open block with its rows alone."""
        path = journal(self.folder, block)
        part = path.with_name(f"{path.name}.tmp")
        with naming(path), part.open("w", encoding="utf-8") as file:
            rows = self._open[block].values()
            file.writelines(row.to_line() for row in rows)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)

    def _size(self, block: int) -> int:
        """Return the number of cases of a block."""
        return min(self._count - block * BLOCK, BLOCK)

    def done(self) -> int:
        """Count the cases that exist."""
        return sum(map(self._size, self._complete)) + sum(map(len, self._open.values()))

    def missing(self) -> Iterator[int]:
        """Yield the numbers of the cases that do not exist yet, in order."""
        for block in range(math.ceil(self._count / BLOCK)):
            if block not in self._complete:
                there = set(self._open.get(block, ()))
                first = block * BLOCK
                yield from (
                    n for n in range(first, first + self._size(block)) if n not in there
                )

    def failed(self) -> int:
        """Count the existing cases that failed."""
        waiting = sum(
            not r.completed for rows in self._open.values() for r in rows.values()
        )
        parts = (
            rows_in(_part(self.folder, CASES, b), ["status"]) for b in self._complete
        )
        return waiting + sum(
            int(s != "completed") for t in parts for s in t["status"].to_pylist()
        )

    def forget(self, code: int) -> None:
        """Discard the cases that ended with this exit code."""
        for block in sorted(self._complete):
            codes = rows_in(_part(self.folder, CASES, block), ["code"])[
                "code"
            ].to_pylist()
            if code in codes:
                self._reopen(block)
        for block, rows in self._open.items():
            self._open[block] = {n: row for n, row in rows.items() if row.code != code}
            self._write_journal(block)

    def add(self, batch: Batch) -> list[CaseRow]:
        """Keep cases of one block and return their rows.

        They go to the file of the block when it is complete, and to its journal until
        then, at once.
        """
        if not batch.described.keys() <= self._described.keys():
            self._described |= batch.described
            write_json(self.folder / NUMBERS, dict(sorted(self._described.items())))
        added = [CaseRow.from_json(json.loads(line)) for line in batch.lines]
        (block,) = {row.case // BLOCK for row in added}
        rows = self._open.pop(block, {}) | {row.case: row for row in added}
        path = journal(self.folder, block)
        if len(rows) == self._size(block):
            _write(self.folder, block, [rows[n] for n in sorted(rows)])
            self._complete.add(block)
            path.unlink(missing_ok=True)
        else:
            self._open[block] = rows
            with naming(path), path.open("a", encoding="utf-8") as file:
                file.writelines(batch.lines)
        return added


# Keys of a row in a journal; the first line that lacks one ends the journal.
_ROW = {
    "case",
    "status",
    "code",
    "message",
    "unmet",
    "stopped_when",
    "numbers",
    "values",
}


def _part(folder: Path, kind: str, block: int) -> Path:
    """Return the path of the Parquet file of a block."""
    return folder / kind / f"part-{block:05}.parquet"


def _parts(folder: Path) -> set[int]:
    """Find the blocks that have a Parquet file of cases."""
    block_names = (
        p.stem.partition("-")[2] for p in (folder / CASES).glob("part-*.parquet")
    )
    return {int(number) for number in block_names if number.isdecimal()}


def journal(folder: Path, block: int) -> Path:
    """Return the path of the journal of a block that is incomplete."""
    return folder / CASES / f"part-{block:05}.jsonl"


def _journals(folder: Path) -> list[Path]:
    """Return the paths of all journals, sorted."""
    return sorted((folder / CASES).glob("part-*.jsonl"))


def _journal(folder: Path) -> Iterator[CaseRow]:
    """Yield the rows of all journals.

    The last line of a journal may be incomplete, if its coordinator was killed.
    """
    for path in _journals(folder):
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                row = json.loads(line)
            except ValueError:
                break
            if not (
                isinstance(row, dict)
                and row.keys() >= _ROW
                and isinstance(row["case"], int)
            ):
                break
            yield CaseRow.from_json(row)


def _write(folder: Path, block: int, rows: Sequence[CaseRow]) -> None:
    """Write the files of a block, each under a temporary name first, cases last."""
    curves = _curves_table(rows)
    if curves.num_columns > 1:
        _save(curves, _part(folder, CURVES, block))
    _save(_table(rows), _part(folder, CASES, block))


def _curves_table(rows: Sequence[CaseRow]) -> pa.Table:
    """Return the envelopes of cases, one column per curve."""
    curves = [row.curves or {} for row in rows]
    columns = {"case": pa.array([row.case for row in rows], pa.int64())}
    for name in sorted({name for each in curves for name in each}):
        columns[name] = pa.array(
            [each.get(name) for each in curves], pa.list_(pa.float64())
        )
    return pa.table(columns)


def _save(table: pa.Table, path: Path) -> None:
    """Write a table to a Parquet file with its sha256."""
    part = path.with_suffix(".tmp")
    with naming(path), part.open("wb") as opened:
        pq.write_table(table, opened, compression="zstd")
    with part.open("rb") as file:
        os.fsync(file.fileno())
        replace(part, path, file.read())


_COLUMN_TYPES = {
    "case": pa.int64(),
    "code": pa.int32(),
    "attempts": pa.int32(),
    "seconds": pa.float64(),
    "unmet": pa.list_(pa.string()),
    **dict.fromkeys(("status", "message", "worker", "versions"), pa.string()),
}


def _table(rows: Sequence[CaseRow]) -> pa.Table:
    """Convert rows to columns: how each ended, drawn values `in.`, numbers `out.`."""
    columns: dict[str, pa.Array] = {
        name: pa.array([getattr(row, name) for row in rows], kind)
        for name, kind in _COLUMN_TYPES.items()
    }
    ends = [row.stopped_when and row.stopped_when.time for row in rows]
    columns["stopped_when"] = pa.array(ends, pa.float64())
    value_rows = [dict(_flat(r.values)) for r in rows]
    for name in sorted({n for d in value_rows for n in d}):
        columns[f"in.{name}"] = pa.array([d.get(name) for d in value_rows])
    for name in sorted({n for r in rows for n in r.numbers}):
        columns[f"out.{name}"] = pa.array(
            [r.numbers.get(name) for r in rows], pa.float64()
        )
    return pa.table(dict(sorted(columns.items(), key=lambda c: (c[0] != "case", c[0]))))


def _flat(values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield drawn values element by element: `component.variable[i]`, i from 1."""
    for name, value in values.items():
        if not isinstance(value, list):
            yield name, value
        elif len(value) == 1:
            yield name, value[0]
        else:
            yield from ((f"{name}[{i}]", x) for i, x in enumerate(value, 1))


def _of_block(folder: Path, block: int) -> list[CaseRow]:
    """Read the rows of a block as they were added."""
    rows = []
    table = rows_in(_part(folder, CASES, block)).to_pylist()
    path = _part(folder, CURVES, block)
    curves = (
        {r.pop("case"): r for r in rows_in(path).to_pylist()} if path.exists() else {}
    )
    for entry in table:
        values = {
            k[3:]: v for k, v in entry.items() if k.startswith("in.") and v is not None
        }
        stopped = entry["stopped_when"]
        rows.append(
            CaseRow.from_json(
                {
                    **entry,
                    "values": values,
                    "numbers": {
                        k[4:]: v for k, v in entry.items() if k.startswith("out.")
                    },
                    "stopped_when": None if stopped is None else {"time": stopped},
                    "curves": curves.get(entry["case"]),
                }
            )
        )
    return rows


def read(
    folder: Path, kind: str = CASES, columns: Sequence[str] | None = None
) -> pa.Table:
    """Read all rows of a campaign in the order of the cases, also of an unfinished one.

    Only the named columns are read.

    Raises
    ------
    DesatError
        If there are no cases yet, or a file holds cases of another block.
    """
    blocks = sorted(_parts(folder))
    tables = []
    for block in blocks:
        path = _part(folder, kind, block)
        if path.exists():
            table = rows_in(path, columns)
            if (
                "case" in table.column_names
                and table.num_rows
                and (table["case"][0].as_py() // BLOCK != block)
            ):
                raise DesatError(
                    f"{path}: damaged (it has other cases); without it the same "
                    "command makes its cases again"
                )
            tables.append(table)
    rows = sorted(
        (r for r in _journal(folder) if r.case // BLOCK not in blocks),
        key=lambda r: r.case,
    )
    if rows and kind == CASES:
        last = _table(rows)
        names = last.column_names
        tables.append(
            last if columns is None else last.select([c for c in columns if c in names])
        )
    elif rows and any(r.curves is not None for r in rows):
        tables.append(_curves_table(rows))
    if not tables:
        if kind == CURVES:
            return pa.table({"case": pa.array([], pa.int64())})
        raise DesatError(f"{folder}: no case is there yet")
    return pa.concat_tables(tables, promote_options="permissive")


def versions_of(folder: Path, case: int) -> dict[str, str] | None:
    """Return the versions that a case was made with, or None if it does not exist."""
    path = _part(folder, CASES, case // BLOCK)
    columns = (
        [
            r["versions"]
            for r in rows_in(path, ["case", "versions"]).to_pylist()
            if r["case"] == case
        ]
        if path.exists()
        else []
    )
    columns = columns or [r.versions for r in _journal(folder) if r.case == case]
    versions: dict[str, str] | None = json.loads(columns[-1]) if columns else None
    return versions


def schema(folder: Path) -> pa.Schema:
    """Return the schema of the existing cases; raise DesatError if there are none."""
    parts = [columns(_part(folder, CASES, b)) for b in sorted(_parts(folder))]
    if rows := [r for r in _journal(folder) if r.case // BLOCK not in _parts(folder)]:
        parts.append(_table(rows).schema)
    if not parts:
        raise DesatError(f"{folder}: no case is there yet")
    return pa.unify_schemas(parts, promote_options="permissive")


def described(folder: Path) -> dict[str, dict[str, str]]:
    """Read title and unit of numbers, of `in.component.variable` and `curve.PLOT`."""
    path = folder / NUMBERS
    if not path.exists():
        return {}
    from pydantic import TypeAdapter, ValidationError

    try:
        return TypeAdapter(dict[str, dict[str, str]]).validate_python(
            table(path), strict=True
        )
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise DesatError(f"{path}: damaged ({place}: {first['msg']})") from error


def digest(folder: Path, first: int | None = None) -> str:
    """Compute the sha256 of all existing cases and curves, except for columns `BOOKKEEPING`.

    It is equal for equal campaigns. With `first` it covers only that many cases.
    """
    hashed = hashlib.sha256()
    for kind in (CASES, CURVES):
        table = read(folder, kind).slice(0, first)
        names = [n for n in table.column_names if n not in BOOKKEEPING]
        for name in sorted(names):
            hashed.update(f"{name}\0{table[name].type}\0".encode())
            for value in table[name].to_pylist():
                hashed.update(f"{value!r}\0".encode())
    return hashed.hexdigest()
