"""A commissioning names each planted fault and nothing else.

The long form, whole records and many seeds, is `benchmarks/commissioning.py`.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from campaigns.planted.commissioning import cases, commission, named, pair
from places import ROOT
from tiers import quick

NOT_PLANTED = {
    "accelerometer-reversed",
    "gyro-sense-reversed",
    "not-commissioned",
    "not-measured",
    "sensor-turned",
    "stage-response-off",
    "stage-turn-not-whole",
    "table-axes-otherwise",
    "table-rate-off",
    "turn-not-whole",
}
"""Codes that the simulated benches have no fault for, and no test of numbers alone expects."""
PLANTED = {case.name: case for case in cases() if case.plant is not None}
FIRST = {case.plant.part: name for name, case in reversed(PLANTED.items()) if case.plant}
"""A fault of each part, on the bench that has it first."""


@pytest.mark.parametrize("name", quick(PLANTED, *FIRST.values()))
def test_a_planted_fault_is_named_alone(name: str, tmp_path: Path) -> None:
    right, outcome = commission(PLANTED[name], 1, tmp_path / "run", short=True)
    assert right, (outcome.error, outcome.document and named(outcome))


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [*range(1, 9), 5004, 5026, 5117, 5156])
def test_two_planted_faults_are_both_named(seed: int, tmp_path: Path) -> None:
    right, outcome = commission(pair(seed), seed, tmp_path / "run", short=True)
    assert right, (pair(seed).name, outcome.error, outcome.document and named(outcome))


def literals(path: Path) -> set[object]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}


def test_every_flag_code_of_a_commissioning_is_expected_somewhere() -> None:
    codes = {
        node.args[0].value
        for path in (ROOT / "procedures" / "commissioning").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in {"Flag", "Cause"}
        and isinstance(node.args[0], ast.Constant)
    }
    others = set(Path(__file__).parent.glob("*.py")) - {Path(__file__)}
    plants = ROOT / "tests" / "support" / "campaigns" / "planted" / "commissioning.py"
    expected = literals(plants).union(*map(literals, others))
    assert codes - expected == NOT_PLANTED
