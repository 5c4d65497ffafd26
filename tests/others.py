"""What other tools do where an FMU fails: `python tests/others.py [--keep] [TOOL ...]`.

failing.c, packed with our pack, fails in its fourth step of 1 s of ten. Each failure
and tool is a process of its own, which says each step that it has made; what is seen is
how the process ended, and the values that it had. `Ecos, proxyfmu` has each FMU in a
process, by the program that its package brings. With `--keep` it goes to
benchmarks/seen.json. A tool that is not installed is left out, and said; OMSimulator's
package could not be installed (docs/failures.md).
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import seen  # noqa: E402
from benchmarks.seen import FAILURES  # noqa: E402
from desat.engine.current_call import describe_exit  # noqa: E402
from desat.engine.recording.results import Results  # noqa: E402
from desat.export.packing import pack  # noqa: E402
from desat.runs.run import Options, prepare  # noqa: E402
from tests.engine.test_failures import FAILURES as WAYS  # noqa: E402
from tests.engine.test_failures import compile_failing, fmu, ssd  # noqa: E402

PATIENCE = 10.0
"""A process that has not ended after so long (s) is killed."""
SITE = Path(sysconfig.get_paths()["purelib"])
LIBCOSIM = """
import sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
log_output_level(CosimLogLevel.WARNING)
execution = CosimExecution.from_ssp_file(sys.argv[1])
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
index = execution.slave_infos()[0].index
for k in range(10):
    went = execution.step()
    print("ROW", bool(went), observer.last_real_values(index, [1])[0], flush=True)
print("FREED", flush=True)
"""
ECOS = """
import ctypes, glob, os, sys, sysconfig
site = sysconfig.get_paths()["purelib"]
for pattern in ("../../libtbb.so.12", "*/libtbb.so.12"):
    for found in glob.glob(os.path.join(site, pattern)):
        ctypes.CDLL(found, mode=ctypes.RTLD_GLOBAL)
from ecospy import EcosSimulation
with EcosSimulation(ssp_path=sys.argv[1], step_size=1.0) as sim:
    sim.init(parameter_set="parameters")
    for k in range(10):
        went = sim.step(1)
        print("ROW", went, sim.get_real("bad::y"), flush=True)
print("FREED", flush=True)
"""
PACKAGES = {
    "desat": "desat",
    "libcosim": "libcosimpy",
    "Ecos": "ecospy",
    "Ecos, proxyfmu": "ecospy",
}
SOURCE = b'source="resources/bad.fmu"'


def write_system(failure: str, folder: Path, binary: bytes) -> Path:
    """The system with the FMU that fails so, as .ssp."""
    fmu(folder / "resources/failing.fmu", binary)
    (folder / "SystemStructure.ssd").write_text(ssd())
    options = Options(sets=[f"bad.how={WAYS.index(failure)}"], step=1.0)
    path = folder / f"{failure}.ssp"
    pack(prepare(str(folder), options).or_raise()[0], path)
    return path


def through_proxy(path: Path, folder: Path) -> tuple[str, Path, dict[str, str]]:
    """Interpreter, system and environment with which Ecos has each FMU in a process."""
    folder.mkdir(exist_ok=True)
    for program in (Path(sys.executable), SITE / "ecospy/binaries/proxyfmu"):
        shutil.copy(
            program, folder / program.name
        )  # it is looked for beside the interpreter
        (folder / program.name).chmod(0o755)
    system = folder / path.name
    with zipfile.ZipFile(path) as original, zipfile.ZipFile(system, "w") as archive:
        for name in original.namelist():
            data = original.read(name)
            proxy_source = SOURCE.replace(
                b"resources", b"proxyfmu://localhost?file=resources"
            )
            archive.writestr(
                name,
                data.replace(SOURCE, proxy_source) if name.endswith(".ssd") else data,
            )
    environment = {
        "PYTHONHOME": sys.base_prefix,
        "PYTHONPATH": str(SITE),
        "LD_LIBRARY_PATH": str(SITE.parents[1]),
    }
    return str(folder / Path(sys.executable).name), system, environment


def ours(path: Path, folder: Path) -> dict[str, Any]:
    """The same of `desat run`, of what its folder holds then."""
    process = subprocess.run(
        [
            sys.executable,
            "-m",
            "desat.cli",
            "run",
            str(path),
            "--out",
            str(folder / "out"),
            "--call-limit",
            "2",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    with Results.open(folder / "out") as results:
        times, values = results.times()[1:], results.values("bad.y")[1:]
    return {
        "ended": f"exit({process.returncode})",
        "rows": len(times),
        "refused": 0,
        "wrong": int((times != values).sum()),
    }


def outcome(tool: str, path: Path, folder: Path) -> dict[str, Any]:
    """How the process of a tool ended that runs this system."""
    if tool == "desat":
        return ours(path, folder)
    interpreter, more = sys.executable, dict[str, str]()
    if tool == "Ecos, proxyfmu":
        interpreter, path, more = through_proxy(path, folder / "bin")
    code = LIBCOSIM if tool == "libcosim" else ECOS
    process = subprocess.Popen(
        [interpreter, "-c", code, str(path)],
        env={**os.environ, **more},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        cwd=folder,
    )
    try:
        out, _ = process.communicate(timeout=PATIENCE)
        number = process.returncode
        ending = describe_exit(-number if number < 0 else number << 8)
    except subprocess.TimeoutExpired:
        ending = "waits"
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)  # also what it has started
    if ending == "waits":
        out, _ = process.communicate()
    rows = [x.split()[1:] for x in out.splitlines() if x.startswith("ROW ")]
    values = [float(r[1]) for r in rows]
    return {
        "ended": ending,
        "rows": len(rows),
        "refused": sum(r[0] == "False" for r in rows),
        "wrong": sum(x != k + 1.0 for k, x in enumerate(values)),
    }


def all_of(tool: str, failures: Iterable[str] = FAILURES) -> dict[str, dict[str, Any]]:
    """What came of each failure in a tool. `rows`: the steps that were made, of them
    `refused` those of which it said that they failed, `wrong` those whose value is not
    that of their time."""
    outcomes = {}
    with tempfile.TemporaryDirectory() as directory:
        binary = compile_failing(Path(directory))
        for failure in failures:
            folder = Path(directory) / failure
            folder.mkdir()
            outcomes[failure] = outcome(
                tool, write_system(failure, folder, binary), folder
            )
    return outcomes


def main() -> None:
    """All failures in all tools, or in those that are named."""
    keep = seen.is_writing()
    for tool in sys.argv[1:] or PACKAGES:
        package = PACKAGES[tool]
        if importlib.util.find_spec(package) is None:
            print(f"{tool}: {package} is not installed")
            continue
        for failure, failure_outcome in (results := all_of(tool)).items():
            print(f"{tool}: {FAILURES[failure]}: {failure_outcome}", flush=True)
        if keep:
            seen.keep("others", tool, {"version": version(package), **results})


if __name__ == "__main__":
    main()
