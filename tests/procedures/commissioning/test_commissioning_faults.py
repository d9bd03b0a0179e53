"""A commissioning on the simulated benches: healthy ones pass, each planted fault is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from campaigns.planted.commissioning import named
from commissioning_parts import AMBIENT, plan_of
from plan_runs import run_of, shipped_bench

from procedures.commissioning.figures import draw_parts
from station.parts import Table
from station.record.folder import RunFolder
from station.runner.evaluation import evaluate_run
from station.runner.outcome import Outcome


def commissioned(
    folder: Path, bench: dict[str, Any], ambient: Any = AMBIENT, **parameters: Any
) -> Outcome:
    """Run the shipped plan, short, with the ambient field of the simulated room stated."""
    plan = plan_of("coils")
    plan["parameters"]["coils"] |= {"record": "2 s", **parameters}
    plan["parameters"]["ambient"] = ambient
    return run_of(folder, plan, bench)


@pytest.mark.parametrize(("bench", "turned"), [("sim", False), ("sim-alternate", True)])
def test_a_healthy_bench_raises_no_alarm(tmp_path: Path, bench: str, turned: bool) -> None:
    # Of four readings, which a one-axis probe gives in 2 s, the noise is hardly known.
    longer = {"record": "5 s"} if turned else {}
    outcome = commissioned(tmp_path / bench, shipped_bench(bench), turn_probe=turned, **longer)
    assert named(outcome) == set()
    assert outcome.exit_code == 0
    assert outcome.document is not None
    ratios = [
        one for one in outcome.document.to_data()["results"] if one["name"] == "coil_constant_ratio"
    ]
    assert {one["axis"] for one in ratios} == {"x", "y", "z"}
    assert all(abs(one["value"] - 1.0) < 3 * one["standard_uncertainty"] for one in ratios)


def test_without_an_ambient_field_both_causes_of_a_sign_are_named(tmp_path: Path) -> None:
    bench = shipped_bench()
    bench["simulation"]["coils"]["x"]["reversed"] = True
    outcome = commissioned(tmp_path / "run", bench, ambient=None)
    assert named(outcome) == {("field-reversed", "x")}
    document, findings = evaluate_run(RunFolder(outcome.folder))
    failed, untried, withheld, checklist = draw_parts(findings, document)
    assert isinstance(failed, Table) and isinstance(checklist, Table)
    assert isinstance(untried, Table) and isinstance(withheld, Table)
    assert ("probe", "left out") in [tuple(row) for row in untried.rows]
    assert ("coils", "field-reversed") in [tuple(row) for row in withheld.rows]
    what = [tuple(row[:2]) for row in failed.rows]
    assert what == [("field-reversed", "x"), ("coil constant ratio", "x")]
    lines = {row[0]: tuple(row[2:]) for row in checklist.rows}
    assert lines["coils"][1:] == ("FAILED", "")
    assert list(lines) == ["coils"]  # what was not done has no line
