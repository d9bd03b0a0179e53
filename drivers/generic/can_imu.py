"""A nine-axis sensor on CAN, decoded by its message file `config/dbc/nine_axis.dbc`.

An output is four messages that bear the same counter and follow one another: `IMU_GYRO_XY`,
`IMU_GYRO_Z_ACC_X`, `IMU_ACC_YZ` and `IMU_FURTHER` (status, and by turns the temperature and the
magnetometers). Rates are in steps of 2^-14 deg/s, specific forces of 2^-19 g.

The sensor's interface has a supply of its own: it says who it is, and that the sensor behind it is
off, before the device under test is switched on.

Commands and their sources:
    IMU_COMMAND - start, stop, identify, report status - this project's message file,
        config/dbc/nine_axis.dbc - confirmed
    IMU_ACK, IMU_STATUS, IMU_IDENTITY - what became of a command, and what it asks for - this
        project's message file, config/dbc/nine_axis.dbc - confirmed
    IMU_GYRO_XY, IMU_GYRO_Z_ACC_X, IMU_ACC_YZ, IMU_FURTHER - an output - this project's message
        file, config/dbc/nine_axis.dbc - confirmed
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.generic.nine_axis import ACCELEROMETERS, GYROS, MAGNETOMETERS, ROW, NineAxisSource
from drivers.transport.can_messages import CanMessages, Parts
from drivers.transport.exchanges import Repeatable
from drivers.transport.streaming import Commands
from station.errors import InputError
from station.roles import Identity, Place, SensorStatus

ANSWERS: Mapping[str, str] = {
    "acknowledgement": "IMU_ACK",
    "status": "IMU_STATUS",
    "identity": "IMU_IDENTITY",
}
OUTPUT = ("IMU_GYRO_XY", "IMU_GYRO_Z_ACC_X", "IMU_ACC_YZ", "IMU_FURTHER")
"""The messages of an output, in the order in which they come."""
REFUSALS: Mapping[str, str] = {
    "unknown_command": "check that the sensor's firmware and this driver belong together",
    "bad_rate": "ask for 1 Hz to 200 Hz",
    "already_running": "see that nobody else uses the sensor, then start again",
    "bad_length": "check the line, then start again",
    "unit_off": "switch the device under test on, then start again",
}
WHEN_SILENT = "check the supply of the sensor's interface, the bus termination and the bit rate"
SLOWEST_HZ, FASTEST_HZ = 1.0, 200.0
RATE_STEP_HZ = 0.1
FAULTS: Mapping[int, str] = {
    **{bit: f"gyro {axis} not valid" for bit, axis in enumerate("xyz")},
    **{bit: f"accelerometer {axis} not valid" for bit, axis in enumerate("xyz", 4)},
    8: "switched off",
    9: "a gyro failed its own test",
}
FURTHER = ("temperature_degC", *MAGNETOMETERS)


class CanImu(NineAxisSource):
    """A sensor that outputs rates, specific forces and by turns field and temperature on a bus."""

    on_can = True
    repeatable: ClassVar[Repeatable] = Repeatable("stop", "identify", "status")
    """Not the start, which sets the counter back."""
    identifies_on: ClassVar[str] = "socketcand"
    """Where a scan of served instruments may ask `identify`; a bus gives no `*IDN?` to go by."""

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._line = CanMessages(place, "nine_axis", ANSWERS, OUTPUT)
        self._commands = Commands(place, self._line, self._send, REFUSALS, WHEN_SILENT)
        parts = enumerate(self._line.signals)
        self._places = {name: (k, names.index(name)) for k, names in parts for name in names}

    def identify(self) -> Identity:
        """Ask the interface for the sensor's identity."""
        return self._commands.identity("nine-axis sensor")

    @classmethod
    def rates_said(cls, rate_Hz: float) -> str:
        """Return in words which rates it has where this is none of them, else nothing."""
        steps = round(rate_Hz / RATE_STEP_HZ) * RATE_STEP_HZ
        if SLOWEST_HZ <= rate_Hz <= FASTEST_HZ and math.isclose(steps, rate_Hz):
            return ""
        return (
            f"it outputs {SLOWEST_HZ:g} Hz to {FASTEST_HZ:g} Hz in steps of {RATE_STEP_HZ:g} Hz, "
            f"not {rate_Hz:g} Hz"
        )

    def start(self, rate_Hz: float) -> None:
        """Begin to output, 1 Hz to 200 Hz in steps of 0.1 Hz, the counter from 1.

        Raises InputError for another rate, InstrumentError when the sensor is switched off.
        """
        if refusal := self.rates_said(rate_Hz):
            raise InputError(f"{self.place.name}: {refusal}; change the plan's sample_rate")
        self.stop()
        self._commands.start_at(rate_Hz, RATE_STEP_HZ, rate=rate_Hz)
        self._begin(rate_Hz)
        self._line.outputs()

    def stop(self) -> None:
        """End the output; what came before can still be drained."""
        self._streams = False
        self._commands.command("stop")

    def status(self) -> SensorStatus:
        """Ask what is wrong with it."""
        bits = int(self._commands.ask("status", "status", "asked for its status")["status"])
        wrong = [bit for bit in range(16) if bits >> bit & 1]
        return SensorStatus(tuple(FAULTS.get(bit, f"status bit {bit}") for bit in wrong))

    def _take(self) -> NDArray[np.void]:
        return self._rows(self._line.outputs())

    def _newest(self) -> NDArray[np.void]:
        newest = self._line.newest()
        return self._rows([] if newest is None else [newest])

    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        signals = {"command": command, "request_id": number, "rate": values.get("rate", 0.0)}
        self._line.send("IMU_COMMAND", signals)

    def _rows(self, outputs: Sequence[Parts]) -> NDArray[np.void]:
        """Return outputs of ROW."""
        rows = np.zeros(len(outputs), dtype=ROW)
        if not outputs:
            return rows
        parts = [
            np.array(values) for values in zip(*(each.values for each in outputs), strict=True)
        ]

        def signal(name: str) -> NDArray[np.float64]:
            part, place = self._places[name]
            return np.asarray(parts[part][:, place])

        for axis, gyro, force in zip("xyz", GYROS, ACCELEROMETERS, strict=True):
            rows[gyro], rows[force] = signal(f"gyro_{axis}"), signal(f"accelerometer_{axis}")
        which = signal("which")
        further = ("temperature", *(f"magnetometer_{axis}" for axis in "xyz"))
        for turn, (column, name) in enumerate(zip(FURTHER, further, strict=True)):
            rows[column] = np.where(which == turn, signal(name), np.nan)
        rows["counter"], rows["status"] = signal("counter"), signal("status")
        rows["arrival_s"] = [each.arrival_s for each in outputs]
        return rows
