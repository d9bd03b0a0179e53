"""One shot and the law of its spins: frequency, decay, baseline, mains, what is refused."""

from __future__ import annotations

import time

import numpy as np
import pytest
from serf_shots import FOUR, Cell, bound_of_frequency, slowing_down

from procedures.serf_nonorthogonality.shots import SPINS
from procedures.serf_nonorthogonality.spin_motion import clocks
from procedures.serf_nonorthogonality.tone import NoTone, ToneFit, fit_tone, pooled

STILL = Cell(pattern=FOUR, polarisation=1e-4, pull=False)


def fits(cell: Cell, seed: int = 0) -> list[ToneFit]:
    dataset = cell.dataset(seed)
    return [
        fit_tone(
            shot.time_s,
            shot.voltage_V,
            baseline_decay_per_s=cell.relaxation / cell.factor_at_rest,
            mains_Hz=dataset.mains_Hz,
        )
        for shot in dataset.shots
    ]


def test_frequencies_decays_and_baselines_come_back_within_their_uncertainties() -> None:
    truth = STILL.frequency_rad_per_s()
    for k, fit in enumerate(fits(STILL)):
        assert abs(fit.omega_rad_per_s - truth[k]) < 4.0 * fit.omega_u
        assert fit.omega_u == pytest.approx(bound_of_frequency(STILL)[k], rel=0.06)
        assert abs(fit.noise_V - 0.01) < 0.001
    alone, _, _, both = fits(STILL)
    assert abs(alone.baseline_V) < 0.01
    assert both.baseline_V == pytest.approx(0.5, abs=0.03)
    assert both.amplitude_V == pytest.approx(0.5, abs=0.01)
    assert alone.cycles == pytest.approx(5.0, abs=0.1)


def test_mains_and_offset_do_not_move_a_frequency() -> None:
    clean, disturbed = fits(STILL), fits(STILL.but(mains_V=0.05, offset_V=0.02))
    for one, other in zip(clean, disturbed, strict=True):
        assert abs(one.omega_rad_per_s - other.omega_rad_per_s) < 0.5 * one.omega_u


def test_a_late_trigger_moves_no_frequency() -> None:
    early, late = fits(STILL), fits(STILL.but(delay_s=50e-6))
    for one, other in zip(early, late, strict=True):
        assert abs(one.omega_rad_per_s - other.omega_rad_per_s) < 0.3 * one.omega_u


def test_spikes_are_left_out_and_gaps_do_no_harm() -> None:
    shot = STILL.dataset(0).shots[1]
    whole = fit_tone(shot.time_s, shot.voltage_V)
    volts = shot.voltage_V.copy()
    volts[[100, 400, 700]] += 0.5
    there = np.ones(len(volts), dtype=bool)
    there[200:230] = False
    fit = fit_tone(shot.time_s[there], volts[there])
    assert int(np.sum(~fit.kept)) == 3
    assert abs(fit.omega_rad_per_s - whole.omega_rad_per_s) < 1.5 * whole.omega_u


def test_a_falling_frequency_shows_in_the_fit_itself() -> None:
    still, still_u = pooled([fit.chirp for fit in fits(STILL)])
    chirped = fits(STILL.but(polarisation=0.3))
    falling, falling_u = pooled([fit.chirp for fit in chirped])
    assert abs(still) < 4.0 * still_u
    assert falling > 20.0 * falling_u


@pytest.mark.parametrize(
    ("volts", "said"),
    [
        (np.zeros(1000), "does not change"),
        (np.full(1000, np.nan), "too few"),
    ],
)
def test_a_record_without_a_tone_is_refused(volts: np.ndarray, said: str) -> None:
    with pytest.raises(NoTone, match=said):
        fit_tone(np.arange(1000) / 1e4, volts)


def test_the_time_of_a_fit_is_a_few_passes_over_its_samples() -> None:
    dataset = STILL.dataset(1)
    begin = time.process_time()
    for shot in dataset.shots:
        fit_tone(shot.time_s, shot.voltage_V)
    assert (time.process_time() - begin) / len(dataset) < 0.3


@pytest.mark.parametrize("spin", [1.5, 2.5, 3.5])
def test_the_slowing_down_factor_lies_between_its_bounds(spin: float) -> None:
    bounds = {1.5: (4.0, 6.0), 2.5: (6.0, 38.0 / 3.0), 3.5: (8.0, 22.0)}
    law = SPINS[spin]
    assert (law.polarised, law.at_rest) == pytest.approx(bounds[spin])
    square = np.linspace(0.0, 1.0, 11)
    assert law.at(square) == pytest.approx(slowing_down(spin, square))


def test_the_clock_follows_the_closed_form_without_spin_exchange() -> None:
    t, p0, rate = np.linspace(0.0, 0.1, 1000), 0.6, 40.0
    one = np.ones(1)
    (u,) = clocks([t], SPINS[1.5], p0**2 * one, rate * one, 0.0 * one, 0.5 * one)
    p = p0 * np.exp(-rate * u)
    # P³/(1 + P²) fades as exp(-R t/2), R = 6 times the rate; the phase is (gamma B/R) ln(P0/P).
    left = p**3 / (1.0 + p**2)
    assert left == pytest.approx(left[0] * np.exp(-3.0 * rate * t), rel=5e-6)


def test_the_clock_goes_on_evenly_when_the_polarisation_is_gone() -> None:
    t, one = np.linspace(0.0, 2.0, 5000), np.ones(1)
    (u,) = clocks([t], SPINS[1.5], 0.36 * one, 40.0 * one, 10.0 * one, 0.3 * one)
    assert np.diff(u[t > 1.0]) == pytest.approx(t[1], rel=1e-6)


def test_the_pull_of_spin_exchange_is_that_of_the_two_level_model() -> None:
    law, omega, exchange = SPINS[1.5], 1467.4, 5e5
    beta = law.broadening / exchange
    assert beta * omega**2 == pytest.approx(1.667 * omega**2 / exchange, rel=1e-3)
    assert law.pull(beta, np.array([omega])) == pytest.approx(
        4.44 * (omega / exchange) ** 2, rel=2e-3
    )
