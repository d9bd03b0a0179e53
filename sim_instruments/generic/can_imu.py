"""The nine-axis sensor on CAN, as `config/dbc/nine_axis.dbc` describes it.

The frames are packed here by hand, not by a DBC library, so that the message file is checked
against an independent reading of it. The interface has a supply of its own.
"""

from __future__ import annotations

import struct
from typing import Any, ClassVar

import numpy as np

from sim_instruments.generic.nine_axis_model import LASTING_FAULTS, Counters, NineAxisModel
from sim_instruments.instrument import Setting
from sim_instruments.wire.socketcand import CanInstrument
from sim_instruments.world.nine_axis_sensor import Means

COMMAND, ACK, STATUS, IDENTITY = 0x0C0, 0x0C1, 0x0C2, 0x0C3
PARTS = (0x0D0, 0x0D1, 0x0D2, 0x0D3)
START, STOP, IDENTIFY, REPORT = 1, 2, 3, 4
OK, UNKNOWN_COMMAND, BAD_RATE, ALREADY_RUNNING, BAD_LENGTH, UNIT_OFF = range(6)
OFF_BIT, GYRO_FAILED = 1 << 8, 1 << 9
SLOWEST, FASTEST = 10, 2000  # outputs per second in units of 0.1 Hz
PROTOCOL_VERSION = 1
VERSIONS = (1, 0, 1, PROTOCOL_VERSION)
"""Firmware major and minor, hardware, protocol."""
GYRO_STEPS, FORCE_STEPS = 2**14, 2**19  # per deg/s, per g
TEMPERATURE_STEPS = 100  # per degC
LARGEST = 2**23 - 1
GYRO_BITS = np.array([1, 2, 4])


class CanImu(CanInstrument):
    """The sensor of the simulated world, where it has one, behind an interface on CAN.

    Truth (`simulator` mapping): `channel` of the bus; `latency` and `clock_error` of the sensor.
    """

    model = "nine-axis sensor"
    dbc = "nine_axis"
    messages = (COMMAND, ACK, STATUS, IDENTITY, *PARTS)
    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        self._serial = setting.serial_number("the sensor's")
        self._model = NineAxisModel(setting, self._frames, self._send_outputs)
        self._status = 0
        self.begin_to_serve(setting, self._model)

    def _received(self, identifier: int, data: bytes) -> None:
        if identifier != COMMAND:
            return
        if len(data) != 6:
            self._acknowledge(data[0] if data else 0, BAD_LENGTH, 0)
            return
        command, request, rate = struct.unpack("<BxHH", data)
        result = OK if command in (STOP, IDENTIFY, REPORT) else UNKNOWN_COMMAND
        if command == START:
            result = self._start(rate)
        elif command == STOP:
            self._model.stop()
        self._acknowledge(command, result, request)
        if command == IDENTIFY:
            self._send(IDENTITY, struct.pack("<I4B", self._serial, *VERSIONS))
        elif command == REPORT:
            counter = self._model.counter & 0xFFFF
            state = (self._bits(), counter, self._rate(), PROTOCOL_VERSION)
            self._send(STATUS, struct.pack("<HHHxB", *state))

    def _start(self, rate: int) -> int:
        if not self._model.powered:
            return UNIT_OFF
        if self._model.rate_Hz:
            return ALREADY_RUNNING
        if not SLOWEST <= rate <= FASTEST:
            return BAD_RATE
        self._model.start(rate / 10.0)
        return OK

    def _rate(self) -> int:
        return round(10.0 * self._model.rate_Hz)

    def _bits(self) -> int:
        if not self._model.powered:
            return OFF_BIT
        return self._status | (GYRO_FAILED if self._model.gyro_failed else 0)

    def _acknowledge(self, command: int, result: int, request: int) -> None:
        self._send(ACK, struct.pack("<BBHH", command, result, request, self._rate()))

    def _frames(self, counters: Counters, means: Means) -> list[tuple[str, ...]]:
        """Return the data of the messages of outputs, in hexadecimal."""
        gyro = np.round(means.gyro_deg_per_s * GYRO_STEPS)
        force = np.round(means.accelerometer_g * FORCE_STEPS)
        warm = np.round(means.temperature_degC * TEMPERATURE_STEPS)
        further = np.column_stack((warm, np.round(means.magnetometer_nT)))
        wide = np.column_stack((gyro, force, further)).clip(-LARGEST, LARGEST).astype(np.int64)
        status = (~means.valid) @ GYRO_BITS
        return [
            self._output(int(counter), row, int(bits))
            for counter, row, bits in zip(counters, wide.tolist(), status, strict=True)
        ]

    def _output(self, counter: int, row: list[int], bits: int) -> tuple[str, ...]:
        number = struct.pack("<H", counter & 0xFFFF)
        wide = [value.to_bytes(3, "little", signed=True) for value in row]
        turn = counter % 4
        return (
            (number + wide[0] + wide[1]).hex(),
            (number + wide[2] + wide[3]).hex(),
            (number + wide[4] + wide[5]).hex(),
            (number + struct.pack("<HB", bits, turn) + wide[6 + turn]).hex(),
        )

    def _send_outputs(self, outputs: Any) -> None:
        if outputs:
            self._status = int.from_bytes(bytes.fromhex(outputs[-1][-1])[2:4], "little")
        self._send_all(
            (identifier, data)
            for output in outputs
            for identifier, data in zip(PARTS, output, strict=True)
        )
