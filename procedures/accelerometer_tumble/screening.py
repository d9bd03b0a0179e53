"""Readings that say nothing of the device: a meter that stands still or is cut off, a thermometer
that does, or that is wild."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from procedures.estimation import channel
from procedures.estimation.frozen import repeated_windows
from procedures.estimation.saturation import at_a_limit
from station.findings import Flag

from .dataset import Mask, TumbleDataset

MOVED_G = 0.01
"""By so much the acceleration changes before a reading that repeats is one of a dead meter."""
THERMOMETER = channel.Channel(
    "the temperature",
    "the thermometer",
    "degC",
    low=-80.0,
    high=150.0,
    harmless=0.5,
    slow=True,
    then="There are no temperature terms.",
)


@dataclass(frozen=True)
class Screened:
    """The dataset without dead readings; `dead` (n,) are their rows in the whole one.

    `limited` (n,) are the readings at a limit of the meter, left out, too. `warm_flags` say what
    was wrong with the thermometer.
    """

    dataset: TumbleDataset
    dead: Mask
    limited: Mask
    warm_flags: tuple[Flag, ...]


def screen(dataset: TumbleDataset) -> Screened:
    """Return the readings that live."""
    limited = at_a_limit(dataset.output_V)
    turned = np.abs(np.diff(dataset.columns[:, 1])) > MOVED_G
    still = turned & (np.diff(dataset.output_V) == 0.0) & ~limited[1:]
    dead = np.append(still, False) | np.append(False, still)
    dead |= repeated_windows([dataset.output_V])[0] & ~limited
    flags: list[Flag] = []
    if dataset.temperature_degC is not None:
        handled = np.append(False, np.diff(dataset.mounting) != 0)
        warm = channel.screen(THERMOMETER, dataset.temperature_degC, free=handled)
        if not warm.good.all():
            flags = channel.flags([warm])
            dataset = replace(dataset, temperature_degC=None)
    return Screened(dataset.only(~dead & ~limited), dead & ~limited, limited, tuple(flags))
