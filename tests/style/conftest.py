"""What tests of the form of the source share."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from tests.style import source


@pytest.fixture(scope="package", autouse=True)
def _trees_are_kept_while_needed() -> Iterator[None]:
    """Keep the syntax trees until the last test of the folder, without collecting
    garbage among them."""
    gc.disable()
    yield
    gc.enable()
    source.forget()
