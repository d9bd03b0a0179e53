"""The laser-gyro pulse board on CAN, as `config/dbc/pulse_board.dbc` describes it.

The frames are packed here by hand, not by a DBC library, so that the message file is checked
against an independent reading of it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from sim_instruments.generic.pulse_board_model import (
    BAD_LENGTH,
    CHANNELS,
    IDENTIFY,
    LASTING_FAULTS,
    NO_SENSOR,
    PROTOCOL_VERSION,
    REPORT_STATUS,
    VERSIONS,
    PulseBoardModel,
    Rows,
)
from sim_instruments.instrument import Setting
from sim_instruments.wire.socketcand import CanInstrument, frame_text

COMMAND, ACK, STATUS, IDENTITY, FIRST_COUNTS = 0x100, 0x101, 0x110, 0x111, 0x121
STATUS_PERIOD_S = 1.0
HEX_DIGITS = 16


class CanPulseBoard(CanInstrument):
    """The board on a bus.

    Truth (`simulator` mapping): `channel` of the bus, and that of the board, see `PulseBoardModel`.
    """

    model = "CAN pulse board"
    dbc = "pulse_board"
    messages = (COMMAND, ACK, STATUS, IDENTITY, *(FIRST_COUNTS + k for k in range(CHANNELS)))
    lasting_faults: ClassVar = LASTING_FAULTS

    def __init__(self, setting: Setting) -> None:
        self._world = setting.world
        self._board = PulseBoardModel(setting, self._samples)
        self._reporting = False
        self.begin_to_serve(setting, self._board)

    def _received(self, identifier: int, data: bytes) -> None:
        if identifier != COMMAND:
            return
        if len(data) != 8:
            self._acknowledge(data[0] if data else 0, self._board.refuse(BAD_LENGTH), 0)
            return
        command, mask, interval, request = struct.unpack("<BBIH", data)
        self._acknowledge(command, self._board.carry_out(command, mask, interval), request)
        if command == IDENTIFY:
            self._send(IDENTITY, struct.pack("<I4B", self._board.serial, *VERSIONS))
        elif command == REPORT_STATUS:
            self._send_status()

    def _acknowledge(self, command: int, result: int, request: int) -> None:
        self._send(ACK, struct.pack("<BBHI", command, result, request, self._board.interval))

    def _samples(self, numbers: npt.NDArray[np.int64], rows: Rows) -> Callable[[], None]:
        text = rows.tobytes().hex()
        parts = []
        channels = [k for k in range(CHANNELS) if self._board.mask >> k & 1]
        for k, n in enumerate(numbers.tolist()):
            time_s = self._board.time_s(n)
            for channel in channels:
                if self._board.gyro_bit >> channel & 1:
                    shown = text[k * HEX_DIGITS : (k + 1) * HEX_DIGITS]
                else:
                    shown = struct.pack("<Hih", n & 0xFFFF, 0, NO_SENSOR).hex()
                parts.append(frame_text(FIRST_COUNTS + channel, time_s, shown))
        return lambda: self._server.send_frames("".join(parts), len(parts))

    def _joined(self) -> None:
        # Not before: with a thread asleep and nobody else there, virtual time would run away.
        with self._world.lock:
            if not self._reporting:
                self._reporting = True
                self._board.begin_to_report(STATUS_PERIOD_S, self._send_status)

    def _send_status(self) -> None:
        board = self._board
        flags = int(board.running) | (board.mask << 4 if board.running else 0)
        lamps = board.present | board.lit << 4
        state = (flags, board.error_bits, lamps, PROTOCOL_VERSION)
        self._send(STATUS, struct.pack("<I4B", board.samples & 0xFFFFFFFF, *state))
