"""How close the laser-gyro estimator comes to the Cramer-Rao bound, case by case.

    python benchmarks/rlg_estimator.py [--runs 2000] [--case NAME]

Seeds are 0 .. runs-1 of each case. One JSON object per case on standard output: root mean square
error over the bound and over the stated u, each with its standard error, coverage of the 95 %
interval, how often which flag came; for the published rule (DFT peak) and the on/off method the
same ratio on data of the same gyro. The bound is sqrt(2 P(f)/N) / (M sinc(f tau0)) with P(f) the
true noise variance per sample at f: white, plus random walk, plus quantisation as the difference of
a white rounding error. A limit applies to the ratio less two standard errors.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

# Matrices of a hundred rows gain nothing from threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cases import Trial, Trials, measured, of_estimates, of_published, print_cases, scored

from procedures.rlg_magnetic_sensitivity.analysis import analyse
from procedures.rlg_magnetic_sensitivity.dataset import RlgDataset, Segment
from procedures.rlg_magnetic_sensitivity.frequencies import Drive

Array = NDArray[np.float64]

AMBIENT_MT = np.array([0.02, -0.03, 0.025])
FIELD_NOISE_MT = 3e-4


@dataclass(frozen=True)
class Case:
    """One gyro in one field; rates in deg/h, angles of a pulse in arcsec."""

    name: str
    sensitivity: float
    cycles: float
    frequency_Hz: float = 0.1
    interval_s: float = 0.1
    amplitude_mT: float = 1.0
    random_walk_deg_per_sqrt_h: float = 1e-3
    rate_walk_deg_per_h_per_sqrt_h: float = 0.0
    ramp_deg_per_h2: float = 0.0
    warm_up_deg_per_h: float = 0.0
    pulse_arcsec: float = 0.0
    quadratic: float = 0.0
    earth_deg_per_h: float = 9.3

    @property
    def samples(self) -> int:
        """Number of samples of the record."""
        return round(self.cycles / self.frequency_Hz / self.interval_s)

    @property
    def bound(self) -> float:
        """Cramer-Rao bound of the sensitivity in deg/h/mT."""
        tau, f = self.interval_s, self.frequency_Hz
        walk = self.rate_walk_deg_per_h_per_sqrt_h / 60.0
        density = (60.0 * self.random_walk_deg_per_sqrt_h) ** 2 / tau
        density += (walk / (2.0 * np.pi * f)) ** 2 / tau
        density += self.pulse_arcsec**2 / 12.0 * (2.0 * np.sin(np.pi * f * tau) / tau) ** 2
        size = self.amplitude_mT * float(np.sinc(f * tau))
        return float(np.sqrt(2.0 * density / self.samples)) / size


CASES = (
    Case("white, 10 cycles", 0.05, 10.0),
    Case("white, 10.5 cycles", 0.05, 10.5),
    Case("white, 10.5 cycles, negative", -0.05, 10.5),
    Case("white, tiny", 0.002, 10.0),
    Case(
        "strong drift",
        0.05,
        10.5,
        frequency_Hz=0.05,
        rate_walk_deg_per_h_per_sqrt_h=0.3,
        ramp_deg_per_h2=1.0,
        warm_up_deg_per_h=0.3,
    ),
    Case(
        "moderate drift, 1000 s",
        0.02,
        100.0,
        rate_walk_deg_per_h_per_sqrt_h=0.05,
        ramp_deg_per_h2=0.1,
    ),
    Case("1 s, 0.2 Hz", 0.05, 20.0, frequency_Hz=0.2, interval_s=1.0),
    Case("counts 0.6 arcsec, 0.1 s", 0.05, 10.5, pulse_arcsec=0.6),
    Case("counts 0.4 arcsec, 1 s", -0.05, 80.0, 0.16, 1.0, 0.8, pulse_arcsec=0.4),
    # 23 pulses in every interval: the rounding error stands still and follows the signal. No
    # linear estimator helps; turn the base or change the interval (a quantisation beat).
    Case(
        "counts, whole pulses", -0.05, 80.0, 0.16, 1.0, 0.8, pulse_arcsec=0.4, earth_deg_per_h=9.2
    ),
    # 23.16 pulses in every interval: the rounding error beats at the drive's frequency.
    Case("counts, beat at f", -0.05, 80.0, 0.16, 1.0, 0.8, pulse_arcsec=0.4, earth_deg_per_h=9.264),
    Case("white, quadratic term", 0.05, 20.0, quadratic=0.02),
    Case("white, 0.1 mT", 0.05, 20.0, amplitude_mT=0.1, quadratic=0.01),
)


def output(case: Case, generator: np.random.Generator, response_deg_per_h: Array) -> Array:
    """Return the gyro's output: interval means of earth rate, response, noise, drift; counted."""
    count, tau = case.samples, case.interval_s
    time_s = (np.arange(count) + 0.5) * tau
    rate = case.earth_deg_per_h + response_deg_per_h
    white = 60.0 * case.random_walk_deg_per_sqrt_h / np.sqrt(tau)
    rate = rate + white * generator.standard_normal(count)
    walk = case.rate_walk_deg_per_h_per_sqrt_h / 60.0 * np.sqrt(tau)
    rate = rate + np.cumsum(walk * generator.standard_normal(count))
    rate = rate + case.ramp_deg_per_h2 * time_s / 3600.0
    rate = rate + case.warm_up_deg_per_h * np.exp(-time_s / 900.0)
    if case.pulse_arcsec > 0.0:
        # 1 deg/h is 1 arcsec/s: the angle in arcsec is the sum of rate times interval.
        angle = np.concatenate(([0.0], np.cumsum(rate) * tau)) / case.pulse_arcsec
        rate = np.diff(np.floor(angle + generator.random())) * case.pulse_arcsec / tau
    return rate


def recorded(case: Case, seed: int) -> Segment:
    """Simulate one record of one gyro with the axis IA driven."""
    generator = np.random.default_rng([seed, 7])
    count, tau, f = case.samples, case.interval_s, case.frequency_Hz
    middle_s = np.asarray((np.arange(count) + 0.5) * tau, dtype=np.float64)
    phase = generator.uniform(0.0, 2.0 * np.pi)
    angle = 2.0 * np.pi * f * middle_s + phase
    size, ambient = case.amplitude_mT, AMBIENT_MT[0]
    wave = size * np.sin(angle)
    response = case.sensitivity * (ambient + wave * np.sinc(f * tau))
    second = ambient**2 + size**2 / 2 + 2.0 * ambient * wave * np.sinc(f * tau)
    second = second - size**2 / 2 * np.cos(2.0 * angle) * np.sinc(2.0 * f * tau)
    rate = output(case, generator, response + case.quadratic * second)
    field = AMBIENT_MT + np.outer(wave, [1.0, 0.003, -0.004])
    field = field + FIELD_NOISE_MT * generator.standard_normal((count, 3))
    return Segment(
        drive={"IA": Drive(f, size)},
        sample_interval_s=tau,
        time_s=middle_s,
        rate_deg_per_h=rate,
        quantum_deg_per_h=case.pulse_arcsec / tau,
        field_time_s=middle_s,
        field_mT=field,
        field_averaging_s=0.0,
    )


def on_off(case: Case, seed: int) -> float:
    """Return what the difference with and without a constant field says (second half on)."""
    generator = np.random.default_rng([seed, 8])
    on = np.arange(case.samples) >= case.samples // 2
    field = case.amplitude_mT * on
    second = (AMBIENT_MT[0] + field) ** 2
    rate = output(case, generator, case.sensitivity * field + case.quadratic * second)
    return float((rate[on].mean() - rate[~on].mean()) / case.amplitude_mT)


def trial(case: Case, seed: int) -> Trial:
    """Analyse one record of a case."""
    analysis = analyse(RlgDataset((recorded(case, seed),)))
    truth = {("magnetic_sensitivity", analysis.estimates[0].axis): case.sensitivity}
    limit = {"magnetic_sensitivity": case.bound}
    results = of_estimates(analysis.estimates, truth, limit)
    results |= of_published(analysis.published, truth, limit)
    difference = on_off(case, seed) - case.sensitivity
    results["on and off"] = scored(difference, np.nan, bound=case.bound)
    return Trial(results, frozenset(flag.code for flag in analysis.flags))


def trials() -> Trials:
    """Return what analyses a record of each case."""
    return {case.name: partial(trial, case) for case in CASES}


def measure(case: Case, runs: int) -> dict[str, object]:
    """Run one case."""
    return {"bound": round(case.bound, 6), **measured(partial(trial, case), runs)}


def main() -> None:
    print_cases("Laser-gyro estimator against its bound.", CASES, measure)


if __name__ == "__main__":
    main()
