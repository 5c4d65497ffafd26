"""Colours of series, apart for normal and for colour-blind eyes, light and dark.

Dichromats by Machado, Oliveira & Fernandes (2009); differences by CIEDE2000 (Sharma, Wu &
Dalal 2005), some of whose pairs are here.
"""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

from desat.figures.style import COLOURS, DASHES, PALETTE
from desat.report.policy import part

XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
EYES = {
    "normal": np.eye(3),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
LEAST = {"tritanopia": 12.0}  # of a difference; else 15
PAGES = dict(
    zip(
        ("light", "dark"),
        ("#ffffff", re.search(r"dark\).*?--paper:(#\w+)", part("page.html"))[1]),
        strict=True,
    )
)


def linear(colour: str) -> np.ndarray:
    """Linear sRGB of a colour as #rrggbb."""
    c = np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIELAB of linear sRGB, D65."""
    xyz = XYZ @ np.clip(rgb, 0.0, 1.0) / XYZ.sum(axis=1)
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def ciede2000(first: np.ndarray, second: np.ndarray) -> float:
    """The difference of two colours in CIELAB."""
    mean_chroma = np.mean([np.hypot(*x[1:]) for x in (first, second)])
    g = 0.5 * (1 - np.sqrt(mean_chroma**7 / (mean_chroma**7 + 25.0**7)))
    (l1, a1, b1), (l2, a2, b2) = first, second
    c1, c2 = np.hypot(a1 * (1 + g), b1), np.hypot(a2 * (1 + g), b2)
    h1, h2 = (
        np.degrees(np.arctan2(b, a * (1 + g))) % 360 for a, b in ((a1, b1), (a2, b2))
    )
    dh = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0.0
    hue = (h1 + dh / 2) % 360 if c1 * c2 else h1 + h2
    lightness, chroma = (l1 + l2) / 2, (c1 + c2) / 2
    t = (
        1
        - 0.17 * np.cos(np.radians(hue - 30))
        + 0.24 * np.cos(np.radians(2 * hue))
        + 0.32 * np.cos(np.radians(3 * hue + 6))
        - 0.20 * np.cos(np.radians(4 * hue - 63))
    )
    s_l = 1 + 0.015 * (lightness - 50) ** 2 / np.sqrt(20 + (lightness - 50) ** 2)
    s_c, s_h = 1 + 0.045 * chroma, 1 + 0.015 * chroma * t
    r = -np.sin(np.radians(60 * np.exp(-(((hue - 275) / 25) ** 2))))
    r *= 2 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
    x = (l2 - l1) / s_l
    y = (c2 - c1) / s_c
    z = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(dh / 2)) / s_h
    return float(np.sqrt(x * x + y * y + z * z + r * y * z))


@pytest.mark.parametrize(
    ("first", "second", "difference"),
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((50.0, 2.5, 0.0), (50.0, 0.0, -2.5), 4.3065),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_the_difference_is_that_of_its_paper(first, second, difference):
    value = ciede2000(np.array(first), np.array(second))
    assert value == pytest.approx(difference, abs=1e-4)


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.parametrize("eyes", EYES)
def test_any_two_series_differ(page, eyes):
    colours = PALETTE if page == "light" else PALETTE.values()
    labs = {c: lab(EYES[eyes] @ linear(c)) for c in colours}
    for first, second in itertools.combinations(labs, 2):
        assert ciede2000(labs[first], labs[second]) >= LEAST.get(eyes, 15.0), (
            first,
            second,
        )


@pytest.mark.parametrize("page", PAGES)
def test_series_stand_out_from_their_page(page):
    paper = XYZ[1] @ linear(PAGES[page])
    for colour in PALETTE if page == "light" else PALETTE.values():
        low, high = sorted((paper, XYZ[1] @ linear(colour)))
        assert (high + 0.05) / (low + 0.05) >= 3.0, colour


def test_nine_series_differ_in_colour_and_five_in_dashes():
    assert len(set(COLOURS)) == len(set(PALETTE.values())) == 9
    assert len(set(DASHES)) == 5
