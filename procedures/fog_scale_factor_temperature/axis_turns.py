"""The turns of one axis, and what can be told of them before anything is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .dataset import Array, Index, Mask
from .turning import FULL_TURN_DEG, PPM, SECONDS_PER_HOUR

COVERED = 0.8
NEXT_SET = 1.6
SAME_TEMPERATURE_DEGC = 0.5
SAME_COMMAND_DEG = 90.0
"""Commands are those of the encoder in a run, and no two of them are quite the same."""


@dataclass(frozen=True)
class AxisTurns:
    """The turns of one axis that can be used at all, every array (n,); `error_deg` as measured."""

    axis: str
    rows: Index
    set_number: Index
    middle_s: Array
    duration_s: Array
    commanded_deg: Array
    error_deg: Array
    temperature_degC: Array
    usable: Mask

    @property
    def data_ppm(self) -> Array:
        """Turn errors in millionths of a turn."""
        return self.error_deg / FULL_TURN_DEG * PPM

    @property
    def turns(self) -> Array:
        """Commanded turns, signed."""
        return self.commanded_deg / FULL_TURN_DEG

    @property
    def sensing(self) -> Mask:
        """Whether a row is a turn; a wait tells the bias alone."""
        return np.asarray(np.abs(self.commanded_deg) > SAME_COMMAND_DEG)

    @property
    def by_bias_ppm(self) -> Array:
        """What a bias of 1 deg/h adds to `data_ppm`."""
        return self.duration_s / SECONDS_PER_HOUR / FULL_TURN_DEG * PPM

    @property
    def set_interval_s(self) -> float:
        """The usual time from a set to the next; the record's length where there is but one."""
        starts = np.array([self.middle_s[self.set_number == n].min() for n in self.sets()])
        steps = np.diff(np.sort(starts))
        steps = steps[steps > 0.0]
        return float(np.median(steps)) if len(steps) else float(max(np.ptp(self.middle_s), 1.0))

    def sets(self) -> Index:
        """Return the numbers of the sets, each once."""
        return np.unique(self.set_number)


def is_paired(turns: AxisTurns) -> bool:
    """Whether turns of another command, or waits, stand beside nearly every turn.

    Beside is within the same set or the next: only there can the bias be told from the scale
    factor however it changes with temperature.
    """
    sensing = turns.usable & turns.sensing
    if not bool(sensing.any()):
        return False
    within_s = NEXT_SET * turns.set_interval_s
    near = np.abs(np.subtract.outer(turns.middle_s, turns.middle_s)) <= within_s
    apart_deg = np.abs(np.subtract.outer(turns.commanded_deg, turns.commanded_deg))
    other = apart_deg > SAME_COMMAND_DEG
    covered = np.any(near & other & turns.usable[None, :], axis=1)
    return bool(covered[sensing].mean() >= COVERED)


def distinct_temperatures(temperature_degC: Array) -> int:
    """Return at how many temperatures there are turns, those within half a degree taken as one."""
    return len(np.unique(np.floor(temperature_degC / SAME_TEMPERATURE_DEGC)))
