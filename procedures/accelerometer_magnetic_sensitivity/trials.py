"""The analysis tried again: other noise of the output, and inputs that deviate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from station.findings import Trials

from .analysis import MOUNTING, analyse
from .dataset import AccelerometerAnalysis, AccelerometerDataset, Array
from .model import accelerations
from .nuisances import KO, KP, OFFSET
from .parameters import AnalysisSettings

Changes = Mapping[str, Callable[[AccelerometerDataset, float], AccelerometerDataset]]


def trials_of(
    analysis: AccelerometerAnalysis, dataset: AccelerometerDataset, settings: AnalysisSettings
) -> Trials:
    """Return how the analysis of a dataset is tried again."""
    own = next((e.value for e in analysis.estimates if e.name == "Ki"), None)
    ki = settings.scale_factor_V_per_g if own is None else own
    used, freedom = int(analysis.used.sum()), 1.0
    for estimate in analysis.estimates:
        freedom = estimate.degrees_of_freedom or freedom
    sigma_V = np.zeros(len(dataset))
    groups = np.zeros(len(dataset), int) if dataset.noise_group is None else dataset.noise_group
    for group in np.unique(groups):
        inside = groups == group
        left = analysis.residual_V[inside & analysis.used]
        if len(left):
            sigma_V[inside] = np.sqrt(np.mean(left**2) * used / freedom)
    return Trials(
        dataset,
        partial(analyse, settings=settings),
        partial(noisy, sigma_V=sigma_V, degrees_of_freedom=freedom),
        perturbed(ki),
    )


def noisy(
    dataset: AccelerometerDataset,
    random: np.random.Generator,
    *,
    sigma_V: Array,
    degrees_of_freedom: float,
) -> AccelerometerDataset:
    """Return the rows with more noise of the output, of the size that the fit leaves."""
    size = np.sqrt(degrees_of_freedom / random.chisquare(degrees_of_freedom))
    added_V = random.standard_normal(len(dataset)) * sigma_V * size
    return replace(dataset, output_V=dataset.output_V + added_V)


def perturbed(ki: float) -> Changes:
    """Return what each input does to the data, `ki` in V/g; the thermometer's is linear.

    The temperatures only say where the results hold: all shifted alike, they change no value.
    """
    return {
        "field_gain": _field_gain,
        "probe_cosine": _field_cosine,
        "field_offset_T": _field_offset,
        "ambient_field_T": _field_offset,
        "voltage_gain": _voltage_gain,
        "voltage_offset_V": _voltage_offset,
        "graduation_sine_rad": partial(_graduated, wave=np.sin),
        "graduation_cosine_rad": partial(_graduated, wave=np.cos),
        "local_gravity": _gravity,
        "stage_angle_rad": _turned,
        MOUNTING[OFFSET]: _turned,
        MOUNTING[KO]: partial(_leaning, ki=ki, towards=1),
        MOUNTING[KP]: partial(_leaning, ki=ki, towards=2),
    }


def _field_gain(dataset: AccelerometerDataset, gain: float) -> AccelerometerDataset:
    return replace(dataset, field_T=dataset.field_T * (1.0 + gain))


def _field_cosine(dataset: AccelerometerDataset, part: float) -> AccelerometerDataset:
    return replace(dataset, field_T=dataset.field_T / (1.0 + part))


def _field_offset(dataset: AccelerometerDataset, offset_T: float) -> AccelerometerDataset:
    return replace(dataset, field_T=dataset.field_T + offset_T)


def _voltage_gain(dataset: AccelerometerDataset, gain: float) -> AccelerometerDataset:
    return replace(dataset, output_V=dataset.output_V * (1.0 + gain))


def _voltage_offset(dataset: AccelerometerDataset, offset_V: float) -> AccelerometerDataset:
    return replace(dataset, output_V=dataset.output_V + offset_V)


def _gravity(dataset: AccelerometerDataset, deviation_g: float) -> AccelerometerDataset:
    return replace(dataset, gravity_g=dataset.gravity_g + deviation_g)


def _graduated(
    dataset: AccelerometerDataset, size_rad: float, *, wave: Callable[[Array], Array]
) -> AccelerometerDataset:
    """Return the rows with the stage's error once a turn taken off its angle."""
    error_rad = size_rad * wave(np.radians(dataset.theta_deg))
    return replace(dataset, theta_deg=dataset.theta_deg - np.degrees(error_rad))


def _turned(dataset: AccelerometerDataset, zero_rad: float) -> AccelerometerDataset:
    return replace(dataset, theta_deg=dataset.theta_deg - np.degrees(zero_rad))


def _leaning(
    dataset: AccelerometerDataset, lean_rad: float, *, ki: float, towards: int
) -> AccelerometerDataset:
    """Return the rows with what an input axis feels that leans towards another axis."""
    theta_rad = np.radians(dataset.theta_deg)
    across_g = accelerations(dataset.plane, theta_rad, dataset.gravity_g)[:, towards]
    return replace(dataset, output_V=dataset.output_V + ki * lean_rad * across_g)
