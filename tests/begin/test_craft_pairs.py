"""Crafts that combine orbit, pointing, wheels, rods, thrusters, dumps and size pair by
pair: what `desat new craft` writes, `desat check` finds sound, and what it refuses it
leaves nothing of."""

from __future__ import annotations

import random
from itertools import combinations
from pathlib import Path

import pytest

from desat.begin.facts import CraftFacts
from desat.runs.checking import check
from desat.runs.new_craft import write_craft
from desat.system.errors import DesatError
from desat.system.options import Options

# by the size of a craft: its wheels, rods and thrusters
SIZES = (
    {"size": "3U", "wheels": "10mNms", "rods": "0.2", "thrusters": "4 10mN"},
    {"size": "12U", "wheels": "30mNms", "rods": "0.5", "thrusters": "4 50mN"},
    {"mass": "50kg", "wheels": "0.9Nms", "rods": "5", "thrusters": "4 1N"},
    {"mass": "200kg", "wheels": "1Nms", "rods": "15", "thrusters": "4 1N"},
    {"mass": "600kg", "wheels": "15Nms", "rods": "30", "thrusters": "4 10N"},
)
ORBITS = (
    {"altitude": "400km", "inclination": "51.6deg"},
    {"sso": "600km"},
    {"sso": "520km", "ltan": "06:00"},
    {"orbit": "geo"},
    {"orbit": "gto"},
    {"orbit": "molniya"},
    {"orbit": "500x39860km"},
    {"sun": "1AU"},
)
CHOICES = (
    ORBITS,
    ("nadir", "inertial", "sun", "yaw"),
    ("4 pyramid", "3 axes"),
    (True, False, None),  # rods of its size, none, those of its class
    (True, False),  # thrusters
    (None, "thrusters 70:10", "coils 70:10", "thrusters 60:5 aligned"),
    SIZES,
)
Pair = tuple[tuple[int, int], tuple[int, int]]


def pairs_of(row: list[int]) -> set[Pair]:
    return set(combinations(enumerate(row), 2))


def pairwise_rows(seed: int) -> list[list[int]]:
    """Rows of choices in which each two choices of two kinds come together."""
    draw = random.Random(seed)
    counts = [len(x) for x in CHOICES]
    missing = {
        ((i, a), (j, b))
        for i, j in combinations(range(len(counts)), 2)
        for a in range(counts[i])
        for b in range(counts[j])
    }
    rows = []
    while missing:
        candidates = [[draw.randrange(n) for n in counts] for _ in range(30)]
        for row in candidates:  # each has a pair that is missing
            (i, a), (j, b) = min(missing)
            row[i], row[j] = a, b
        rows.append(max(candidates, key=lambda row: len(pairs_of(row) & missing)))
        missing -= pairs_of(rows[-1])
    return rows


def facts_of(row: list[int]) -> CraftFacts:
    orbit, pointing, layout, rods, thrusters, dump, size = (
        x[k] for x, k in zip(CHOICES, row, strict=True)
    )
    return CraftFacts(
        **orbit,
        pointing=pointing,
        wheels=f"{layout} {size['wheels']}",
        rods={True: size["rods"], False: "none", None: None}[rods],
        thrusters=size["thrusters"] if thrusters else None,
        dump=dump,
        **{k: x for k, x in size.items() if k in ("size", "mass")},
    )


@pytest.mark.study
@pytest.mark.parametrize("seed", [1])
def test_what_is_written_is_sound_and_what_is_refused_leaves_nothing(
    tmp_path: Path, seed: int
) -> None:
    written_count = 0
    for k, row in enumerate(pairwise_rows(seed)):
        facts, folder = facts_of(row), tmp_path / f"c{k}"
        try:
            _, warnings = write_craft(folder, facts, "desat new craft")
        except DesatError:
            assert not folder.exists()
            continue
        written_count += 1
        for file in sorted(folder.glob("*.toml")):
            if file.name == "craft.toml":
                continue
            case = check(str(file), Options())
            assert not case.problems, facts
            if file.name == "nominal.toml":
                assert {*case.warnings} == {*warnings}, facts
            insufficient = [x for x in warnings if "the Sun and the Moon" not in x]
            assert not insufficient, facts
    assert written_count >= 20


def test_a_craft_that_cannot_fly_leaves_no_folder(tmp_path: Path) -> None:
    for facts in (
        {"epoch": "2031-01-01"},
        {"rods": "rod 20Am2 60x8mm 0.2mm 100mA", "size": "12U"},
        {"wheels": "4 pyramid 4Nms", "size": "12U"},
    ):
        with pytest.raises(DesatError):
            write_craft(tmp_path / "c", CraftFacts(**facts), "desat new craft")
        assert not list(tmp_path.iterdir())
