"""Faults planted in logs of turns over temperature: none ends in a wrong number without a flag.

The short form of `benchmarks/sabotage.py --procedure fog-scale-factor-temperature`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sabotage_fog
from fog_logs import made
from fog_records import NOISE_DEG, quartic, record
from sabotage import analysed, error_u, judged

from procedures.fog_scale_factor_temperature.analysis import analyse
from procedures.fog_scale_factor_temperature.dataset import FogDataset

PLANTED = {one.name: one for one in sabotage_fog.FAULTS}
QUICK = (
    "headings in gon",
    "headings as DD.MMSS",
    "headings to 0.1 deg",
    "temperatures in degF",
    "x drifts by 8 degC",
    "turns back called double",
    "earth's rate not taken off",
    "times in ms",
    "labels exchanged, attitudes known",
    "upside down, attitudes known",
    "wrong sense, with a drive",
    "commands unsigned",
    "waits called turns",
    "chamber for gyro",
    "thermometers stop for a sixth",
    "headings do not follow from two thirds on",
    "headings copied from earlier sets",
    "temperatures to 2 degC",
    "hysteresis of 10 ppm",
)


@pytest.mark.parametrize("name", QUICK)
def test_a_planted_fault_is_named(name: str) -> None:
    found = judged(PLANTED[name], 1)
    assert found["named"], found
    assert not found["broken"]


@pytest.mark.parametrize("kind", range(len(sabotage_fog.KINDS)))
def test_a_clean_log_has_no_flag_and_its_uncertainty_holds(kind: int) -> None:
    clean = made(sabotage_fog.KINDS[kind](3000 + kind))
    document = analysed(clean)
    assert {one["code"] for one in document["flags"]} <= sabotage_fog.USUAL_FLAGS
    assert error_u(clean, document["results"]) < 4.5


def featured(seed: int, at: float, ppm: float, width: float, turns: tuple[int, ...]) -> FogDataset:
    return record(
        seed,
        turns,
        curves={"x": lambda heat: quartic(heat) + ppm * np.exp(-0.5 * ((heat - at) / width) ** 2)},
    )


@pytest.mark.parametrize("turns", [(360, -360), (360,)])
def test_a_feature_between_two_sets_is_in_the_uncertainty(turns: tuple[int, ...]) -> None:
    """Some of its turns are left out: in pairs one of each, of one sense two neighbours."""
    for seed in range(4):
        at = 13.2 + 0.3 * seed
        fit = analyse(featured(seed, at, 40.0, 1.3, turns)).fits["x"]
        assert fit.misfit is not None
        assert fit.misfit.sure
        assert fit.curve is not None
        assert float(fit.curve.check_ppm(np.array([fit.misfit.at_degC]))[0]) > 15.0


def test_a_knocked_turn_is_no_feature() -> None:
    for seed in range(8):
        for turns in ((360, -360), (360,), (360, 0)):
            dataset = record(seed, turns)
            after = dataset.turns.attitude_after_deg
            rows = np.random.default_rng(seed).choice(len(after), 3, replace=False)
            after[rows, 0] += np.array([0.02, -0.05, 0.1])
            fit = analyse(dataset).fits["x"]
            assert fit.misfit is None or not fit.misfit.sure


def test_sets_far_apart_in_temperature_are_not_called_missing() -> None:
    (said,) = [one.message for one in analyse(record(1, sets=9)).flags if one.code == "gap"]
    assert "far apart" in said
    assert "missing" not in said


def test_few_sets_are_named_where_the_curve_may_be_taken_for_noise() -> None:
    dataset = replace(record(1, sets=6), angle_random_walk_deg_per_sqrt_h=0.002)
    (said,) = [one for one in analyse(dataset).flags if one.code == "contradicts-statement"]
    assert "measure more sets (6 " in said.message


def test_a_kink_that_chance_makes_hardly_widens_the_uncertainty() -> None:
    grew = []
    for seed in range(40):
        curve = analyse(record(seed)).fits["x"].curve
        assert curve is not None
        at = np.array([20.0])
        grew.append(
            float(np.hypot(1.0, curve.check_ppm(at) / curve.standard_uncertainty_ppm(at))[0])
        )
    assert np.mean(grew) < 1.08
    assert max(grew) < 2.5


def test_readings_that_all_round_alike_leave_an_uncertainty() -> None:
    dataset = record(4)
    change = dataset.turns.attitude_after_deg - dataset.turns.attitude_before_deg
    dataset.turns.attitude_before_deg[:, 0] = 0.0
    dataset.turns.attitude_after_deg[:, 0] = np.round(np.mod(change[:, 0], 360.0))
    curve = analyse(dataset).fits["x"].curve
    assert curve is not None
    u = np.hypot(
        curve.standard_uncertainty_ppm(np.array([20.0])), curve.check_ppm(np.array([20.0]))
    )
    off = abs(float(curve.error_ppm(np.array([20.0]))[0]) - float(quartic(np.array([20.0]))[0]))
    assert off < 4.0 * float(u[0])


def test_much_noise_does_not_hide_the_curve_from_the_uncertainty() -> None:
    """At 200 times the noise the criterion takes a lower order; what it leaves out is in u."""
    worst = []
    for seed in range(8):
        noisy = record(seed, noise_deg=200.0 * NOISE_DEG)
        curve = analyse(noisy).fits["x"].curve
        assert curve is not None
        grid = curve.temperatures_degC(41)
        u = np.hypot(curve.standard_uncertainty_ppm(grid), curve.check_ppm(grid))
        worst.append(float(np.max(np.abs(curve.error_ppm(grid) - quartic(grid)) / u)))
    assert max(worst) < 5.0
