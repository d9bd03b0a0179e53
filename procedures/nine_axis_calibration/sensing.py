"""The sensor's output while something is measured: recorded whole, and looked at for its means."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from station.errors import InstrumentError

from .check import IMU
from .dataset import Array
from .parameters import NineAxisParameters

if TYPE_CHECKING:
    from station.runner.run import Run


LOOK_S = 2.0
"""Run time between two looks; less where time runs by itself, so that a kill loses little."""
SILENT_AFTER_S = 5.0
FROZEN_AFTER_S, FEWEST_FROZEN = 2.0, 10
"""Noise never gives three gyros and three accelerometers the same values for so long, all six."""
SECONDS_PER_HOUR = 3600.0
MOSTLY = 0.5
GYRO_BITS = {"gyro X": 0, "gyro Y": 1, "gyro Z": 2}
ACCELEROMETER_BITS = {"accelerometer X": 4, "accelerometer Y": 5, "accelerometer Z": 6}
"""Bits of an output's status that are set while a part is not valid."""
GYROS = tuple(f"gyro_{axis}_deg_per_s" for axis in "xyz")
ACCELEROMETERS = tuple(f"accelerometer_{axis}_g" for axis in "xyz")


class Sensing:
    """The sensor's stream for one unit of work; `stop` it when the unit is done."""

    def __init__(self, run: Run, unit: str) -> None:
        from station.roles import Imu

        self._run, self._unit = run, unit
        self._sensor = run.role(IMU, Imu)
        parameters: NineAxisParameters = run.parameters
        self._sensor.start(parameters.sample_rate_Hz)
        self._heard_s = run.clock.now()
        self._rows: list[NDArray[Any]] = []
        self._newest = np.empty((0, len(GYROS) + len(ACCELEROMETERS)))
        self._frozen_after = max(
            math.ceil(FROZEN_AFTER_S * parameters.sample_rate_Hz), FEWEST_FROZEN
        )

    def follow(self, until_s: float, said: str) -> None:
        """Record until a run time; raises InstrumentError for a sensor that is silent or frozen."""
        clock = self._run.clock
        while clock.now() < until_s:
            clock.sleep_until(min(clock.now() + clock.holding_s(LOOK_S), until_s))
            self.look()
            self._run.say_progress(said)

    def look(self) -> None:
        """Record what has come."""
        from station.runner.verbs import to_rows

        run, sensor = self._run, self._sensor
        rows = to_rows(sensor.drain())
        now_s = run.clock.now()
        if len(rows):
            run.record.block(sensor.source, self._unit, sensor.columns, rows)
            self._rows.append(rows)
            self._heard_s = now_s
            self._need_changes(rows)
        elif now_s - self._heard_s > SILENT_AFTER_S:
            raise self._silent(f"for {SILENT_AFTER_S:g} s")

    def _need_changes(self, rows: NDArray[Any]) -> None:
        """Raise InstrumentError where new outputs, after those before, repeat one set of values."""
        values = np.column_stack([rows[name] for name in (*GYROS, *ACCELEROMETERS)])
        values = np.concatenate((self._newest, values))
        same = longest_repeat(values)
        if same >= self._frozen_after:
            raise InstrumentError(
                IMU,
                f"record {self._unit}",
                f"{same} outputs in a row hold the same six rates and specific forces, though "
                "their counter goes on",
                "switch it off and on; where it does so again have it looked at",
            )
        self._newest = values[-self._frozen_after :]

    def means(self, from_s: float) -> tuple[Array, Array]:
        """Return the gyros' means in deg/h and the accelerometers' in g, (3,) each, since a time.

        NaN where nothing came.
        """
        from station.record.raw import ARRIVAL

        rows = [one[one[ARRIVAL] > from_s] for one in self._rows]
        if not any(len(one) for one in rows):
            return np.full(3, np.nan), np.full(3, np.nan)
        together = np.concatenate(rows)
        gyro = np.array([np.nanmean(together[name]) for name in GYROS])
        return gyro * SECONDS_PER_HOUR, np.array([np.nanmean(together[n]) for n in ACCELEROMETERS])

    def need_valid(self, from_s: float, parts: Mapping[str, int]) -> None:
        """Raise InstrumentError for a part, given with its status bit, that mostly is not valid.

        Of the outputs since a time. For parts that nothing drives beyond their range now.
        """
        from station.record.raw import ARRIVAL

        status = [one["status"][one[ARRIVAL] > from_s].astype(np.int64) for one in self._rows]
        if not any(len(one) for one in status):
            raise self._silent("during the whole record")
        for part, bit in parts.items():
            share = float(np.mean(np.concatenate(status) >> bit & 1))
            if share > MOSTLY:
                raise InstrumentError(
                    IMU,
                    f"record {self._unit}",
                    f"its outputs say that {part} is not valid, {share:.0%} of them, and nothing "
                    "drives it beyond its range",
                    "switch it off and on; where it says the same again have it looked at",
                )

    def _silent(self, when: str) -> InstrumentError:
        return InstrumentError(
            IMU,
            f"record {self._unit}",
            f"no output came {when}",
            "check its cable and its power",
        )

    def stop(self) -> None:
        """End the output and record the rest of it."""
        self._sensor.stop()
        self.look()


def longest_repeat(values: Array) -> int:
    """Return how many successive rows (n, columns) hold the same values at most; 0 for none."""
    changes = np.flatnonzero(np.any(values[1:] != values[:-1], axis=1)) + 1
    edges = np.concatenate(([0], changes, [len(values)]))
    return int(np.diff(edges).max())
