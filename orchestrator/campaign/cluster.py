"""Run cases on a Dask cluster, with the function used on this machine.

The system is sent once per worker.
"""

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
from .workers import NoResult

WAIT = "15s"  # time that a cluster has to answer
LARGEST = 256_000_000  # bytes: limit of a system that is sent to a worker
_PARTS = (".toml", ".ssd", ".fmu", ".ssv")
_LATE = 75  # exit code of a worker that ends itself because a case takes too long
# Settings of Dask that differ from the defaults, here and in the workers of `local:N`.
SETTINGS = {
    "distributed.comm.timeouts.connect": WAIT,
    "distributed.scheduler.allowed-failures": 0,
    "distributed.worker.daemon": False,
    # the profiler keeps its samples for an hour: a worker grew by 0.2 MB a second
    "distributed.worker.profile.enabled": False,
}


class Unfit(Exception):  # noqa: N818
    """Reason why a worker cannot make the cases of this campaign."""


# On a worker: digest of a system that is a file -> the file there.
_shipped: dict[str, str] = {}


# On a worker: result of `_compared_with` for a system.
_compared: dict[tuple[str, str], str] = {}


def shipped(target: str) -> bytes | None:
    """Pack the files of a target as a zip archive, or return None for our scenarios.

    The target is an archive, or a scenario file with the other scenario files and FMUs
    of its folder.

    Raises
    ------
    DesatError
        If they have more than `LARGEST` bytes.
    """
    path = Path(target)
    if not path.exists():
        return None
    buffer = io.BytesIO()
    is_craft = path.suffix == ".toml"
    files = (
        sorted(p for p in path.parent.iterdir() if p.suffix in _PARTS)
        if is_craft
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
    """On a worker: keep a system that is a file for later cases."""
    if plan.digest not in _shipped:
        folder = library.scratch("run-campaign")
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            archive.extractall(folder)
        _shipped[plan.digest] = str(folder / Path(plan.target).name)


def _plugin(plan: CampaignPlan, data: bytes) -> Any:
    """Build the plugin that gives every worker the system once, also later ones."""
    from distributed import WorkerPlugin

    class ShippedSystem(WorkerPlugin):  # type: ignore[misc]
        name = f"desat-{plan.digest}"

        def setup(self, worker: Any) -> None:
            keep(plan, data)

    return ShippedSystem()


def other(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return a text for the first package whose version on a worker differs.

    It is empty where all are the same.
    """
    for name, version in here.items():
        if there.get(name) != version:
            return f"{name} {there.get(name)}, here it is {version}; the same is needed"
    return ""


def unfit(plan: CampaignPlan, sent: bool, here: Mapping[str, str]) -> str:
    """On a worker: return the reason why it cannot make the cases of a campaign, or "".

    The worker may have come late. `here` are the versions of the coordinator, and with
    `sent` the system is a file.
    """
    if text := other(versions(), here):
        return f"has {text}"
    if sent and plan.digest not in _shipped:
        return "has not got the system"
    key = (plan.digest, plan.target)
    if key not in _compared:
        _compared[key] = _compared_with(_here(plan, sent))
    return _compared[key]


def _here(plan: CampaignPlan, sent: bool) -> CampaignPlan:
    """On a worker: return the plan with the system as it is there."""
    return replace(plan, target=_shipped[plan.digest]) if sent else plan


def _compared_with(plan: CampaignPlan) -> str:
    """Return the reason why the system of a plan is not the coordinator's, or ""."""
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
    description: str,
) -> Batch:
    """On a worker: run cases of one block.

    Cases that take too long end their worker, which its nanny replaces. Raises Unfit
    where the worker has other versions than the coordinator, or another system.
    """
    if reason := unfit(plan, sent, here):
        raise Unfit(reason)
    timer = threading.Timer(plan.limit, os._exit, (_LATE,))
    timer.daemon = True
    if attempt == 1:  # a supervised case ends itself
        timer.start()
    try:
        return batch(_here(plan, sent), numbers, attempt, description)
    finally:
        timer.cancel()


class Cluster:
    """Workers of a Dask cluster.

    They are named by an address, a scheduler file, or `local:N` processes here.
    """

    def __init__(self, address: str, plan: CampaignPlan) -> None:
        """Connect to the scheduler at an address and send the system to its workers.

        Raises DesatError if there is none, or if its packages differ.
        """
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
            )  # errors are reported in a line of ours
        try:
            self._client = self._connect(distributed)
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
            for worker, reason in self._unfit().items():
                raise DesatError(f"--cluster {address}: worker {worker} {reason}")
        except BaseException:
            self._close()
            raise
        self.size = max(1, sum(threads.values()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def _connect(self, distributed: Any) -> Any:
        """Return a client of the scheduler, which is begun here for `local:N`."""
        address = self._address
        if address.startswith("local:"):
            self._local = distributed.LocalCluster(
                n_workers=worker_count(address),
                threads_per_worker=1,
                dashboard_address=None,
                silence_logs=50,
            )
            return distributed.Client(self._local)
        if Path(address).is_file():
            return distributed.Client(scheduler_file=address, timeout=WAIT)
        return distributed.Client(address, timeout=WAIT)

    def _close(self) -> None:
        """Close the client, and a local cluster."""
        self._client.close()
        if self._local is not None:
            self._local.close()

    def _unfit(self) -> dict[str, str]:
        """Return the reason for each worker that cannot make these cases."""
        answers = self._client.run(
            unfit, self._plan, self._sent, versions(), on_error="return"
        )
        # a dying worker does not answer; one without desat lacks the function
        return {
            worker: answer if isinstance(answer, str) else f"cannot be asked: {answer}"
            for worker, answer in sorted(answers.items())
            if answer and not isinstance(answer, OSError)
        }

    def _send_away(self) -> bool:
        """Retire late workers that cannot make these cases, with a line each.

        A worker that only refused them would be free for the next ones at once. Returns
        whether any was ever retired.
        """
        if obstacle := self._unfit():
            for worker, reason in obstacle.items():
                print(
                    f"worker {worker} {reason}: sent away", file=sys.stderr, flush=True
                )
            self._client.retire_workers(list(obstacle))
            self._sent_away += obstacle
        return bool(self._sent_away)

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Submit cases: their numbers, the attempt, and the versions for their rows."""
        future = self._client.submit(
            on_worker, self._plan, self._sent, versions(), *arguments, pure=False
        )
        future.add_done_callback(lambda ended: self._done.put((key, arguments, ended)))

    def ended(self) -> tuple[Hashable, Any]:
        """Wait for the next cases that end; raise RunError if the scheduler is gone."""
        from distributed import KilledWorker

        while True:
            key, arguments, future = self._done.get()
            try:
                return key, future.result()
            except KilledWorker:
                return key, NoResult(
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


def worker_count(address: str) -> int:
    """Parse the number of workers of `local:N`; raise DesatError for another form."""
    text = address.partition(":")[2]
    if not text.isdecimal() or int(text) < 1:
        raise DesatError(
            f"--cluster {address}: local:N is needed, N a whole number from 1 on"
        )
    return int(text)
