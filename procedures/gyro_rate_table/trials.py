"""The analysis tried again: other noise of output and encoder, and inputs that deviate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.estimation.direction import LATITUDE
from station.findings import Trials

from .analysis import RateTableAnalysis, TriadAnalysis, analyse, end_variance, together
from .dataset import PPM, AnalysisSettings, Array, RateTableDataset


@dataclass(frozen=True)
class Noise:
    """The noise of records: of a sample, of each record's mean beyond that, of all of them.

    `quantised` and `white` in deg/h are of the ends of an interval and of its mean; `ends` (r,) in
    deg/h of the angle at a record's ends; `walk` in deg/h per root of an hour. `scattered` is that
    part of the scale factor's u which the scatter of `freedom` + 1 switch-ons has.
    """

    quantised: float
    white: float
    ends: Array
    walk: float
    scattered: float
    freedom: int


Datasets = Mapping[str, RateTableDataset]
"""By the axis that stands upright."""


def analysed(datasets: Datasets, settings: AnalysisSettings) -> TriadAnalysis:
    """Return the results of all axes."""
    return together({axis: analyse(dataset, settings) for axis, dataset in datasets.items()})


def trials_of(analysis: TriadAnalysis, datasets: Datasets, settings: AnalysisSettings) -> Trials:
    """Return how the analysis of all axes is tried again."""
    noises = {axis: noise_of(own, datasets[axis]) for axis, own in analysis.axes.items()}
    again = partial(analysed, settings=settings)
    return Trials(datasets, again, partial(noisy, noises=noises), perturbed())


def noise_of(analysis: RateTableAnalysis, dataset: RateTableDataset) -> Noise | None:
    """Return the noise that the analysis saw; None where it has no solution."""
    screened, fit, within = analysis.screened, analysis.fit, analysis.within
    if screened is None or fit is None or within is None:
        return None
    interval_s = dataset.sample_interval_s
    own = end_variance(screened.kept, dataset.encoder_accuracy_deg, screened.scale)
    ends = np.zeros(len(dataset.records))
    for kept, variance in zip(screened.kept, own, strict=True):
        place = next(n for n, r in enumerate(dataset.records) if r is kept.record)
        ends[place] = np.sqrt(variance)
    results, scattered, freedom = analysis.results, 0.0, fit.switch_ons - 1
    if freedom and results is not None and results.repeatability is not None:
        scattered = results.repeatability.value / PPM / np.sqrt(fit.switch_ons)
    return Noise(
        float(np.sqrt(max(within.squares[0], 0.0))) / interval_s,
        float(np.sqrt(max(within.squares[1], 0.0) / interval_s)),
        ends,
        float(np.sqrt(max(fit.walk, 0.0))),
        float(scattered),
        freedom,
    )


def noisy(
    datasets: Datasets, random: np.random.Generator, *, noises: Mapping[str, Noise | None]
) -> Datasets:
    """Return the records with more noise, of the size that theirs has."""
    return {axis: _noisy(own, random, noises[axis]) for axis, own in datasets.items()}


def _noisy(
    dataset: RateTableDataset, random: np.random.Generator, noise: Noise | None
) -> RateTableDataset:
    if noise is None:
        return dataset
    factor = 1.0
    if noise.freedom:
        factor += noise.scattered * float(random.standard_t(noise.freedom))
    records, strayed, last_s, repeat = [], 0.0, 0.0, None
    for record, end in zip(dataset.records, noise.ends, strict=True):
        count = len(record.time_s)
        middle_s = float(record.time_s.mean())
        strayed = strayed if record.repeat == repeat else 0.0
        if record.repeat == repeat:
            steps_h = max(middle_s - last_s, 0.0) / SECONDS_PER_HOUR
            strayed += noise.walk * float(np.sqrt(steps_h) * random.standard_normal())
        last_s, repeat = middle_s, record.repeat
        added = noise.quantised * np.diff(random.standard_normal(count + 1))
        added = added + noise.white * random.standard_normal(count)
        added += end * random.standard_normal() + strayed
        rate = record.rate_deg_per_s * factor + added / SECONDS_PER_HOUR
        records.append(replace(record, rate_deg_per_s=rate))
    return replace(dataset, records=tuple(records))


Change = Callable[[RateTableDataset, float], RateTableDataset]


def perturbed() -> Mapping[str, Callable[[Datasets, float], Datasets]]:
    """Return what each input does to the data.

    A table's axis that leans stands vertical at another latitude.
    """
    changes: Mapping[str, Change] = {
        "clock": _clock,
        "pulse_weight": _pulse,
        "alignment": _aligned,
        "level": _levelled,
        LATITUDE: _latitude,
    }
    return {name: partial(_of_axes, change=change) for name, change in changes.items()}


def _of_axes(datasets: Datasets, deviation: float, *, change: Change) -> Datasets:
    return {axis: change(dataset, deviation) for axis, dataset in datasets.items()}


def _clock(dataset: RateTableDataset, slower: float) -> RateTableDataset:
    longer = 1.0 + slower
    records = tuple(replace(r, time_s=r.time_s * longer) for r in dataset.records)
    interval_s = dataset.sample_interval_s * longer
    return replace(dataset, records=records, sample_interval_s=interval_s)


def _aligned(dataset: RateTableDataset, part: float) -> RateTableDataset:
    records = tuple(
        replace(r, rate_deg_per_s=r.rate_deg_per_s * (1.0 + part)) for r in dataset.records
    )
    return replace(dataset, records=records)


def _pulse(dataset: RateTableDataset, part: float) -> RateTableDataset:
    quantum = dataset.quantum_deg_per_s * (1.0 + part)
    return replace(_aligned(dataset, part), quantum_deg_per_s=quantum)


def _levelled(dataset: RateTableDataset, lean_rad: float) -> RateTableDataset:
    return replace(dataset, latitude_rad=dataset.latitude_rad - lean_rad)


def _latitude(dataset: RateTableDataset, off_rad: float) -> RateTableDataset:
    return replace(dataset, latitude_rad=dataset.latitude_rad + off_rad)
