"""What blocks of a role share."""

from __future__ import annotations

import pytest

from desat.files.build import build
from desat.fmus import registry
from desat.runs.checks import check_draft
from desat.runs.prepare import read
from desat.runs.run import Options
from desat.system.errors import DesatError


def test_a_shared_parameter_must_be_equal_everywhere():
    draft = build(read("integrated/mil-nadir"), Options(blocks=True))
    draft.components["manager"].parameters["axes_wheel[1,2]"] = 0.5
    case = check_draft(draft)
    assert case.problems == []  # a model onboard may err
    assert any(
        "manager.axes_wheel[1,2] = 0.5, but spacecraft." in w for w in case.warnings
    )
    draft = build(read("integrated/mil-nadir"), Options(blocks=True))
    draft.components["wheels"].parameters["axes_wheel[1,2]"] = 0.5
    with pytest.raises(
        DesatError, match=r"axes_wheel\[1,2\] = .*the two must be equal"
    ):
        check_draft(draft).or_raise()


@pytest.mark.parametrize("parameter", ["axes_wheel", "inertia_wheel"])
def test_what_blocks_know_of_the_wheels_is_shared(parameter):
    """So that `check` says of a manager that it knows other wheels than there are."""
    shared_names = {
        name: v.shared
        for name in registry.names()
        for v in registry.block_class(name).variables
        if v.name == parameter
    }
    assert len(shared_names) > 2
    assert all(shared_names.values()), shared_names
