"""The analysis tried again: other noise of the output, and inputs that deviate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from procedures.common.helmholtz import FieldAtDevice
from procedures.common.perturbing import drawn_size, scaled, shifted
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
        perturbed(ki, dataset.at_device),
    )


def noisy(
    dataset: AccelerometerDataset,
    random: np.random.Generator,
    *,
    sigma_V: Array,
    degrees_of_freedom: float,
) -> AccelerometerDataset:
    """Return the rows with more noise of the output, of the size that the fit leaves."""
    size = drawn_size(degrees_of_freedom, random)
    added_V = random.standard_normal(len(dataset)) * sigma_V * size
    return replace(dataset, output_V=dataset.output_V + added_V)


def perturbed(ki: float, at: FieldAtDevice | None = None) -> Changes:
    """Return what each input does to the data, `ki` in V/g; the thermometer's is linear.

    The temperatures only say where the results hold: all shifted alike, they change no value.
    """
    places = () if at is None else at.inputs
    return {
        **{place.name: partial(_elsewhere, name=place.name) for place in places},
        "field_gain": partial(scaled, column="field_T"),
        "probe_cosine": _field_cosine,
        "field_offset_T": partial(shifted, column="field_T"),
        "ambient_field_T": partial(shifted, column="field_T"),
        "voltage_gain": partial(scaled, column="output_V"),
        "voltage_offset_V": partial(shifted, column="output_V"),
        "graduation_sine_rad": partial(_graduated, wave=np.sin),
        "graduation_cosine_rad": partial(_graduated, wave=np.cos),
        "local_gravity": partial(shifted, column="gravity_g"),
        "stage_angle_rad": _turned,
        MOUNTING[OFFSET]: _turned,
        MOUNTING[KO]: partial(_leaning, ki=ki, towards=1),
        MOUNTING[KP]: partial(_leaning, ki=ki, towards=2),
    }


def _field_cosine(dataset: AccelerometerDataset, part: float) -> AccelerometerDataset:
    return replace(dataset, field_T=dataset.field_T / (1.0 + part))


def _elsewhere(
    dataset: AccelerometerDataset, deviation: float, *, name: str
) -> AccelerometerDataset:
    """Return the rows with the field at the device where coil, probe and device are elsewhere."""
    if dataset.at_device is None:
        return dataset
    share = float(dataset.at_device.deviating(name, deviation)[0, 0])
    return replace(dataset, field_T=dataset.field_T * share)


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
