"""Records of gyros on a rate table with known response and noise, made in the time domain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from static_records import counted, noise

from procedures.estimation.rate_spectrum import covariances
from procedures.gyro_rate_table.analysis import analyse
from procedures.gyro_rate_table.dataset import PPM, RateTableDataset, Record

Array = NDArray[np.float64]

LATITUDE_RAD = float(np.deg2rad(39.9))
RATES = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
REST_S, BETWEEN_S, MIN_S = 120, 20, 40.0
EARTH_DEG_PER_H = 15.041


@dataclass(frozen=True)
class Gyro:
    """A gyro, its mounting and its table; rates in deg/h but the table's."""

    scale: float = 1.000085
    nonlinearity_ppm: float = 0.0
    cubic_ppm: float = 0.0
    asymmetry_ppm: float = 0.0
    scatter_ppm: float = 0.0
    drift_ppm: float = 0.0
    bias: float = 0.4
    N: float = 0.006
    B: float = 0.0
    K: float = 0.0
    warm_up: float = 0.0
    axis_off_deg: float = 0.0
    table_off_ppm: float = 0.0
    settling: float = 0.0
    encoder_deg: float = 3e-5
    record_s: float | None = None
    repeats: int = 1
    rates: tuple[float, ...] = RATES
    quantum_deg: float = 0.0
    earth_in_output: bool = True

    def departure(self, rate: float) -> float:
        """Return K_i/K0 - 1 in ppm, a wave over the rates and what a cubic output makes of it."""
        wave = self.nonlinearity_ppm * float(np.sin(np.pi * np.log10(max(rate, 1e-9))))
        return wave + self.cubic_ppm * (rate / 100.0) ** 2


CASES = {
    "white": Gyro(),
    "drifting": Gyro(B=0.03, K=0.1, warm_up=0.3),
    "nonlinear": Gyro(nonlinearity_ppm=20.0, asymmetry_ppm=15.0),
    "table 100 ppm off": Gyro(table_off_ppm=100.0),
    "part turns, axis 1 deg off": Gyro(record_s=60.0, axis_off_deg=1.0),
    "settling": Gyro(settling=0.004),
    "scale factor drifts": Gyro(drift_ppm=40.0, repeats=3),
    "curved, scale factor drifts": Gyro(cubic_ppm=50.0, drift_ppm=40.0, repeats=3),
    "four switch-ons": Gyro(scatter_ppm=3.0, repeats=4),
    "nine-axis sensor": Gyro(N=0.012),
    "navigator": Gyro(N=0.002, K=0.05, quantum_deg=1e-4, earth_in_output=False),
}


def plan(one: Gyro) -> list[tuple[float, int]]:
    """Return the rates in their order with the samples of each record."""
    found = [(0.0, REST_S)]
    for rate in one.rates:
        turns = np.ceil(MIN_S * rate / 360.0)
        seconds = round(one.record_s or turns * 360.0 / rate)
        found += [(rate, seconds), (-rate, seconds)]
    return [*found, (0.0, REST_S)]


@dataclass(frozen=True)
class Made:
    """A dataset with what is true of it, in the units of the results."""

    dataset: RateTableDataset
    truth: dict[str, float]


def made(rng: np.random.Generator, one: Gyro, axis: str = "IA") -> Made:
    """Return records of a gyro whose switch-ons scatter, with 1 s between samples."""
    records: list[Record] = []
    drawn, levels = [], []
    for repeat in range(1, one.repeats + 1):
        scale = one.scale * (1.0 + one.scatter_ppm * rng.standard_normal() / PPM)
        drawn.append(scale)
        count = sum(seconds + BETWEEN_S for _, seconds in plan(one))
        device = {"Q": 0.0, "N": 0.0, "B": one.B, "K": one.K}
        slow = noise(rng, device, count, 1.0) + one.bias
        slow += one.warm_up * np.exp(-np.arange(count) / 1500.0)
        begin, angle = 0, rng.uniform(0.0, 360.0)
        for rate, seconds in plan(one):
            own = slice(begin, begin + seconds)
            rates = np.full(seconds, rate * (1.0 + one.table_off_ppm / PPM))
            rates *= 1.0 + one.settling * np.exp(-np.arange(seconds) / 2.0)
            edges = angle + np.concatenate(([0.0], np.cumsum(rates)))
            # About the mean time of a switch-on, by so much from its first to its last second.
            since_middle = (np.arange(begin, begin + seconds) + 0.5) / count - 0.5
            drifting: Array = scale * (1.0 + one.drift_ppm / PPM * since_middle)
            record, level = _record(rng, one, repeat, rate, begin, edges, drifting, slow[own])
            records.append(record)
            levels.append(level)
            begin, angle = begin + seconds + BETWEEN_S, float(edges[-1])
    dataset = RateTableDataset(LATITUDE_RAD, 1.0, one.quantum_deg, 0.0, tuple(records))
    dataset = replace(dataset, axis=axis, earth_in_output=one.earth_in_output)
    return Made(dataset, _truth(one, drawn, float(np.mean(levels))))


def _record(
    rng: np.random.Generator,
    one: Gyro,
    repeat: int,
    rate: float,
    begin: int,
    edges: Array,
    scale: Array,
    slow: Array,
) -> tuple[Record, float]:
    count = len(slow)
    table = np.diff(edges)
    response = scale * (table * (1.0 + one.departure(abs(rate)) / PPM))
    response += scale * one.asymmetry_ppm / PPM / 2.0 * np.abs(table)
    middle = np.radians(0.5 * (edges[1:] + edges[:-1]))
    earth_deg_per_h = EARTH_DEG_PER_H * one.earth_in_output
    level = earth_deg_per_h * np.cos(LATITUDE_RAD) * np.sin(np.radians(one.axis_off_deg))
    extra = slow + scale * earth_deg_per_h * np.sin(LATITUDE_RAD)
    extra = extra + level * np.cos(middle) * np.sinc(table / 360.0)
    extra = extra + 60.0 * one.N * rng.standard_normal(count)
    read = edges + one.encoder_deg * rng.standard_normal(count + 1)
    time_s: Array = begin + 0.5 + np.arange(count, dtype=np.float64)
    unsteady = np.abs(table - np.median(table)) > 1e-3
    output: Array = np.asarray(response + extra / 3600.0)
    if one.quantum_deg:
        output = counted(output, one.quantum_deg, 1.0, rng.uniform(0.0, one.quantum_deg))
    record = Record(repeat, rate, time_s, output, read[:-1], read[1:], unsteady)
    return record, float(slow.mean())


def _truth(one: Gyro, drawn: list[float], bias: float) -> dict[str, float]:
    rates = np.array(one.rates)
    departure = np.array([one.departure(rate) for rate in one.rates]) / PPM
    line = float(rates**2 @ (1.0 + departure)) / float(rates @ rates)
    relative = (1.0 + departure) / line - 1.0
    even = one.asymmetry_ppm / PPM / line / 2.0 * (rates - rates.mean())
    both = np.concatenate((rates * relative + even, rates * relative - even)) / rates.max()
    truth = {
        "scale_factor": one.scale * line,
        "nonlinearity": float(np.max(np.abs(relative))) * PPM,
        "nonlinearity_of_full_scale": float(np.max(np.abs(both))) * PPM,
        "asymmetry": one.asymmetry_ppm / line,
        "bias": bias,
    }
    if len(drawn) > 1:
        truth["scale_factor_repeatability"] = float(np.std(drawn, ddof=1)) / one.scale * PPM
    return truth


def bounds(one: Gyro) -> dict[str, float]:
    """Return the Cramér-Rao bounds of K and of the asymmetry in ppm, by generalised least squares.

    One switch-on with its level and ramp; white noise, flicker and walk of known size.
    """
    steps = plan(one)
    starts = np.cumsum([0, *(seconds + BETWEEN_S for _, seconds in steps)])[:-1]
    count = int(starts[-1] + steps[-1][1])
    mixed = np.zeros((len(steps), count))
    for row, (start, (_, seconds)) in enumerate(zip(starts, steps, strict=True)):
        mixed[row, start : start + seconds] = 1.0 / seconds
    shared = covariances(count, 1.0)
    own = one.B**2 * shared[2] + one.K**2 / 3600.0 * shared[3]
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    seconds = np.array([one for _, one in steps], dtype=np.float64)
    turned = np.array([rate for rate, _ in steps]) * 3600.0
    reading = 2.0 * (3600.0 * one.encoder_deg / seconds) ** 2
    noise_of = mixed @ own[lag] @ mixed.T + np.diag((60.0 * one.N) ** 2 / seconds + reading)
    place = np.array([one.rates.index(abs(rate)) if rate else -1 for rate, _ in steps])
    rates = np.where(place[:, None] == np.arange(len(one.rates)), turned[:, None], 0.0)
    time = starts + 0.5 * seconds
    columns = np.column_stack(
        (rates, np.abs(turned) / 2.0, np.ones(len(steps)), time - time.mean())
    )
    # Generalised covariances may have any constant beside them: the level takes it up.
    noise_of = noise_of + 1e3 * float(np.abs(noise_of).max())
    covariance = np.linalg.inv(columns.T @ np.linalg.solve(noise_of, columns))
    weights = np.array(one.rates) ** 2 / float(np.sum(np.array(one.rates) ** 2))
    width = len(one.rates)
    return {
        "scale_factor": PPM * float(np.sqrt(weights @ covariance[:width, :width] @ weights)),
        "asymmetry": PPM * float(np.sqrt(covariance[width, width])),
    }


@dataclass(frozen=True)
class Trial:
    """Errors and u of a result, (runs,), in the units of the result, and which were covered."""

    errors: Array
    u: Array
    covered: NDArray[np.bool_]


def trials(one: Gyro, runs: int, seed: int = 0) -> dict[str, Trial]:
    """Return what the analysis makes of many datasets, by result."""
    from scipy.stats import t

    found: dict[str, list[tuple[float, float, bool]]] = {}
    for number in range(runs):
        case = made(np.random.default_rng((seed, number)), one)
        analysis = analyse(case.dataset)
        for name, true in case.truth.items():
            estimate = analysis.estimate(name, "IA")
            assert estimate.value is not None and estimate.standard_uncertainty is not None
            error, u = estimate.value - true, estimate.standard_uncertainty
            reach = float(t.ppf(0.975, estimate.degrees_of_freedom or np.inf)) * u
            found.setdefault(name, []).append((error, u, abs(error) <= reach))
    return {
        name: Trial(
            np.array([one[0] for one in rows]),
            np.array([one[1] for one in rows]),
            np.array([one[2] for one in rows]),
        )
        for name, rows in found.items()
    }


def lines(made_: Made, output: str = "rate_deg_per_s") -> Iterator[str]:
    """Yield the rows of a dataset file, stamps at the end of each interval."""
    yield f"repeat,commanded_deg_per_s,t_s,{output},encoder_deg"
    for one in made_.dataset.records:
        angles = np.mod(np.concatenate((one.start_deg[:1], one.end_deg)), 360.0)
        rates = np.concatenate((one.rate_deg_per_s[:1], one.rate_deg_per_s))
        times = one.time_s[0] - 0.5 + np.arange(len(rates))
        for time, rate, angle in zip(times, rates, angles, strict=True):
            yield f"{one.repeat},{one.commanded_deg_per_s:g},{time:g},{rate:.7f},{angle:.5f}"


CONDITIONS = """dataset: 1
procedure: gyro-rate-table
files: {samples: samples.csv}
conditions:
  sample_interval: 1 s
  timestamp: interval-end
  gyro_output: rate
  latitude: 39.9 deg
"""


def written(folder: Path, rows: list[str], conditions: str = CONDITIONS) -> Path:
    """Write a dataset folder."""
    folder.mkdir(parents=True)
    (folder / "dataset.yaml").write_text(conditions, encoding="utf-8")
    (folder / "samples.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def without(dataset: RateTableDataset, *commanded: float) -> RateTableDataset:
    """Return a dataset without the records of some commanded rates."""
    kept = tuple(one for one in dataset.records if one.commanded_deg_per_s not in commanded)
    return replace(dataset, records=kept)
