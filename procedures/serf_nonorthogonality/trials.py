"""The analysis tried again: other noise of the detector, and inputs that deviate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from procedures.common.perturbing import scaled
from station.findings import Trials

from .analysis import analyse
from .dataset import SerfAnalysis, SerfDataset, Shot
from .parameters import AnalysisSettings
from .shots import AXES


def trials_of(analysis: SerfAnalysis, dataset: SerfDataset, settings: AnalysisSettings) -> Trials:
    """Return how the analysis of all shots is tried again."""
    sigma_V = {shot.name: _rms(shot.residual_V) for shot in analysis.shots if shot.used}
    return Trials(
        dataset,
        partial(analyse, settings=settings),
        partial(noisy, sigma_V=[sigma_V.get(shot.name, 0.0) for shot in dataset.shots]),
        perturbed(),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def noisy(
    dataset: SerfDataset, random: np.random.Generator, *, sigma_V: Sequence[float]
) -> SerfDataset:
    """Return the shots with more noise, of the size that their fits leave."""
    shots = [
        replace(shot, voltage_V=shot.voltage_V + own * random.standard_normal(len(shot.time_s)))
        for shot, own in zip(dataset.shots, sigma_V, strict=True)
    ]
    return replace(dataset, shots=shots)


def perturbed() -> Mapping[str, Callable[[SerfDataset, float], SerfDataset]]:
    """Return what each input does to the data."""
    changes: dict[str, Callable[[SerfDataset, float], SerfDataset]] = {
        "sample_clock": _clock,
        "gyromagnetic_ratio": partial(scaled, column="gamma_Hz_per_nT"),
    }
    for k, axis in enumerate(AXES):
        changes[f"coil_{axis}"] = partial(_of_shots, change=partial(_coil, k=k))
        changes[f"residual_{axis}_nT"] = partial(_of_shots, change=partial(_residual, k=k))
    return changes


def _clock(dataset: SerfDataset, slower: float) -> SerfDataset:
    shots = [replace(shot, time_s=shot.time_s * (1.0 + slower)) for shot in dataset.shots]
    return replace(dataset, shots=shots, sample_rate_Hz=dataset.sample_rate_Hz / (1.0 + slower))


def _of_shots(
    dataset: SerfDataset, deviation: float, *, change: Callable[[Shot, float], Shot]
) -> SerfDataset:
    return replace(dataset, shots=[change(shot, deviation) for shot in dataset.shots])


def _coil(shot: Shot, part: float, *, k: int) -> Shot:
    """Return a shot whose coil makes more than its constant says."""
    field_nT = shot.field_nT.copy()
    field_nT[k] *= 1.0 + part
    return replace(shot, field_nT=field_nT)


def _residual(shot: Shot, residual_nT: float, *, k: int) -> Shot:
    """Return a shot whose spins precess as they would without a field along an axis."""
    field_nT = np.asarray(shot.field_nT, dtype=np.float64)
    there_nT = field_nT + residual_nT * np.eye(len(AXES))[k]
    faster = float(np.linalg.norm(there_nT) / np.linalg.norm(field_nT))
    return replace(shot, time_s=shot.time_s * faster)
