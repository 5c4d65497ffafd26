"""Crafts that logs are made of."""

from __future__ import annotations

import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts

FACTS = {"size": "6U", "altitude": "500km", "inclination": "51.6deg", "rods": "0.18"}


@pytest.fixture(scope="session")
def craft(tmp_path_factory):
    """The folder of a craft."""
    folder = tmp_path_factory.mktemp("telemetry") / "my6u"
    write(folder, CraftFacts(**FACTS, residual_dipole="0.045"), "")
    return folder
