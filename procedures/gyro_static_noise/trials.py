"""The analysis tried again: other noise of the size that was fitted, and inputs that deviate.

The results are the size of the noise, so that more noise on the records would not do: a trial makes
them anew of their means, the fitted ramp and lines, and noise. How these switch-ons differ is a
result of theirs and stays; all are shifted alike, as far as their mean is uncertain by it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from procedures.common.perturbing import of_directions, shifted
from procedures.estimation.direction import LATITUDE
from procedures.estimation.noise import grid_index
from procedures.estimation.rate_spectrum import allan_terms, in_time, noise_variances
from station.findings import Trials

from .analysis import StaticAnalysis, analyse
from .checks import AxisAnalysis
from .dataset import AnalysisSettings, Array, Record, StaticDataset


@dataclass(frozen=True)
class Made:
    """What an axis's records are made of.

    `theta` (4,) are the squares of its noise, rounding of pulses left out; `shift` in deg/h is the
    standard uncertainty of the mean of all switch-ons by their scatter, with `freedom` degrees of
    freedom, or by how the mean of one wanders; `ramp` is in deg/h per h, `lines` in Hz and deg/h.
    """

    theta: Array
    shift: float
    freedom: int
    ramp: float
    lines: tuple[tuple[float, float], ...]


def trials_of(
    analysis: StaticAnalysis, dataset: StaticDataset, settings: AnalysisSettings
) -> Trials:
    """Return how the analysis of a dataset is tried again."""
    made = [made_of(axis, dataset) for axis in analysis.axes]
    return Trials(
        dataset,
        partial(analyse, settings=settings),
        partial(noisy, made=made),
        perturbed(list(dataset.directions)),
    )


def made_of(axis: AxisAnalysis, dataset: StaticDataset) -> Made | None:
    """Return what the records of an axis are made of; None where their noise is not known."""
    fit, means = axis.fit, axis.means
    if fit is None or not len(means):
        return None
    theta = np.maximum(fit.theta - np.array([dataset.pulse_arcsec**2 / 12.0, 0.0, 0.0, 0.0]), 0.0)
    lines = tuple((line.frequency_Hz, line.amplitude_deg_per_h) for line in fit.lines)
    length_s = float(axis.counts[0]) * dataset.sample_interval_s
    shift = float(np.sqrt(fit.theta @ allan_terms(length_s)))
    if len(means) > 1:
        shift = float(np.std(means, ddof=1) / np.sqrt(len(means)))
    return Made(theta, shift, len(means) - 1, fit.ramp, lines)


def noisy(
    dataset: StaticDataset, random: np.random.Generator, *, made: Sequence[Made | None]
) -> StaticDataset:
    """Return the records made anew, at the times of the measured ones."""
    shifts = [_shift(own, random) for own in made]
    records = []
    for record in dataset.records:
        columns = [
            record.rate_deg_per_h[:, n]
            if own is None
            else _column(dataset, record, n, own, by, random)
            for n, (own, by) in enumerate(zip(made, shifts, strict=True))
        ]
        records.append(replace(record, rate_deg_per_h=np.column_stack(columns)))
    return replace(dataset, records=tuple(records))


def _shift(made: Made | None, random: np.random.Generator) -> float:
    """Return by how much all switch-ons are shifted; a scatter of few of them may be larger."""
    if made is None:
        return 0.0
    drawn = random.standard_t(made.freedom) if made.freedom else random.standard_normal()
    return made.shift * float(drawn)


def _column(
    dataset: StaticDataset,
    record: Record,
    number: int,
    made: Made,
    shift: float,
    random: np.random.Generator,
) -> Array:
    interval_s, pulse = dataset.sample_interval_s, dataset.pulse_arcsec
    places, measured = grid_index(record.time_s, interval_s), record.rate_deg_per_h[:, number]
    there = np.isfinite(measured)
    if not there.any():
        return measured
    count = int(places[-1]) + 1
    time_s = (np.arange(count) - 0.5 * (count - 1)) * interval_s
    sigma = np.sqrt(made.theta @ noise_variances(count, interval_s))
    rate = in_time(sigma * random.standard_normal(count - 1), count)
    rate = rate + float(measured[there].mean()) + shift
    if made.freedom:
        length_s = float(there.sum()) * interval_s
        white = made.theta[1] / length_s + 2.0 * made.theta[0] / length_s**2
        rate += np.sqrt(white) * random.standard_normal()
    rate += made.ramp * time_s / SECONDS_PER_HOUR
    for f, amplitude in made.lines:
        phase = random.uniform(0.0, 2.0 * np.pi)
        rate += amplitude * np.sinc(f * interval_s) * np.cos(2.0 * np.pi * f * time_s + phase)
    if pulse:
        angle = np.cumsum(np.append(random.uniform(0.0, pulse), rate * interval_s))
        rate = np.diff(np.floor(angle / pulse)) * pulse / interval_s
    return np.where(there, rate[places], np.nan)


Change = Callable[[StaticDataset, float], StaticDataset]


def perturbed(axes: Sequence[str]) -> Mapping[str, Change]:
    """Return what each input does to the data."""
    moved = partial(shifted, column="latitude_rad")
    return {"clock": _clock, "pulse_weight": _pulse, LATITUDE: moved, **of_directions(axes)}


def _scaled(dataset: StaticDataset, factor: float, slower: float = 1.0) -> StaticDataset:
    records = [
        replace(r, rate_deg_per_h=r.rate_deg_per_h * factor, time_s=r.time_s * slower)
        for r in dataset.records
    ]
    return replace(dataset, records=tuple(records))


def _clock(dataset: StaticDataset, slower: float) -> StaticDataset:
    """Return the records with longer intervals, in which as much was counted."""
    longer = 1.0 + slower
    scaled = _scaled(dataset, 1.0 / longer, longer)
    return replace(scaled, sample_interval_s=dataset.sample_interval_s * longer)


def _pulse(dataset: StaticDataset, part: float) -> StaticDataset:
    factor = 1.0 + part
    return replace(_scaled(dataset, factor), pulse_arcsec=dataset.pulse_arcsec * factor)
