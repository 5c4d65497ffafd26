"""Torques by a table: impulse, frames, the end of the table."""

from __future__ import annotations

import numpy as np
import pytest

from desat.components.contract.block import BlockError
from desat.components.maths.attitude import normalise, rotate
from desat.system.errors import DesatError
from desat.system.parameters import expand
from tests.conftest import started


def table(*rows: tuple[float, ...]) -> tuple[float, ...]:
    flat = [x for row in rows for x in row]
    return tuple(flat + [0.0] * (1024 - len(flat)))


@pytest.mark.parametrize("between", [0, 1])
def test_a_tables_impulse_is_exact_whatever_the_steps(between: int) -> None:
    rows = [(0.0, 0.0, 1.0, 0.0), (10.0, 1.0, 1.0, 0.0), (25.0, -1.0, 0.0, 0.0)]
    source = started(
        "disturbance_table", torque=table(*rows), between=between, repeated=True
    )
    # hold: 10 s of (0, 1, 0), 15 s of (1, 1, 0); linear: means of both ends
    full = np.array([15.0, 25.0, 0.0] if between == 0 else [5.0, 17.5, 0.0])
    for dt in (0.7, 1.0, 5.0, 12.5):
        total, steps = np.zeros(3), 0
        while (steps + 1) * dt <= 75.0 + 1e-9:
            source.advance(steps * dt, dt)
            total += dt * np.array(source.tau_ext_body)
            steps += 1
        rest = 75.0 - steps * dt
        if rest > 1e-9:
            source.advance(steps * dt, rest)
            total += rest * np.array(source.tau_ext_body)
        assert total == pytest.approx(3.0 * full, rel=1e-12, abs=1e-12)


def test_a_tables_frames_and_what_it_is_added_to() -> None:
    q = normalise((0.1, 0.2, 0.3, 0.9))
    rows = table((0.0, 0.1, 0.2, 0.3))
    source = started("disturbance_table", torque=rows, frame=2, factor=2.0)
    source.q_bi, source.tau_other_body = q, (0.0, 0.0, 1.0)
    source.advance(0.0, 10.0)
    x, y, z = rotate(q, (0.2, 0.4, 0.6))
    assert source.tau_ext_body == pytest.approx((x, y, z + 1.0))


def test_a_table_that_ends_before_the_run_is_refused() -> None:
    source = started("disturbance_table", torque=table((0.0, 1, 0, 0), (10.0, 1, 0, 0)))
    with pytest.raises(
        BlockError, match="the table is from 0 to 10 s, the run from 0 to 20 s"
    ):
        list(source.foresee(0.0, 20.0, frozenset()))
    assert not list(source.foresee(0.0, 10.0, frozenset()))


def test_the_first_rows_of_a_table_may_stand_alone_but_not_those_of_a_matrix() -> None:
    from desat.system.interface import interface_of_block

    interface = interface_of_block("disturbance_table")
    values = expand(
        interface, "torque", [[0.0, 1.0, 2.0, 3.0], [5.0, 0.0, 0.0, 0.0]], "x"
    )
    assert [values[f"torque[1,{k}]"] for k in (1, 2, 3, 4)] == [0.0, 1.0, 2.0, 3.0]
    assert values["torque[256,4]"] == 0.0
    with pytest.raises(DesatError, match="has rows of 4 values, got rows of 3"):
        expand(interface, "torque", [[0.0, 1.0, 2.0]], "x")
    wheels = interface_of_block("wheels")
    with pytest.raises(DesatError, match="axes_wheel needs 12 values, got 4"):
        expand(wheels, "axes_wheel", [[1.0, 0.0, 0.0, 0.0]], "x")
