"""A commissioning on the simulated benches: healthy ones pass, each planted fault is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from commissioning_parts import AMBIENT, plan_of
from plan_runs import run_of, shipped_bench, shipped_plan
from plants import named

from procedures.commissioning.coils import limits
from station.runner.outcome import Outcome


def commissioned(folder: Path, bench: dict[str, Any], **parameters: Any) -> Outcome:
    """Run the shipped plan, short, with the ambient field of the simulated room stated."""
    plan = plan_of("coils")
    plan["parameters"]["coils"] |= {"record": "2 s", "ambient": AMBIENT, **parameters}
    return run_of(folder, plan, bench)


@pytest.mark.parametrize(("bench", "turned"), [("sim", False), ("sim-alternate", True)])
def test_a_healthy_bench_raises_no_alarm(tmp_path: Path, bench: str, turned: bool) -> None:
    outcome = commissioned(tmp_path / bench, shipped_bench(bench), turn_probe=turned)
    assert named(outcome) == set()
    assert outcome.exit_code == 0
    assert outcome.document is not None
    ratios = [
        one for one in outcome.document.to_data()["results"] if one["name"] == "coil_constant_ratio"
    ]
    assert {one["axis"] for one in ratios} == {"x", "y", "z"}
    assert all(abs(one["value"] - 1.0) < 3 * one["standard_uncertainty"] for one in ratios)


def swapped_coils(bench: dict[str, Any]) -> None:
    instruments = bench["instruments"]
    instruments["coil_supply.x"]["simulator"]["coil"] = "z"
    instruments["coil_supply.z"]["simulator"]["coil"] = "x"


def reversed_coil(bench: dict[str, Any]) -> None:
    bench["simulation"]["coils"]["x"]["reversed"] = True


def constant_off(bench: dict[str, Any]) -> None:
    bench["instruments"]["coil_supply.y"]["settings"]["coil_constant"] = "0.343 mT/A"


def swapped_probe(bench: dict[str, Any]) -> None:
    bench["instruments"]["gaussmeter"]["simulator"]["wiring"] = {"x": "y", "y": "x"}


def reversed_probe(bench: dict[str, Any]) -> None:
    bench["instruments"]["gaussmeter"]["simulator"]["wiring"] = {"z": "-z"}


def leaning_coil(bench: dict[str, Any]) -> None:
    bench["simulation"]["coils"]["z"]["normal"]["towards_x"] = "6 deg"


@pytest.mark.parametrize(
    ("plant", "cause"),
    [
        (swapped_coils, ("coils-swapped", None)),
        (reversed_coil, ("coil-polarity-reversed", "x")),
        (constant_off, ("coil-constant-off", "y")),
        (swapped_probe, ("probe-axes-swapped", None)),
        (reversed_probe, ("probe-axis-reversed", "z")),
        (leaning_coil, ("coil-leans", "z")),
    ],
)
def test_a_planted_fault_is_named_alone(
    tmp_path: Path, plant: Any, cause: tuple[str, str | None]
) -> None:
    bench = shipped_bench()
    plant(bench)
    outcome = commissioned(tmp_path / "run", bench)
    assert named(outcome) == {cause}
    assert outcome.exit_code == 1


def test_without_an_ambient_field_both_causes_of_a_sign_are_named(tmp_path: Path) -> None:
    bench = shipped_bench()
    reversed_coil(bench)
    outcome = commissioned(tmp_path / "run", bench, ambient=None)
    assert named(outcome) == {("field-reversed", "x")}


def test_the_shipped_plan_states_the_limits_of_the_naming() -> None:
    stated = shipped_plan("commissioning")["limits"]
    assert stated["coil_constant_ratio"] == {
        "min": 1.0 - limits.COIL_CONSTANT,
        "max": 1.0 + limits.COIL_CONSTANT,
    }
    assert stated["cross_axis"] == {"max": limits.CROSS_AXIS}
    assert stated["ambient_noise"] == {"max": f"{limits.AMBIENT_NOISE_MT:g} mT"}
    assert stated["field_after_off"]["max"] == f"{limits.FIELD_AFTER_OFF_MT:g} mT"
