"""What the estimator of the tumble test is worth: rmse over the bound and coverage, by case.

`python benchmarks/tumble_estimator.py --runs 200` prints a line a case: the
root of the mean square over the coefficients of error / bound, the worst one, and the least and
largest part of the 95 % intervals that hold the truth. The bound is the solution's covariance with
the true noise, the priors and only the slow terms that are there. The formulas' figures are beside.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from cases import Trial, Trials, scored
from figures import Figures
from scipy.special import stdtrit

from procedures.accelerometer_tumble.analysis import analyse
from procedures.accelerometer_tumble.dataset import TumbleDataset
from procedures.accelerometer_tumble.model import COEFFICIENTS, Array
from procedures.accelerometer_tumble.solution import ENCODER, MOUNTING, beside_model

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from tumble_records import FOUR, QUARTZ, Stage, made

HEAD = tuple((plane, turned, 90.0) for plane, turned, _ in FOUR)
SHORT: dict[str, Any] = {"mountings": FOUR[:3], "positions": 8}
CASES = {
    "four mountings": (Stage(), ()),
    "12 positions": (Stage(positions=12), ()),
    "one mounting": (Stage(mountings=FOUR[:1]), ()),
    "io, reversed, ip": (Stage(mountings=FOUR[:3]), ()),
    "head 0, 90": (Stage(mountings=(*FOUR, *HEAD)), ()),
    "drift 20 uV/h": (Stage(drift_V_per_h=20e-6), ("drift",)),
    "warms by 1 K": (Stage(warms_K=1.0), ("K0_T", "Ki_T")),
    "noise 30 uV": (Stage(noise_V=30e-6), ()),
    "short": (Stage(**SHORT), ()),
    "short, drift 20 uV/h": (Stage(**SHORT, drift_V_per_h=20e-6), ("drift",)),
    "short, warms by 0.1 K": (Stage(**SHORT, warms_K=0.1), ("K0_T", "Ki_T")),
    "short, warms by 1 K": (Stage(**SHORT, warms_K=1.0), ("K0_T", "Ki_T")),
}
"""Short is the shortest form of the plan: eight positions in three mountings."""


def bound(
    dataset: TumbleDataset, kept: tuple[str, ...], stage: Stage, slow: tuple[str, ...]
) -> Array:
    """Return the standard deviations (k,) that no unbiased estimator is below."""
    model = dataset.columns
    columns = [model[:, [COEFFICIENTS.index(name) for name in kept]]]
    assert dataset.temperature_degC is not None
    warm = dataset.temperature_degC - np.mean(dataset.temperature_degC)
    added = {"drift": dataset.time_s - dataset.time_s.mean(), "K0_T": warm}
    added["Ki_T"] = warm * model[:, 1]
    columns += [added[name][:, None] for name in slow]
    beside = beside_model(dataset, stage.truth["Ki"])
    whole = np.column_stack((*columns, beside.columns)) / stage.noise_V
    scale = np.linalg.norm(whole, axis=0)
    normal = (whole / scale).T @ (whole / scale)
    prior = np.zeros(whole.shape[1])
    prior[whole.shape[1] - len(beside.prior_rad) :] = 1.0 / beside.prior_rad**2
    normal += np.diag(prior / scale**2)
    inverse = np.linalg.inv(normal) / np.outer(scale, scale)
    return np.sqrt(np.diag(inverse))[: len(kept)]


def run(stage: Stage, slow: tuple[str, ...], sets: int) -> tuple[Array, ...]:
    """Return rmse/bound and coverage (k,) of the kept ones, and rmse/bound of the formulas."""
    rng = np.random.default_rng(1)
    errors, covered, formulas, limits = [], [], [], None
    for _ in range(sets):
        dataset = made(rng, stage)
        analysis = analyse(dataset)
        kept = tuple(analysis.terms)
        if limits is None:
            limits = bound(dataset, kept, stage, slow)
        truth = np.array(
            [
                sum(share * QUARTZ.get(one, 0.0) for one, share in analysis.terms[name].items())
                for name in kept
            ]
        )
        found = [analysis.estimate(name) for name in kept]
        error = np.array([one.value for one in found]) - truth
        own_u = np.array([one.standard_uncertainty for one in found], dtype=np.float64)
        stated = [[one.sensitivities[kind] for kind in (ENCODER, MOUNTING)] for one in found]
        u = np.hypot(own_u, np.linalg.norm(stated, axis=1))
        freedom = found[0].degrees_of_freedom
        share = own_u / u
        factor = stdtrit(freedom / share**4, 0.975)
        errors.append(error)
        covered.append(np.abs(error) <= factor * u)
        published = {one.name: one.value for one in analysis.published}
        own = [published.get(name) for name in kept]
        formulas.append([np.nan if v is None else v for v in own] - truth)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / limits
    other = np.sqrt(np.mean(np.square(formulas), axis=0)) / limits
    return ratio, np.mean(covered, axis=0), other


def trial(stage: Stage, slow: tuple[str, ...], seed: int) -> Trial:
    """Analyse the readings of one test; u holds encoder and mountings as stated."""
    dataset = made(np.random.default_rng((seed, 1)), stage)
    analysis = analyse(dataset)
    kept = tuple(analysis.terms)
    limits, results = bound(dataset, kept, stage, slow), {}
    for name, limit in zip(kept, limits, strict=True):
        one = analysis.estimate(name)
        if one.value is None or one.standard_uncertainty is None:
            results[name] = scored(np.nan, np.nan, bound=limit)
            continue
        truth = sum(share * QUARTZ.get(part, 0.0) for part, share in analysis.terms[name].items())
        stated = [one.sensitivities[kind] for kind in (ENCODER, MOUNTING)]
        u = float(np.hypot(one.standard_uncertainty, np.linalg.norm(stated)))
        freedom = (one.degrees_of_freedom or np.inf) * (u / one.standard_uncertainty) ** 4
        results[name] = scored(one.value - truth, u, freedom, limit)
    return Trial(results, frozenset(flag.code for flag in analysis.flags))


def trials() -> Trials:
    """Return what analyses the readings of each case."""
    return {name: partial(trial, *case) for name, case in CASES.items()}


def main() -> None:
    """Print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--case", choices=CASES, action="append")
    figures = Figures(parser)
    given = figures.parse()
    for name in given.case or CASES:
        ratio, cover, other = run(*CASES[name], given.runs)
        figures.line(
            name,
            runs=given.runs,
            rmse_over_bound=round(float(np.sqrt(np.mean(ratio**2))), 3),
            largest_over_bound=round(float(ratio.max()), 3),
            least_covered=round(float(cover.min()), 4),
            most_covered=round(float(cover.max()), 4),
            formulas_over_bound=round(float(np.nanmax(other)), 2),
        )


if __name__ == "__main__":
    main()
