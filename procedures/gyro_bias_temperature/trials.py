"""The analysis tried again: other noise of the output, and inputs that deviate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from procedures.common.perturbing import of_directions, scaled, shifted
from procedures.estimation.direction import LATITUDE
from procedures.estimation.linear import robust_sigma
from procedures.estimation.noise import grid_index
from procedures.estimation.rate_spectrum import in_time, noise_variances
from station.findings import Trials

from .analysis import TemperatureAnalysis, analyse
from .dataset import AnalysisSettings, Array, TemperatureDataset
from .solution import variance_of_mean

CLOCK, PULSE = "clock", "pulse_weight"


def trials_of(
    analysis: TemperatureAnalysis, dataset: TemperatureDataset, settings: AnalysisSettings
) -> Trials:
    """Return how the analysis of a dataset is tried again; the thermometer's offset is linear."""
    thetas = [None if axis.fit is None else axis.fit.theta for axis in analysis.axes]
    return Trials(
        dataset,
        partial(analyse, settings=settings),
        partial(noisy, thetas=thetas),
        {
            CLOCK: _clock,
            PULSE: partial(scaled, column="rate_deg_per_h"),
            LATITUDE: partial(shifted, column="latitude_rad"),
            **of_directions(dataset.directions),
        },
    )


def noisy(
    dataset: TemperatureDataset, random: np.random.Generator, *, thetas: Sequence[Array | None]
) -> TemperatureDataset:
    """Return the record with more noise, of the size that the fit of each axis leaves.

    Beside a gyro's own thermometer that of the chamber says how far the gyro lags; the noise of its
    readings is that of their second differences.
    """
    interval_s = dataset.sample_interval_s
    rate = dataset.rate_deg_per_h.copy()
    for column, theta in enumerate(thetas):
        if theta is not None:
            places = grid_index(dataset.time_s, interval_s)
            count = int(places[-1]) + 1
            sigma = np.sqrt(theta @ noise_variances(count, interval_s)[1:])
            added = in_time(sigma * random.standard_normal(count - 1), count)
            # The coefficients lack the mean.
            added += np.sqrt(variance_of_mean(theta, count * interval_s)) * random.standard_normal()
            rate[:, column] += added[places]
    chamber = dataset.chamber_degC
    if dataset.gyro_degC is not None:
        sigma_degC = robust_sigma(np.diff(chamber, 2)) / np.sqrt(6.0)
        chamber = chamber + sigma_degC * random.standard_normal(len(chamber))
    return replace(dataset, rate_deg_per_h=rate, chamber_degC=chamber)


def _clock(dataset: TemperatureDataset, slower: float) -> TemperatureDataset:
    """Return the record with longer intervals, in which as much was counted."""
    longer = 1.0 + slower
    return replace(
        dataset,
        rate_deg_per_h=dataset.rate_deg_per_h / longer,
        time_s=dataset.time_s * longer,
        sample_interval_s=dataset.sample_interval_s * longer,
    )
