"""The probe's part on the simulated bench: its place is measured, or not decided."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.planted.commissioning import named
from commissioning_parts import plan_of
from plan_runs import run_of, shipped_bench
from short_forms import read_bench_at

from procedures.commissioning.probe import (
    PART,
    PLACES,
    ProbeDataset,
    analyse,
    shares_at,
)
from procedures.common.helmholtz import pair_field
from station.files.lookup import BENCHES, find

CENTRED_MM = {"x": 20.0, "y": -15.0, "z": 30.0}


def short_plan() -> dict[str, Any]:
    plan = plan_of("probe")
    plan["parameters"]["probe"] |= {"record": "2 s", "settle": "0.5 s"}
    return plan


def results_of(outcome: Any) -> dict[tuple[str, str], dict[str, Any]]:
    return {(one["name"], one["axis"]): one for one in outcome.document.to_data()["results"]}


def test_the_shipped_probe_raises_no_alarm_and_its_place_is_measured(tmp_path: Path) -> None:
    outcome = run_of(tmp_path / "run", short_plan(), shipped_bench())
    assert named(outcome) == set()
    assert outcome.exit_code == 0
    found = results_of(outcome)
    for axis, mm in CENTRED_MM.items():
        one = found["probe_offset", axis]
        assert abs(one["value"] - mm) < 3 * one["standard_uncertainty"]
        assert one["standard_uncertainty"] < 3.0
        assert abs(found["probe_field_error", axis]["value"]) < 0.001


def test_with_two_coils_on_one_axis_no_place_is_named() -> None:
    shift_mm = np.array([place.shift_mm for place in PLACES])
    field_mT = np.tile(0.5 * np.eye(3)[[0, 0, 2]], (len(PLACES), 1, 1))
    fit = analyse(ProbeDataset(shift_mm, field_mT, np.full((7, 3, 3), 1e-4), 1.0, 0.5, 60.0))
    assert [flag.code for flag in fit.flags] == ["probe-place-undecided"]
    assert fit.flags[0].details["coils"] == ["x", "y"]
    assert all(one.value is None for one in fit.estimates)


@pytest.mark.parametrize("coils", list(permutations(range(3))))
@pytest.mark.parametrize("wires", [(0, 1, 2), (1, 0, 2), (1, 2, 0)])
def test_neither_exchanged_coils_nor_an_exchanged_probe_hide_the_place(
    coils: tuple[int, ...], wires: tuple[int, ...]
) -> None:
    shift_mm, centre_mm = np.array([place.shift_mm for place in PLACES]), np.array([80.0, -20, 10])
    normal = np.array([[1.0, 0.1, -0.05], [-0.1, 1.0, 0.05], [0.05, -0.1, 1.0]])
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    unknown = np.concatenate((centre_mm, np.full(3, 0.5), (300.0, 270.0, 240.0), np.ones(3)))
    field_mT = 0.5 * shares_at(shift_mm + centre_mm, unknown, normal)[..., None] * normal
    field_mT[:, 1] *= -1.0
    field_mT = field_mT[:, coils][..., wires]
    fit = analyse(ProbeDataset(shift_mm, field_mT, np.full((7, 3, 3), 1e-4), 1.0, 0.5, 60.0))
    assert [flag.code for flag in fit.flags] == ["probe-off-centre"]
    for estimate, mm in zip(fit.estimates[:3], centre_mm, strict=True):
        assert estimate.standard_uncertainty is not None
        assert estimate.value == pytest.approx(mm, abs=2.0 * estimate.standard_uncertainty)


def test_a_pair_falls_off_as_its_fourth_power_about_the_centre() -> None:
    along = np.array([0.1, 0.2])
    lost = 1.0 - pair_field(along, np.zeros(2), 1.0, 1.0)[0]
    assert lost == pytest.approx(1.152 * along**4, rel=0.06)


def test_a_probe_of_one_axis_is_not_moved() -> None:
    assert PART.is_possible(read_bench_at(find(BENCHES, "sim")))
    assert not PART.is_possible(read_bench_at(find(BENCHES, "sim-alternate")))
