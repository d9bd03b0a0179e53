"""Nulling by modulation on the whole station, beside nulling by precession."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_runs import shipped_bench
from test_run_serf import run_plan

from station.record.folder import RunFolder

SEEDS = (0, 1, 2, 3)
AT_REST = {"gyro_was_running": False}
SHIELD_NT = {"x": 1.2, "y": -0.9, "z": 0.8}


def read(folder: Path) -> list[dict[str, Any]]:
    return [dict(one.details) for one in RunFolder(folder).events_of("residual-by-modulation")]


@pytest.mark.parametrize(
    "seed", [SEEDS[0], *(pytest.param(s, marks=pytest.mark.campaign) for s in SEEDS[1:])]
)
def test_modulation_and_precession_tell_the_same_residual_field(tmp_path: Path, seed: int) -> None:
    outcome, truth = run_plan(tmp_path / "tones", seed, nulling="modulation")
    assert outcome.document is not None, outcome.error
    rounds = read(outcome.folder)
    first, last = rounds[0], rounds[-1]
    assert len(rounds) == 2
    assert np.linalg.norm(list(last["field_nT"].values())) <= 0.5
    for axis, true_nT in SHIELD_NT.items():
        assert abs(first["field_nT"][axis] - true_nT) < 3 * first["u_nT"][axis]
    beside = {
        one.axis: one.value
        for one in outcome.document.published
        if (one.name, one.method) == ("residual_field", "modulation")
    }
    assert beside == last["field_nT"]
    for axis in "xyz":
        solved = outcome.document.result("residual_field", axis)
        assert solved.estimate.value is not None and solved.combined is not None
        u_nT = np.hypot(last["u_nT"][axis], solved.combined.standard_uncertainty)
        assert abs(beside[axis] - solved.estimate.value) < 2 * u_nT
    for pair in ("xy", "xz", "yz"):
        angle = outcome.document.result("nonorthogonality_angle", pair)
        true_deg = float(truth["coils"]["angles"][pair].split()[0])
        assert angle.estimate.value is not None and angle.combined is not None
        assert abs(angle.estimate.value - true_deg) < 4 * angle.combined.standard_uncertainty
    by_precession, _ = run_plan(tmp_path / "shots", seed)
    looks = list(RunFolder(by_precession.folder).events_of("residual-field"))
    for axis, nT in looks[0].details["field_nT"].items():
        assert abs(nT - first["field_nT"][axis]) < 2 * first["u_nT"][axis] + 0.02
    assert not [one for one in by_precession.document.published if one.name == "residual_field"]


def wrong(coil: str, **changes: str) -> dict[str, Any]:
    coils = shipped_bench()["simulation"]["serf"]["coils"]
    coils[coil] |= changes
    return {**AT_REST, "coils": coils}


@pytest.mark.parametrize(
    ("coil", "changes", "said"),
    [
        ("y", {"error": "-100 %"}, "nothing answers the tone on coil y"),
        ("z", {"constant": "-20 nT/V"}, "left-handed triad: one of the coils x, y, z"),
    ],
)
def test_a_coil_that_is_dead_or_turned_ends_the_run_by_name(
    tmp_path: Path, coil: str, changes: dict[str, str], said: str
) -> None:
    outcome, _ = run_plan(tmp_path, 0, wrong(coil, **changes), **AT_REST, nulling="modulation")
    assert outcome.exit_code == 3
    assert said in str(outcome.error)
    assert all(one.verified for one in outcome.safe)


@pytest.mark.parametrize(
    ("nulling", "others", "said"),
    [
        ({"rounds": 1}, {}, "after 1 rounds of nulling by modulation"),
        ({"at_most": "1 nT"}, {}, "more than nulling.at_most, 1 nT"),
        ({}, {"full_scale": "0.05 V"}, "reaches the full scale, 0.05 V"),
    ],
)
def test_what_does_not_become_small_or_is_cut_off_ends_the_run(
    tmp_path: Path, nulling: dict[str, Any], others: dict[str, str], said: str
) -> None:
    rule = {"method": "modulation", **nulling}
    outcome, _ = run_plan(tmp_path, 0, AT_REST, **AT_REST, **others, nulling=rule)
    assert outcome.exit_code == 3
    assert said in str(outcome.error)
