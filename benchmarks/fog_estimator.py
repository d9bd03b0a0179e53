"""How close the estimate of a gyro's scale factor over temperature comes to the physical limit.

    python benchmarks/fog_estimator.py [--runs 2000] [--case NAME]

Seeds are 0 .. runs-1 of each case. One JSON object per case on standard output; errors are those of
the curve at 21 temperatures over the range of the turns, in ppm: the root mean square error, its
part that is the same in all runs (bias) and the rest (std), each over the Cramer-Rao bound with its
standard error; coverage of the 95 % interval, and how often the true curve lay within the band of
the whole curve over all of its range; how often the true order was chosen; rejected rows, found and
false; the same for the published rule (all turns of the published sense, order 4, plain
least squares). The bound knows order, noise and the walk of the bias, and has the bias's own
polynomial among its unknowns; wild and missing turns are not in it.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

# Matrices of a hundred rows gain nothing from threads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cases import Scored, Trial, Trials, print_cases

from procedures.fog_scale_factor_temperature.analysis import analyse
from procedures.fog_scale_factor_temperature.curve import Band
from procedures.fog_scale_factor_temperature.dataset import FogDataset, TurnTable

Array = NDArray[Any]

QUARTIC_PPM = (60.0, -170.0, 140.0, 40.0, 110.0)
"""In powers of the temperature scaled to -40 .. 60 degC; steepest at the cold end, 16 ppm/degC."""
BIAS_DEG_PER_H = (0.0, 0.35, -0.25, 0.2)
ARCSEC = 1.0 / 3600.0
SETS, SET_S, RAMP_S, TURN_S, PAUSE_S = 54, 600.0, 18000.0, 47.0, 2.0
WALL_S = 42.0 * 60.0
AWAY_S = 3.5 * 3600.0
"""From a kill to the next turn: back to where the gyros were."""
BIAS_ORDER = 3
DENSE = 201


@dataclass(frozen=True)
class Case:
    """A plan and what disturbs it; angles in deg, rates in deg/h."""

    name: str
    turns: tuple[int, ...] = (360, -360)
    bias: float = 0.0
    bias_over_temperature: float = 0.0
    walk: float = 0.0
    outliers: float = 0.0
    missing: float = 0.0
    resolution: float = 1e-4
    random_walk: float = 0.002
    ripple_ppm: float = 0.0
    bump_ppm: float = 0.0
    kills: int = 0

    @property
    def noise_deg(self) -> float:
        """The standard deviation of a turn's error."""
        drift = self.random_walk**2 * TURN_S / 3600.0
        return float(np.sqrt(drift + ARCSEC**2 + self.resolution**2 / 6.0))


DRIFTING = {"bias": 0.3, "bias_over_temperature": 1.0, "walk": 0.05}
CASES = (
    Case("plain turns", (360,), bias=0.02),
    Case("plain turns, 5 % outliers, 5 % missing", (360,), bias=0.02, outliers=0.05, missing=0.05),
    Case("pairs, drifting bias", **DRIFTING),  # type: ignore[arg-type]
    Case("+--+, drifting bias", (360, -360, -360, 360), **DRIFTING),  # type: ignore[arg-type]
    Case("turn and wait, drifting bias", (360, 0), **DRIFTING),  # type: ignore[arg-type]
    Case(
        "pairs, 5 % outliers, 5 % missing",
        bias=0.02,
        walk=0.005,
        outliers=0.05,
        missing=0.05,
    ),
    Case(
        "pairs, drifting bias, 5 % outliers, 5 % missing",
        outliers=0.05,
        missing=0.05,
        **DRIFTING,  # type: ignore[arg-type]
    ),
    Case("pairs, drifting bias, ten taken apart by kills", kills=10, **DRIFTING),  # type: ignore[arg-type]
    Case("pairs, heading to 0.01 deg", bias=0.02, resolution=0.01),
    Case("pairs, 0.02 deg/sqrt(h), bias 1 deg/h", bias=1.0, walk=0.1, random_walk=0.02),
    Case("pairs, 8 ppm ripple of 25 degC", bias=0.02, ripple_ppm=8.0),
    Case("pairs, bump of 420 ppm at 5 degC", bias=0.02, bump_ppm=420.0),
)


def delta_ppm(case: Case, heat_degC: Array) -> Array:
    """Return the true scale-factor error."""
    scaled = (heat_degC - 10.0) / 50.0
    smooth = np.polynomial.polynomial.polyval(scaled, QUARTIC_PPM)
    bump = case.bump_ppm * np.exp(-0.5 * ((heat_degC - 5.0) / 6.4) ** 2)
    return np.asarray(smooth + case.ripple_ppm * np.sin(2 * np.pi * heat_degC / 25.0) + bump)


def schedule(case: Case) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Return set, start in s, commanded angle in deg and true gyro temperature of each turn.

    A kill comes after the first turn of a set, and the set is made again.
    """
    number = np.repeat(np.arange(SETS), len(case.turns))
    place = np.tile(np.arange(len(case.turns)), SETS)
    killed = np.linspace(0, SETS, case.kills + 2).astype(int)[1:-1]
    twice = np.flatnonzero(np.isin(number, killed) & (place == 0))
    rows = np.sort(np.concatenate((np.arange(len(number)), twice)))
    kills = np.cumsum(np.diff(rows, prepend=-1) == 0)
    number, place = number[rows], place[rows]
    start = RAMP_S + SET_S * number + 75.0 + place * (TURN_S + PAUSE_S)
    since = start + 0.5 * TURN_S - RAMP_S
    lag = WALL_S * (1.0 - np.exp(-since / WALL_S))
    heat = -40.0 + 12.0 / 3600.0 * (since - lag) + 5.0 * (1.0 - np.exp(-(since + 1800.0) / WALL_S))
    return number, start + AWAY_S * kills, np.array(case.turns, float)[place], heat


def record(case: Case, seed: int) -> tuple[FogDataset, Array, NDArray[np.bool_], float]:
    """Simulate a log of one axis; return it, true temperatures, which rows are wild, the bias."""
    generator = np.random.default_rng([seed, 7])
    number, start, commanded, heat = schedule(case)
    count = len(start)
    first = case.bias * generator.standard_normal() if len(set(case.turns)) == 1 else case.bias
    scaled = (heat - 10.0) / 50.0
    smooth = np.polynomial.polynomial.polyval(scaled, BIAS_DEG_PER_H) * case.bias_over_temperature
    hours = np.diff(start, prepend=start[0]) / 3600.0
    walk = np.cumsum(case.walk * np.sqrt(hours) * generator.standard_normal(count))
    bias = first + smooth + walk
    noise = case.random_walk * np.sqrt(TURN_S / 3600.0) * generator.standard_normal(count)
    noise = noise + ARCSEC * generator.standard_normal(count)
    wild = generator.random(count) < case.outliers
    size = generator.uniform(0.04, 0.15, count) * generator.choice([-1.0, 1.0], count)
    error = commanded * delta_ppm(case, heat) * 1e-6 + bias * TURN_S / 3600.0
    error = error + noise + np.where(wild, size, 0.0)
    before = generator.uniform(0.0, 360.0, count)
    quantum = case.resolution
    read_before = np.mod(np.round(before / quantum) * quantum, 360.0)
    after = np.mod(np.round((before + commanded + error) / quantum) * quantum, 360.0)
    there = generator.random(count) >= case.missing
    nothing = np.full(count, np.nan)
    sensor = 0.02 * generator.standard_normal((2, count))

    def attitude(heading: Array) -> Array:
        return np.column_stack((heading, nothing, nothing))[there]

    rising = 6.0 / 3600.0 * TURN_S
    turns = TurnTable(
        set_number=number[there],
        before_s=start[there],
        after_s=start[there] + TURN_S,
        axis=np.full(int(there.sum()), "x"),
        commanded_deg=commanded[there],
        attitude_before_deg=attitude(read_before),
        attitude_after_deg=attitude(after),
        temperature_before_degC=(heat - rising + sensor[0])[there],
        temperature_after_degC=(heat + rising + sensor[1])[there],
        chamber_degC=nothing[there],
    )
    dataset = FogDataset(
        turns,
        "heading",
        full_attitude=False,
        gyro_bias_deg_per_h=max(case.bias, 0.02),
        heading_resolution_deg=quantum,
    )
    return dataset, heat[there], wild[there], float(first)


def bound_ppm(case: Case, keep: NDArray[np.bool_], at_degC: Array, order: int = 4) -> Array:
    """Return the Cramer-Rao bound of the curve at temperatures, rows `keep` of the schedule."""
    _, start, commanded, heat = schedule(case)
    low, high = float(heat.min()), float(heat.max())

    def columns(temperature: Array, top: int) -> Array:
        scaled = (2.0 * temperature - low - high) / (high - low)
        return np.asarray(np.polynomial.chebyshev.chebvander(scaled, top))

    design = columns(heat, order) * commanded[:, None] * 1e-6
    if len(set(case.turns)) > 1:
        design = np.column_stack((design, columns(heat, BIAS_ORDER) * TURN_S / 3600.0))
    hours = (start - start[0]) / 3600.0
    walk = case.walk**2 * np.minimum.outer(hours, hours) * (TURN_S / 3600.0) ** 2
    cover = case.noise_deg**2 * np.eye(len(start)) + walk
    rows = design[keep]
    scale = np.linalg.norm(rows, axis=0)
    normal = (rows / scale).T @ np.linalg.solve(cover[np.ix_(keep, keep)], rows / scale)
    inverse = np.linalg.inv(normal) / np.outer(scale, scale)
    there = columns(at_degC, order)
    part = inverse[: order + 1, : order + 1]
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", there, part, there)))


def measure(case: Case, runs: int) -> dict[str, object]:
    """Run one case and summarise it."""
    plain = len(set(case.turns)) == 1
    _, _, _, heat = schedule(case)
    grid = np.linspace(float(heat.min()) + 0.05, float(heat.max()) - 0.05, 21)
    truth = delta_ppm(case, grid)
    everything = np.ones(len(heat), dtype=bool)
    share = bound_ppm(case, everything, grid)
    limit = np.zeros((runs, len(grid)))
    errors, published, inside = (np.zeros((runs, len(grid))) for _ in range(3))
    within = np.zeros((runs, len(grid)), dtype=bool)
    whole = np.zeros(runs, dtype=bool)
    orders, flags = np.zeros(runs, dtype=int), {}  # type: ignore[var-annotated]
    found = missed = false = 0
    for seed in range(runs):
        dataset, there, wild, bias = record(case, seed)
        analysis = analyse(dataset)
        fit, paper = analysis.fits["x"], analysis.published["x"]
        if fit.curve is None or paper is None:
            raise RuntimeError(f"{case.name}: seed {seed} leaves the curve undetermined")
        shift = bias * TURN_S / 3600.0 / 360.0 * 1e6 if plain else 0.0
        errors[seed] = fit.curve.error_ppm(grid) - truth - shift
        published[seed] = paper.error_ppm(grid) - truth
        band = Band(fit.curve, dataset.gyro_bias_deg_per_h or 0.0)
        inside[seed] = np.abs(errors[seed] + shift) <= band.expanded_ppm(grid)
        dense = fit.curve.temperatures_degC(DENSE)
        off = np.abs(fit.curve.error_ppm(dense) - delta_ppm(case, dense))
        whole[seed] = bool(np.all(off <= band.whole_ppm(dense)))
        low, high = fit.curve.domain_degC
        within[seed] = (grid >= low) & (grid <= high)
        good = np.isin(np.round(heat, 9), np.round(there[~wild], 9))
        limit[seed] = share if bool(good.all()) else bound_ppm(case, good, grid)
        orders[seed] = fit.curve.order
        rejected = ~fit.kept
        found += int((rejected & wild).sum())
        missed += int((~rejected & wild).sum())
        false += int((rejected & ~wild).sum())
        for code in sorted({flag.code for flag in analysis.flags}):
            flags[code] = flags.get(code, 0) + 1
    # Where the last turns of a range are missing the curve ends before it.
    errors, published, limit = (np.where(within, one, 0.0) for one in (errors, published, limit))
    points = within.sum(axis=1)
    level = float(np.sqrt(np.mean(np.sum(limit**2, axis=1) / points)))
    mean = errors.sum(axis=0) / np.maximum(within.sum(axis=0), 1)
    of_run = np.sum(errors**2, axis=1) / points
    about_mean = np.sum(np.where(within, errors - mean, 0.0) ** 2, axis=1) / points

    def ratio(squares: Array) -> list[float]:
        size = float(np.sqrt(squares.mean()))
        error = float(squares.std()) / np.sqrt(runs) / (2.0 * size)
        return [round(size / level, 3), round(error / level, 3)]

    return {
        "turns": len(heat),
        "runs": runs,
        "bound_rms_ppm": round(level, 3),
        "rmse_over_bound": ratio(of_run),
        "std_over_bound": ratio(about_mean),
        "bias_rms_ppm": round(float(np.sqrt(np.mean(mean**2))), 3),
        "largest_error_ppm": round(float(np.abs(errors).max(axis=1).mean()), 2),
        "coverage_95": round(float(inside[within].mean()), 4),
        "whole_curve_inside": round(float(whole.mean()), 4),
        "true_order": round(float(np.mean(orders == 4)), 4),
        "orders": {int(n): int((orders == n).sum()) for n in np.unique(orders)},
        "wild_rows": {"found": found, "missed": missed, "false": false},
        "flags": flags,
        "published_rmse_over_bound": ratio(np.sum(published**2, axis=1) / points),
        "published_largest_error_ppm": round(float(np.abs(published).max(axis=1).mean()), 2),
    }


@cache
def common_to(case: Case) -> tuple[Array, Array, Array]:
    """Return the temperatures of the turns, the 21 that the curve is held at, the bound there."""
    heat = schedule(case)[3]
    grid = np.linspace(float(heat.min()) + 0.05, float(heat.max()) - 0.05, 21)
    return heat, grid, bound_ppm(case, np.ones(len(heat), dtype=bool), grid)


def trial(case: Case, seed: int) -> Trial:
    """Analyse one log; the curve's errors in ppm at 21 temperatures, beyond its ends NaN.

    Of turns of one sense the gyro's bias is left out of errors and bound, in u it stays.
    """
    heat, grid, share = common_to(case)
    dataset, there, wild, bias = record(case, seed)
    analysis = analyse(dataset)
    codes = frozenset(flag.code for flag in analysis.flags)
    curve = analysis.fits["x"].curve
    if curve is None:
        nothing = np.full(len(grid), np.nan)
        return Trial({"curve": Scored(nothing, nothing, nothing > 0.0, share)}, codes)
    shift = bias * TURN_S / 3600.0 / 360.0 * 1e6 if len(set(case.turns)) == 1 else 0.0
    error = curve.error_ppm(grid) - delta_ppm(case, grid)
    reach = Band(curve, dataset.gyro_bias_deg_per_h or 0.0).expanded_ppm(grid)
    low, high = curve.domain_degC
    good = np.isin(np.round(heat, 9), np.round(there[~wild], 9))
    limit = share if bool(good.all()) else bound_ppm(case, good, grid)
    within = (grid >= low) & (grid <= high)
    of_curve = Scored(
        np.where(within, error - shift, np.nan), reach / 1.96, np.abs(error) <= reach, limit
    )
    return Trial({"curve": of_curve}, codes)


def trials() -> Trials:
    """Return what analyses a log of each case."""
    return {case.name: partial(trial, case) for case in CASES}


def main() -> None:
    print_cases("Estimator of a FOG's scale factor over heat.", CASES, measure)


if __name__ == "__main__":
    main()
