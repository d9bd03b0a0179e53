"""The fibre-optic navigator on CAN, as `config/dbc/navigator.dbc` describes it.

The frames are packed here by hand, not by a DBC library, so that the message file is checked
against an independent reading of it.
"""

from __future__ import annotations

import struct
from typing import ClassVar

from sim_instruments.generic.navigator_model import (
    BAD_LENGTH,
    IDENTIFY,
    LASTING_FAULTS,
    PROTOCOL_VERSION,
    REPORT,
    VERSIONS,
    NavigatorModel,
    Output,
)
from sim_instruments.instrument import Setting
from sim_instruments.wire.socketcand import CanInstrument

COMMAND, ACK, STATUS, IDENTITY = 0x0A0, 0x0A1, 0x0A2, 0x0A3
HEADING, ROLL, TEMPERATURES = 0x0B0, 0x0B1, 0x0B2
ANGLE_STEPS = 1e4  # per deg


class CanNavigator(CanInstrument):
    """The navigator of the simulated world, where it has one, behind an interface on CAN.

    Truth (`simulator` mapping): `channel` of the bus; `resolution`, `latency` and `clock_error` of
    the navigator. An angle is sent in steps of 0.0001 deg, whatever finer resolution it has.
    """

    model = "FOG navigator"
    dbc = "navigator"
    messages = (COMMAND, ACK, STATUS, IDENTITY, HEADING, ROLL, TEMPERATURES)
    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        self._model = NavigatorModel(setting, self._send_output)
        self.begin_to_serve(setting, self._model)

    def _received(self, identifier: int, data: bytes) -> None:
        if identifier != COMMAND:
            return
        if len(data) != 8:
            self._acknowledge(data[0] if data else 0, BAD_LENGTH, 0)
            return
        command, rate, request, latitude = struct.unpack("<BBHi", data)
        result = self._model.carry_out(command, rate, latitude * 1e-7)
        self._acknowledge(command, result, request)
        if command == IDENTIFY:
            self._send(IDENTITY, struct.pack("<I4B", self._model.serial, *VERSIONS))
        elif command == REPORT:
            state = self._model.report()
            self._send(STATUS, struct.pack("<HHHBB", *state, PROTOCOL_VERSION))

    def _acknowledge(self, command: int, result: int, request: int) -> None:
        data = struct.pack("<BBHB3x", command, result, request, self._model.rate)
        self._send(ACK, data)

    def _send_output(self, output: Output) -> None:
        counter = struct.pack("<H", output.counter)
        heading, pitch, roll = (
            round(angle * ANGLE_STEPS).to_bytes(3, "little", signed=True)
            for angle in (output.heading_deg, output.pitch_deg, output.roll_deg)
        )
        frames = (
            (HEADING, counter + heading + pitch),
            (ROLL, counter + roll + struct.pack("<H", output.status)),
            (TEMPERATURES, counter + struct.pack("<3h", *output.temperature_steps())),
        )
        self._send_all((identifier, data.hex()) for identifier, data in frames)
