"""The laser-gyro pulse board on CAN, decoded by its message file `config/dbc/pulse_board.dbc`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import cantools
import numpy as np

from drivers.roles import Block, Identity, Place
from drivers.transport.can_line import CanLine, Frame
from drivers.transport.can_messages import message_file
from drivers.transport.retry import Repeatable
from station.errors import InputError, InstrumentError, InstrumentTimeout

ANSWER_WITHIN_S = 0.5
SHORTEST_SILENCE_S = 3.0
SILENT_INTERVALS = 3
NO_SENSOR_DEGC = -327.68
ENCODED_INTERVAL_PER_S = 1000.0
ACCEPTED = ("ok",)


COLUMNS: Mapping[str, str] = {
    "sequence": "1, the board's 16-bit number of the sample interval that ended",
    "counts": "1, pulses since the start, signed, cumulative",
    "temperature_degC": "degC, the gyro's temperature",
}


class CanPulseBoard:
    """A board that counts the pulses of up to three laser gyros against its own clock."""

    source = "gyro_acquisition"
    columns: Mapping[str, str] = COLUMNS
    repeatable: ClassVar[Repeatable] = Repeatable("stop", "identify", "status")
    """Not the start: counters would begin again at zero, or a board that runs refuse it."""
    identifies_on: ClassVar[str] = "socketcand"
    """Where a scan of served instruments may ask `identify`; a bus gives no `*IDN?` to go by."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self._messages = message_file("pulse_board")
        self._counts = self._messages.get_message_by_name("GYRO_COUNTS_1")
        self._requests = 0
        self._channel: int | None = None
        self._heard_s = 0.0
        self._silent_after_s = SHORTEST_SILENCE_S
        self._temperature_degC: float | None = None
        names = {one.frame_id: one.name for one in self._messages.messages}
        self._line = CanLine(place, names)

    def identify(self) -> Identity:
        """Ask for the board's identity frame."""
        self._command("identify")
        frame = self._answer("BOARD_IDENTITY", "asked who it is")
        told = self._decode(frame)
        firmware = f"{told['firmware_major']}.{told['firmware_minor']}"
        return Identity("house-made", "CAN pulse board", str(told["serial_number"]), firmware)

    def start(self, sample_interval_s: float, channel: int) -> None:
        """Begin to sample one channel; raises InstrumentError when the board sees no lit gyro."""
        self._command("stop")
        self._silent_after_s = max(SHORTEST_SILENCE_S, SILENT_INTERVALS * sample_interval_s)
        self._heard_s, self._temperature_degC = self.place.clock.now(), None
        self._channel = channel
        self._check_gyro(self._status(), "start")
        bit = 1 << (channel - 1)
        self._command("start", channel_mask=bit, sample_interval_s=sample_interval_s)
        self._counts = self._messages.get_message_by_name(f"GYRO_COUNTS_{channel}")
        interval = f"{COLUMNS['sequence']}, every {sample_interval_s:.9g} s"
        self.columns = {**COLUMNS, "sequence": interval}
        self.drain()

    def drain(self) -> Block:
        """Return the count frames that came since the last call."""
        frames = self._line.take(self._counts.frame_id)
        for frame in self._line.take(self._id("BOARD_STATUS")):
            self._check_gyro(self._decode(frame), "record")
        decoded = [self._decode(frame) for frame in frames]
        if decoded:
            self._heard(frames[-1], decoded[-1])
        return Block(
            {
                "sequence": np.array([one["sequence"] for one in decoded], dtype=np.uint16),
                "counts": np.array([one["counts"] for one in decoded], dtype=np.int32),
                "temperature_degC": np.array([one["temperature"] for one in decoded], dtype=float),
            },
            np.array([frame.arrival_s for frame in frames], dtype=float),
        )

    def read_quantity(self, quantity: str) -> float | None:
        """Return the gyro's `temperature` of the newest sample, degC; None where none can be.

        Samples are looked at and left where they are, for whoever drains them. Raises
        InstrumentError when the board samples and none has come for a while, or none has one.
        """
        if quantity != "temperature":
            raise InputError(
                f"{self.place.name}: this board does not measure its {quantity}; take that "
                "interlock out of the bench file"
            )
        if self._channel is None:
            return None
        newest = self._line.newest(self._counts.frame_id)
        if newest is not None:
            self._heard(newest, self._decode(newest))
        silent_s = self.place.clock.now() - self._heard_s
        attempted = "looked for the gyro's temperature"
        if silent_s > self._silent_after_s:
            raise InstrumentError(
                self.place.name,
                attempted,
                f"no sample came for {silent_s:.3g} s",
                "check the board's power, the bus and that the device under test is on",
            )
        if self._temperature_degC is not None and math.isnan(self._temperature_degC):
            raise InstrumentError(
                self.place.name,
                attempted,
                "the samples say that there is no sensor",
                "check the sensor's cable, or take that interlock out of the bench file",
            )
        return self._temperature_degC

    def stop(self) -> None:
        """End the sampling."""
        self._channel = None
        self._command("stop")

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _heard(self, frame: Frame, told: Mapping[str, Any]) -> None:
        """Take note of the newest sample."""
        temperature_degC = float(told["temperature"])
        self._heard_s = max(self._heard_s, frame.arrival_s)
        if temperature_degC <= NO_SENSOR_DEGC + 0.005:
            self._temperature_degC = math.nan
            return
        self._temperature_degC = temperature_degC
        self.place.publish("temperature", temperature_degC, "degC")

    def _check_gyro(self, status: dict[str, Any], attempted: str) -> None:
        """Raise InstrumentError when the board sees no lit gyro on the channel in use."""
        if self._channel is None:
            return
        bit = 1 << (self._channel - 1)
        if not int(status["gyro_present"]) & bit or not int(status["laser_on"]) & bit:
            raise InstrumentError(
                self.place.name,
                f"{attempted} channel {self._channel}",
                "the board sees no lit gyro there",
                "check the gyro's cable and power, and the plan's channel",
            )

    def _status(self) -> dict[str, Any]:
        self._line.take(self._id("BOARD_STATUS"))
        self._command("status")
        return self._decode(self._answer("BOARD_STATUS", "asked for its status"))

    def _command(
        self, command: str, *, channel_mask: int = 0, sample_interval_s: float = 0.001
    ) -> None:
        """Send a command and take its acknowledgement; a refusal is InstrumentError."""
        self._requests = (self._requests + 1) % 65536
        message = self._messages.get_message_by_name("BOARD_COMMAND")
        data = message.encode(
            {
                "command": command,
                "channel_mask": channel_mask,
                "sample_interval": sample_interval_s * ENCODED_INTERVAL_PER_S,
                "request_id": self._requests,
            }
        )
        attempted = f"sent the command {command}"
        self._line.send(message.frame_id, data)
        told = self._acknowledgement(attempted)
        if str(told["result"]) not in ACCEPTED:
            raise InstrumentError(
                self.place.name,
                attempted,
                f"it refused with {told['result']}",
                "compare the plan's sample interval and channel with the board's ranges",
            )

    def _acknowledgement(self, attempted: str) -> dict[str, Any]:
        """Return the acknowledgement of the last request; a late one of another is passed over."""
        deadline_s = self._deadline_s()
        while frames := self._line.wait_for(self._id("BOARD_ACK"), deadline_s):
            for told in map(self._decode, frames):
                if told["request_id"] == self._requests:
                    return told
        raise self._silent("BOARD_ACK", attempted)

    def _answer(self, name: str, attempted: str) -> Frame:
        frames = self._line.wait_for(self._id(name), self._deadline_s())
        if not frames:
            raise self._silent(name, attempted)
        return frames[-1]

    def _deadline_s(self) -> float:
        clock = self.place.clock
        return clock.now() + clock.patience_s(ANSWER_WITHIN_S)

    def _silent(self, name: str, attempted: str) -> InstrumentTimeout:
        return InstrumentTimeout(
            self.place.name,
            attempted,
            f"no {name} frame came within {ANSWER_WITHIN_S:g} s",
            "check the board's power, the bus termination and the bit rate",
        )

    def _id(self, name: str) -> int:
        return int(self._messages.get_message_by_name(name).frame_id)

    def _decode(self, frame: Frame) -> dict[str, Any]:
        try:
            decoded: dict[str, Any] = self._messages.decode_message(frame.identifier, frame.data)
        except cantools.database.DecodeError as error:
            raise InstrumentError(
                self.place.name,
                "read a frame",
                f"{frame.identifier:03X}#{frame.data.hex().upper()} is none of its messages",
                "check that the board's firmware and config/dbc/pulse_board.dbc belong together",
            ) from error
        return decoded
