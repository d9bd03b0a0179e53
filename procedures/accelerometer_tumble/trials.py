"""The analysis tried again: other noise of the output, and inputs that deviate."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from procedures.common.perturbing import drawn_size, scaled, shifted
from station.findings import Trials

from .analysis import TumbleAnalysis, analyse
from .dataset import AnalysisSettings, TumbleDataset
from .solution import ENCODER, MOUNTING


def trials_of(
    analysis: TumbleAnalysis, dataset: TumbleDataset, settings: AnalysisSettings
) -> Trials:
    """Return how the analysis of a dataset is tried again; the thermometer's offset is linear."""
    solved = analysis.solution
    sigma_V, freedom = (solved.sigma_V, solved.freedom) if solved else (0.0, np.inf)
    changes = {
        "multimeter_gain": partial(scaled, column="output_V"),
        "multimeter_zero": partial(shifted, column="output_V"),
        "local_gravity": partial(shifted, column="gravity_g"),
    }
    drawn = {ENCODER: _harmonics, MOUNTING: _mountings}
    noise = partial(noisy, sigma_V=sigma_V, degrees_of_freedom=freedom)
    return Trials(dataset, partial(analyse, settings=settings), noise, changes, drawn)


def noisy(
    dataset: TumbleDataset,
    random: np.random.Generator,
    *,
    sigma_V: float,
    degrees_of_freedom: float,
) -> TumbleDataset:
    """Return the readings with more noise, of the size that the fit leaves."""
    size = sigma_V * drawn_size(degrees_of_freedom, random)
    added_V = random.standard_normal(len(dataset.output_V)) * size
    return replace(dataset, output_V=dataset.output_V + added_V)


def _harmonics(dataset: TumbleDataset, u: float, random: np.random.Generator) -> TumbleDataset:
    """Return the readings with other errors of the encoder, once and twice a turn."""
    alpha = dataset.encoder_rad
    waves = np.column_stack([wave(n * alpha) for n in (1.0, 2.0) for wave in (np.cos, np.sin)])
    off_rad = u * dataset.encoder_accuracy_rad * random.standard_normal(waves.shape[1])
    return replace(dataset, encoder_rad=alpha + waves @ off_rad)


def _mountings(dataset: TumbleDataset, u: float, random: np.random.Generator) -> TumbleDataset:
    """Return the readings with each mounting set down at another angle."""
    number = dataset.mounting
    off_rad = u * dataset.mounting_rad * random.standard_normal(int(number[-1]) + 1)
    return replace(dataset, encoder_rad=dataset.encoder_rad + off_rad[number])
