"""Managers: shares within their range, the law that each calls, the wheel that it commands."""

from __future__ import annotations

import pytest

from desat.components.contract.block import BlockError
from desat.components.laws import (
    dumping,
)
from tests.contract.test_block import begin, fresh


@pytest.mark.parametrize("name", ["magnetic_share", "threshold_off", "threshold_on"])
def test_a_share_is_none_to_all(name):
    for value, right in ((0.0, True), (1.0, True), (-0.01, False), (1.01, False)):
        block = fresh("manager_integrated")
        setattr(block, name, value)
        if right:
            block.check()
        else:
            with pytest.raises(BlockError, match=name):
                block.check()


@pytest.mark.parametrize("law", [0, 1, 2])
def test_the_manager_asks_the_law_it_is_told(law):
    h, n_con, rate = (1.0, -2.0, 0.5), (1e-4, 0.0, -2e-4), 0.008
    block = fresh("manager_combined")
    block.law, block.g_rate, block.n_con_body = law, rate, n_con
    block.horizon, block.sample_time = 600.0, 10.0
    begin(block)
    block.omega_bi_body = omega = (0.0, -1e-3, 0.0)
    offsets = dumping.lqr_offsets(omega, rate, n_con, 600.0, 10.0)
    start = dumping.mec_costate(h, omega, n_con, 600.0)
    law_dump = (
        dumping.ilqr(h, omega, rate, n_con),
        dumping.lqr(h, rate, 600.0, offsets[:3]),
        dumping.mec(start, omega, 0.0),
    )[law]
    assert block.dump(0.0, 0.0, h)[0] == pytest.approx(law_dump, rel=1e-12)


@pytest.mark.parametrize("wheel", range(4))
def test_one_wheel_is_commanded(wheel):
    block = fresh("manager_start_up")
    begin(block)
    block._wheel, block._along, block.valid_h = wheel, -1.0, False
    block.give((0.0, 0.0, 0.0), 1e-5)
    assert block.tau_cmd_wheel == tuple(-1e-5 * (i == wheel) for i in range(4))
