"""The solution of made readings: truth within u, plausible but wrong data right or flagged."""

from __future__ import annotations

import numpy as np
import pytest
from tumble_records import ARCSEC, FOUR, QUARTZ, Stage, changed, made

from procedures.accelerometer_tumble.analysis import TumbleAnalysis, analyse
from procedures.accelerometer_tumble.dataset import TumbleDataset

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


@pytest.fixture(scope="module")
def base() -> TumbleDataset:
    return made(np.random.default_rng(3), Stage())


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


def test_too_few_readings_give_no_numbers(base: TumbleDataset) -> None:
    analysis = analyse(base.only(np.arange(len(base.time_s)) % 48 == 0))
    assert all(one.value is None for one in analysis.estimates)
    assert "not-identifiable" in codes(analysis)


@pytest.mark.parametrize("column", ["encoder_rad", "output_V"])
def test_a_position_180_deg_off_is_left_out(base: TumbleDataset, column: str) -> None:
    wrong = getattr(base, column).copy()
    wrong[20] = wrong[20] + np.pi if column == "encoder_rad" else -wrong[20]
    analysis = analyse(changed(base, **{column: wrong}))
    assert "outliers-rejected" in codes(analysis) and worst(analysis) < 3.5
    assert ("contradicts-statement" in codes(analysis)) == (column == "encoder_rad")


def test_a_wild_encoder_reading_is_left_out(base: TumbleDataset) -> None:
    wrong = base.encoder_rad.copy()
    wrong[100] += 30 * ARCSEC
    analysis = analyse(changed(base, encoder_rad=wrong))
    assert "outliers-rejected" in codes(analysis) and worst(analysis) < 3.5


def test_a_frozen_meter_and_a_copied_mounting_are_left_out(base: TumbleDataset) -> None:
    frozen, copied = base.output_V.copy(), base.output_V.copy()
    frozen[60:75] = frozen[60]
    copied[48:96] = copied[:48]
    for output, count in ((frozen, 15), (copied, 48)):
        analysis = analyse(changed(base, output_V=output))
        flag = next(one for one in analysis.flags if one.code == "frozen")
        assert flag.details["count"] == count and worst(analysis) < 3.5


def test_a_frozen_thermometer_gives_no_temperature_terms(base: TumbleDataset) -> None:
    warm = base.temperature_degC
    assert warm is not None
    analysis = analyse(changed(base, temperature_degC=np.where(base.time_s > 1e3, 23.0, warm)))
    assert "frozen" in codes(analysis) and analysis.used.temperature_degC is None
    assert worst(analysis) < 3.5


def test_a_step_of_the_output_is_solved_for(base: TumbleDataset) -> None:
    after = base.time_s >= base.time_s[60]
    analysis = analyse(changed(base, output_V=base.output_V + 50e-6 * after))
    flag = next(one for one in analysis.flags if one.code == "output-step")
    assert flag.details["time_s"] == base.time_s[60]
    assert flag.details["step_V"] == pytest.approx(50e-6, rel=0.1)
    assert abs((analysis.estimate("Ko").value or 0.0) - QUARTZ["Ko"]) < 15e-6


@pytest.mark.parametrize("what", ["plane", "reverse"])
def test_one_mounting_under_another_name_is_flagged(base: TumbleDataset, what: str) -> None:
    own = getattr(base, what).copy()
    own[base.mounting == 1] = "ip" if what == "plane" else 1.0
    # Two mountings of one name in a row are one, whose readings contradict one another.
    raised = codes(analyse(changed(base, **{what: own})))
    assert raised & {"contradicts-statement", "model-too-stiff"}


def test_a_sense_that_is_reversed_throughout_is_flagged(base: TumbleDataset) -> None:
    turned = changed(base, encoder_rad=-base.encoder_rad, commanded_rad=-base.commanded_rad)
    statements = [one.details.get("statement") for one in analyse(turned).flags]
    assert "theta_deg" in statements


def test_a_higher_harmonic_of_the_encoder_is_flagged(base: TumbleDataset) -> None:
    beside = base.encoder_rad + 5 * ARCSEC * np.cos(5 * base.encoder_rad)
    assert "misfit" in codes(analyse(changed(base, encoder_rad=beside)))
