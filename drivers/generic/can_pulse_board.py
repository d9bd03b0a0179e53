"""The laser-gyro pulse board on CAN, decoded by its message file `config/dbc/pulse_board.dbc`.

Commands and their sources:
    BOARD_COMMAND - start, stop, identify, report status - this project's message file,
        config/dbc/pulse_board.dbc - confirmed
    BOARD_ACK, BOARD_STATUS, BOARD_IDENTITY - what became of a command, and what it asks for - this
        project's message file, config/dbc/pulse_board.dbc - confirmed
    GYRO_COUNTS_1, GYRO_COUNTS_2, GYRO_COUNTS_3 - the counts of a channel - this project's message
        file, config/dbc/pulse_board.dbc - confirmed
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from drivers.generic.pulse_board import PulseBoard, Sample
from drivers.transport.can_messages import CanMessages, Parts
from station.roles import Place

NO_SENSOR_DEGC = -327.68
ENCODED_INTERVAL_PER_S = 1000.0
ANSWERS: Mapping[str, str] = {
    "acknowledgement": "BOARD_ACK",
    "status": "BOARD_STATUS",
    "identity": "BOARD_IDENTITY",
}
SHORTEST_INTERVAL_S = 0.001
"""What a command holds that has no interval; the message file knows none below."""


class CanPulseBoard(PulseBoard):
    """A board that counts the pulses of up to three laser gyros, on a CAN bus."""

    model = "CAN pulse board"
    identifies_on: ClassVar[str] = "socketcand"
    """Where a scan of served instruments may ask `identify`; a bus gives no `*IDN?` to go by."""

    def __init__(self, place: Place) -> None:
        self._line = CanMessages(place, "pulse_board", ANSWERS, ())
        self._counts = "GYRO_COUNTS_1"
        super().__init__(place, self._line)

    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        interval_s = values.get("sample_interval_s", SHORTEST_INTERVAL_S)
        signals = {
            "command": command,
            "channel_mask": int(values.get("channel_mask", 0)),
            "sample_interval": interval_s * ENCODED_INTERVAL_PER_S,
            "request_id": number,
        }
        self._line.send("BOARD_COMMAND", signals)

    def _begin(self, channel: int, sample_interval_s: float) -> None:
        self._counts = f"GYRO_COUNTS_{channel}"
        self._line.take_single(self._counts)

    def _samples(self) -> Sequence[Sample]:
        return [sample(parts) for parts in self._line.take_single(self._counts)]

    def _newest(self) -> Sample | None:
        newest = self._line.newest_single(self._counts)
        return None if newest is None else sample(newest)


def sample(parts: Parts) -> Sample:
    """Return a sample in its units."""
    ((sequence, counts, temperature_degC),) = parts.values
    if temperature_degC <= NO_SENSOR_DEGC + 0.005:
        temperature_degC = math.nan
    return Sample(int(sequence), int(counts), temperature_degC, True, parts.arrival_s)
