"""The names in our C: each that is known in a whole file, or outside of it, has a
prefix that no library's has; so that no platform's libc or libm owns it."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest

from desat.export.block_c import export as export_c
from desat.export.loop_fmu import LoopEnds, export
from desat.files import library, paths
from desat.fmus import native
from desat.system.options import Options

OURS = re.compile(r"py_|PY_|block_|desat_|DESAT_|fmi2|FMI2_|fmi3|FMI3_")
HOME = Path(native.__file__).parent
WRITTEN = [
    *sorted((HOME / "c").iterdir()),
    HOME / "alone.c",
    Path(library.__file__).parents[1] / "engine" / "loop.c",
]
_ASIDE = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.S)


def known_names(text: str) -> set[str]:
    """What a C file declares outside of its functions: macros, types, enumerators,
    objects, functions."""
    text = _ASIDE.sub('""', text).replace("\\\n", " ")
    names = set(re.findall(r"^ *# *define (\w+)", text, re.M))
    text = re.sub(r"^ *#.*$", "", text, flags=re.M)
    names |= set(re.findall(r"\b(?:struct|enum) (\w+) \{", text))
    for body in re.findall(r"^(?:typedef )?enum(?: \w+)? \{(.*?)\}", text, re.M | re.S):
        names |= set(re.findall(r"(\w+)(?: = [^,]*)?(?:,|$)", body.strip()))
    flat = text
    while (less := re.sub(r"\{[^{}]*\}", "", flat)) != flat:  # no bodies
        flat = less
    # what remains of a parameter list, an array or a value is none either
    flat = re.sub(r"= [^;,]*(?=[;,])", "", re.sub(r"\[[^\]]*\]", "", flat))
    for statement in re.split(r";|(?<=\))\s*\n(?=\w)|\n\n", flat):
        statement = re.sub(r"__\w+__\(\(.*?\)\)|\b__\w+\b", "", statement).strip()
        if pointer := re.match(r"[^(]*\(\*(?:const )?(\w+)\)", statement):
            names.add(pointer[1])
        elif function := re.match(r"[^(]*?(\w+)\(", statement):
            names.add(function[1])
        else:
            names |= {
                x.split()[-1].strip("*")
                for x in statement.split(",")
                if " " in x.strip() or "*" in x
            }
    return {x for x in names if x and not x.isdigit()}


def foreign(text: str, own_scenario: str = "") -> list[str]:
    """The names without a prefix of ours, or the own one of a block that stands alone."""
    mine = (
        re.compile(rf"{own_scenario}(_|$)|{own_scenario.upper()}_")
        if own_scenario
        else None
    )
    return sorted(
        n
        for n in known_names(text)
        if not OURS.match(n) and not (mine and mine.match(n))
    )


def test_what_a_file_declares_is_found():
    text = """#define SIZE 3
typedef struct place { int x; } place;
enum { FIRST, LAST = 2 };
static const char *const KINDS[] = { "a" };
static int top, *first;
static void (*const steps[SIZE])(int *) = { 0 };
static double finite(double x)
{
    double inner = x;
    return inner;
}
int out(void) { return 1; }
"""
    assert known_names(text) >= {
        "SIZE",
        "place",
        "FIRST",
        "LAST",
        "KINDS",
        "top",
        "first",
        "steps",
        "finite",
        "out",
    }
    assert "inner" not in known_names(text)


@pytest.mark.parametrize("path", WRITTEN, ids=lambda p: p.name)
def test_written_names_have_a_prefix(path):
    text = path.read_text(encoding="utf-8")
    assert len(known_names(text)) > 5
    assert foreign(text) == []


def test_translated_names_have_a_prefix():
    foreign_names, count = {}, 0
    for fmu in sorted((paths.fmus() / "native").glob("*.fmu")):
        with zipfile.ZipFile(fmu) as archive:
            text = archive.read(f"sources/{fmu.stem}.c").decode()
        foreign_names |= {f"{fmu.stem}: {n}": 1 for n in foreign(text)}
        count += len(known_names(text))
    assert count > 1000
    assert list(foreign_names) == []


def test_names_of_a_block_alone_have_a_prefix(tmp_path):
    for name in ("manager_integrated", "torquers", "star_tracker"):
        for path in export_c(name, tmp_path)[0]:
            assert foreign(path.read_text(encoding="utf-8"), name) == [], path.name


def test_names_of_a_loop_have_a_prefix(tmp_path):
    loop_fmu = export("integrated/mil-nadir", Options(), LoopEnds(), tmp_path / "x.fmu")
    with zipfile.ZipFile(loop_fmu) as archive:
        sources = [
            n
            for n in archive.namelist()
            if n.startswith("sources/") and n.endswith(".c")
        ]
        texts = {n: archive.read(n).decode() for n in sources}
    assert "sources/integrated_mil_nadir.c" in texts
    assert {n: foreign(t) for n, t in texts.items() if foreign(t)} == {}
