"""The analysis tried again: other noise of output and field, and inputs that deviate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from procedures.common.helmholtz import FieldAtDevice, carried
from procedures.common.perturbing import drawn_size, scaled, shifted
from procedures.estimation.noise import grid_index
from procedures.estimation.sine import averaging_factor
from station.findings import Trials

from .analysis import analyse
from .dataset import AXES, UNDRIVEN, Array, RlgDataset, Segment
from .fitted import FittedRecord, RlgAnalysis
from .parameters import AnalysisSettings

Lines = tuple[tuple[float, tuple[complex, ...]], ...]
"""The lines of a field: frequency in Hz, phasors on IA, NA, LA in mT."""


@dataclass(frozen=True)
class Noise:
    """The noise of a record, as its fits have it.

    `sigma_deg_per_h` is of a sample of the output, by the frequency near which it holds;
    `field_mT` (3,) of a reading of the field. The output's is known with `degrees_of_freedom`.
    """

    sigma_deg_per_h: Mapping[float, float]
    field_mT: Array
    degrees_of_freedom: float


def trials_of(analysis: RlgAnalysis, dataset: RlgDataset, settings: AnalysisSettings) -> Trials:
    """Return how the analysis of a dataset is tried again."""
    noises = tuple(noise_of(record) for record in analysis.segments)
    return Trials(
        dataset,
        partial(analyse, settings=settings),
        partial(noisy, noises=noises),
        perturbed([lines_of(record) for record in analysis.segments], dataset.at_device),
    )


def noise_of(record: FittedRecord) -> Noise:
    """Return the noise next to the lines of a record, from the covariances of their phasors."""
    segment, gyro = record.segment, record.gyro
    samples, readings = int(gyro.kept.sum()), int((~record.field.wild).sum())
    variances = np.diag(gyro.covariance).reshape(-1, 2).mean(axis=1)
    sigma: dict[float, float] = {}
    field_mT = np.zeros(3)
    for k, line in enumerate(record.field.lines):
        f = line.frequency_Hz
        averaged = averaging_factor(f, segment.field_averaging_s)
        field_mT = np.maximum(field_mT, np.sqrt(line.variance_mT2 * readings / 2.0) * averaged)
        if not record.fitted:
            continue
        double = gyro.double[k]
        for place, at_Hz in ((k, f), *(() if double is None else ((double, 2.0 * f),))):
            own = averaging_factor(at_Hz, segment.sample_interval_s)
            sigma[at_Hz] = float(np.sqrt(variances[place] * samples / 2.0)) * own
    driven = gyro.degrees_of_freedom[: len(record.field.lines)]
    return Noise(sigma, field_mT, float(np.min(driven)) if len(driven) else np.inf)


def lines_of(record: FittedRecord) -> Lines:
    """Return the lines of a record's field."""
    return tuple((line.frequency_Hz, tuple(line.phasor_mT)) for line in record.field.lines)


def noisy(
    dataset: RlgDataset, random: np.random.Generator, *, noises: Sequence[Noise]
) -> RlgDataset:
    """Return the records with more noise on output and field, of the size that theirs has."""
    pairs = zip(dataset.segments, noises, strict=True)
    segments = tuple(_noisy(segment, noise, random) for segment, noise in pairs)
    return replace(dataset, segments=segments)


def _noisy(segment: Segment, noise: Noise, random: np.random.Generator) -> Segment:
    field_mT = segment.field_mT + random.standard_normal(segment.field_mT.shape) * noise.field_mT
    if not noise.sigma_deg_per_h:
        return replace(segment, field_mT=field_mT)
    # A level next to each line, on a grid without gaps.
    count, interval_s = segment.places, segment.sample_interval_s
    frequency_Hz = np.fft.rfftfreq(count, interval_s)
    known_Hz = np.array([*noise.sigma_deg_per_h])
    nearest = np.argmin(np.abs(frequency_Hz[:, None] - known_Hz), axis=1)
    sigma = np.array([*noise.sigma_deg_per_h.values()])[nearest]
    sigma = sigma * drawn_size(noise.degrees_of_freedom, random)
    spectrum = np.fft.rfft(random.standard_normal(count)) * sigma
    added = np.fft.irfft(spectrum, count)
    there = np.isfinite(segment.time_s)
    places = grid_index(segment.time_s[there], interval_s)
    rate = segment.rate_deg_per_h.copy()
    rate[there] += added[places]
    return replace(segment, field_mT=field_mT, rate_deg_per_h=rate)


def perturbed(
    lines: Sequence[Lines],
    at_device: FieldAtDevice | None = None,
) -> Mapping[str, Callable[[RlgDataset, float], RlgDataset]]:
    """Return what each input does to the data; how the field leans is linear."""
    changes: dict[str, Callable[[RlgDataset, float], RlgDataset]] = {
        "field_gain": partial(of_segments, change=partial(scaled, column="field_mT")),
        "field_time_offset_s": partial(of_segments, change=partial(shifted, column="field_time_s")),
        "probe_cosine": partial(of_segments, change=_field_cosine),
        "gyro_scale": partial(of_segments, change=_gyro_scale),
    }
    for own, axis in enumerate(AXES):
        changes[f"{UNDRIVEN}{axis}"] = partial(without_axis, own=own, lines=tuple(lines))
    for quantity in at_device.inputs if at_device is not None else ():
        changes[quantity.name] = partial(elsewhere, name=quantity.name)
    return changes


def of_segments(
    dataset: RlgDataset, deviation: float, *, change: Callable[[Segment, float], Segment]
) -> RlgDataset:
    """Return all records changed alike."""
    segments = tuple(change(segment, deviation) for segment in dataset.segments)
    return replace(dataset, segments=segments)


def elsewhere(dataset: RlgDataset, deviation: float, *, name: str) -> RlgDataset:
    """Return the records with the field at the gyro where coils, probe and gyro are elsewhere."""
    if dataset.at_device is None:
        return dataset
    matrix = dataset.at_device.deviating(name, deviation)

    def moved(segment: Segment, _: float) -> Segment:
        return replace(segment, field_mT=carried(segment.field_mT, matrix))

    return of_segments(dataset, deviation, change=moved)


def _field_cosine(segment: Segment, part: float) -> Segment:
    return replace(segment, field_mT=segment.field_mT / (1.0 + part))


def _gyro_scale(segment: Segment, scale: float) -> Segment:
    rate, quantum = segment.rate_deg_per_h, segment.quantum_deg_per_h
    factor = 1.0 + scale
    return replace(segment, rate_deg_per_h=rate * factor, quantum_deg_per_h=quantum * factor)


def without_axis(
    dataset: RlgDataset, sensitivity: float, *, own: int, lines: Sequence[Lines]
) -> RlgDataset:
    """Return the records without what an axis that is not driven makes of the field on it."""

    def without(segment: Segment, known: Lines) -> Segment:
        time_s = segment.time_s - segment.middle_s
        rate = segment.rate_deg_per_h.copy()
        for f, phasor_mT in known:
            field_mT = np.real(phasor_mT[own] * np.exp(2j * np.pi * f * time_s))
            rate -= sensitivity * averaging_factor(f, segment.sample_interval_s) * field_mT
        return replace(segment, rate_deg_per_h=rate)

    pairs = zip(dataset.segments, lines, strict=True)
    segments = tuple(without(segment, known) for segment, known in pairs)
    return replace(dataset, segments=segments)
