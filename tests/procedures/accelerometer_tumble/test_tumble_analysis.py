"""The solution of made readings: truth within u, and what the mountings determine."""

from __future__ import annotations

import numpy as np
import pytest
from tumble_records import FOUR, QUARTZ, Stage, changed, made

from procedures.accelerometer_tumble.analysis import TumbleAnalysis, analyse
from procedures.accelerometer_tumble.checks import screened

WARMTH = "thermometer_degC"
HEAD = tuple((plane, turned, 90.0) for plane, turned, _ in FOUR)


def worst(analysis: TumbleAnalysis) -> float:
    """Return the largest error over u of the kept combinations."""
    off = []
    for name, terms in analysis.terms.items():
        one = analysis.estimate(name)
        assert one.value is not None and one.standard_uncertainty is not None
        priors = np.hypot(one.sensitivities["encoder"], one.sensitivities["mounting"])
        truth = sum(share * QUARTZ.get(other, 0.0) for other, share in terms.items())
        off.append(abs(one.value - truth) / np.hypot(one.standard_uncertainty, priors))
    return float(max(off))


def codes(analysis: TumbleAnalysis) -> set[str]:
    return {one.code for one in analysis.flags}


@pytest.mark.parametrize(
    "stage",
    [
        Stage(),
        Stage(mountings=FOUR[:3], positions=12),
        Stage(mountings=(*FOUR, *HEAD)),
        Stage(drift_V_per_h=20e-6),
        Stage(warms_K=1.0),
    ],
    ids=["four", "three of 12", "head", "drift", "warms"],
)
def test_the_truth_lies_within_the_uncertainty(stage: Stage) -> None:
    analysis = analyse(made(np.random.default_rng(8), stage))
    assert worst(analysis) < 3.5
    assert codes(analysis) <= {"not-identifiable", "drift-removed", "not-significant"}
    moves = stage.drift_V_per_h or stage.warms_K
    assert ("drift-removed" in codes(analysis)) == bool(moves)


def test_mountings_decide_what_is_determined() -> None:
    rng = np.random.default_rng(1)
    one = analyse(made(rng, Stage(mountings=FOUR[:1], positions=8)))
    assert {name: dict(terms) for name, terms in one.terms.items()} == {
        "K0": {"K0": 1.0, "Koo": 1.0},
        "Ki": {"Ki": 1.0},
        "Kii": {"Kii": 1.0, "Koo": -1.0},
        "Kiii": {"Kiii": 1.0},
        "Kio": {"Kio": 1.0},
        "Kf": {"Kf": 1.0, "Ko": 1.0},
    }
    assert one.estimate("fixture_error").value is None
    (flag,) = [flag for flag in one.flags if flag.code == "not-identifiable"]
    assert {"fixture_error", "misalignment o", "Kop"} < set(flag.details["coefficients"])
    assert one.estimate("misalignment", "o").value is None
    assert one.estimate("bias").value is not None
    four = analyse(made(rng, Stage(mountings=FOUR[:1], positions=4)))
    assert dict(four.terms["Ki"]) == {"Ki": 1.0, "Kiii": 1.0} and "Kio" not in four.terms
    three = analyse(made(rng, Stage(mountings=FOUR[:3])))
    assert {"Kpp", "Kop"} == set(QUARTZ | {"Kpp": 0, "Kop": 0}) - set(three.terms)


def test_turning_the_head_frees_the_third_order() -> None:
    rng = np.random.default_rng(1)
    plain, turned = (
        analyse(made(rng, Stage(mountings=mountings))).estimate("Kiii").sensitivities["encoder"]
        for mountings in (FOUR, (*FOUR, *HEAD))
    )
    assert plain > 9e-6 and turned < 0.3 * plain


@pytest.mark.parametrize("rows", [0, 1, 2, 9])
def test_a_run_that_ended_early_has_no_results_and_a_flag(rows: int) -> None:
    readings = made(np.random.default_rng(1), Stage(positions=8))
    analysis = analyse(readings.only(np.arange(len(readings.time_s)) < rows))
    assert "not-identifiable" in codes(analysis)
    assert analysis.estimate("Kpp").value is None


def test_the_bias_depends_on_the_thermometer_as_the_ratio_that_it_is() -> None:
    analysis = analyse(made(np.random.default_rng(8), Stage(warms_K=1.0)))
    k0, ki, bias = (analysis.estimate(name) for name in ("K0", "Ki", "bias"))
    warmer = [(one.value or 0.0) + one.sensitivities.get(WARMTH, 0.0) for one in (k0, ki)]
    assert bias.value is not None
    moved = warmer[0] / warmer[1] - bias.value
    assert moved != 0.0 and bias.sensitivities[WARMTH] == pytest.approx(moved, rel=1e-3)
    assert bias.extra["conditions"] == k0.extra["conditions"]
    same = analyse(made(np.random.default_rng(8), Stage()))
    assert WARMTH not in same.estimate("bias").sensitivities


def test_a_temperature_that_is_another_one_after_a_pause_makes_no_reading_wild() -> None:
    """A run that was stopped after 20 positions goes on an hour later, the stage cold again."""
    rng = np.random.default_rng(3)
    dataset = made(rng, Stage(positions=12))
    row = np.arange(len(dataset.time_s))
    later = row >= 20
    warm = 23.4 + 0.04 * row - 1.3 * later + 0.001 * rng.standard_normal(len(row))
    without = changed(dataset, temperature_degC=warm)
    assert screened(without)[0].temperature_degC is None, "without a pause nothing cools so fast"
    used, flags = screened(changed(without, time_s=dataset.time_s + 3600.0 * later))
    assert used.temperature_degC is not None and not flags


def test_a_temperature_term_too_small_to_choose_is_in_the_uncertainty() -> None:
    stage = Stage(mountings=FOUR[:3], positions=8, warms_K=0.05)
    off = []
    for seed in range(40):
        estimate = analyse(made(np.random.default_rng((seed, 7)), stage)).estimate("Koo")
        assert estimate.value is not None and estimate.standard_uncertainty is not None
        u = np.hypot(estimate.standard_uncertainty, estimate.sensitivities["encoder"])
        off.append((estimate.value - QUARTZ["Koo"]) / u)
    assert np.mean(np.square(off)) < 1.5


@pytest.mark.parametrize(
    ("factor", "meant"),
    [(-1.0, "`head_deg` is of the other sense"), (0.0, "`theta_deg` holds `head_deg` already")],
)
def test_a_head_that_means_something_else_is_named(factor: float, meant: str) -> None:
    readings = made(np.random.default_rng(3), Stage(mountings=(*FOUR, *HEAD)))
    more = (1.0 - factor) * readings.head_rad
    angles = {name: getattr(readings, name) + more for name in ("commanded_rad", "encoder_rad")}
    analysis = analyse(changed(readings, **angles))
    (flag,) = [flag for flag in analysis.flags if flag.code == "contradicts-statement"]
    assert flag.details["statement"] == "head_deg"
    assert meant in flag.message
    assert all(one.value is None for one in analysis.estimates)
