"""A recording that ends where a sensor or a pulse board says the same again and again."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from station.errors import InstrumentError
from station.method.run import Rates, Run
from station.method.verbs import Recording

from .gyro_source import GYRO, IMU

if TYPE_CHECKING:
    from numpy.typing import NDArray

FROZEN_AFTER_S = 2.0
"""Noise never gives three gyros and three accelerometers the same values for so long, all six."""
SAME_COUNT_S = 1800.0
"""No gyro counts the same in each sample for so long: the noise of the quietest at a weight of
0.4 arcsec, 0.0003 deg/sqrt(h), moves it by two pulses then, however slowly it turns."""
PULSES_MISSED, NO_PULSE_S = 100.0, 60.0
"""A count of zero ends it as soon as the earth's rate should have given so many pulses, not before
such a time."""
GYROS = tuple(f"gyro_{axis}_deg_per_s" for axis in "xyz")
ACCELEROMETERS = tuple(f"accelerometer_{axis}_g" for axis in "xyz")


class NeedsChanges(Recording):
    """Sampled sources of a unit of work; raises InstrumentError for one that is frozen.

    `earth_arcsec_per_s` is the part of the earth's rate that a gyro at rest on the pulse board
    feels, `pulse_arcsec` the weight of a pulse; without them a count of zero may last as others.
    """

    def __init__(
        self,
        run: Run,
        unit: str,
        rates: Rates,
        earth_arcsec_per_s: float = 0.0,
        pulse_arcsec: float = 0.0,
    ) -> None:
        super().__init__(run, unit, rates)
        self._last: NDArray[Any] | None = None
        self._count, self._same = 0, 0
        required = abs(earth_arcsec_per_s) / pulse_arcsec if pulse_arcsec else 0.0
        missed_s = PULSES_MISSED / required if required else SAME_COUNT_S
        self._no_pulse_s = min(max(missed_s, NO_PULSE_S), SAME_COUNT_S)

    def take(self) -> dict[str, NDArray[Any]]:
        """Record what has come."""
        came = super().take()
        if IMU in came:
            self._need_changes(came[IMU])
        if GYRO in came:
            self._need_pulses(came[GYRO])
        return came

    def _need_pulses(self, rows: NDArray[Any]) -> None:
        """Raise InstrumentError where the counts of new samples, after those before, stand."""
        from .frozen import IN_A_ROW, equal_runs

        counts = rows["counts"]
        starts, lengths = equal_runs(counts)
        for count, same in zip(counts[starts], lengths, strict=True):
            self._same = int(same) + self._same * bool(count == self._count)
            self._count = int(count)
            longest_s = SAME_COUNT_S if self._count else self._no_pulse_s
            if self._same > max(longest_s * (self.rates[GYRO] or 0.0), IN_A_ROW):
                raise InstrumentError(
                    GYRO,
                    f"record {self.unit}",
                    f"{self._same} samples in a row hold the same count, {self._count} pulses, "
                    "though their number goes on",
                    "look whether the gyro is on and its cable is in; switch the board off and on; "
                    "where it does so again have it looked at",
                )

    def _need_changes(self, rows: NDArray[Any]) -> None:
        """Raise InstrumentError where new outputs, after those before, repeat one set of values."""
        import numpy as np

        from .frozen import IN_A_ROW, equal_runs

        values = np.column_stack([rows[name] for name in (*GYROS, *ACCELEROMETERS)])
        if self._last is not None:
            values = np.concatenate((self._last, values))
        same = int(equal_runs(values)[1].max())
        frozen_after = max(math.ceil(FROZEN_AFTER_S * (self.rates[IMU] or 0.0)), IN_A_ROW)
        if same >= frozen_after:
            raise InstrumentError(
                IMU,
                f"record {self.unit}",
                f"{same} outputs in a row hold the same six rates and specific forces, though "
                "their counter goes on",
                "switch it off and on; where it does so again have it looked at",
            )
        self._last = values[-frozen_after:]
