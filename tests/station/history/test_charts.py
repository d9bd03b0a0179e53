"""Control charts: limits by the moving range, the Western Electric rules, Cpk."""

from __future__ import annotations

import random
from statistics import NormalDist

import pytest

from station.history.charts import BASELINE, FEWEST, broken_rule, capability, chart_of


@pytest.mark.parametrize(
    ("latest", "words"),
    [
        ([3.1], "more than 3 sigma above"),
        ([0.0, -3.1], "more than 3 sigma below"),
        ([2.1, 0.0, 2.2], "2 of 3 in a row more than 2 sigma above"),
        ([1.1, 1.2, 0.0, 1.3, 1.4], "4 of 5 in a row more than 1 sigma above"),
        ([-0.1] * 8, "8 in a row below"),
    ],
)
def test_each_rule_is_named(latest: list[float], words: str) -> None:
    assert words in broken_rule(latest, 1.0)


@pytest.mark.parametrize(
    "latest", [[2.9], [2.1, -2.2, 0.1], [1.1, 1.2, 0.0, 1.3, 0.9], [0.1] * 7, [2.1, 2.1, 0.0]]
)
def test_just_short_of_a_rule_is_in_control(latest: list[float]) -> None:
    assert broken_rule(latest, 1.0) == ""


def test_sigma_of_a_chart_is_that_of_the_values_and_false_alarms_are_as_rare_as_stated() -> None:
    numbers, sigmas, alarms = random.Random(1), [], 0
    for _ in range(400):
        chart = chart_of([numbers.gauss(5.0, 0.2) for _ in range(BASELINE)])
        assert chart is not None
        sigmas.append(chart.sigma)
        alarms += chart.out_of_control
    assert sum(sigmas) / len(sigmas) == pytest.approx(0.2, rel=0.03)
    # The four rules together alarm on about 1 % of values of a normal process (Champ and Woodall,
    # 1987: mean run length 91.75); limits from 20 values add to that.
    assert 0.002 < alarms / 400 < 0.05


def test_few_values_have_no_chart() -> None:
    assert chart_of([1.0] * (FEWEST - 1)) is None


def test_a_drift_does_not_widen_its_own_limits() -> None:
    values = [NormalDist(0, 1).inv_cdf((i * 7 % 20 + 0.5) / 20) for i in range(BASELINE)]
    before, after = chart_of(values), chart_of([*values, 4.0, 8.0, 16.0])
    assert before is not None
    assert after is not None
    assert after.sigma == before.sigma
    assert {20, 21, 22} <= set(after.alarms)


def test_cpk_is_the_room_to_the_nearer_limit_in_three_standard_deviations() -> None:
    values = [1.0, 3.0] * 8
    assert capability(values, -4.0, 5.0) == pytest.approx(3.0 / (3 * 1.032796), rel=1e-5)
    assert capability(values, None, 8.0) == pytest.approx(6.0 / (3 * 1.032796), rel=1e-5)
    assert capability(values, None, None) is None
    assert capability([2.0] * 16, 0.0, 4.0) is None
