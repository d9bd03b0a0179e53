"""An estimate is a number with an uncertainty, or the data do not determine it."""

from __future__ import annotations

import math

import pytest

from station.findings import Estimate, Findings, of_numbers


@pytest.mark.parametrize(("value", "u"), [(math.nan, 1.0), (1.0, math.nan), (1.0, math.inf)])
def test_what_is_no_number_is_undetermined_and_flagged(value: float, u: float) -> None:
    sound = Estimate("bias", "X", 1.0, "deg/h", 0.1, 5.0, "fit", {}, {})
    lost = Estimate("bias", "Y", value, "deg/h", u, 5.0, "fit", {}, {})
    findings = of_numbers(Findings([sound, lost], [], [], [], None))
    assert findings.estimates[0] is sound
    assert findings.estimates[1].value is None
    (flag,) = findings.flags
    assert (flag.code, flag.axis) == ("not-identifiable", "Y")
