"""How close the nine-axis estimator comes to the Cramer-Rao bound, case by case.

    python benchmarks/nine_axis_estimator.py [--runs 2000] [--case NAME]

Seeds are 0 .. runs-1 of each case. One JSON object per case on standard output: for bias, scale
factor, asymmetry and misalignment the root mean square error over the bound and over the stated u,
each with its standard error, the coverage of the 95 % interval; for bias and scale factor the same
ratio of the published rule; the scale factors of which the rates agree by themselves; how often
which flag came.

The bound of the biases holds what is known of the set-up (heading, tilts, accelerometers); where
the heading is off by a fixed 30 arcmin its prior of 10 arcmin is left out of it. The bound of K
is that of the mean which its definition asks for: weighted by noise, or plain where the rates'
scale factors truly differ.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from cases import (
    Scored,
    Trial,
    Trials,
    measured,
    of_estimates,
    of_published,
    print_cases,
    scored,
)
from nine_axis_records import ARCMIN, LATITUDE_DEG, PRIOR, RATES, STANDS
from nine_axis_stands import FACES, Bench, truth_of

from procedures.nine_axis_calibration.all_axes.results import results_of
from procedures.nine_axis_calibration.analysis import analyse
from procedures.nine_axis_calibration.dataset import (
    NineAxisDataset,
    StaticRecord,
    TurnRecord,
)
from procedures.nine_axis_calibration.outlook import expected_uncertainty

Array = NDArray[Any]

EARTH = 15.041067
RANDOM_WALK = 0.01
POSITIONS = {n: np.array(axes) for n, axes in STANDS.items()}
ARCSEC_PER_RAD = 180.0 * 3600.0 / np.pi


@dataclass(frozen=True)
class Case:
    """How the sensor stood, how the table turned, and what disturbs the samples."""

    name: str
    heading_arcmin: float | None = 0.0
    """Fixed; None draws it from its prior."""
    ideal: bool = False
    nonlinearity_ppm: float = 0.0
    table_ppm: float = 0.0
    dwell_s: float = 360.0
    turns: int | None = None
    """Whole turns at every rate, an efficient dwell; None for `dwell_s` at each, as published."""
    outliers: float = 0.0
    missing: float = 0.0
    static_s: int = 600
    places: int = 3
    """How many of the positions 1 to 6 it stood in."""

    def lasts_s(self, rate_deg_per_s: float) -> float:
        """Return the time of a record at a rate."""
        return self.dwell_s if self.turns is None else 360.0 * self.turns / abs(rate_deg_per_s)


CASES = (
    Case("ideal attitude; white noise", ideal=True),
    Case("heading within its prior of 10 arcmin; white noise", None),
    Case("heading 10 arcmin off; nonlinearity 20 ppm", 10.0, nonlinearity_ppm=20.0),
    Case("heading 30 arcmin off; table 100 ppm off", 30.0, table_ppm=100.0),
    Case("within prior; nonlinearity 5 ppm, table 100 ppm", None, False, 5.0, 100.0),
    Case("efficient dwell; white noise", None, turns=5),
    Case("efficient dwell; nonlinearity 20 ppm", None, nonlinearity_ppm=20.0, turns=5),
    Case("efficient dwell; table 100 ppm off", None, table_ppm=100.0, turns=5),
    Case("within prior; part turns of 60 s", None, dwell_s=60.0),
    Case("within prior; 3 % wild, 5 % missing", None, outliers=0.03, missing=0.05),
)


def turned(axes: Array, east: float, north: float, up: float) -> Array:
    """Return axes (rows) turned about east, then north, then up, by angles in rad."""
    for angle, (a, b) in ((east, (1, 2)), (north, (2, 0)), (up, (0, 1))):
        matrix = np.eye(3)
        matrix[a, a] = matrix[b, b] = np.cos(angle)
        matrix[b, a], matrix[a, b] = np.sin(angle), -np.sin(angle)
        axes = axes @ matrix.T
    return axes


@dataclass(frozen=True)
class Truth:
    """What one simulated sensor is."""

    bias: Array
    scale: Array
    asymmetry: Array
    cross: Array


def spoiled(
    case: Case, values: Array, size: float, generator: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Return samples with wild ones among them, and which are there at all."""
    count = len(values)
    if case.outliers:
        wild = generator.random(count) < case.outliers
        kick = size * 10.0 ** generator.uniform(1.0, 4.0, count) * generator.choice((-1, 1), count)
        values = values + np.where(wild, kick, 0.0)[:, None]
    there = generator.random(count) >= case.missing
    there[0] = True
    return values, there


def simulate(case: Case, seed: int) -> tuple[NineAxisDataset, Truth]:
    """Return one record of everything, and the truth behind it."""
    generator = np.random.default_rng([seed, 8])
    truth = Truth(
        generator.normal(0.0, 0.2, 3),
        1.0 + generator.normal(0.0, 1e-4, 3),
        np.array([8e-6, -5e-6, 3e-6]),
        generator.normal(0.0, 2.0 * ARCMIN, (3, 3)),
    )
    gain = truth.cross.copy()
    np.fill_diagonal(gain, 1.0)
    gain *= truth.scale[:, None]
    heading = case.heading_arcmin
    psi = generator.normal(0.0, PRIOR.heading_rad) if heading is None else heading * ARCMIN
    lean = 0.0 if case.ideal else 1.0
    offset_g = lean * generator.normal(0.0, PRIOR.accelerometer_bias_g, 3)
    latitude = np.radians(LATITUDE_DEG)
    turning = EARTH * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    noise = 60.0 * RANDOM_WALK
    static = []
    for position, axes in list(POSITIONS.items())[: case.places]:
        tilt = lean * generator.normal(0.0, PRIOR.tilt_rad, 2)
        own = lean * generator.normal(0.0, PRIOR.relative_heading_rad)
        stood = turned(axes, tilt[0], tilt[1], -(psi + own))
        rate = truth.bias + gain @ (stood @ turning)
        count = case.static_s
        rates = rate + noise * generator.standard_normal((count, 3))
        rates, there = spoiled(case, rates, noise, generator)
        acceleration = stood[:, 2] + offset_g + 1e-4 * generator.standard_normal((count, 3))
        time_s = np.arange(1.0, count + 1)
        static.append(StaticRecord(position, time_s[there], rates[there], acceleration[there]))
    turns = []
    for axis in range(3):
        deviation = generator.standard_normal(len(RATES))
        deviation = case.nonlinearity_ppm * 1e-6 * (deviation - deviation.mean())
        turns += [
            turn(case, truth, gain, axis, sense * rate, deviation[n], generator)
            for n, rate in enumerate(RATES)
            for sense in (1.0, -1.0)
        ]
    dataset = NineAxisDataset(LATITUDE_DEG, PRIOR, tuple(static), tuple(turns))
    return dataset, truth


def turn(
    case: Case,
    truth: Truth,
    gain: Array,
    axis: int,
    commanded: float,
    deviation: float,
    generator: np.random.Generator,
) -> TurnRecord:
    """Return one record on the table; the turned axis up, another one along the table's zero."""
    count = round(case.lasts_s(commanded))
    rate = commanded * (1.0 + case.table_ppm * 1e-6)
    time_s = np.arange(1.0, count + 1)
    angle_deg = generator.uniform(0.0, 360.0) + rate * time_s
    width = np.radians(rate)
    middle = np.radians(angle_deg) - 0.5 * width
    shrunk = np.sinc(width / (2.0 * np.pi))
    latitude = np.radians(LATITUDE_DEG)
    felt = np.zeros((count, 3))
    felt[:, axis] = rate + EARTH * np.sin(latitude) / 3600.0
    level = EARTH * np.cos(latitude) / 3600.0 * shrunk
    felt[:, (axis + 1) % 3] = level * np.cos(middle)
    felt[:, (axis + 2) % 3] = -level * np.sin(middle)
    output = felt @ gain.T + truth.bias / 3600.0
    bent = deviation + np.sign(rate) * truth.asymmetry[axis] / 2.0
    output[:, axis] += truth.scale[axis] * rate * bent
    noise = 60.0 * RANDOM_WALK / 3600.0
    output = output + noise * generator.standard_normal((count, 3))
    output, there = spoiled(case, output, noise, generator)
    reading = np.asarray(np.round(np.mod(angle_deg, 360.0), 5), dtype=np.float64)
    return TurnRecord(axis, commanded, time_s[there], output[there], reading[there])


def bounds(case: Case) -> dict[str, Array]:
    """Return the bounds of the biases (deg/h), K, asymmetry (ratios) and misalignment (rad)."""
    rates = np.array(RATES)
    dwell = np.array([case.lasts_s(rate) for rate in rates])
    prior = PRIOR if case.heading_arcmin != 30.0 else replace(PRIOR, heading_rad=1.0)
    expected = expected_uncertainty(
        (1, 2, 3), case.static_s, rates, dwell, RANDOM_WALK, LATITUDE_DEG, prior
    )
    plain = case.nonlinearity_ppm > 0.0
    scale = expected.published_scale_factor if plain else expected.scale_factor
    return {
        "bias": expected.bias_deg_per_h,
        "scale_factor": np.full(3, scale),
        "asymmetry": np.full(3, expected.asymmetry),
        "misalignment": np.full(6, expected.scale_factor),
    }


PAIRS = ("XY", "XZ", "YX", "YZ", "ZX", "ZY")
UNIT = {"bias": 1.0, "scale_factor": 1.0, "asymmetry": 1e-6, "misalignment": 1 / ARCSEC_PER_RAD}


known_bounds = cache(bounds)


def trial(case: Case, seed: int) -> Trial:
    """Analyse one dataset of the published form."""
    limit = known_bounds(case)
    dataset, truth = simulate(case, seed)
    analysis = analyse(dataset, allan=False)
    cross = [truth.cross["XYZ".index(one[0]), "XYZ".index(one[1])] for one in PAIRS]
    values_of = (truth.bias, truth.scale, truth.asymmetry, np.array(cross))
    true = dict(zip(limit, values_of, strict=True))
    results: dict[str, Scored] = {}
    for name, values in true.items():
        axes = PAIRS if len(values) == len(PAIRS) else "XYZ"
        rows: list[tuple[float, float, float]] = []
        for along, value in zip(axes, values, strict=True):
            one = analysis.estimate(name, along)
            if one.value is None or one.standard_uncertainty is None:
                rows.append((np.nan, np.nan, np.inf))
                continue
            u = one.standard_uncertainty
            if name == "bias" and analysis.bias is not None:
                parts = [
                    size for part, size in one.sensitivities.items() if part.startswith("prior_")
                ]
                u = float(np.hypot(u, np.linalg.norm(parts)))
            error = one.value * UNIT[name] - value
            rows.append((error, u * UNIT[name], one.degrees_of_freedom or np.inf))
        error_of, u_of, freedom = np.transpose(rows)
        results[name] = scored(error_of, u_of, freedom, limit[name])
    of_axes: dict[tuple[str, str | None], float] = {
        (name, axis): true[name][k]
        for name in ("bias", "scale_factor")
        for k, axis in enumerate("XYZ")
    }
    results |= of_published(analysis.published, of_axes, limit)
    agree = [one is not None and one.agree for one in analysis.axes.values()]
    of_scale = results["scale_factor"]
    weighted = np.where(agree, of_scale.error, np.nan)
    results["scale_factor, rates that agree"] = replace(of_scale, error=weighted)
    return Trial(results, frozenset(flag.code for flag in analysis.flags))


ALL_AXES: Mapping[str, Mapping[str, Any]] = {
    "all axes, faces and edges": {},
    "all axes, turned upside down too": {"turned": ("X", "Y", "Z", "-Z")},
    "all axes, faces alone, no field": {"poses": FACES, "field_at_poses": False},
    "all axes, put by hand to 3 arcmin": {"tilt_arcmin": 3.0},
}


def trial_of_all_axes(setting: Mapping[str, Any], seed: int) -> Trial:
    """Analyse stands and turns of all nine axes; no bound is known, u is each result's own."""
    bench = Bench(seed, **setting)
    if not bench.field_at_poses:  # the faces alone say nothing of the second order
        bench.sensor = replace(bench.sensor, second=np.zeros(3))
    analysis = results_of(bench.data())
    estimates = (*analysis.estimates, *analysis.misalignment)
    truth: dict[tuple[str, str | None], float] = {}
    truth.update({(name, axis): one for (name, axis), one in truth_of(bench.sensor).items()})
    results = of_estimates(estimates, truth)
    return Trial(results, frozenset(flag.code for flag in analysis.flags))


def trials() -> Trials:
    """Return what analyses a dataset of each case, those of all nine axes last."""
    published = {case.name: partial(trial, case) for case in CASES}
    return published | {name: partial(trial_of_all_axes, one) for name, one in ALL_AXES.items()}


def measure(case: Case, runs: int) -> dict[str, object]:
    """Run one case."""
    return measured(partial(trial, case), runs)


def main() -> None:
    print_cases("Nine-axis estimator against its bound.", CASES, measure)


if __name__ == "__main__":
    main()
