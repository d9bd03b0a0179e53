"""The fibre-optic navigator on RS-422, in the frames that its driver's documentation lays out.

Sync 9A 65, kind, length of the payload, payload, CRC-32 as STIM300 has it; the most significant
byte comes first. Written from that layout alone, with a checksum of its own.
"""

from __future__ import annotations

import struct
from functools import partial
from typing import ClassVar

from sim_instruments.generic.navigator_model import (
    ALIGN,
    BAD_LENGTH,
    IDENTIFY,
    LASTING_FAULTS,
    REPORT,
    START,
    STOP,
    VERSIONS,
    NavigatorModel,
    Output,
)
from sim_instruments.instrument import Setting
from sim_instruments.wire.frames import CRC_BYTES, UNKNOWN, FrameInstrument, frames_in, with_crc

SYNC = bytes((0x9A, 0x65))
COMMAND, OUTPUT, ACK, STATUS, IDENTITY = 0x10, 0x90, 0x91, 0x92, 0x93
NAMES = {
    COMMAND: "command",
    OUTPUT: "output",
    ACK: "acknowledgement",
    STATUS: "status",
    IDENTITY: "identity",
}
COMMANDS = {START: "start", STOP: "stop", IDENTIFY: "identify", REPORT: "report", ALIGN: "align"}
HEAD_BYTES, COMMAND_BYTES = 4, 7
MAX_PAYLOAD = 32
ANGLE_STEPS = 1e7  # per deg


def frame_of(kind: int, payload: bytes) -> bytes:
    """Return a whole frame."""
    return with_crc(SYNC + bytes((kind, len(payload))) + payload)


def size_of(pending: bytes) -> int:
    """Return how long the frame is that begins here."""
    if len(pending) < HEAD_BYTES:
        return UNKNOWN
    # Waited for, a longer one would swallow what follows.
    return HEAD_BYTES + pending[3] + CRC_BYTES if pending[3] <= MAX_PAYLOAD else 0


def named(frame: bytes) -> list[tuple[str, bytes]]:
    """Return the payload of a frame with the name of its command, where it is one."""
    if frame[2] != COMMAND:
        return []
    payload = frame[HEAD_BYTES:]
    return [(f"{NAMES[COMMAND]} {COMMANDS.get(payload[0] if payload else 0, 'unknown')}", payload)]


class SerialNavigator(FrameInstrument):
    """The navigator of the simulated world, where it has one, behind an interface on RS-422.

    Truth (`simulator` mapping): `resolution`, `latency` and `clock_error` of the navigator.
    """

    model = "FOG navigator"
    kinds = NAMES
    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        self._model = NavigatorModel(setting, self._send_output)
        commands_in = partial(frames_in, sync=SYNC, size_of=size_of, named=named)
        self.begin_to_serve(setting, commands_in, self._model)

    def _received(self, payload: bytes) -> None:
        if len(payload) != COMMAND_BYTES:
            self._acknowledge(payload[0] if payload else 0, BAD_LENGTH, 0)
            return
        command, request, argument = struct.unpack(">BHi", payload)
        result = self._model.carry_out(command, argument, argument * 1e-7)
        self._acknowledge(command, result, request)
        if command == IDENTIFY:
            self._send(IDENTITY, struct.pack(">I4B", self._model.serial, *VERSIONS))
        elif command == REPORT:
            self._send(STATUS, struct.pack(">HHHB", *self._model.report()))

    def _acknowledge(self, command: int, result: int, request: int) -> None:
        self._send(ACK, struct.pack(">BBHB", command, result, request, self._model.rate))

    def _send_output(self, output: Output) -> None:
        heading, pitch, roll = (
            round(angle * ANGLE_STEPS)
            for angle in (output.heading_deg, output.pitch_deg, output.roll_deg)
        )
        warm = output.temperature_steps()
        self._send(
            OUTPUT,
            struct.pack(">HIii3hH", output.counter, heading, pitch, roll, *warm, output.status),
        )

    def _send(self, kind: int, payload: bytes) -> None:
        self._server.send(NAMES[kind], frame_of(kind, payload))
