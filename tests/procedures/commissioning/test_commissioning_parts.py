"""A commissioning has parts: a plan chooses them, and `fits` leaves out what a bench cannot do."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml
from plan_runs import shipped_bench, shipped_plan
from short_forms import read_bench_at

from procedures.commissioning import PARTS, PROCEDURE, coils
from procedures.commissioning.parameters import CommissioningParameters
from station.files.faults import FaultList
from station.files.plan import read_plan
from station.procedure import Procedures
from station.units import parse_as


def test_a_part_that_is_left_out_measures_nothing() -> None:
    parameters = CommissioningParameters()
    for part in PARTS:
        without = parameters.model_copy(update={"checks": ()})
        assert PROCEDURE.measured_axes(without)[next(iter(part.results))] == ()
    assert not PROCEDURE.walk(parameters.model_copy(update={"checks": ()})).acts


def test_a_bench_without_a_gaussmeter_has_no_part_and_no_limit_of_the_coils(tmp_path: Path) -> None:
    bench = shipped_bench()
    del bench["instruments"]["gaussmeter"]
    bench["interlocks"] = [
        one for one in bench["interlocks"] if one["when"]["instrument"] != "gaussmeter"
    ]
    path = tmp_path / "bench.yaml"
    path.write_text(yaml.safe_dump(bench), encoding="utf-8")
    overrides = list(PROCEDURE.fits(read_bench_at(path), False, {}))
    assert "coils" not in overrides[0]
    assert {f"limits.{name}=null" for name in coils.PART.results} <= set(overrides)


@pytest.mark.parametrize(("part", "key"), [("coils", "ambient"), ("gyro", "earth")])
def test_what_the_site_is_stands_in_no_part(part: str, key: str, tmp_path: Path) -> None:
    plan = shipped_plan("commissioning")
    plan["parameters"][part][key] = {}
    path = tmp_path / "plan.yaml"
    path.write_text(yaml.safe_dump(plan), encoding="utf-8")
    with pytest.raises(FaultList, match=f"did you mean 'parameters.{key}'"):
        read_plan(path, Procedures())


FIGURES = {figure.name: figure for part in PARTS for figure in part.figures}


def quantity(stated: object, unit: str) -> float:
    """Return a limit of a plan as a number in a unit; a plan states ratios without one."""
    return float(stated) if isinstance(stated, int | float) else parse_as(str(stated), unit)


@pytest.mark.parametrize("name", sorted(FIGURES))
def test_the_shipped_plan_states_the_limits_of_the_naming(name: str) -> None:
    figure, stated = FIGURES[name], shipped_plan("commissioning")["limits"].get(name, {})
    edges = {
        (-1.0 if key == "min" else 1.0, round(quantity(value, figure.unit), 12))
        for key, value in stated.items()
    }
    low, high = (round(figure.nominal + sign * figure.limit, 12) for sign in (-1.0, 1.0))
    assert edges <= {(-1.0, low), (1.0, high)}
    assert bool(edges) == math.isfinite(figure.limit)
