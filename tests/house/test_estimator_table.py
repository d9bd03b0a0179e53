"""The table of estimators says what was made up: the ratio, the coverage, what is undetermined."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cases import Trial, scored, shares, summary
from estimators import MODULES, table, trials_of

RUNS = 4000


def made_up(error_over_u: float, bound: float | None = 0.5) -> list[Trial]:
    """Return trials of two axes with u of one."""
    draw = np.random.default_rng(5000)
    errors = error_over_u * draw.standard_normal((RUNS, 2))
    results = [scored(error, np.ones(2), bound=bound) for error in errors]
    return [Trial({"K": one}, frozenset({"gap"} if n % 4 else {})) for n, one in enumerate(results)]


def test_errors_as_large_as_stated_are_covered_in_95_percent() -> None:
    line = summary(made_up(1.0), "K")
    assert line["rmse_over_u"] == pytest.approx(1.0, abs=0.04)
    assert line["rmse_over_bound"] == pytest.approx(2.0, abs=0.08)
    assert line["coverage_95"] == pytest.approx(0.95, abs=0.01)
    assert line["undetermined"] == 0.0


def test_errors_three_times_as_large_as_stated_are_seen_to_be() -> None:
    line = summary(made_up(3.0, bound=None), "K")
    assert line["rmse_over_u"] == pytest.approx(3.0, abs=0.1)
    assert line["coverage_95"] == pytest.approx(0.487, abs=0.02)
    assert "rmse_over_bound" not in line


def test_a_result_without_a_value_is_counted_and_nothing_else() -> None:
    none = scored([np.nan, np.nan], [np.nan, np.nan])
    nothing = [Trial({"K": none}, frozenset())]
    assert summary(nothing, "K") == {"runs": 1, "undetermined": 1.0}
    line = summary([*made_up(1.0, bound=None), *nothing * RUNS], "K")
    assert line["undetermined"] == pytest.approx(0.5)
    assert line["rmse_over_u"] == pytest.approx(1.0, abs=0.04)


def test_flags_are_shares_of_the_datasets() -> None:
    assert shares(made_up(1.0)) == {"gap": 0.75}


def test_files_of_lines_stand_side_by_side(tmp_path: Path) -> None:
    head = {"procedure": "p", "case": "c"}
    for name, ratio in (("before", 1.234), ("after", 1.0)):
        line = {**head, "quantity": "K", **summary(made_up(ratio), "K")}
        clean = {**head, "quantity": "false flags", "runs": 9, "false": 1, "by_code": {"gap": 1}}
        text = "\n".join(json.dumps(one) for one in (line, clean))
        (tmp_path / f"{name}.jsonl").write_text(text, encoding="utf-8")
    rows = list(table([tmp_path / "before.jsonl", tmp_path / "after.jsonl"]))
    assert len(rows) == 4
    assert rows[2].startswith("| p: c | K | 2.4")
    assert "1 of 9: gap 1" in rows[3]


@pytest.mark.parametrize("procedure", MODULES)
def test_every_procedure_has_cases_with_a_result_for_each_dataset(procedure: str) -> None:
    make = next(iter(trials_of(procedure).values()))
    results = make(5000).results
    assert results
    assert all(np.isfinite(one.error).all() for one in results.values())
