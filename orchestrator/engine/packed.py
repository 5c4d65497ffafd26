"""Makes the series of a run that is over smaller, and known to other programs.

While a run goes on its Reals are written as they are: what is flushed stays readable when it is
killed, and compressing takes longer than writing. When it is over every data set is compressed
(shuffle and deflate, which every reader of HDF5 has), and gets its times as dimension scale:
`/time` for states, `/.interval` for what holds over [t_k, t_k+1).
"""

from __future__ import annotations

import os
import shutil
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from . import wide
from .wide import INTERVAL

_LEVEL = 1
_SAMPLE = 384
"""Bytes of each third of a chunk's n-th bytes by which it is seen whether they shrink."""
_AHEAD = 16
"""Chunks that are compressed before they are written."""
_OURS = ("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST")
"""Attributes by which HDF5 keeps scales; they point into their own file."""


def pack(path: Path) -> None:
    """Pack a closed file in its place. Where the disk has no room for both it stays as it is."""
    if shutil.disk_usage(path.parent).free < path.stat().st_size:
        return
    part = path.with_name(f"{path.name}.packing")
    try:
        with (
            h5py.File(path, "r") as old,
            h5py.File(part, "w") as new,
            ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool,
        ):
            new.attrs.update(old.attrs)
            _times(old, new, pool)
            if wide.INDEX in old:
                new.create_dataset(wide.INDEX, data=old[wide.INDEX][()])
            for source in wide.data_sets(old):
                _scaled(new, _copied(source, new, pool))
        part.replace(path)
    except (OSError, RuntimeError):  # h5py knows a full disk as either
        part.unlink(missing_ok=True)


def _times(old: Any, new: Any, pool: ThreadPoolExecutor) -> None:
    """The scales."""
    _copied(old["time"], new, pool).make_scale("time")
    rows = [len(d) for d in wide.data_sets(old) if _is_interval(d)]
    if rows:
        begin = new.create_dataset(INTERVAL, data=old["time"][: rows[0]])
        begin.attrs.update({"unit": "s", "description": "begin t_k of the interval"})
        begin.make_scale("interval")


def _is_interval(dataset: Any) -> bool:
    name = dataset.name.rpartition("/")[2]
    found: bool = dataset.attrs.get("class") == "interval" or name.startswith(f"{INTERVAL}.")
    return found


def _scaled(new: Any, dataset: Any) -> None:
    scale = new[INTERVAL if _is_interval(dataset) else "time"]
    dataset.dims[0].label = "interval" if _is_interval(dataset) else "time"
    dataset.dims[0].attach_scale(scale)


def _copied(source: Any, new: Any, pool: ThreadPoolExecutor) -> Any:
    """A data set in another file, compressed."""
    made = new.create_dataset(
        source.name, source.shape, source.dtype, chunks=source.chunks, maxshape=source.maxshape,
        shuffle=True, compression="gzip", compression_opts=_LEVEL,
    )  # fmt: skip
    made.attrs.update({k: v for k, v in source.attrs.items() if k not in _OURS})
    places = _chunks(source.shape, source.chunks)
    while ahead := [p for _, p in zip(range(_AHEAD), places, strict=False)]:
        blocks = [_block(source, at) for at in ahead]
        for at, data in zip(ahead, pool.map(_deflated, blocks), strict=True):
            made.id.write_direct_chunk(at, data)
    return made


def _chunks(shape: tuple[int, ...], chunk: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Where the chunks of a data set begin."""
    steps = [range(0, n, k) for n, k in zip(shape, chunk, strict=True)]
    for first in steps[0]:
        if len(steps) == 1:
            yield (first,)
        else:
            yield from ((first, second) for second in steps[1])


def _block(source: Any, at: tuple[int, ...]) -> NDArray[Any]:
    """A chunk, whole: zeros beyond the end."""
    block = np.zeros(source.chunks, source.dtype)
    part = source[tuple(slice(a, a + k) for a, k in zip(at, source.chunks, strict=True))]
    block[tuple(slice(0, n) for n in part.shape)] = part
    return block


def _deflated(block: NDArray[Any]) -> bytes:
    """A chunk as HDF5's filters shuffle and deflate leave it: first bytes first. The last bytes of
    measured values are noise, on which deflate spends two thirds of its time for nothing: they are
    blocks that are stored."""
    octets = block.reshape(-1).view(np.uint8).reshape(-1, block.dtype.itemsize)
    made, total = [b"\x78\x01"], 1
    for plane in np.ascontiguousarray(octets.T):
        data = plane.tobytes()
        total = zlib.adler32(data, total)
        deflate = zlib.compressobj(_LEVEL if _shrinks(data) else 0, zlib.DEFLATED, -zlib.MAX_WBITS)
        made += [deflate.compress(data), deflate.flush(zlib.Z_FULL_FLUSH)]
    return b"".join([*made, b"\x03\x00", total.to_bytes(4, "big")])


def _shrinks(data: bytes) -> bool:
    """True where a sample of it does."""
    third = len(data) // 3
    sample = b"".join(data[i * third :][:_SAMPLE] for i in range(3))
    return len(zlib.compress(sample, _LEVEL)) < 0.9 * len(sample)
