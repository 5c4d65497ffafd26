"""Check the layout of two-line element sets before sgp4 reads them."""

from __future__ import annotations

import re

from ..system.errors import DesatError, plain

_ANGLE = r"[ \d]{2}\d\.\d{4}"
# Fields of each line that are used: name, first and last column, and form.
_LAYOUT: dict[int, tuple[tuple[str, int, int, str], ...]] = {
    1: (
        ("year of the epoch", 19, 20, r"\d\d"),
        ("day of the epoch", 21, 32, r"[ \d]{2}\d\.\d{8}"),
        ("B*", 54, 61, r"[ +-][ \d]{5}[ +-]\d"),
    ),
    2: (
        ("inclination", 9, 16, _ANGLE),
        ("right ascension of the ascending node", 18, 25, _ANGLE),
        ("eccentricity", 27, 33, r"\d{7}"),
        ("argument of perigee", 35, 42, _ANGLE),
        ("mean anomaly", 44, 51, _ANGLE),
        ("mean motion", 53, 63, r"[ \d]\d\.\d{8}"),
    ),
}


def check_layout(lines: list[str], place: str) -> None:
    """Check that the fields of both lines stand in their columns, with their points.

    The checksum does not reveal a missing point, and sgp4 would then read another
    number.

    Parameters
    ----------
    lines
        The first and the second line.
    place
        The option and the file, for messages.

    Raises
    ------
    DesatError
        If a field has another form; the text names line, field and columns.
    """
    for number, line in enumerate(lines, 1):
        for name, first, last, form in _LAYOUT[number]:
            text = line[first - 1 : last]
            if not re.fullmatch(form, text, re.ASCII):
                raise DesatError(
                    f"{place}: line {number}, {name} (columns {first} to {last}): "
                    f"{plain(text)!r} is no number in the format of two-line elements"
                )
    year, day = int(lines[0][18:20]), float(lines[0][20:32])
    leap = year % 4 == 0  # 1957 to 2056
    if not 1.0 <= day < 366.0 + leap:
        raise DesatError(
            f"{place}: line 1, day of the epoch (columns 21 to 32): {day:g}; a day from 1 to "
            f"{365 + leap} is needed"
        )
