"""Laser gyro: three coils at once, and records that end by themselves, against fixed ones.

    python benchmarks/rlg_modes.py [--runs 2000] [--only simultaneous|target|decision]

Seeds are 0 .. runs-1. One JSON object a line on standard output.

simultaneous: one record of 200 s with all coils at frequencies that the plan's rule chooses, coils
up to 2 % out of true, beside three records of 200 s one after the other, at 0.1 Hz, on the same
gyro; for each axis the standard deviation over the bound sqrt(2 P/N) / (M sinc(f tau0)), bias,
coverage of the 95 % interval, and the root mean square error of the published rule and of the
on/off method (a record for each axis, second half on) over the same bound.

target: angle random walk from 0.0005 to 0.002 deg/sqrt(h), evenly on a logarithmic scale; a record
goes on until u = 0.003 deg/h/mT. Mean time against the 3200 s that the worst gyro needs.

decision: |S| <= 0.05 deg/h/mT with S anywhere between -0.1 and 0.1; a record ends when the value is
clear of the limit. Mean time against the 800 s at which a fixed record has 3 u = 0.009.

A limit applies to a ratio less two of its standard errors.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

# Matrices of a hundred rows gain nothing from threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rlg_estimator import Case, output
from scipy.special import stdtrit

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from procedures.rlg_magnetic_sensitivity.analysis import analyse
from procedures.rlg_magnetic_sensitivity.dataset import AXES, RlgDataset, Segment
from procedures.rlg_magnetic_sensitivity.fitted import RlgAnalysis
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters, Stop
from procedures.rlg_magnetic_sensitivity.records import sensitivity_records
from procedures.rlg_magnetic_sensitivity.stopping import (
    Standing,
    is_enough,
    samples_at_next_look,
)

Array = NDArray[Any]

TRUTH = {"IA": 0.04, "NA": -0.015, "LA": 0.022}
AMBIENT_MT = np.array([0.02, -0.03, 0.025])
FIELD_NOISE_MT = 3e-4
LARGEST_LEAN = 0.02
WALKS = (0.0005, 0.002)
WORST_CASE_S, TARGET = 3200.0, 0.003
LIMIT, FIXED_S = 0.05, 800.0


def plan(**given: object) -> RlgParameters:
    """Return the parameters of a plan, as a plan file gives them."""
    common = {
        "amplitude": "1 mT",
        "pulse_weight": "0.0625 arcsec",
        "warm_up": {"slope_limit": "1 deg/h^2"},
    }
    return RlgParameters.model_validate({**common, **given})


def record(
    drive: dict[str, Drive], case: Case, truth: dict[str, float], coils: Array, seed: list[int]
) -> Segment:
    """Simulate one record: each driven coil's field on all axes, the gyro's answer to it."""
    generator = np.random.default_rng(seed)
    count, tau = case.samples, case.interval_s
    middle_s = np.asarray((np.arange(count) + 0.5) * tau, dtype=np.float64)
    field, seen = np.tile(AMBIENT_MT, (count, 1)), np.tile(AMBIENT_MT, (count, 1))
    for axis, sine in drive.items():
        angle = 2.0 * np.pi * (sine.frequency_Hz * middle_s + generator.random())
        wave = np.outer(sine.amplitude_mT * np.sin(angle), coils[AXES.index(axis)])
        field += wave
        seen += wave * np.sinc(sine.frequency_Hz * tau)
    rate = output(case, generator, seen @ np.array([truth[axis] for axis in AXES]))
    field += FIELD_NOISE_MT * generator.standard_normal(field.shape)
    return Segment(drive, tau, middle_s, rate, 0.0, middle_s, field, 0.0)


def on_off(case: Case, truth: dict[str, float], axis: str, coils: Array, seed: list[int]) -> float:
    """Return what the difference with and without a constant field of one coil says."""
    on = np.arange(case.samples) >= case.samples // 2
    response = float(coils[AXES.index(axis)] @ np.array([truth[one] for one in AXES]))
    rate = output(case, np.random.default_rng(seed), np.asarray(response * on, dtype=np.float64))
    return float(rate[on].mean() - rate[~on].mean())


def covered(analysis: RlgAnalysis, axis: str, truth: float) -> tuple[float, float, bool]:
    """Return error and standard uncertainty of an axis, and whether its 95 % interval has it."""
    one = next(e for e in analysis.estimates if e.axis == axis)
    if one.value is None or one.standard_uncertainty is None:
        raise RuntimeError(f"{axis} is undetermined")
    factor = float(stdtrit(one.degrees_of_freedom or 1e9, 0.975))
    error = one.value - truth
    return error, one.standard_uncertainty, abs(error) <= factor * one.standard_uncertainty


def ratio(errors: Array, bounds: Array) -> dict[str, float]:
    """Return root mean square of errors over bounds with its standard error."""
    square = (errors / bounds) ** 2
    rms = float(np.sqrt(square.mean()))
    error = float(square.std() / np.sqrt(len(square)) / (2.0 * rms))
    return {"rmse_over_bound": round(rms, 3), "standard_error": round(error, 3)}


def simultaneous(runs: int) -> Iterator[dict[str, object]]:
    """Yield one line for each axis and excitation."""
    common = {"sample_interval": "0.1 s", "duration": "200 s"}
    (together,) = sensitivity_records(plan(excitation="simultaneous", **common))
    alone = sensitivity_records(plan(frequency="0.1 Hz", **common))
    case = Case("200 s", 0.0, 20.0)
    kinds = {"simultaneous, 200 s": [together], "sequential, 600 s": list(alone)}
    for kind, planned in kinds.items():
        errors = {axis: np.zeros((runs, 3)) for axis in AXES}
        inside = dict.fromkeys(AXES, 0)
        for seed in range(runs):
            lean = np.random.default_rng([seed, 5]).uniform(-LARGEST_LEAN, LARGEST_LEAN, (3, 3))
            coils = np.eye(3) + lean * (1.0 - np.eye(3))
            segments = tuple(
                record(dict(one.drive), case, TRUTH, coils, [seed, 20 + k, len(planned)])
                for k, one in enumerate(planned)
            )
            analysis = analyse(RlgDataset(segments))
            published = {one.axis: one.value or 0.0 for one in analysis.published}
            for k, axis in enumerate(AXES):
                error, _, within = covered(analysis, axis, TRUTH[axis])
                inside[axis] += within
                steady = on_off(case, TRUTH, axis, coils, [seed, 40 + k])
                errors[axis][seed] = (
                    error,
                    published[axis] - TRUTH[axis],
                    steady - TRUTH[axis],
                )
        for axis in AXES:
            frequency_Hz = next(r.drive[axis].frequency_Hz for r in planned if axis in r.drive)
            bound = replace(case, frequency_Hz=frequency_Hz, cycles=200.0 * frequency_Hz).bound
            best, peak, half = errors[axis].T
            yield {
                "case": kind,
                "axis": axis,
                "runs": runs,
                "frequency_Hz": frequency_Hz,
                "bound": round(bound, 6),
                "std_over_bound": round(float(best.std() / bound), 3),
                **ratio(best, np.array(bound)),
                "bias_over_bound": round(float(best.mean() / bound), 3),
                "coverage_95": round(inside[axis] / runs, 4),
                "published": ratio(peak, np.array(bound)),
                "on_off": ratio(half, np.array(bound)),
            }


def until(stop: Stop, walk: float, truth: float, seed: int) -> tuple[RlgAnalysis, float]:
    """Take a record as a run does, look by look; return its analysis and its length in s."""
    interval_s = 0.5
    parameters = plan(
        frequency="0.1 Hz",
        sample_interval="0.5 s",
        duration="100 s",
        axes=["IA"],
        stop={"early_decision": True, "at_most": f"{stop.at_most_s} s"},
    )
    (planned,) = sensitivity_records(parameters)
    cycles = planned.most * interval_s * 0.1
    case = Case("", truth, cycles, interval_s=interval_s, random_walk_deg_per_sqrt_h=walk)
    truths = {"IA": truth, "NA": 0.0, "LA": 0.0}
    whole = record(dict(planned.drive), case, truths, np.eye(3), [seed, 9])
    samples = planned.samples
    while True:
        part = replace(
            whole,
            time_s=whole.time_s[:samples],
            rate_deg_per_h=whole.rate_deg_per_h[:samples],
            field_time_s=whole.field_time_s[:samples],
            field_mT=whole.field_mT[:samples],
        )
        analysis = analyse(RlgDataset((part,)))
        one = analysis.estimates[0]
        standing = [Standing("IA", one.value, one.standard_uncertainty, (-LIMIT, LIMIT))]
        if samples >= planned.most or is_enough(standing, stop):
            return analysis, samples * interval_s
        samples = samples_at_next_look(standing, stop, planned, samples)


def target(runs: int) -> dict[str, object]:
    """Return how long records take until a target is reached, and whether their u is true."""
    stop = Stop.model_validate({"uncertainty": f"{TARGET} deg/h/mT", "at_most": "3600 s"})
    errors, took_s, inside, u = np.zeros(runs), np.zeros(runs), 0, np.zeros(runs)
    for seed in range(runs):
        generator = np.random.default_rng([seed, 6])
        walk = float(np.exp(generator.uniform(*np.log(WALKS))))
        analysis, took_s[seed] = until(stop, walk, 0.05, seed)
        errors[seed], u[seed], within = covered(analysis, "IA", 0.05)
        inside += within
    shorter = WORST_CASE_S / took_s.mean()
    return {
        "case": f"until u = {TARGET}",
        "runs": runs,
        "mean_time_s": round(float(took_s.mean()), 1),
        "longest_time_s": float(took_s.max()),
        "worst_case_fixed_s": WORST_CASE_S,
        "times_shorter": round(float(shorter), 3),
        "standard_error": round(float(shorter * took_s.std() / took_s.mean() / np.sqrt(runs)), 3),
        "coverage_95": round(inside / runs, 4),
        "coverage_standard_error": round(float(np.sqrt(0.95 * 0.05 / runs)), 4),
        "rms_error": round(float(np.sqrt(np.mean(errors**2))), 5),
        "target_reached": round(float(np.mean(u <= TARGET)), 4),
        "mean_square_pull": round(float(np.mean((errors / u) ** 2)), 3),
    }


def decision(runs: int) -> dict[str, object]:
    """Return how long records take until a decision is clear, and how many decide wrongly."""
    stop = Stop.model_validate({"early_decision": True, "at_most": f"{FIXED_S} s"})
    took_s, wrong, far_wrong = np.zeros(runs), 0, 0
    for seed in range(runs):
        truth = float(np.random.default_rng([seed, 4]).uniform(-2.0 * LIMIT, 2.0 * LIMIT))
        analysis, took_s[seed] = until(stop, 1e-3, truth, seed)
        value = analysis.estimates[0].value or 0.0
        if (abs(value) <= LIMIT) != (abs(truth) <= LIMIT):
            wrong += 1
            far_wrong += took_s[seed] < FIXED_S
    shorter = FIXED_S / took_s.mean()
    return {
        "case": f"until clear of {LIMIT}",
        "runs": runs,
        "mean_time_s": round(float(took_s.mean()), 1),
        "fixed_s": FIXED_S,
        "times_shorter": round(float(shorter), 3),
        "standard_error": round(float(shorter * took_s.std() / took_s.mean() / np.sqrt(runs)), 3),
        "decided_wrongly": wrong,
        "of_these_early": int(far_wrong),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Modes of the laser-gyro procedure.")
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--only", choices=("simultaneous", "target", "decision"))
    options = parser.parse_args()
    if options.only in (None, "simultaneous"):
        for line in simultaneous(options.runs):
            print(json.dumps(line), flush=True)
    for name, measure in (("target", target), ("decision", decision)):
        if options.only in (None, name):
            print(json.dumps(measure(options.runs)), flush=True)


if __name__ == "__main__":
    main()
