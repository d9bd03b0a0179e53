"""Budgets with the GUM's columns, covariance of results, probability of conformity."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from station.decision import Limit, conformity
from station.findings import Covariance, Estimate, Findings, InputQuantity
from station.results import conclude
from station.uncertainty import BudgetLine, combine, covariance_of

GAIN = InputQuantity("gain", "gaussmeter", 0.01, "1", "certificate 7", distribution="uniform")
X = Estimate("s", "x", 2.0, "V", 0.03, 40.0, "mean", {"gain": -2.0})
Y = Estimate("s", "y", 3.0, "V", 0.04, None, "mean", {"gain": 3.0, "unknown": 9.0})
LOST = Estimate("s", "z", None, "V", None, None, "mean")
OF_THE_DATA = Covariance((("s", "x"), ("s", "y")), ((9e-4, 2e-4), (2e-4, 16e-4)))


def test_a_budget_has_the_columns_of_the_gum_and_its_shares_add_to_one() -> None:
    combined, *_ = combine([X], [GAIN])
    assert combined is not None
    from_data, from_gain = combined.budget
    assert from_gain.quantity == "gain"
    assert (from_gain.standard_uncertainty, from_gain.unit) == (0.01, "1")
    assert (from_gain.distribution, from_gain.sensitivity) == ("uniform", -2.0)
    assert from_gain.contribution == pytest.approx(0.02)
    assert from_gain.to_data()["degrees_of_freedom"] is None
    assert from_data.degrees_of_freedom == 40.0
    assert sum(line.share for line in combined.budget) == pytest.approx(1.0)
    assert combined.standard_uncertainty == pytest.approx(math.hypot(0.03, 0.02))
    json.dumps([line.to_data() for line in combined.budget], allow_nan=False)


def test_an_input_that_nobody_states_has_its_row_and_adds_nothing() -> None:
    gravity = InputQuantity.if_stated("gravity", "local gravity", None, "g", "plan", value=1.0)
    estimate = replace(X, sensitivities={"gain": -2.0, "gravity": 7.0})
    (alone,), (combined,) = combine([X], [GAIN]), combine([estimate], [GAIN, gravity])
    assert alone is not None and combined is not None
    assert combined.standard_uncertainty == alone.standard_uncertainty
    line = combined.budget[-1].to_data()
    assert (line["quantity"], line["value"], line["source"]) == ("gravity", 1.0, "not stated")
    assert (line["standard_uncertainty"], line["contribution"]) == (None, 0.0)
    assert BudgetLine.of(line) == combined.budget[-1]
    assert covariance_of([estimate], [GAIN, gravity], OF_THE_DATA) is not None


def test_results_of_one_gaussmeter_are_correlated() -> None:
    related = covariance_of([X, Y, LOST], [GAIN], OF_THE_DATA)
    assert related is not None
    assert related.keys == (("s", "x"), ("s", "y"))
    expected = np.array(OF_THE_DATA.matrix) + 1e-4 * np.outer([-2.0, 3.0], [-2.0, 3.0])
    assert np.allclose(related.matrix, expected, rtol=1e-12)
    for key, both in zip(related.keys, combine([X, Y], [GAIN]), strict=True):
        place = related.keys.index(key)
        assert both is not None
        assert math.sqrt(related.matrix[place][place]) == pytest.approx(both.standard_uncertainty)


def test_results_of_which_nobody_knows_the_correlation_are_not_stated_uncorrelated() -> None:
    findings = Findings([X, Y], [], [], [GAIN], None)
    assert "covariance" not in conclude("p", findings, {}, "simple").to_data()


@pytest.mark.parametrize(
    "procedure", ["rlg-magnetic-sensitivity", "accelerometer-magnetic-sensitivity"]
)
def test_a_run_exports_the_covariance_of_its_results(
    procedure: str, run_of: Callable[[str], Path]
) -> None:
    document = json.loads((run_of(procedure) / "results.json").read_text(encoding="utf-8"))
    results = {(one["name"], one["axis"]): one for one in document["results"]}
    matrix = np.array(document["covariance"]["matrix"])
    u = [
        results[name, axis]["standard_uncertainty"]
        for name, axis in document["covariance"]["names"]
    ]
    assert len(u) > 1
    assert np.allclose(np.sqrt(np.diag(matrix)), u, rtol=1e-9)
    assert np.allclose(matrix, matrix.T)
    assert np.all(np.linalg.eigvalsh(matrix / np.outer(u, u)) > -1e-9)


@pytest.mark.parametrize(
    ("value", "u", "dof", "limit", "probability"),
    [
        (0.0, 1.0, math.inf, Limit(max=0.0), 0.5),
        (0.0, 1.0, math.inf, Limit(max_abs=1.959964), 0.95),
        (0.0, 1.0, 4.0, Limit(max_abs=2.776445), 0.95),
        (5.0, 1.0, math.inf, Limit(min=2.0, max=8.0), 0.9973),
        (5.0, 1.0, math.inf, Limit(max=2.0), 0.00135),
    ],
)
def test_the_probability_of_conformity(
    value: float, u: float, dof: float, limit: Limit, probability: float
) -> None:
    assert conformity(value, u, dof, limit) == pytest.approx(probability, abs=1e-5)


def test_there_is_no_probability_without_limit_value_or_uncertainty() -> None:
    assert conformity(1.0, 1.0, 4.0, None) is None
    assert conformity(None, 1.0, 4.0, Limit(max=1.0)) is None
    assert conformity(1.0, 0.0, 4.0, Limit(max=1.0)) is None


@pytest.mark.parametrize(("rule", "band"), [("simple", 0.0), ("guarded", None)])
def test_the_guard_band_of_the_rule_is_stated(rule: str, band: float | None) -> None:
    limits = {("s", "x"): Limit(max=2.1)}
    document = conclude("p", Findings([X], [], [], [GAIN], None), limits, rule)  # type: ignore[arg-type]
    entry = document.to_data()["results"][0]
    assert entry["guard_band"] == (entry["expanded_uncertainty"] if band is None else band)
    assert 0.99 < entry["conformity_probability"] < 1.0
