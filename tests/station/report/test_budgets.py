"""Budgets of a result's axes stand side by side where their contributions are the same."""

from __future__ import annotations

import pytest

from station.findings import Estimate, Findings, InputQuantity
from station.report.budgets import MOST_AXES, budgets_of
from station.results import Result, conclude


def results_of(*axes: str, others: tuple[str, ...] = (), u: float = 0.3) -> list[Result]:
    """Return results of axes; those of `others` depend on a second input too."""
    estimates = [
        Estimate(
            "bias", axis, 1.0 + n, "deg/h", u, None, "mean",
            {f"scale_{axis}": 2.0} | ({"clock": 1.0} if axis in others else {}),
        )
        for n, axis in enumerate(axes)
    ]  # fmt: skip
    inputs = [
        InputQuantity(f"scale_{axis}", f"scale of {axis}", 0.1 * (n + 1), "1", "the plan")
        for n, axis in enumerate(axes)
    ]
    inputs.append(InputQuantity("clock", "clock", 0.01, "1", "the plan"))
    return list(conclude("p", Findings(estimates, [], [], inputs, None), {}, "simple").results)


def test_axes_with_the_same_contributions_are_one_table() -> None:
    (budget,) = budgets_of(results_of("X", "Y"))
    assert budget["axes"] == ["X", "Y"]
    own, scale = budget["rows"]
    assert scale["description"] == "scale of X, Y"
    assert (scale["u"], scale["sensitivity"]) == ("0.100 / 0.200", "2.00")
    assert [cell["contribution"] for cell in scale["cells"]] == ["0.20", "0.40"]
    assert [cell["contribution"] for cell in own["cells"]] == ["0.30", "0.30"]
    assert budget["totals"] == ["0.36", "0.50"]
    for n in (0, 1):
        assert sum(row["cells"][n]["percent"] for row in budget["rows"]) == pytest.approx(100.0)


def test_an_axis_with_another_contribution_has_a_table_of_its_own() -> None:
    budgets = budgets_of(results_of("X", "Y", "Z", others=("Z",)))
    assert [budget["axes"] for budget in budgets] == [["X", "Y"], ["Z"]]
    assert [len(budget["rows"]) for budget in budgets] == [2, 3]


def test_no_table_is_wider_than_paper_and_none_is_of_a_convention() -> None:
    budgets = budgets_of(results_of(*"ABCDE"))
    assert [len(budget["axes"]) for budget in budgets] == [MOST_AXES, 2]
    estimate = Estimate("factor", "X", 1.0, "1", 0.0, None, "mean")
    convention = conclude("p", Findings([estimate], [], [], [], None), {}, "simple")
    assert budgets_of(convention.results) == []
