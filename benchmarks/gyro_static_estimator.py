"""Noise coefficients of a gyro at rest: rmse over the Cramér-Rao bound, and coverage.

    python benchmarks/gyro_static_estimator.py --runs 2000 --device FOG

Records are made in the time domain, the analysis is the station's own. The bound is that of the
squares Q², N², B², K² with ramp and known rounding. Values below one: squares are not below zero.
One JSON object a device.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np
from cases import Scored, Trial, Trials, of_estimates, scored
from figures import Figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from static_records import (
    DEVICES,
    TRIADS,
    UP,
    bound_of_squares,
    measured_squares,
    records,
    stability_deg_per_h,
    together,
    true_squares,
)

from procedures.gyro_static_noise.analysis import analyse
from procedures.gyro_static_noise.dataset import PER_SQRT_H
from station.findings import Estimate

NAMES = ("Q", "N", "B", "K", "R")


SQUARES = {
    "quantisation_noise": 1.0,
    "angle_random_walk": PER_SQRT_H**2,
    "bias_instability": 1.0,
    "rate_random_walk": PER_SQRT_H**-2,
}
"""The squares that have a bound, and what the square of a result is multiplied by."""
BIAS_DEG_PER_H = 0.35
LONG, SHORT = (14_400,), (7200, *[900] * 6)

bound_of = cache(lambda device, count: bound_of_squares(DEVICES[device], count))


def square_of(one: Estimate, name: str, truth: float, limit: float | None) -> Scored:
    """Return the square of a coefficient, its u and interval as the coefficient's."""
    factor = SQUARES[name]
    if one.value is None or one.standard_uncertainty is None:
        return scored(np.nan, np.nan, bound=limit)
    error = factor * one.value**2 - truth
    u = factor * ((one.value + one.standard_uncertainty) ** 2 - one.value**2)
    low, high = one.extra["interval"]
    inside = factor * low**2 <= truth <= factor * high**2
    bound = None if limit is None else np.array([limit])
    return Scored(np.array([error]), np.array([u]), np.array([inside]), bound)


def trial(device: str, counts: Sequence[int], seed: int) -> Trial:
    """Analyse switch-ons of a device with a ramp of ten u; bounds are those of one switch-on.

    The repeatability is that of these switch-ons, slow noise in it; it is known without a counter.
    Of a sensor and of a navigator it is all three axes.
    """
    gyro, lone = DEVICES[device], len(counts) == 1
    limits = bound_of(device, counts[0]) if lone else np.full(5, np.nan)
    ramp = 10.0 * float(bound_of(device, counts[0])[4])
    made = partial(records, counts=counts, ramp_deg_per_h2=ramp, bias_deg_per_h=BIAS_DEG_PER_H)
    axes = TRIADS.get(device, {"IA": UP})
    gyros, truth = [], dict[tuple[str, str | None], float]()
    for number, (axis, direction) in enumerate(axes.items()):
        key = (seed, 1, number) if device in TRIADS else (seed, 1)
        told = None if device == "navigator" else direction
        gyros.append(made(np.random.default_rng(key), gyro, direction=told))
        first = np.random.default_rng(key).standard_normal()
        truth["rate_ramp", axis] = ramp
        truth["bias", axis] = BIAS_DEG_PER_H + (gyro["switch_on"] * first if lone else 0.0)
        truth["bias_stability", axis] = stability_deg_per_h(gyro, counts[0], ramp)
        if not lone and not gyro["pulse"]:
            quiet = {**gyro, "N": 0.0, "Q": 0.0}
            slow = made(np.random.default_rng(key), quiet, direction=told)
            means = [float(record.rate_deg_per_h.mean()) for record in slow.records]
            truth["bias_repeatability", axis] = float(np.std(means, ddof=1))
    analysis = analyse(together(axes, gyros))
    results = of_estimates(analysis.estimates, truth, {"rate_ramp": limits[4]} if lone else {})
    for name, square, limit in zip(SQUARES, true_squares(gyro), limits[:4], strict=True):
        bound = float(limit) if lone else None
        own = [
            square_of(estimate, name, square, bound)
            for estimate in analysis.estimates
            if estimate.name == name
        ]
        results[name] = Scored(
            np.concatenate([part.error for part in own]),
            np.concatenate([part.u for part in own]),
            np.concatenate([part.inside for part in own]),
            None if bound is None else np.full(len(own), bound),
        )
    return Trial(results, frozenset(flag.code for flag in analysis.flags))


def trials() -> Trials:
    """Return what analyses the switch-ons of each device: one of 4 h, one of 2 h and six short."""
    return {name: partial(trial, name, LONG) for name in DEVICES} | {
        f"{name}, seven switch-ons": partial(trial, name, SHORT) for name in DEVICES
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=2000)
    options.add_argument("--samples", type=int, default=14_400)
    options.add_argument("--device", choices=DEVICES, action="append")
    figures = Figures(options)
    given = figures.parse()
    for device in given.device or DEVICES:
        found = measured_squares(DEVICES[device], given.runs, given.samples)
        bound = bound_of_squares(DEVICES[device], given.samples)
        rms = np.sqrt(np.mean(found.errors**2, axis=0))
        line: dict[str, object] = {"runs": given.runs, "samples": given.samples}
        for n, name in enumerate(NAMES):
            line[f"{name}_over_bound"] = round(float(rms[n] / bound[n]), 4)
            line[f"{name}_u_over_bound"] = round(float(np.median(found.u[:, n]) / bound[n]), 4)
            line[f"{name}_covered"] = round(float(found.covered[:, n].mean()), 4)
        figures.line(device, **line, lines_seen_in_pure_noise=found.lines)


if __name__ == "__main__":
    main()
