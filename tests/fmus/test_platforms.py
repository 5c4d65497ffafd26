"""Native FMUs for other platforms, by the package ziglang; run under wine where that
is."""

from __future__ import annotations

import importlib.util
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest

from desat.files import library
from desat.fmus import native
from tests.conftest import ROOT
from tests.fmus.test_native import path

ZIG = bool(importlib.util.find_spec("ziglang"))
WINE = (
    shutil.which("wine64")
    or shutil.which("wine")
    or shutil.which("/usr/lib/wine/wine64")
)
HOST = """
#include <stdio.h>
#if defined(_WIN32)
#include <windows.h>
#define OPEN(path) (void *)LoadLibraryA(path)
#define FIND(library, name) (void *)GetProcAddress((HMODULE)(library), name)
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FIND(library, name) dlsym(library, name)
#endif
#define CALL(name, ...) ((int (*)())FIND(library, "fmi2" #name))(__VA_ARGS__)
typedef struct { void *log, *get, *free, *end, *environment; } Calls;
int main(int n, char **given)
{
    void *library = OPEN(given[1]);
    Calls calls = {0};
    void *(*make)(const char *, int, const char *, const char *, Calls *, int, int);
    if (library == NULL) return 2;
    make = (void *(*)(const char *, int, const char *, const char *, Calls *, int, int))
        FIND(library, "fmi2Instantiate");
    void *c = make("host", 1, given[2], "", &calls, 0, 0);
    if (c == NULL) return 3;
    int (*setup)(void *, int, double, double, int, double) =
        (int (*)(void *, int, double, double, int, double))FIND(library, "fmi2SetupExperiment");
    int (*step)(void *, double, double, int) =
        (int (*)(void *, double, double, int))FIND(library, "fmi2DoStep");
    unsigned count = (unsigned)(n > 3 ? n - 3 : 0), reference;
    double x;
    setup(c, 0, 0.0, 0.0, 0, 0.0);
    CALL(EnterInitializationMode, c);
    CALL(ExitInitializationMode, c);
    for (int k = 0; k < 50; k++) {
        if (step(c, (double)k, 1.0, 1) != 0) return 4;
        for (unsigned i = 0; i < count; i++) {
            if (sscanf(given[3 + i], "%u", &reference) != 1) return 5;
            CALL(GetReal, c, &reference, (size_t)1, &x);
            printf("%a ", x);
        }
    }
    return 0;
}
"""


def test_libraries_of_two_processors_are_one_file():
    first, second = (
        struct.pack("<III", 0xFEEDFACF, kind, 3) + bytes(20000) for kind in (7, 12)
    )
    assert native.universal([first]) == first
    full = native.universal([first, second])
    magic, count = struct.unpack_from(">II", full)
    assert (magic, count) == (0xCAFEBABE, 2)
    for i, binary in enumerate((first, second)):
        processor, _, at, size, power = struct.unpack_from(">IIIII", full, 8 + 20 * i)
        assert at % (1 << power) == 0
        assert full[at : at + size] == binary
        assert processor == (7, 12)[i]


def test_a_library_of_windows_has_no_time_in_it():
    def make_library(at: int) -> bytes:
        head = bytearray(b"MZ" + bytes(198))
        struct.pack_into("<I", head, 60, 120)
        struct.pack_into("<4sHHI", head, 120, b"PE", 0x8664, 9, at)
        return bytes(head)

    assert make_library(1) != make_library(2)
    assert (
        native.undated(make_library(1))
        == native.undated(make_library(2))
        == make_library(0)
    )
    assert native.undated(b"\x7fELF" + bytes(200)) == b"\x7fELF" + bytes(200)


def test_a_platform_that_there_is_not_is_named(desat, tmp_path, monkeypatch):
    monkeypatch.setattr(native, "zig", lambda: ("zig",))
    file = tmp_path / "x.py"
    file.write_text("")
    command = desat("build", str(file), "--platforms", "win32")
    assert command.returncode == 2
    assert (
        "platform win32: there is all, linux64, win64, darwin64, aarch64-linux"
        in command.stderr
    )


def test_a_loop_is_for_the_platforms_that_are_asked_for(desat, tmp_path, monkeypatch):
    requests = (native.Target("odd64", ".so"),)
    inputs = []
    monkeypatch.setattr(native, "targets_of", lambda platforms: requests)
    monkeypatch.setattr(
        native, "compile_wrapper", lambda folder, targets: inputs.append(targets)
    )
    monkeypatch.setattr(native, "assemble", lambda *args: inputs.append(args[6]))
    desat(
        "export",
        "fmu",
        "integrated/mil-nadir",
        "--platforms",
        "odd64",
        "--out",
        str(tmp_path / "x.fmu"),
    )
    assert inputs == [requests, requests]


@pytest.mark.skipif(ZIG, reason="ziglang is there")
def test_without_ziglang_it_is_said(desat, tmp_path):
    command = desat("build", str(tmp_path / "x.py"), "--platforms", "all")
    assert command.returncode == 2
    assert "for other platforms the package ziglang is needed" in command.stderr


@pytest.mark.parametrize(
    ("platforms", "portable"), [(["linux64"], False), (["linux64", "win64"], True)]
)
def test_native_ones_are_packed_once_they_are_for_windows_too(
    monkeypatch, platforms, portable
):
    index = {k: {**e, "platforms": platforms} for k, e in library.index().items()}
    monkeypatch.setattr(library, "index", lambda: index)
    assert library.portable() is portable
    assert library.python_alone() == ["environment_tle"]


def same_bits_for_linux_and_windows(tmp_path):
    """Run one block's libraries for both: a minute, of which `make builds` makes it."""
    name = "spacecraft_rigid"
    subprocess.run(
        [
            sys.executable,
            "-m",
            "desat.fmus.build",
            "--into",
            str(tmp_path),
            "--platforms",
            "linux64,win64",
            name,
        ],
        check=True,
        cwd=ROOT,
        capture_output=True,
    )
    fmu = tmp_path / "native" / f"{name}.fmu"
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path / "x")
    description = fmpy.read_model_description(fmu)
    real = [
        v
        for v in description.modelVariables
        if v.causality == "output" and v.type == "Real"
    ]
    references = [str(v.valueReference) for v in real]
    (tmp_path / "host.c").write_text(HOST)
    compiler = [sys.executable, "-m", "ziglang", "cc", "-w", "-fno-sanitize=undefined"]

    def rows(target: str, library: Path, *runner: str) -> str:
        host = tmp_path / f"host-{target}.exe"
        subprocess.run(
            [*compiler, "-target", target, str(tmp_path / "host.c"), "-o", str(host)],
            check=True,
        )
        host_run = subprocess.run(
            [*runner, str(host), str(library), description.guid, *references],
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert host_run.returncode == 0, (host_run.returncode, host_run.stderr[-500:])
        return host_run.stdout

    binaries = tmp_path / "x" / "binaries"
    (linux,) = (binaries / "linux64").iterdir()
    (windows,) = (binaries / "win64").iterdir()
    symbols = linux.read_bytes()
    assert b"GLIBC_2.2" in symbols
    assert not any(f"GLIBC_2.{k}".encode() in symbols for k in range(18, 40))
    ours = rows("x86_64-linux-gnu.2.17", linux)
    usual = tmp_path / "usual"
    with zipfile.ZipFile(path(name)) as archive:
        archive.extractall(usual)
    if not WINE:
        return "without wine the library for Windows is built, not run"
    theirs = rows("x86_64-windows-gnu", windows, WINE)
    as_numbers = [[float.fromhex(x) for x in text.split()] for text in (ours, theirs)]
    assert len(as_numbers[0]) == 50 * len(references)
    assert as_numbers[0] == as_numbers[1]
    return f"{len(as_numbers[0])} numbers are equal"
