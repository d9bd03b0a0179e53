"""What a driver of a nine-axis sensor does alike on RS-422 and on CAN."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.transport.streaming import StreamingDriver
from station.roles import Block, Place

AXES = ("x", "y", "z")
GYROS = tuple(f"gyro_{axis}_deg_per_s" for axis in AXES)
ACCELEROMETERS = tuple(f"accelerometer_{axis}_g" for axis in AXES)
MAGNETOMETERS = tuple(f"magnetometer_{axis}_nT" for axis in AXES)
COLUMNS: Mapping[str, str] = {
    "counter": "1, 16-bit number of the output",
    **{
        name: f"deg/s, mean rate about {axis} over the output's interval"
        for name, axis in zip(GYROS, AXES, strict=True)
    },
    **{
        name: f"g, mean specific force along {axis}, 1 g up at rest"
        for name, axis in zip(ACCELEROMETERS, AXES, strict=True)
    },
    **{
        name: f"nT, field along {axis}; NaN in an output that has none"
        for name, axis in zip(MAGNETOMETERS, AXES, strict=True)
    },
    "temperature_degC": "degC, of the sensor; NaN in an output that has none",
    "status": "1, bits of what is not valid: 0 1 2 gyro x y z, 4 5 6 accelerometer x y z",
}
ROW = np.dtype(
    [
        (name, np.uint16 if name in ("counter", "status") else np.float64)
        for name in (*COLUMNS, "arrival_s")
    ]
)
"""Columns and arrival of an output."""


class NineAxisSource(StreamingDriver):
    """The outputs of a sensor, and its temperature for interlocks."""

    source = "imu"
    whose = "sensor's"
    when_quiet = "check that the device under test is on, and its cable"

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self.columns: Mapping[str, str] = COLUMNS

    @abstractmethod
    def _take(self) -> NDArray[np.void]:
        """Return the outputs that came since the last call, of ROW."""

    @abstractmethod
    def _newest(self) -> NDArray[np.void]:
        """Return the last output that nobody has taken yet and keep it; shape (1,), or (0,)."""

    def drain(self) -> Block:
        """Return the outputs that came since the last call."""
        rows = self._take()
        self._heard(rows)
        return Block({name: rows[name] for name in COLUMNS}, rows["arrival_s"])

    def _look(self) -> None:
        self._heard(self._newest())

    def _begin(self, rate_Hz: float) -> None:
        """Take note that outputs begin, every so often by the sensor's clock."""
        self._begin_to_hear(1 / rate_Hz)
        self.columns = {**COLUMNS, "counter": f"{COLUMNS['counter']}, every {1 / rate_Hz:.9g} s"}

    def _heard(self, rows: NDArray[np.void]) -> None:
        """Take note of the newest outputs."""
        if not len(rows):
            return
        warm = rows["temperature_degC"]
        known_degC = warm[np.isfinite(warm)]
        newest_degC = float(known_degC[-1]) if len(known_degC) else None
        self._hear(float(rows["arrival_s"][-1]), newest_degC)
