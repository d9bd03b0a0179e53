"""What a driver of a laser-gyro pulse board does alike on CAN and on RS-422."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from drivers.transport.exchanges import Repeatable
from drivers.transport.streaming import AnswerLine, Commands, StreamingDriver
from station.errors import InstrumentError
from station.roles import Block, Identity, Place

NO_SUCH_PARAMETERS = "compare the plan's sample interval and channel with the board's ranges"
REFUSALS: Mapping[str, str] = {
    "unknown_command": NO_SUCH_PARAMETERS,
    "already_running": "see that nobody else uses the board, then start again",
    "bad_length": "check the line, then start again",
}
WHEN_SILENT = "check the board's power, its cable or the bus termination, and the bit rate"
COLUMNS: Mapping[str, str] = {
    "sequence": "1, the board's 16-bit number of the sample interval that ended",
    "counts": "1, pulses since the start, signed, cumulative",
    "temperature_degC": "degC, the gyro's temperature",
}


class Sample(NamedTuple):
    """One sample interval of one channel; the temperature is NaN where there is no sensor."""

    sequence: int
    counts: int
    temperature_degC: float
    lit: bool
    """Whether the board saw a lit gyro; True where its samples do not say so."""
    arrival_s: float
    more: tuple[float, ...] = ()
    """Values of the line's further columns."""


class PulseBoard(StreamingDriver):
    """A board that counts the pulses of up to three laser gyros against its own clock."""

    source = "gyro_acquisition"
    whose, output = "gyro's", "sample"
    when_quiet = "check the board's power, its line and that the device under test is on"
    model: ClassVar[str]
    repeatable: ClassVar[Repeatable] = Repeatable("stop", "identify", "status")
    """Not the start: counters would begin again at zero, or a board that runs refuse it."""

    further: ClassVar[Mapping[str, str]] = {}
    """Columns besides those of every board, to unit and meaning."""

    def __init__(self, place: Place, answers: AnswerLine) -> None:
        super().__init__(place)
        self._answers = answers
        self._commands = Commands(place, answers, self._send, REFUSALS, WHEN_SILENT)
        self.columns: Mapping[str, str] = {**COLUMNS, **self.further}
        self._channel: int | None = None

    @abstractmethod
    def _send(self, command: str, number: int, values: Mapping[str, float]) -> None:
        """Put a command on the line: `channel_mask` and `sample_interval_s` are its values.

        Of the answers, `status` has `gyro_present` and `laser_on`, bits.
        """

    @abstractmethod
    def _begin(self, channel: int, sample_interval_s: float) -> None:
        """Take note that the samples of a channel begin anew; what came before is forgotten."""

    @abstractmethod
    def _samples(self) -> Sequence[Sample]:
        """Return the samples that came since the last call."""

    @abstractmethod
    def _newest(self) -> Sample | None:
        """Return the last sample that nobody has taken yet, and keep it."""

    def identify(self) -> Identity:
        """Ask for the board's identity."""
        return self._commands.identity(self.model)

    def start(self, sample_interval_s: float, channel: int) -> None:
        """Begin to sample one channel; raises InstrumentError when the board sees no lit gyro."""
        self._commands.command("stop")
        self._channel = channel
        self._begin_to_hear(sample_interval_s)
        status = self._commands.ask("status", "status", "asked for its status")
        self._check_gyro(status, "start")
        bit = 1 << (channel - 1)
        self._commands.command("start", channel_mask=bit, sample_interval_s=sample_interval_s)
        # What was still on its way from before has come before the acknowledgement.
        self._begin(channel, sample_interval_s)
        interval = f"{COLUMNS['sequence']}, every {sample_interval_s:.9g} s"
        self.columns = {**self.columns, "sequence": interval}

    def drain(self) -> Block:
        """Return the samples that came since the last call."""
        samples = self._samples()
        for status in self._answers.take("status"):
            self._check_gyro(status, "record")
        if samples:
            self._heard(samples[-1])
        further = list(self.further)
        more = np.array([sample.more for sample in samples], dtype=float)
        more = more.reshape(len(samples), len(further))
        return Block(
            {
                "sequence": np.array([sample.sequence for sample in samples], dtype=np.uint16),
                "counts": np.array([sample.counts for sample in samples], dtype=np.int32),
                "temperature_degC": np.array(
                    [sample.temperature_degC for sample in samples], dtype=float
                ),
                **dict(zip(further, more.T, strict=True)),
            },
            np.array([sample.arrival_s for sample in samples], dtype=float),
        )

    def stop(self) -> None:
        """End the sampling."""
        self._channel = None
        self._streams = False
        self._commands.command("stop")

    def _look(self) -> None:
        newest = self._newest()
        if newest is not None:
            self._heard(newest)

    def _heard(self, sample: Sample) -> None:
        """Take note of the newest sample."""
        if not sample.lit and self._channel is not None:
            raise self._dark("record")
        self._hear(sample.arrival_s, sample.temperature_degC)

    def _check_gyro(self, status: Mapping[str, Any], attempted: str) -> None:
        """Raise InstrumentError when the board sees no lit gyro on the channel in use."""
        if self._channel is None:
            return
        bit = 1 << (self._channel - 1)
        if not int(status["gyro_present"]) & bit or not int(status["laser_on"]) & bit:
            raise self._dark(attempted)

    def _dark(self, attempted: str) -> InstrumentError:
        return self.error(
            f"{attempted} channel {self._channel}",
            "the board sees no lit gyro there",
            "check the gyro's cable and power, and the plan's channel",
        )
