"""The limits that a plot draws."""

from __future__ import annotations

from desat.language.scenario import LimitLine
from desat.numbers.limits import limits_of
from desat.system.model import Parameter


def test_a_limit_is_left_out_where_its_unless_holds():
    parameters = {
        "torquers": {
            "drive": Parameter("ideal", ""),
            "m_limit": Parameter(40.0, "A.m2"),
        }
    }
    limits = [LimitLine(value="torquers.m_limit", unless={"torquers.drive": "ideal"})]
    assert limits_of(limits, parameters, "A.m2") == []
    parameters["torquers"]["drive"] = Parameter("pulsed", "")
    assert [x[1] for x in limits_of(limits, parameters, "A.m2")] == [40.0]
