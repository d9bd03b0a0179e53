"""Readings that say nothing of the device: a meter or a thermometer that stands still."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation.frozen import frozen, repeated_windows

from .dataset import Mask, TumbleDataset

MOVED_G = 0.01
"""By so much the acceleration changes before a reading that repeats is one of a dead meter."""


@dataclass(frozen=True)
class Screened:
    """The dataset without dead readings; `dead` (n,) are their rows in the whole one.

    `thermometer` is how many readings of it repeat; it is then left out.
    """

    dataset: TumbleDataset
    dead: Mask
    thermometer: int


def screen(dataset: TumbleDataset) -> Screened:
    """Return the readings that live."""
    turned = np.abs(np.diff(dataset.columns[:, 1])) > MOVED_G
    still = turned & (np.diff(dataset.output_V) == 0.0)
    dead = np.append(still, False) | np.append(False, still)
    dead |= repeated_windows([dataset.output_V])[0]
    stuck = 0
    if dataset.temperature_degC is not None:
        stuck = int(frozen(dataset.temperature_degC).sum())
        if stuck:
            dataset = replace(dataset, temperature_degC=None)
    return Screened(dataset.only(~dead), dead, stuck)
