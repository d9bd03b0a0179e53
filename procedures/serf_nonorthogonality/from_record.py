"""From a run's raw rows to the dataset: the last attempt of each finished shot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from procedures.serf_nonorthogonality.cell import DIGITIZER

if TYPE_CHECKING:
    from station.record.folder import RunFolder

Array = NDArray[np.float64]


def shot_of_unit(folder: RunFolder, unit: str) -> tuple[Array, Array]:
    """Return time (s, zero where the field comes) and voltage of a shot, (samples,) each.

    A shot that was taken again holds several records, each beginning before the trigger: only the
    last one counts.
    """
    rows = folder.rows(DIGITIZER, unit)
    starts = np.flatnonzero(np.diff(rows["time_s"]) < 0) + 1
    last = rows[starts[-1] :] if len(starts) else rows
    finished = folder.finished_units().get(unit, {})
    time_s = last["time_s"] - float(finished.get("delay_s", 0.0))
    after = time_s > 0.0
    return np.asarray(time_s[after]), np.asarray(last["voltage_V"][after])
