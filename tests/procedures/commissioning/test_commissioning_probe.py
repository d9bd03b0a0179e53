"""The probe's part on the simulated bench: its place is measured, or not decided."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns.planted.commissioning import named
from commissioning_parts import plan_of
from plan_runs import run_of, shipped_bench
from short_forms import read_bench_at

from procedures.commissioning.probe import PART, PLACES, ProbeDataset, analyse, pair_field
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


def test_with_two_coils_exchanged_no_place_is_named() -> None:
    shift_mm = np.array([place.shift_mm for place in PLACES])
    field_mT = np.full((len(PLACES), 3), 0.5)
    field_mT[:, 1] = 0.002
    fit = analyse(ProbeDataset(shift_mm, field_mT, np.full((7, 3), 1e-4), 1.0, 0.5, 60.0))
    assert [flag.code for flag in fit.flags] == ["probe-place-undecided"]
    assert all(one.value is None for one in fit.estimates)


def test_a_pair_falls_off_as_its_fourth_power_about_the_centre() -> None:
    along = np.array([0.1, 0.2])
    lost = 1.0 - pair_field(along, np.zeros(2), 1.0, 1.0)
    assert lost == pytest.approx(1.152 * along**4, rel=0.06)


def test_a_probe_of_one_axis_is_not_moved() -> None:
    assert PART.is_possible(read_bench_at(find(BENCHES, "sim")))
    assert not PART.is_possible(read_bench_at(find(BENCHES, "sim-alternate")))
