"""What a driver of a nine-axis sensor does alike on RS-422 and on CAN."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.roles import Block, Place
from station.errors import InputError, InstrumentError

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

SHORTEST_SILENCE_S = 3.0
SILENT_INTERVALS = 3


class NineAxisSource(ABC):
    """The outputs of a sensor, and its temperature for interlocks."""

    source = "imu"

    def __init__(self, place: Place) -> None:
        self.place = place
        self.columns: Mapping[str, str] = COLUMNS
        self._running = False
        self._heard_s = 0.0
        self._silent_after_s = SHORTEST_SILENCE_S
        self._temperature_degC: float | None = None

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

    def read_quantity(self, quantity: str) -> float | None:
        """Return the sensor's `temperature`, degC; None while nothing is output.

        Outputs are looked at and left where they are, for whoever drains them. Raises
        InstrumentError when none has come for a while.
        """
        if quantity != "temperature":
            raise InputError(
                f"{self.place.name}: a nine-axis sensor is not asked for its {quantity}; take that "
                "interlock out of the bench file"
            )
        if not self._running:
            return None
        self._heard(self._newest())
        silent_s = self.place.clock.now() - self._heard_s
        if silent_s > self._silent_after_s:
            raise InstrumentError(
                self.place.name,
                "looked for the sensor's temperature",
                f"no output came for {silent_s:.3g} s",
                "check that the device under test is on, and its cable",
            )
        return self._temperature_degC

    def _begin(self, rate_Hz: float) -> None:
        """Take note that outputs begin, every so often by the sensor's clock."""
        self._silent_after_s = max(SHORTEST_SILENCE_S, SILENT_INTERVALS / rate_Hz)
        self._heard_s, self._temperature_degC = self.place.clock.now(), None
        self.columns = {**COLUMNS, "counter": f"{COLUMNS['counter']}, every {1 / rate_Hz:.9g} s"}
        self._running = True

    def _heard(self, rows: NDArray[np.void]) -> None:
        """Take note of the newest outputs."""
        if not len(rows):
            return
        self._heard_s = max(self._heard_s, float(rows["arrival_s"][-1]))
        warm = rows["temperature_degC"]
        told = warm[np.isfinite(warm)]
        if len(told):
            self._temperature_degC = float(told[-1])
            self.place.publish("temperature", self._temperature_degC, "degC")
