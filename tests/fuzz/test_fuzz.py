"""Readers under mutated files, commands under changed lines: refused in lines, never a
traceback, never long."""

from __future__ import annotations

import re
import shlex

import pytest
import typer
from typer.main import get_command

from desat.runs.prepare import prepare
from desat.system.errors import DesatError, Exit
from tests import fuzz
from tests.conftest import ROOT
from tests.fuzz import commands, tree
from tests.fuzz.seeds import (
    ABOUT,
    BARE,
    FILES,
    SSB,
    SSD,
    SSM,
    SSV,
    TARGETS,
    TOML,
    forbidden_pairs,
    plain_kind,
    pointing_nowhere,
    seeds,
)

SEED, COUNT, LINES = 1, 1000, 5


def test_mutated_files_are_refused_in_lines(tmp_path, capsys):
    outcome = fuzz.run(tmp_path / "in", SEED, COUNT)
    with capsys.disabled():
        print(f"\nfuzz: seed {SEED}: {outcome}")
    assert outcome.failures == []
    assert outcome.count >= COUNT
    assert 0 < outcome.refused < outcome.count
    assert len(outcome.lines) > 600


def test_what_the_page_says_is_fuzzed_is():
    """Each kind of file that it names, and model descriptions of each FMI that is read."""
    page = (ROOT / "docs/failures.md").read_text(encoding="utf-8")
    message = re.search(r"puts mutated files \(([\w, .]+)\)", page)
    assert message is not None
    kinds = {plain_kind(k) for k in seeds()}
    assert set(message[1].split(", ")) == {
        k for k in kinds if k != "craft" and k[:3] != "xml"
    }
    texts = [seeds()[kind] for kind in ("xml", "xml1", "xml3")]
    assert [re.search(rb'fmiVersion="(.*?)"', t)[1] for t in texts] == [
        b"2.0",
        b"1.0",
        b"3.0",
    ]


@pytest.mark.parametrize("kind", TARGETS)
def test_a_file_of_each_kind_is_read(tmp_path, kind):
    """What is mutated is looked at: right as it is, and refused by its name where it is
    cut."""
    write_all(tmp_path)
    target, file = TARGETS[kind]
    data = seeds()[kind]
    (tmp_path / file).write_bytes(fuzz._wrap_input(kind, data))
    prepare(str(tmp_path / target), fuzz._options(kind)).or_raise()
    (tmp_path / file).write_bytes(fuzz._wrap_input(kind, data[: len(data) // 2]))
    with pytest.raises(DesatError, match=re.escape(file.rpartition("/")[2])):
        prepare(str(tmp_path / target), fuzz._options(kind)).or_raise()


def write_all(folder):
    """All files of the seeds, as they are."""
    for file, data in FILES.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data())


SOURCE = b'startConnector="tau_cmd_wheel[1]" '
CAUSES = {
    "a connection without a connector": ("ssd", SSD, SOURCE, b""),
    "scenario.json that is not JSON": ("json", ABOUT, b'{"name"', b'{name"'),
    "scenario.json that is not UTF-8": ("json", ABOUT, b"Small", b"Sm\xffll"),
    "TOML that is not UTF-8": ("toml", TOML, b"Own", b"O\xffn"),
    "axes of a wrong type": (
        "toml",
        TOML,
        b"[axes.method.x]",
        b"[axes]\nmethod = 3\n[axes.m.x]",
    ),
    "dispersions of a wrong type": (
        "json",
        ABOUT,
        b'"uniform": [-1.0, 1.0]',
        b'"uniform": 1',
    ),
    "a number that is none": ("ssd", SSD, b'factor="2.0"', b'factor="two"'),
    "a time that is none": ("ssd", SSD, b'stopTime="10"', b'stopTime="soon"'),
    "an exponent that is none": ("ssv", SSV, b'rad="1"', b'rad="one"'),
    "a factor of a mapping that is none": (
        "ssm",
        SSM,
        b'factor="0.5"',
        b'factor="half"',
    ),
    "a signal of a dictionary without a name": ("ssb", SSB, b'name="x"', b""),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_what_once_was_internal_is_a_line(tmp_path, cause):
    kind, _, old, new = CAUSES[cause]
    write_all(tmp_path)
    target, file = TARGETS[kind]
    data = FILES[file]()
    assert old in data
    (tmp_path / file).write_bytes(data.replace(old, new, 1))
    with pytest.raises(DesatError) as refusal:
        prepare(str(tmp_path / target), fuzz._options(kind)).or_raise()
    assert file.rpartition("/")[2] in str(refusal.value)


FAULTS = [
    (f"{kind}{end}", fault, data)
    for kind, fault, data in (*forbidden_pairs(), *pointing_nowhere())
    for end in ("", BARE)
]


@pytest.mark.parametrize(
    ("kind", "data"),
    [(k, d) for k, _, d in FAULTS],
    ids=[f"{k}: {f}" for k, f, _ in FAULTS],
)
def test_a_variable_that_the_standard_does_not_allow_is_named_in_a_line(
    tmp_path, kind, data
):
    """Each forbidden causality and variability, and each reference to no variable: a
    refusal, or a warning where the meaning is clear."""
    write_all(tmp_path)
    target, file = TARGETS[kind]
    (tmp_path / file).write_bytes(fuzz._wrap_input(kind, data))
    try:
        case = prepare(str(tmp_path / target), fuzz._options(kind))
        code, lines = Exit.INPUT, [*case.problems, *case.warnings]
    except DesatError as refusal:
        code, lines = refusal.code, str(refusal).splitlines()
    assert code == Exit.INPUT
    place = (
        r"(source|wheels): theirs.fmu(/|: not as FMI wants it: )modelDescription.xml"
    )
    assert any(
        re.search(rf"{place}:\d+: \w+: \S", line)
        and ("allowed" in line or "is needed" in line)
        for line in lines
    )


def test_each_command_and_option_is_in_a_seed():
    """Also those that are added; and no seed is of a command or an option that is gone."""
    all_commands = tree.every_command()
    there = {
        (place, name)
        for place, command in all_commands.items()
        for o in tree.options_in(command)
        for name in (*o.opts, *o.secondary_opts)
    }
    seed_options, commands_seen = set(), set()
    for line in (*commands.QUICK, *commands.SLOW):
        words = shlex.split(line)
        names = (" ".join(words[:2]), words[0], f"{words[0]} run")
        place = next(name for name in names if name in all_commands)
        commands_seen.add(place)
        seed_options |= {
            (place, w) for w in words if re.fullmatch("--?[a-z][a-z-]*", w)
        }
    assert commands_seen == set(all_commands)
    assert there - seed_options == set()
    assert seed_options - there == set()


def test_an_option_that_is_added_is_in_a_seed_at_once():
    app = typer.Typer(add_completion=False)

    @app.command()
    def added(target: str, new_one: int = 1, other: bool = False) -> None:
        """Do something."""

    lines = list(tree.lines_of("added", get_command(app), "nowhere", False))
    assert lines == ["added nowhere", "added nowhere --new-one 1 --other --no-other"]


def test_changed_command_lines_never_are_a_bug(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    line_count, wrong = commands.run(folder, SEED, LINES)
    assert wrong == []
    assert line_count == LINES + len(commands.QUICK)
