"""Doubted coil constants, lost shots, tones that fade: what each is worth in u."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from serf_shots import Cell

from procedures.serf_nonorthogonality.analysis import analyse
from procedures.serf_nonorthogonality.dataset import SerfAnalysis, SerfDataset
from procedures.serf_nonorthogonality.precession import saturated_samples

COILS, RESIDUAL = (1.010, 0.995, 1.008), (1.0, -0.6, 0.8)


def pull(analysis: SerfAnalysis, name: str, axis: str | None, truth: float) -> float:
    """Return the error of a result in its standard uncertainties."""
    one = analysis.estimate(name, axis)
    assert one.value is not None and one.standard_uncertainty is not None
    return (one.value - truth) / one.standard_uncertainty


def statements(analysis: SerfAnalysis) -> set[object]:
    """Return what the data contradict."""
    flags = [flag for flag in analysis.flags if flag.code == "contradicts-statement"]
    return {flag.details["statement"] for flag in flags}


def without(dataset: SerfDataset, *names: str) -> SerfDataset:
    """Return the dataset without the signal of some shots."""
    shots = [
        replace(one, voltage_V=np.zeros_like(one.voltage_V)) if one.name in names else one
        for one in dataset.shots
    ]
    return replace(dataset, shots=shots)


def test_known_coil_constants_that_fourteen_shots_contradict_are_overruled_and_flagged() -> None:
    cell = Cell(factors=(1.001, 0.9995, 1.0008), known=True)
    analysis = analyse(cell.dataset(0))
    assert statements(analysis) == {"coil_constants"}
    for pair, angle in zip(("xy", "xz", "yz"), cell.angles_deg, strict=True):
        assert abs(pull(analysis, "nonorthogonality_angle", pair, angle)) < 4.0
    for axis, factor in zip("yz", cell.factors[1:], strict=True):
        assert abs(pull(analysis, "coil_factor", axis, factor / cell.factors[0])) < 4.0
    # What the bench file's uncertainty covers is solved for too, and contradicts nothing.
    covered = analyse(replace(cell.dataset(0), coil_u=(0.002, 0.002, 0.002)))
    assert not statements(covered)
    assert covered.estimates == analysis.estimates


def test_known_coil_constants_are_one_number_in_the_solution() -> None:
    cell = Cell(known=True, residual_nT=RESIDUAL)
    for seed in range(2):
        analysis = analyse(cell.dataset(seed))
        assert analysis.frequencies is not None
        assert float(np.ptp(analysis.frequencies.solution.scale)) == 0.0
        assert abs(pull(analysis, "slowing_down_factor", None, 6.0)) < 4.0
        assert not statements(analysis)


def test_doubtful_coil_constants_are_kept_and_widen_the_uncertainty() -> None:
    still, off = (Cell(known=True, factors=(1.0, 1.0, one)) for one in (1.0, 1.0003))
    u = []
    for cell in (still, off):
        analysis = analyse(cell.dataset(0))
        assert not statements(analysis)
        assert abs(pull(analysis, "slowing_down_factor", None, 6.0)) < 4.0
        u.append(analysis.estimate("slowing_down_factor").standard_uncertainty or 0.0)
    assert u[1] > 1.3 * u[0]


def test_known_coil_constants_are_not_denied_by_what_the_model_misses() -> None:
    cell = Cell(known=True, pull=False, field_nT=80.0, polarisation=0.1, relaxation=100.0)
    analysis = analyse(cell.but(noise_V=0.001, duration_s=0.2).dataset(2))
    assert not statements(analysis)


@pytest.mark.parametrize("part, seen", [(1.0, False), (0.9, True)])
def test_the_steps_of_a_coarse_recorder_are_no_saturation(part: float, seen: bool) -> None:
    clean = Cell(sample_rate_Hz=50_000.0, duration_s=0.02, noise_V=0.005).dataset(0)
    found = []
    for shot in clean.shots:
        steps = np.round(shot.voltage_V * 256.0 / 2.4)
        clipped = np.minimum(steps, np.round(part * np.max(steps)))
        found.append(bool(saturated_samples(replace(shot, voltage_V=clipped * 2.4 / 256.0)).any()))
    assert sum(found) > 10 if seen else not any(found)


@pytest.mark.parametrize("exchange", [5e5, 2e5])
def test_coil_factors_are_not_biased_when_single_coil_shots_are_rejected(exchange: float) -> None:
    cell = Cell(polarisation=0.02, exchange=exchange, factors=COILS, residual_nT=RESIDUAL)
    clean, pulls = cell.clean_V(), []
    for seed in range(2):
        analysis = analyse(without(cell.dataset(seed, clean), "s01", "s14"))
        assert sum(shot.used for shot in analysis.shots) == 12
        pulls += [
            pull(analysis, "coil_factor", axis, factor / COILS[0])
            for axis, factor in zip("yz", COILS[1:], strict=True)
        ]
    assert abs(np.mean(pulls)) < 1.5 and np.max(np.abs(pulls)) < 4.0


def test_a_chirp_too_weak_to_be_seen_moves_no_slowing_down_factor() -> None:
    cell = Cell(polarisation=0.03)
    clean, pulls = cell.clean_V(), []
    for seed in range(3):
        analysis = analyse(cell.dataset(seed, clean))
        assert analysis.frequencies is not None and analysis.frequencies.joint is None
        pulls.append(pull(analysis, "slowing_down_factor", None, 6.0))
    assert abs(np.mean(pulls)) < 1.5


@pytest.mark.parametrize("polarisation", [0.05, 0.5])
def test_tones_of_a_steady_cell_fade_alike(polarisation: float) -> None:
    pulls = []
    for seed in range(2):
        found = analyse(Cell(polarisation=polarisation).dataset(seed)).frequencies
        assert found is not None and np.isfinite(found.fading[1])
        pulls.append(found.fading[0] / found.fading[1])
    assert np.max(np.abs(pulls)) < 4.0


def test_a_transient_at_the_begin_of_all_shots_is_no_noise() -> None:
    clean = Cell().dataset(1)
    noise_V = Cell().noise_V
    shots = [
        replace(
            shot,
            voltage_V=shot.voltage_V
            + 6.0 * noise_V * np.exp(-np.arange(len(shot.voltage_V)) / 4.0),
        )
        for shot in clean.shots
    ]
    found = {flag.code for flag in analyse(replace(clean, shots=shots)).flags}
    assert "misfit" in found
    assert "misfit" not in {flag.code for flag in analyse(clean).flags}
