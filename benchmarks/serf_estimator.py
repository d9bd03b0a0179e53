"""How close the estimator of coil angles comes to the Cramer-Rao bound, case by case.

    python benchmarks/serf_estimator.py [--runs 400] [--case NAME]

Seeds are 0 .. runs-1 of each case, and a thousand times its number. One JSON object per case on
standard output, angles xy, xz, yz in arcsec: bound, bias, bias over the standard deviation, the
standard deviation over the bound with its
standard error, coverage of the 95 % interval of the noise alone and with the type B inputs of an
import; beside it the bias of the published law of cosines on the same frequencies, and on those of
the printed signal formula, which has no baseline. The bound is that of low polarisation in all
cases: frequency, decay, phase, amplitude, baseline and offset of each shot unknown, and with the
angles factors and residual field, or none of these where the coils are known. The last lines are
the time of a shot's fit and of a whole analysis.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.special import stdtrit

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from cases import Trial, Trials, print_cases, scored
from serf_shots import FOUR, Cell, bound_of_frequency

from procedures.serf_nonorthogonality.analysis import analyse
from procedures.serf_nonorthogonality.angles import solve
from procedures.serf_nonorthogonality.dataset import SerfDataset
from procedures.serf_nonorthogonality.evaluate import common_inputs
from procedures.serf_nonorthogonality.published import published_angles
from procedures.serf_nonorthogonality.tone import fit_tone
from station.uncertainty import combine

Array = NDArray[np.float64]

PAIRS = ("xy", "xz", "yz")
ARCSEC_PER_DEG = 3600.0
RESIDUAL = (1.0, -0.6, 0.8)
COILS = (1.010, 0.995, 1.008)
LEAN = (np.sin(np.radians(0.3)), np.sin(np.radians(-0.2)), 1.0)


@dataclass(frozen=True)
class Case:
    """A cell and what it is called."""

    name: str
    cell: Cell


CASES = (
    Case("ideal", Cell()),
    Case("residual field (1, -0.6, 0.8) nT", Cell(residual_nT=RESIDUAL)),
    Case("coil errors +1.0, -0.5, +0.8 %", Cell(factors=COILS)),
    Case("coil errors +1.5, -1.5, +1.0 %", Cell(factors=(1.015, 0.985, 1.010))),
    Case("low signal: noise 0.2 of the amplitude", Cell(noise_V=0.2)),
    Case("fast: 1.1 cycles within the 1/e time", Cell(relaxation=1200.0)),
    Case("mains 50 mV, offset 20 mV", Cell(mains_V=0.05, offset_V=0.02)),
    Case("polarisation 0.3", Cell(polarisation=0.3)),
    Case("polarisation 0.6", Cell(polarisation=0.6)),
    Case(
        "polarisation 0.6, residual field, coil errors",
        Cell(polarisation=0.6, residual_nT=RESIDUAL, factors=COILS),
    ),
    Case("polarisation 0.6, pump light leans 0.3, -0.2 deg", Cell(polarisation=0.6, pump=LEAN)),
    Case(
        "polarisation 0.6, broadening of the moment",
        Cell(polarisation=0.6, momentary_broadening=True),
    ),
    Case("four shots, coils known", Cell(pattern=FOUR, known=True)),
)


def bound_arcsec(cell: Cell) -> Array:
    """Return the Cramer-Rao bound of the three angles."""
    low = cell.but(polarisation=0.05, momentary_broadening=False)
    variance = np.diag(bound_of_frequency(low) ** 2)
    found = solve(low.commanded_nT, low.frequency_rad_per_s(), variance, known=low.known)
    sines = np.sin(np.radians(np.array(cell.angles_deg)))
    return np.asarray(np.degrees(np.sqrt(np.diag(found.covariance)[3:6]) / sines) * ARCSEC_PER_DEG)


def printed_fit(dataset: SerfDataset, true: Array) -> Array:
    """Return the frequencies in rad/s by the printed formula, begun at the true ones."""

    def formula(t: Array, s0: float, rate: float, omega: float, phase: float) -> Array:
        return np.asarray(s0 * np.exp(-rate * t) * np.sin(omega * t + phase))

    found = []
    for shot, omega in zip(dataset.shots, true, strict=True):
        starts = [(0.7, 50.0, float(omega), phase) for phase in (0.0, 1.5, 3.0, 4.5)]
        fits = []
        for start in starts:
            try:
                fits.append(curve_fit(formula, shot.time_s, shot.voltage_V, start)[0])
            except RuntimeError:
                continue
        costs = [np.sum((formula(shot.time_s, *fit) - shot.voltage_V) ** 2) for fit in fits]
        found.append(float(fits[int(np.argmin(costs))][2]) if fits else np.nan)
    return np.array(found)


def measure(case: Case, runs: int) -> dict[str, object]:
    """Run one case and summarise it."""
    cell, clean = case.cell, case.cell.clean_V()
    bound = bound_arcsec(cell)
    truth = np.array(cell.angles_deg)
    errors, inside, within = np.zeros((runs, 3)), np.zeros((runs, 3)), np.zeros((runs, 3))
    own, paper = np.full((runs, 3), np.nan), np.full((runs, 3), np.nan)
    joint, freedom, chi_square = 0, 0, 0.0
    flags: dict[str, int] = {}
    for seed in range(runs):
        dataset = cell.dataset(1000 * CASES.index(case) + seed, clean)
        analysis = analyse(dataset)
        estimates = analysis.estimates[:3]
        solved = analysis.frequencies
        joint += solved is not None and solved.joint is not None
        if solved is not None:
            chi_square += solved.solution.chi_square / runs
            freedom = solved.solution.degrees_of_freedom
        combined = combine(estimates, list(common_inputs(dataset)))
        for k, (one, whole) in enumerate(zip(estimates, combined, strict=True)):
            if one.value is None or one.standard_uncertainty is None or whole is None:
                raise RuntimeError(f"{case.name}: seed {seed} leaves {one.axis} undetermined")
            errors[seed, k] = (one.value - truth[k]) * ARCSEC_PER_DEG
            factor = stdtrit(one.degrees_of_freedom or 1e9, 0.975)
            size = ARCSEC_PER_DEG * one.standard_uncertainty
            inside[seed, k] = abs(errors[seed, k]) <= factor * size
            within[seed, k] = abs(errors[seed, k]) <= ARCSEC_PER_DEG * whole.expanded_uncertainty
        values = [published.value for published in analysis.published]
        own[seed] = [np.nan if one is None else one for one in values]
        if seed < 20:
            omega = printed_fit(dataset, cell.frequency_rad_per_s())
            found = published_angles(dataset.commanded_nT, omega, dataset.gamma_rad_per_s_nT)
            paper[seed] = [found.angles_deg[pair] or np.nan for pair in PAIRS]
        for code in sorted({flag.code for flag in analysis.flags}):
            flags[code] = flags.get(code, 0) + 1
    spread = errors.std(axis=0, ddof=1)
    return {
        "runs": runs,
        "joint_fits": joint,
        "bound": rounded(bound, 1),
        "bias": rounded(errors.mean(axis=0), 1),
        "bias_over_std": rounded(errors.mean(axis=0) / spread, 2),
        "std_over_bound": rounded(spread / bound, 3),
        "standard_error": round(1.0 / np.sqrt(2.0 * runs), 3),
        "coverage_95_noise": rounded(inside.mean(axis=0), 3),
        "coverage_95": rounded(within.mean(axis=0), 3),
        "chi_square_by_freedom": round(chi_square / freedom, 2) if freedom else None,
        "law_of_cosines_bias": rounded((np.nanmean(own, axis=0) - truth) * ARCSEC_PER_DEG, 0),
        "printed_formula_bias": rounded((np.nanmean(paper, axis=0) - truth) * ARCSEC_PER_DEG, 0),
        "flags": flags,
    }


known_bound_arcsec, known_clean_V = cache(bound_arcsec), cache(Cell.clean_V)


def trial(case: Case, seed: int) -> Trial:
    """Analyse the shots of one cell; u holds the type B inputs of an import."""
    dataset = case.cell.dataset(1000 * CASES.index(case) + seed, known_clean_V(case.cell))
    analysis = analyse(dataset)
    estimates = analysis.estimates[:3]
    combined = combine(estimates, list(common_inputs(dataset)))
    errors, units, freedom = np.full((3, 3), np.nan)
    for k, (one, whole) in enumerate(zip(estimates, combined, strict=True)):
        if one.value is not None and whole is not None:
            errors[k] = (one.value - case.cell.angles_deg[k]) * ARCSEC_PER_DEG
            units[k], freedom[k] = (
                ARCSEC_PER_DEG * whole.standard_uncertainty,
                whole.degrees_of_freedom,
            )
    angles = scored(errors, units, freedom, known_bound_arcsec(case.cell))
    codes = frozenset(flag.code for flag in analysis.flags)
    return Trial({"nonorthogonality_angle": angles}, codes)


def trials() -> Trials:
    """Return what analyses the shots of each case."""
    return {case.name: partial(trial, case) for case in CASES}


def rounded(values: Array, digits: int) -> list[float]:
    """Return numbers for the output."""
    return [round(float(one), digits) for one in values]


def speed() -> dict[str, object]:
    """Return the processor time of one shot's fit and of an analysis of fourteen shots."""
    result: dict[str, object] = {}
    dataset = Cell().dataset(0)
    for name, repeats, work in (
        (
            "one_shot_fit_ms",
            5,
            lambda: [fit_tone(shot.time_s, shot.voltage_V) for shot in dataset.shots],
        ),
        ("analysis_of_14_shots_s", 3, lambda: analyse(dataset)),
    ):
        times = []
        for _ in range(repeats):
            begin = time.process_time()
            work()
            times.append(time.process_time() - begin)
        best = min(times)
        result[name] = round(1e3 * best / len(dataset), 2) if "ms" in name else round(best, 2)
    chirped = Cell(polarisation=0.6).dataset(0)
    begin = time.process_time()
    analyse(chirped)
    result["analysis_of_14_chirped_shots_s"] = round(time.process_time() - begin, 2)
    return result


def main() -> None:
    print_cases("Coil angles against their bound.", CASES, measure, 400)
    print(json.dumps(speed()), flush=True)


if __name__ == "__main__":
    main()
