"""Errors of a temperature log that leave a smooth curve: each is flagged by its cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from fog_records import CURVES, NOISE_DEG, Array, only, quartic, record

from procedures.fog_scale_factor_temperature.analysis import FogAnalysis, analyse
from procedures.fog_scale_factor_temperature.dataset import FogDataset, TurnTable
from procedures.fog_scale_factor_temperature.evaluate import to_findings
from station.findings import Estimate, Flag
from station.uncertainty import Combined, combine

PAIRS, SINGLE = (360, -360), (360,)
STATED = {"angle_random_walk_deg_per_sqrt_h": 0.002, "turntable_accuracy_arcsec": 1.0}
SHOWN = {"misfit", "model-too-stiff"}


def flags(analysis: FogAnalysis, code: str) -> list[Flag]:
    return [flag for flag in analysis.flags if flag.code == code]


def with_total(dataset: FogDataset) -> tuple[Estimate, Combined | None]:
    findings = to_findings(analyse(dataset), dataset, [], "specification")
    return findings.estimates[0], combine(findings.estimates, findings.inputs)[0]


def bent(shape: Callable[[Array], Array]) -> dict[str, Callable[[Array], Array]]:
    """Return a gyro's curve with something on it."""
    return {"x": lambda heat: quartic(heat) + shape(heat)}


def in_radians(table: TurnTable) -> TurnTable:
    return replace(
        table,
        attitude_before_deg=np.radians(table.attitude_before_deg),
        attitude_after_deg=np.radians(table.attitude_after_deg),
    )


def shifted(seed: int, ppm: float) -> FogDataset:
    """Return a log whose verification ramp was made by a gyro that had changed by 20 ppm rms."""
    down = record(
        seed + 50, first_degC=58.0, last_degC=-37.0, curves=bent(lambda heat: ppm + 0.0 * heat)
    )
    return replace(record(seed), verification=down.turns)


def test_a_verification_that_disagrees_by_20_ppm_is_flagged_and_in_the_uncertainty() -> None:
    for seed in range(5):
        dataset = shifted(seed, 20.0)
        analysis = analyse(dataset)
        (flag,) = flags(analysis, "contradicts-statement")
        assert flag.details["statement"] == "verification"
        estimate, total = with_total(dataset)
        assert estimate.value is not None
        assert total is not None
        assert 15.0 < total.standard_uncertainty < 25.0
        assert "what checks of the curve of x show" in {one.description for one in total.budget}
    for seed in range(20):
        for turns in (PAIRS, SINGLE):
            clean = replace(
                record(seed, turns),
                verification=record(seed + 50, turns, first_degC=58.0, last_degC=-37.0).turns,
            )
            assert not flags(analyse(clean), "contradicts-statement")


def test_noise_far_beyond_the_stated_one_is_flagged() -> None:
    for turns in (PAIRS, SINGLE):
        noisy = replace(record(1, turns, noise_deg=200.0 * NOISE_DEG), **STATED)  # type: ignore[arg-type]
        (flag,) = flags(analyse(noisy), "contradicts-statement")
        assert flag.details["statement"] == "angle_random_walk"
        assert flag.details["noise_ppm"] == pytest.approx(200.0, rel=0.3)
        for seed in range(20):
            quiet = replace(record(seed, turns), **STATED)  # type: ignore[arg-type]
            assert not flags(analyse(quiet), "contradicts-statement")


def test_headings_in_radians_are_flagged_and_nothing_is_told() -> None:
    for turns in (PAIRS, SINGLE):
        dataset = record(2, turns)
        analysis = analyse(replace(dataset, turns=in_radians(dataset.turns)))
        (flag,) = flags(analysis, "contradicts-statement")
        assert flag.details["statement"] == "heading_deg"
        assert analysis.fits["x"].curve is None
        near_north = replace(
            dataset.turns,
            attitude_before_deg=dataset.turns.attitude_before_deg / 60.0,
        )
        found = flags(analyse(replace(dataset, turns=near_north)), "contradicts-statement")
        assert "heading_deg" not in {flag.details["statement"] for flag in found}


@pytest.mark.parametrize("width", [1.0, 2.0])
def test_a_feature_of_15_ppm_and_2_degC_is_flagged(width: float) -> None:
    for seed in range(8):
        at = 12.3 + 0.37 * seed
        dataset = record(
            seed, curves=bent(lambda h, at=at: 15.0 * np.exp(-0.5 * ((h - at) / width) ** 2))
        )
        analysis = analyse(dataset)
        (flag,) = flags(analysis, "misfit")
        assert flag.details["at_degC"] == pytest.approx(at, abs=4.0)


@pytest.mark.parametrize("slope", [0.5, 1.0, 3.0])
def test_a_kink_is_flagged_or_within_the_uncertainty(slope: float) -> None:
    said = missed = 0
    for seed in range(12):
        at = 10.0 + 0.7 * seed

        def kink(heat: Array, at: float = at) -> Array:
            return np.asarray(slope * np.maximum(heat - at, 0.0))

        analysis = analyse(record(seed, curves=bent(kink)))
        curve = analysis.fits["x"].curve
        assert curve is not None
        grid = curve.temperatures_degC(200)
        off = np.abs(curve.error_ppm(grid) - quartic(grid) - kink(grid))
        u = np.hypot(curve.standard_uncertainty_ppm(grid), curve.check_ppm(grid))
        shown = {one.code for one in analysis.flags} & SHOWN
        said += bool(shown)
        missed += not shown and float(np.max(off / u)) > 6.0
    # One of 0.5 ppm/degC bends the curve by 1.2 ppm, less than two noises of a set.
    assert said >= (10 if slope >= 1.0 else 3)
    assert missed <= (0 if slope >= 1.0 else 4)


def test_in_a_gap_of_80_degC_nothing_is_told_and_a_small_one_is_in_the_uncertainty() -> None:
    dataset = record(3)
    heat = dataset.turns.temperature_degC
    wide = only(dataset, (heat < -30.0) | (heat > 50.0))
    analysis = analyse(wide)
    (flag,) = flags(analysis, "not-identifiable")
    assert flag.details["coefficients"] == ["scale_factor_error"]
    assert "no value is given" in flags(analysis, "gap")[0].message
    findings = to_findings(analysis, wide, [], "specification")
    assert [one.value for one in findings.estimates] == [None, None]
    for seed in range(6):
        one = record(seed)
        heat = one.turns.temperature_degC
        small = only(one, (heat < 12.0) | (heat > 28.0))
        estimate, total = with_total(small)
        assert estimate.value is not None
        assert total is not None
        truth = float(quartic(np.array([20.0]))[0])
        assert abs(estimate.value - truth) < 4.0 * total.standard_uncertainty
        whole = with_total(one)[1]
        assert whole is not None
        assert total.standard_uncertainty > whole.standard_uncertainty


def test_clean_logs_have_none_of_these_flags() -> None:
    for seed in range(60):
        turns = PAIRS if seed % 2 else SINGLE
        walk = 0.05 if seed % 4 == 1 else 0.0
        dataset = replace(record(seed, turns, walk=walk, curves=dict(CURVES)), **STATED)  # type: ignore[arg-type]
        found = {flag.code for flag in analyse(dataset).flags}
        assert not found & {"misfit", "contradicts-statement", "gap"}, (seed, found)
