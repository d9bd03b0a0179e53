"""A commissioning has parts: a plan chooses them, and `fits` leaves out what a bench cannot do."""

from __future__ import annotations

from pathlib import Path

import yaml
from plan_runs import shipped_bench
from short_forms import read_bench_at

from procedures.commissioning import PARTS, PROCEDURE
from procedures.commissioning.coils import COIL_PART
from procedures.commissioning.parameters import CommissioningParameters


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
    assert {f"limits.{name}=null" for name in COIL_PART.results} <= set(overrides)
