"""`make release`: all that a release has, into build/release/desat-VERSION/.

- the wheel and the source distribution, tried in empty environments of each Python that is asked
  for and found here: a craft of one's own is begun, flown and sized, a page of help is read;
- the FMUs of all platforms that the package ziglang builds for, and the site, a zip each;
- the bill of materials (CycloneDX) of the environment with the wheel alone;
- SHA256SUMS of all of it, and TRIED.md: what was tried with which versions, and how it ended.

Ends with 1 where a trial fails.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
COMMANDS = (
    "desat --version",
    "desat list",
    "desat help own-block",
    "desat new craft my12u --size 12U --altitude 400km --rods 0.2",
    "desat run my12u --stop 10min",
    "desat size my12u --stop 2orbits --no-year --own-law --no-loop",
)
"""What is tried with the wheel, from an empty folder."""
DATE = (1980, 1, 1, 0, 0, 0)


def do(*command: str | Path, cwd: Path | None = None, **more: str) -> str:
    """What a command prints. Raises RuntimeError, with its last lines, where it fails."""
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "DESAT"))
    }
    done = subprocess.run(
        [str(x) for x in command],
        cwd=cwd or ROOT,
        env={**environment, **more},
        text=True,
        capture_output=True,
        check=False,
    )
    if done.returncode:
        last = "\n".join((done.stdout + done.stderr).strip().splitlines()[-8:])
        raise RuntimeError(
            f"{' '.join(map(str, command))}: exit code {done.returncode}\n{last}"
        )
    return done.stdout


def packed(folder: Path, file: Path, form: str = "**/*") -> None:
    """A folder as a zip, the same bytes of the same contents."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in folder.glob(form) if p.is_file()):
            entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, path.read_bytes())


def found(python: str) -> str | None:
    """The interpreter of a version that is here, of pyenv's too; None where there is
    none."""
    folders = sorted((Path.home() / ".pyenv" / "versions").glob(f"{python}.*/bin"))
    for path in (
        shutil.which(f"python{python}"),
        *(str(p / "python") for p in folders),
    ):
        if path is None:
            continue
        process = subprocess.run(
            [path, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"],
            capture_output=True,
            text=True,
            check=False,
        )
        if process.stdout.strip() == python:
            return path
    return None


def tried(wheel: Path, python: str, work: Path) -> tuple[Path, list[tuple[str, str]]]:
    """The environment of a trial, and how each command ended there. Raises RuntimeError
    for one that failed."""
    environment, empty = work / f"env-{python}", work / f"empty-{python}"
    empty.mkdir()
    do(str(found(python)), "-m", "venv", environment)
    do(
        environment / "bin/python",
        "-m",
        "pip",
        "install",
        "-q",
        "--disable-pip-version-check",
        wheel,
    )
    ended = []
    for line in COMMANDS:
        name, *rest = line.split()
        message = do(
            environment / "bin" / name,
            *rest,
            cwd=empty,
            DESAT_CACHE=str(work / f"cache-{python}"),
        )
        ended.append(
            (
                line,
                next((x for x in message.splitlines() if x.strip()), "").strip()[:90],
            )
        )
    return environment, ended


def main() -> None:
    """Make it all, and say what came of it."""
    number = version("desat")
    if not re.search(
        rf"^## {re.escape(number)}\b", (ROOT / "CHANGELOG.md").read_text(), re.M
    ):
        raise SystemExit(f"CHANGELOG.md says nothing of {number}")
    out = ROOT / "build" / "release" / f"desat-{number}"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    print("wheel and source distribution", flush=True)
    do(sys.executable, "-m", "build", "-q", "--outdir", out, ROOT)
    (wheel,) = out.glob("*.whl")
    print("FMUs of all platforms", flush=True)
    fmus = ROOT / "build" / "release" / "fmus"
    do(sys.executable, "-m", "desat.fmus.build", "--into", fmus, "--platforms", "all")
    packed(fmus, out / f"desat-fmus-{number}.zip", "**/*.fmu")
    packed(ROOT / "build" / "site", out / f"desat-site-{number}.zip")
    lines = [f"# desat {number}, tried on {datetime.now(UTC).date()}", ""]
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for python in PYTHONS:
            if found(python) is None:
                lines.append(f"- Python {python}: not tried, there is none here")
                continue
            print(f"the wheel with Python {python}", flush=True)
            try:
                environment, ended = tried(wheel, python, work)
            except RuntimeError as error:
                failed = True
                lines += [
                    f"- Python {python}: FAILED",
                    "",
                    *(f"      {x}" for x in str(error).splitlines()),
                    "",
                ]
                continue
            listed = json.loads(
                do(
                    environment / "bin/python",
                    "-m",
                    "pip",
                    "list",
                    "--format",
                    "json",
                    "--disable-pip-version-check",
                )
            )
            shown = (
                "numpy",
                "scipy",
                "fmpy",
                "pythonfmu",
                "typer",
                "pydantic",
                "pandas",
            )
            versions = ", ".join(
                f"{x['name']} {x['version']}"
                for x in listed
                if x["name"].lower() in shown
            )
            lines += [
                f"- Python {python}: all commands end well; {versions}",
                *(f"  - `{line}`: {message}" for line, message in ended),
            ]
            bill = out / f"desat-{number}.cdx.json"
            if not bill.exists():
                do(
                    sys.executable,
                    "-m",
                    "cyclonedx_py",
                    "environment",
                    "--of",
                    "JSON",
                    "-o",
                    bill,
                    environment / "bin/python",
                )
    (out / "TRIED.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    files = sorted(p for p in out.iterdir() if p.name != "SHA256SUMS")
    sums = "".join(
        f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}\n" for p in files
    )
    (out / "SHA256SUMS").write_text(sums, encoding="utf-8")
    print("\n".join(lines))
    for path in [*files, out / "SHA256SUMS"]:
        print(f"{path.stat().st_size / 1e6:8.2f} MB  {path.relative_to(ROOT)}")
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
