"""Environments at other dates: the native FMU gives the bits of the block."""

from __future__ import annotations

import numpy as np
import pytest

from desat.analyses import flight
from desat.runs.prepare import prepare
from desat.system.errors import DesatError
from desat.system.options import Options


@pytest.mark.real_units
@pytest.mark.parametrize(
    ("target", "spacing"),
    [
        ("nadir_day/day-dipole", 120.0),
        ("space_telescope/ours-igrf", 60.0),
        ("alsat1/ours-case-a", 7.3),
    ],
)
def test_the_native_fmu_gives_the_rows_of_the_block(
    target: str, spacing: float
) -> None:
    system, _ = prepare(target, Options()).or_raise()
    component = system.components["environment"]
    times = [86400.0 + spacing * k for k in range(300)]
    block_rows = flight._rows_of_block(flight.environment_block(component), times)
    native = flight.native_of(flight.environment_block(component))
    assert native is not None
    elements = native.interface.elements
    outputs = [s for name in flight.ENVIRONMENT_OUTPUTS for s in elements[name]]
    native_rows = flight.rows_of(native, times, outputs)
    assert native_rows is not None
    np.testing.assert_array_equal(native_rows, block_rows)


def test_a_date_beyond_the_field_s_model_is_refused_by_its_own_words() -> None:
    system, _ = prepare("space_telescope/ours-igrf", Options()).or_raise()
    block = flight.environment_block(system.components["environment"])
    with pytest.raises(DesatError, match="IGRF"):
        flight.inputs_at(block, [0.0, 86400.0 * 365.25 * 60.0])
