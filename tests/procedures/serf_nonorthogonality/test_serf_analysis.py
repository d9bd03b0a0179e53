"""Angles, factors and residual field from shots: bias, spread, coverage, flags, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit
from serf_shots import FOUR, Cell, bound_of_frequency

from procedures.serf_nonorthogonality.analysis import analyse
from procedures.serf_nonorthogonality.angles import solve
from procedures.serf_nonorthogonality.dataset import SerfAnalysis
from procedures.serf_nonorthogonality.published import closed_form, published_angles

RESIDUAL, COILS = (1.0, -0.6, 0.8), (1.010, 0.995, 1.008)
GAMMA = 2.0 * np.pi * 28.02495


def angles(analysis: SerfAnalysis) -> np.ndarray:
    return np.array([one.value for one in analysis.estimates[:3]], dtype=float)


def codes(analysis: SerfAnalysis) -> list[str]:
    return [flag.code for flag in analysis.flags]


def said(analysis: SerfAnalysis, code: str) -> str:
    return next(flag.message for flag in analysis.flags if flag.code == code)


def bound_deg(cell: Cell) -> np.ndarray:
    low = cell.but(polarisation=0.05)
    variance = np.diag(bound_of_frequency(low) ** 2)
    found = solve(low.commanded_nT, low.frequency_rad_per_s(), variance, known=low.known)
    return np.degrees(np.sqrt(np.diag(found.covariance)[3:6]))


@pytest.mark.campaign
@pytest.mark.parametrize(
    "cell",
    [
        Cell(residual_nT=RESIDUAL, factors=COILS),
        Cell(noise_V=0.2),
        Cell(relaxation=1200.0),
    ],
    ids=["residual and coils", "low signal", "fast"],
)
def test_bias_and_spread_are_those_of_the_bound(cell: Cell) -> None:
    clean, errors, inside = cell.clean_V(), [], []
    for seed in range(4):
        analysis = analyse(cell.dataset(seed, clean))
        off = angles(analysis) - cell.angles_deg
        errors.append(off)
        for one, error in zip(analysis.estimates[:3], off, strict=True):
            assert one.standard_uncertainty is not None and one.degrees_of_freedom is not None
            inside.append(
                abs(error) < stdtrit(one.degrees_of_freedom, 0.9995) * one.standard_uncertainty
            )
    pulls = np.array(errors) / bound_deg(cell)
    assert abs(pulls.mean()) < 1.2
    assert np.sqrt(np.mean(pulls**2)) < 1.8
    assert all(inside)


def test_a_strong_chirp_is_fitted_jointly_and_flagged() -> None:
    cell = Cell(polarisation=0.6, residual_nT=RESIDUAL, factors=COILS)
    analysis = analyse(cell.dataset(1))
    assert np.all(np.abs(angles(analysis) - cell.angles_deg) < 4.0 * bound_deg(cell))
    assert {one.method for one in analysis.estimates} == {"joint-chirp"}
    assert analysis.frequencies is not None and analysis.frequencies.joint is not None
    assert analysis.frequencies.joint.polarisation == pytest.approx(0.6, abs=0.005)
    assert "chirp" in codes(analysis)
    assert "falls by 21 %" in said(analysis, "chirp")
    paper = np.array([one.value for one in analysis.published], dtype=float)
    assert np.all(np.abs(paper - cell.angles_deg) > 0.3)


def test_spins_that_do_not_begin_along_the_pump_light_move_no_angle() -> None:
    leaning = Cell(polarisation=0.6, pump=(0.05, -0.03, 1.0), probe=(0.004, 1.0, -0.005))
    analysis = analyse(leaning.dataset(1))
    assert np.all(np.abs(angles(analysis) - leaning.angles_deg) < 4.0 * bound_deg(leaning))


def test_residual_field_factors_and_slowing_down_are_relative_to_the_first_coil() -> None:
    cell = Cell(residual_nT=RESIDUAL, factors=COILS)
    analysis = analyse(cell.dataset(2))
    truth = {
        "residual_field": cell.residual_on_coils_nT / COILS[0],
        "coil_factor": np.array(COILS) / COILS[0],
    }
    for name, values in truth.items():
        for axis, value in zip("xyz", values, strict=True):
            one = analysis.estimate(name, axis)
            assert one.value is not None and one.standard_uncertainty is not None
            assert abs(one.value - value) <= 4.0 * one.standard_uncertainty
    assert analysis.estimate("coil_factor", "x").standard_uncertainty == 0.0
    factor = analysis.estimate("slowing_down_factor")
    assert factor.value == pytest.approx(6.0 / COILS[0], rel=5e-4)
    assert codes(analysis) == ["unseen-step", "scale-by-convention"]
    assert [check.passed for check in analysis.checks] == [True] * 5


def test_the_published_rule_is_biased_by_what_leaves_the_solution_alone() -> None:
    cell = Cell(residual_nT=RESIDUAL)
    analysis = analyse(cell.dataset(3))
    paper = np.array([one.value for one in analysis.published], dtype=float)
    assert (paper - cell.angles_deg) * 3600 == pytest.approx([6326, 889, 7094], abs=250)
    assert np.all(np.abs(angles(analysis) - cell.angles_deg) < 4.0 * bound_deg(cell))


def test_the_published_angle_is_theta_and_not_its_supplement() -> None:
    cell = Cell(pattern=FOUR, pull=False)
    paper = published_angles(cell.commanded_nT, cell.frequency_rad_per_s(), GAMMA)
    assert list(paper.angles_deg.values()) == pytest.approx(cell.angles_deg)
    assert paper.slowing_down == pytest.approx(6.0)
    # Of another polarity the same angle between the positive axes.
    turned = cell.commanded_nT * np.array([1.0, -1.0, 1.0])
    other = published_angles(
        turned,
        cell.but(pattern=((1, 0, 0), (1, -1, 0), (1, 0, 1), (0, -1, 1))).frequency_rad_per_s(),
        GAMMA,
    )
    assert list(other.angles_deg.values()) == pytest.approx(cell.angles_deg)


def test_the_published_rule_says_why_it_cannot_run() -> None:
    analysis = analyse(replace(Cell().dataset(0), shots=Cell().dataset(0).shots[1:4]))
    assert [one.value for one in analysis.published] == [None] * 3
    assert any("no shot with a single coil" in flag.message for flag in analysis.flags)


def test_the_general_solution_is_exact_without_noise_and_agrees_with_the_closed_form() -> None:
    cell = Cell(residual_nT=RESIDUAL, factors=COILS, pull=False, angles_deg=(84.0, 95.0, 97.0))
    omega = cell.frequency_rad_per_s()
    found = solve(cell.commanded_nT, omega, np.eye(14), known=False)
    assert np.degrees(np.arccos(found.cosine)) == pytest.approx(cell.angles_deg, abs=1e-9)
    assert found.residual / found.scale[0] == pytest.approx(
        cell.residual_on_coils_nT / COILS[0], abs=1e-9
    )
    closed = closed_form(cell.commanded_nT, omega)
    assert list(closed.values()) == pytest.approx(found.cosine.tolist(), abs=1e-4)


def test_frequencies_of_no_cell_give_a_solution_that_did_not_settle() -> None:
    fields = Cell().commanded_nT
    for seed in range(20):  # frequencies over twenty orders: what a cell without light records
        chance = np.random.default_rng(seed)
        omega = 10.0 ** chance.uniform(-6.0, 6.0, 14) * chance.choice([1.0, 1e-3, 1e6], 14)
        found = solve(fields, omega, 1e-6 * np.eye(14), known=False)
        settled = found.converged and found.positive_definite
        assert not settled or np.all(np.isfinite(found.covariance))


def test_unequal_fields_and_missing_shots_are_solved_as_well() -> None:
    cell = Cell(residual_nT=RESIDUAL, factors=COILS, pull=False)
    fields = cell.commanded_nT * np.array([1.0, 0.8, 1.3])
    direction = cell.but(factors=tuple(np.array(COILS) * [1.0, 0.8, 1.3]))
    keep = [k for k in range(14) if k not in (4, 8)]
    omega = direction.frequency_rad_per_s()[keep]
    found = solve(fields[keep], omega, np.eye(12), known=False)
    assert np.degrees(np.arccos(found.cosine)) == pytest.approx(cell.angles_deg, abs=1e-8)
    assert closed_form(fields[keep], omega) == {}


def test_four_shots_with_known_coils_give_angles_and_no_residual_field() -> None:
    cell = Cell(pattern=FOUR, known=True)
    analysis = analyse(cell.dataset(4))
    assert np.all(np.abs(angles(analysis) - cell.angles_deg) < 4.0 * bound_deg(cell))
    assert [analysis.estimate("residual_field", axis).value for axis in "xyz"] == [None] * 3
    assert [analysis.estimate("coil_factor", axis).value for axis in "xyz"] == [1.0] * 3
    assert codes(analysis) == ["not-identifiable"]
    # A per cent of the coil x and a nanotesla along it move the angle xy by about a degree.
    sensitivities = analysis.estimate("nonorthogonality_angle", "yz").sensitivities
    assert sensitivities["coil_x"] * 0.01 == pytest.approx(-1.13, abs=0.02)
    assert sensitivities["residual_x_nT"] == pytest.approx(-2.27, abs=0.05)
    assert sensitivities["trigger_delay_s"] == 0.0


def test_a_field_that_moves_from_shot_to_shot_enlarges_the_uncertainty() -> None:
    dataset, moved = Cell().dataset(6), Cell(residual_nT=(0.4, 0.3, 0.2)).dataset(6)
    mixed = [(moved if k % 3 == 0 else dataset).shots[k] for k in range(14)]
    still, analysis = analyse(dataset), analyse(replace(dataset, shots=mixed))
    assert "shots-disagree" in codes(analysis)
    assert "shots-disagree" not in codes(still)
    one, other = (a.estimates[0].standard_uncertainty for a in (still, analysis))
    assert one is not None and other is not None and other > 2.0 * one


def test_a_wrong_unit_of_the_gyromagnetic_ratio_shows_in_the_factor() -> None:
    dataset = replace(Cell().dataset(10), gamma_Hz_per_nT=1.0 / 28.02495)
    analysis = analyse(dataset)
    assert "slowing-down-factor-outside" in codes(analysis)
    assert analysis.checks[0].passed is False
    # The angles do not depend on it.
    assert angles(analysis) == pytest.approx(angles(analyse(Cell().dataset(10))), abs=1e-9)


def test_the_same_shots_give_the_same_result() -> None:
    one, other = (analyse(Cell(polarisation=0.1).dataset(11)) for _ in range(2))
    assert [e.value for e in one.estimates] == [e.value for e in other.estimates]
