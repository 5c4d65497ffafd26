"""Cases on a Dask cluster: the same function as on this machine, and the system once
per worker."""

from __future__ import annotations

import io
import logging
import os
import queue
import sys
import threading
import zipfile
from collections.abc import Hashable, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from ..files import library
from ..files.identity import versions
from ..system.errors import DesatError, Exit, RunError
from .case import batch
from .plan import CampaignPlan, digest_of
from .store import Batch
from .workers import Lost

WAIT = "15s"
"""How long a cluster has to answer."""
LARGEST = 256_000_000
"""Bytes of a system that are sent to a worker."""
_PARTS = (".toml", ".ssd", ".fmu", ".ssv")
_LATE = 75
"""The exit code of a worker that ends itself as a case takes too long."""
SETTINGS = {
    "distributed.comm.timeouts.connect": WAIT,
    "distributed.scheduler.allowed-failures": 0,
    "distributed.worker.daemon": False,
    # a tree of calls a second, kept for an hour: a worker grew by 0.2 MB a second
    "distributed.worker.profile.enabled": False,
}
"""What of Dask is other than by default: here, and in the workers of `local:N`."""


class Unfit(Exception):  # noqa: N818
    """A worker cannot make the cases of this campaign, which says why."""


_shipped: dict[str, str] = {}
"""On a worker: digest of a system that is a file -> the file here."""


_compared: dict[tuple[str, str], str] = {}
"""On a worker: what `_compare` has said of a system."""


def shipped(target: str) -> bytes | None:
    """What a target is made of, where it is a file: the archive, or a scenario file
    with the other scenario files and FMUs of its folder, zipped. None for a scenario of
    ours. Raises DesatError for more than LARGEST bytes."""
    path = Path(target)
    if not path.exists():
        return None
    buffer = io.BytesIO()
    whole = path.suffix == ".toml"
    files = (
        sorted(p for p in path.parent.iterdir() if p.suffix in _PARTS)
        if whole
        else [path]
    )
    if (size := sum(p.stat().st_size for p in files)) > LARGEST:
        raise DesatError(
            f"{path.parent}: {size / 1e6:.0f} MB of scenario files and FMUs would be "
            f"sent to each worker; at most {LARGEST / 1e6:.0f} are"
        )
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name), file.read_bytes())
    return buffer.getvalue()


def keep(plan: CampaignPlan, data: bytes) -> None:
    """On a worker: keep a system that is a file for the cases to come."""
    if plan.digest not in _shipped:
        folder = library.scratch("run-campaign")
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            archive.extractall(folder)
        _shipped[plan.digest] = str(folder / Path(plan.target).name)


def _plugin(plan: CampaignPlan, data: bytes) -> Any:
    """What every worker gets once, also one that comes later."""
    from distributed import WorkerPlugin

    class System(WorkerPlugin):  # type: ignore[misc]
        name = f"desat-{plan.digest}"

        def setup(self, worker: Any) -> None:
            keep(plan, data)

    return System()


def other(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """The first package of a worker that is another one than the head's; empty without."""
    for name, version in here.items():
        if there.get(name) != version:
            return f"{name} {there.get(name)}, here it is {version}; the same is needed"
    return ""


def unfit(plan: CampaignPlan, sent: bool, here: Mapping[str, str]) -> str:
    """On a worker, which may have come late: why it cannot make the cases of a
    campaign; empty where it can. `here`: the head's versions; `sent`: the system is a
    file."""
    if text := other(versions(), here):
        return f"has {text}"
    if sent and plan.digest not in _shipped:
        return "has not got the system"
    key = (plan.digest, plan.target)
    if key not in _compared:
        _compared[key] = _compared_with(_here(plan, sent))
    return _compared[key]


def _here(plan: CampaignPlan, sent: bool) -> CampaignPlan:
    """On a worker: the plan of the system as it is here."""
    return replace(plan, target=_shipped[plan.digest]) if sent else plan


def _compared_with(plan: CampaignPlan) -> str:
    try:
        there = digest_of(plan.target, plan.options)
    except DesatError as error:
        return f"cannot have the system: {error}"
    return (
        ""
        if there == plan.digest
        else (
            f"has another {plan.target}: its wiring, times, content, parameters or FMUs differ"
        )
    )


def on_worker(
    plan: CampaignPlan,
    sent: bool,
    here: dict[str, str],
    numbers: Sequence[int],
    attempt: int,
    told: str,
) -> Batch:
    """On a worker: cases of one block. Those that take too long end their worker, which
    its nanny replaces. Raises Unfit where the worker has other versions than the head,
    or another system."""
    if why := unfit(plan, sent, here):
        raise Unfit(why)
    timer = threading.Timer(plan.limit, os._exit, (_LATE,))
    timer.daemon = True
    if attempt == 1:  # a supervised case ends itself
        timer.start()
    try:
        return batch(_here(plan, sent), numbers, attempt, told)
    finally:
        timer.cancel()


class Cluster:
    """The workers of a Dask cluster: an address, a scheduler file, or `local:N`
    processes here."""

    def __init__(self, address: str, plan: CampaignPlan) -> None:
        try:
            import distributed
        except ImportError as error:
            raise DesatError(
                "--cluster needs Dask: pip install 'desat[cluster]'"
            ) from error
        import dask

        if ":" not in address and not Path(address).is_file():
            raise DesatError(
                f"--cluster {address}: no such file, and no address such as "
                "tcp://HOST:8786 or local:2"
            )
        self._plan, self._address, self._local = plan, address, None
        dask.config.set(SETTINGS)
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(
                logging.CRITICAL + 1
            )  # we say it in a line
        try:
            if address.startswith("local:"):
                self._local = distributed.LocalCluster(
                    n_workers=_whole(address),
                    threads_per_worker=1,
                    dashboard_address=None,
                    silence_logs=50,
                )
                self._client = distributed.Client(self._local)
            elif Path(address).is_file():
                self._client = distributed.Client(scheduler_file=address, timeout=WAIT)
            else:
                self._client = distributed.Client(address, timeout=WAIT)
        except (OSError, TimeoutError, ValueError, KeyError, TypeError) as error:
            raise RunError(
                f"--cluster {address}: no scheduler answers ({error})", Exit.INPUT
            ) from error
        data = shipped(plan.target)
        self._sent = data is not None
        self._done: queue.SimpleQueue[tuple[Hashable, tuple[Any, ...], Any]] = (
            queue.SimpleQueue()
        )
        self._sent_away: list[str] = []
        try:
            if not (threads := self._client.nthreads()):
                raise DesatError(f"--cluster {address}: it has no workers")
            if data is not None:
                self._client.register_plugin(_plugin(plan, data))
            for worker, why in self._unfit().items():
                raise DesatError(f"--cluster {address}: worker {worker} {why}")
        except BaseException:
            self._close()
            raise
        self.size = max(1, sum(threads.values()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def _close(self) -> None:
        self._client.close()
        if self._local is not None:
            self._local.close()

    def _unfit(self) -> dict[str, str]:
        """Of each worker that cannot make these cases, why."""
        told = self._client.run(
            unfit, self._plan, self._sent, versions(), on_error="return"
        )
        # one that dies just now does not answer; one without desat has no such function
        return {
            worker: said if isinstance(said, str) else f"cannot be asked: {said}"
            for worker, said in sorted(told.items())
            if said and not isinstance(said, OSError)
        }

    def _send_away(self) -> bool:
        """End the workers that came late and cannot make these cases, a line each: one
        that only refused them would be free at once for the next. Whether there is or
        was any."""
        if found := self._unfit():
            for worker, why in found.items():
                print(f"worker {worker} {why}: sent away", file=sys.stderr, flush=True)
            self._client.retire_workers(list(found))
            self._sent_away += found
        return bool(self._sent_away)

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Have cases made: their numbers, which attempt it is, and the versions that
        rows say."""
        future = self._client.submit(
            on_worker, self._plan, self._sent, versions(), *arguments, pure=False
        )
        future.add_done_callback(lambda ended: self._done.put((key, arguments, ended)))

    def ended(self) -> tuple[Hashable, Any]:
        """The next cases that have ended. Raises RunError where the scheduler is gone."""
        from distributed import KilledWorker

        while True:
            key, arguments, future = self._done.get()
            try:
                return key, future.result()
            except KilledWorker:
                return key, Lost(
                    "its worker died, or ended itself as it was not over within "
                    f"{self._plan.limit:g} s"
                )
            except CancelledError as error:
                text = f"--cluster {self._address}: the scheduler is gone"
                raise RunError(
                    f"{text}; the same command continues with the remaining cases",
                    Exit.COMPONENT,
                ) from error
            except Unfit:
                self._send_away()
            except ImportError:  # it has no desat, or another one
                if not self._send_away():
                    raise
            self.submit(key, *arguments)


def _whole(address: str) -> int:
    text = address.partition(":")[2]
    if not text.isdecimal() or int(text) < 1:
        raise DesatError(
            f"--cluster {address}: local:N is needed, N a whole number from 1 on"
        )
    return int(text)
