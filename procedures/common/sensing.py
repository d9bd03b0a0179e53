"""A recording that ends where a nine-axis sensor says the same again and again."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from station.errors import InstrumentError
from station.method.run import Rates, Run
from station.method.verbs import Recording

from .gyro_source import IMU

if TYPE_CHECKING:
    from numpy.typing import NDArray

FROZEN_AFTER_S = 2.0
"""Noise never gives three gyros and three accelerometers the same values for so long, all six."""
FEWEST_ROWS = 10
GYROS = tuple(f"gyro_{axis}_deg_per_s" for axis in "xyz")
ACCELEROMETERS = tuple(f"accelerometer_{axis}_g" for axis in "xyz")


class NeedsChanges(Recording):
    """Sampled sources of a unit of work; raises InstrumentError for a sensor that is frozen."""

    def __init__(self, run: Run, unit: str, rates: Rates) -> None:
        super().__init__(run, unit, rates)
        self._last: NDArray[Any] | None = None

    def take(self) -> dict[str, NDArray[Any]]:
        """Record what has come."""
        came = super().take()
        if IMU in came:
            self._need_changes(came[IMU])
        return came

    def _need_changes(self, rows: NDArray[Any]) -> None:
        """Raise InstrumentError where new outputs, after those before, repeat one set of values."""
        import numpy as np

        values = np.column_stack([rows[name] for name in (*GYROS, *ACCELEROMETERS)])
        if self._last is not None:
            values = np.concatenate((self._last, values))
        new = np.flatnonzero((values[1:] != values[:-1]).any(axis=1)) + 1
        same = int(np.diff(np.concatenate(([0], new, [len(values)]))).max())
        frozen_after = max(math.ceil(FROZEN_AFTER_S * (self.rates[IMU] or 0.0)), FEWEST_ROWS)
        if same >= frozen_after:
            raise InstrumentError(
                IMU,
                f"record {self.unit}",
                f"{same} outputs in a row hold the same six rates and specific forces, though "
                "their counter goes on",
                "switch it off and on; where it does so again have it looked at",
            )
        self._last = values[-frozen_after:]
