"""A call of a process that may die, by itself: a process that is begun for it imports
little."""

from __future__ import annotations

import os
import time


def dies_or_not(number: int) -> int:
    """Of every third it dies at once, and one hangs."""
    if number % 3 == 1:
        os._exit(number)
    if number == 6:
        time.sleep(60.0)
    return number**2
