"""What a gyro's source put out, as mean rates over intervals of run time.

A pulse board counts; a nine-axis sensor gives rates; a navigator gives attitudes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procedures.common.constants import SECONDS_PER_HOUR

from .alignment import Alignment, align, unwrapped
from .pulses import pulses_of

Array = NDArray[np.float64]
ARRIVAL = "arrival_time_s"
ATTITUDE = ("heading_deg", "pitch_deg", "roll_deg")
BODY = ("X", "Y", "Z")


@dataclass(frozen=True)
class Outputs:
    """Intervals that end at the source's counter `number` (n,), and the mean rates in them.

    `rate_deg_per_h` (n, axes) is infinite where the source calls it not valid. `clock` maps the
    counter to run time.
    """

    number: Array
    rate_deg_per_h: Array
    clock: Alignment

    def before_end_s(self, intervals: float) -> Array:
        """Return the run times so many intervals before the intervals' ends."""
        return self.clock.run_time_s(self.number - intervals)


def outputs_of(
    rows: NDArray[Any], interval_s: float, axes: Sequence[str], pulse_arcsec: float
) -> Outputs:
    """Return what the rows (n,) of one acquisition say; `pulse_arcsec` is what one count is worth.

    An interval whose count or attitude, or that before it, was lost is left out.
    """
    columns = rows.dtype.names or ()
    counts = "counts" in columns
    number = unwrapped(rows["sequence" if counts else "counter"])
    # One line for all: its slope is the source's clock against the station's.
    clock = align(number, rows[ARRIVAL], interval_s)
    if not counts and ATTITUDE[0] not in columns:
        return Outputs(number, sensor_rates(rows, axes), clock)
    if counts:
        turned_arcsec = (pulses_of(rows["counts"]) * pulse_arcsec)[:, None]
    else:
        turned_arcsec = attitude_steps(rows, axes)
    whole = np.diff(number) == 1
    return Outputs(number[1:][whole], turned_arcsec[whole] / interval_s, clock)


def sensor_rates(rows: NDArray[Any], axes: Sequence[str]) -> Array:
    """Return the sensor's rates along some axes in deg/h, (n, axes)."""
    rates = []
    for axis in axes:
        rate = rows[f"gyro_{axis.lower()}_deg_per_s"].astype(np.float64) * SECONDS_PER_HOUR
        valid = (rows["status"].astype(np.int64) >> BODY.index(axis)) & 1 == 0
        rates.append(np.where(valid, rate, np.inf))
    return np.column_stack(rates)


def attitude_steps(rows: NDArray[Any], axes: Sequence[str]) -> Array:
    """Return what a navigator turns in arcsec from row to row about some axes, (n - 1, axes)."""
    from scipy.spatial.transform import Rotation

    angles = np.column_stack([rows[name] for name in ATTITUDE])
    attitude = Rotation.from_euler("ZYX", angles, degrees=True)
    turned = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    own = [BODY.index(axis) for axis in axes]
    return np.asarray(np.degrees(turned[:, own]) * SECONDS_PER_HOUR)
