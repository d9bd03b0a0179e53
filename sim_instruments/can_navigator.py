"""The fibre-optic navigator on CAN, as `config/dbc/navigator.dbc` describes it.

The frames are packed here by hand, not by a DBC library, so that the message file is checked
against an independent reading of it.
"""

from __future__ import annotations

import struct
from typing import Any, ClassVar

from sim_instruments.instrument import Setting
from sim_instruments.navigator_model import (
    ALIGN,
    BAD_LENGTH,
    FIRMWARE_MAJOR,
    FIRMWARE_MINOR,
    HARDWARE_REVISION,
    IDENTIFY,
    LASTING_FAULTS,
    OK,
    PROTOCOL_VERSION,
    REPORT,
    START,
    STOP,
    UNKNOWN_COMMAND,
    NavigatorModel,
    Output,
)
from sim_instruments.socketcand import SocketcandServer, frame_text

COMMAND, ACK, STATUS, IDENTITY = 0x0A0, 0x0A1, 0x0A2, 0x0A3
HEADING, ROLL, TEMPERATURES = 0x0B0, 0x0B1, 0x0B2
ANGLE_STEPS, TEMPERATURE_STEPS = 1e4, 100.0  # per deg, per degC
LARGEST_TEMPERATURE = 32767
LONGEST_TOLD = 0xFFFF


class CanNavigator:
    """The navigator of the simulated world, where it has one, behind an interface on CAN.

    Truth (`simulator` mapping): `channel` of the bus; `resolution`, `latency` and `clock_error` of
    the navigator. An angle is sent in steps of 0.0001 deg, whatever finer resolution it has.
    """

    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        self._clock, self._world = setting.clock, setting.world
        self._model = NavigatorModel(setting, self._send_output)
        self._server = SocketcandServer(
            setting.name,
            setting.port,
            setting.truth.text("channel"),
            setting.clock,
            setting.world.lock,
            self._received,
            lambda: None,
            setting.faults,
        )
        self._server.begin()

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        return self._server.describe("FOG navigator", "navigator")

    def close(self) -> None:
        """Stop serving."""
        self._model.close()
        self._server.close()

    def _received(self, identifier: int, data: bytes) -> None:
        if identifier != COMMAND:
            return
        if len(data) != 8:
            self._acknowledge(data[0] if data else 0, BAD_LENGTH, 0)
            return
        command, rate, request, latitude = struct.unpack("<BBHi", data)
        if command == START:
            result = self._model.start(rate)
        elif command == STOP:
            result = self._model.stop()
        elif command == ALIGN:
            result = self._model.align(latitude * 1e-7)
        else:
            result = OK if command in (IDENTIFY, REPORT) else UNKNOWN_COMMAND
        self._acknowledge(command, result, request)
        if command == IDENTIFY:
            versions = (FIRMWARE_MAJOR, FIRMWARE_MINOR, HARDWARE_REVISION, PROTOCOL_VERSION)
            self._send(IDENTITY, struct.pack("<I4B", self._model.serial, *versions))
        elif command == REPORT:
            self._send_status()

    def _acknowledge(self, command: int, result: int, request: int) -> None:
        data = struct.pack("<BBHB3x", command, result, request, self._model.rate)
        self._send(ACK, data)

    def _send_status(self) -> None:
        model = self._model
        status, aligning = model.status(), min(round(10 * model.aligning_for_s()), LONGEST_TOLD)
        counter = model.counter & 0xFFFF
        data = struct.pack("<HHHBB", status, aligning, counter, model.rate, PROTOCOL_VERSION)
        self._send(STATUS, data)

    def _send_output(self, output: Output) -> None:
        now_s = self._clock.now()
        counter = struct.pack("<H", output.counter)
        heading, pitch, roll = (
            round(angle * ANGLE_STEPS).to_bytes(3, "little", signed=True)
            for angle in (output.heading_deg, output.pitch_deg, output.roll_deg)
        )
        steps = (round(one * TEMPERATURE_STEPS) for one in output.temperature_degC)
        warm = [max(-LARGEST_TEMPERATURE, min(one, LARGEST_TEMPERATURE)) for one in steps]
        frames = (
            (HEADING, counter + heading + pitch),
            (ROLL, counter + roll + struct.pack("<H", output.status)),
            (TEMPERATURES, counter + struct.pack("<3h", *warm)),
        )
        text = "".join(frame_text(identifier, now_s, data.hex()) for identifier, data in frames)
        self._server.send_frames(text, len(frames))

    def _send(self, identifier: int, data: bytes) -> None:
        self._server.send_frames(frame_text(identifier, self._clock.now(), data.hex()), 1)
