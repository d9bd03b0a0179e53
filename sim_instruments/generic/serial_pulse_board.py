"""The laser-gyro pulse board on RS-422, in the datagrams that its driver's documentation lays out.

Outputs are those of a STIM300 with temperatures, 0x94 (TS1524): three values of 24 bits, status,
three temperatures of 16 bits, status, counter, latency, CRC-32 over three more zero bytes that are
not sent. Commands and answers, 0x60 to 0x63, are the board's own. Written from that layout alone,
with a checksum of its own.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from sim_instruments.generic.pulse_board_model import (
    BAD_LENGTH,
    CHANNELS,
    IDENTIFY,
    LASTING_FAULTS,
    NO_SENSOR,
    REPORT_STATUS,
    START,
    STOP,
    VERSIONS,
    PulseBoardModel,
    Rows,
)
from sim_instruments.instrument import Setting
from sim_instruments.truth import SimulationError
from sim_instruments.wire.frames import CRC_BYTES, FrameInstrument, frames_in, with_crc

COMMAND, OUTPUT, ACK, STATUS, IDENTITY = 0x60, 0x94, 0x61, 0x62, 0x63
NAMES = {OUTPUT: "output", ACK: "acknowledgement", STATUS: "status", IDENTITY: "identity"}
COMMANDS = {START: "start", STOP: "stop", IDENTIFY: "identify", REPORT_STATUS: "status"}
COMMAND_BYTES = 8
COUNTS_MODULUS = 1 << 24
TEMPERATURE_STEPS, LARGEST_TEMPERATURE = 256.0, 32767  # per degC
SHOWN_PER_DEGC = 100.0
ALL = (1 << CHANNELS) - 1
BATCH_S, MAX_LATENCY_S = 0.04, 0.02
LARGEST_LATENCY = 0xFFFF  # us


def datagram(kind: int, payload: bytes) -> bytes:
    """Return a whole datagram."""
    return with_crc(bytes((kind,)) + payload)


def named(frame: bytes) -> list[tuple[str, bytes]]:
    """Return the payload of a datagram with the name of its command."""
    return [(f"command {COMMANDS.get(frame[1], 'unknown')}", frame[1:])]


class SerialPulseBoard(FrameInstrument):
    """The board on a serial line.

    Truth (`simulator` mapping): `latency` from the end of an interval to its datagram, and that of
    the board, see `PulseBoardModel`.
    """

    model = "serial pulse board"
    kinds = MappingProxyType({COMMAND: "command", **NAMES})
    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        latency_s = setting.truth.quantity("latency", "s")
        if not 0.0 <= latency_s <= MAX_LATENCY_S:
            raise SimulationError(f"{setting.truth.where}.latency: 0 s to {MAX_LATENCY_S:g} s")
        self._clock = setting.clock
        self._board = PulseBoardModel(setting, self._outputs, latency_s, BATCH_S)
        size = 1 + COMMAND_BYTES + CRC_BYTES
        commands_in = partial(
            frames_in, sync=bytes((COMMAND,)), size_of=lambda _: size, named=named
        )
        self.begin_to_serve(setting, commands_in, self._board)

    def _received(self, payload: bytes) -> None:
        board = self._board
        if len(payload) != COMMAND_BYTES:
            self._acknowledge(payload[0] if payload else 0, board.refuse(BAD_LENGTH), 0)
            return
        command, mask, interval, request = struct.unpack(">BBIH", payload)
        self._acknowledge(command, board.carry_out(command, mask, interval), request)
        if command == IDENTIFY:
            self._send(IDENTITY, struct.pack(">I4B", board.serial, *VERSIONS))
        elif command == REPORT_STATUS:
            state = (int(board.running), board.error_bits, board.present, board.lit)
            self._send(STATUS, struct.pack(">I4B", board.samples & 0xFFFFFFFF, *state))

    def _acknowledge(self, command: int, result: int, request: int) -> None:
        self._send(ACK, struct.pack(">BBHI", command, result, request, self._board.interval))

    def _outputs(self, numbers: npt.NDArray[np.int64], rows: Rows) -> Callable[[], None]:
        """Return what sends the outputs."""
        board, now_s = self._board, self._clock.now()
        dark = ALL & ~(board.lit & board.mask)
        frames = []
        for number, (_, counts, warm) in zip(numbers.tolist(), rows.tolist(), strict=True):
            pulses, degC, missing = [0] * CHANNELS, [0] * CHANNELS, ALL
            for k in range(CHANNELS):
                if board.gyro_bit & board.mask & 1 << k and warm != NO_SENSOR:
                    steps = round(warm / SHOWN_PER_DEGC * TEMPERATURE_STEPS)
                    degC[k] = max(-LARGEST_TEMPERATURE, min(steps, LARGEST_TEMPERATURE))
                    pulses[k] = counts % COUNTS_MODULUS
                    missing &= ~(1 << k)
            values = b"".join(count.to_bytes(3, "big") for count in pulses)
            latency = min(round((now_s - board.time_s(number)) * 1e6), LARGEST_LATENCY)
            rest = struct.pack(">B3hBBH", dark, *degC, missing, number & 0xFF, latency)
            frames.append(datagram(OUTPUT, values + rest))
        return lambda: self._server.send_all(NAMES[OUTPUT], frames)

    def _send(self, kind: int, payload: bytes) -> None:
        self._server.send(NAMES[kind], datagram(kind, payload))
