"""Instruments that stream: numbered commands and their acknowledgements, and the newest output."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Protocol

from station.errors import InstrumentError, InstrumentTimeout
from station.roles import Driver, Identity, Place


class AnswerLine(Protocol):
    """The answers of an instrument by kind; `acknowledgement` has `request_id` and `result`."""

    def take(self, answer: str) -> Sequence[Mapping[str, Any]]:
        """Return the answers of a kind that have come."""
        ...

    def wait_for(self, answer: str, deadline_s: float) -> Sequence[Mapping[str, Any]]:
        """Return the answers of a kind as soon as there are any, or none at run time."""
        ...


class Commands:
    """The commands to one instrument.

    `send` puts a command on the line: its word, its number and its values. `refusals` tells by the
    word of a refusal what to do now, `when_silent` what to do where nothing comes back.
    """

    def __init__(
        self,
        place: Place,
        line: AnswerLine,
        send: Callable[[str, int, Mapping[str, float]], None],
        refusals: Mapping[str, str],
        when_silent: str,
    ) -> None:
        self._place, self._line, self._send = place, line, send
        self._refusals, self._when_silent = refusals, when_silent
        self._number = 0

    def command(self, command: str, **values: float) -> Mapping[str, Any]:
        """Send a command and return its acknowledgement.

        Raises InstrumentError for a refusal, InstrumentTimeout where none comes.
        """
        self._number = (self._number + 1) % 65536
        attempted = f"sent the command {command}"
        self._send(command, self._number, values)
        reply = self._acknowledgement(attempted)
        result = str(reply["result"])
        if result != "ok":
            raise InstrumentError(
                self._place.name,
                attempted,
                f"it refused with {result}",
                self._refusals.get(result, self._refusals["unknown_command"]),
            )
        return reply

    def ask(self, command: str, answer: str, attempted: str) -> Mapping[str, Any]:
        """Send a command and return the newest answer of a kind that follows it."""
        self._line.take(answer)
        self.command(command)
        answers = self._line.wait_for(answer, self._deadline_s())
        if not answers:
            raise self._silent(answer, attempted)
        return answers[-1]

    def start_at(self, rate_Hz: float, step_Hz: float, /, **values: float) -> None:
        """Send a start; raises InstrumentError where the reported rate is another."""
        reply = self.command("start", **values)
        if not math.isclose(float(reply["rate"]), rate_Hz, abs_tol=step_Hz / 2):
            raise InstrumentError(
                self._place.name,
                f"started it at {rate_Hz:g} Hz",
                f"it reports an output rate of {reply['rate']:g} Hz",
                self._refusals["already_running"],
            )

    def identity(self, model: str) -> Identity:
        """Ask an instrument of our own who it is."""
        reply = self.ask("identify", "identity", "asked who it is")
        firmware = f"{reply['firmware_major']}.{reply['firmware_minor']}"
        return Identity("house-made", model, str(reply["serial_number"]), firmware)

    def _acknowledgement(self, attempted: str) -> Mapping[str, Any]:
        """Return the acknowledgement of the last command; a late one of another is passed over."""
        deadline_s = self._deadline_s()
        while replies := self._line.wait_for("acknowledgement", deadline_s):
            for reply in replies:
                if reply["request_id"] == self._number:
                    return reply
        raise self._silent("acknowledgement", attempted)

    def _deadline_s(self) -> float:
        clock = self._place.clock
        return clock.now() + clock.patience_s(self._place.exchanges.deadline_s)

    def _silent(self, answer: str, attempted: str) -> InstrumentTimeout:
        return InstrumentTimeout(
            self._place.name,
            attempted,
            f"no {answer} came within {self._place.exchanges.deadline_s:g} s",
            self._when_silent,
        )


SHORTEST_SILENCE_S = 3.0
SILENT_INTERVALS = 3


class StreamingDriver(Driver, ABC):
    """A device that streams; its temperature, for interlocks, is that of its newest output.

    `whose` temperature it is and what an `output` is called stand in the message of a fault;
    `when_quiet` is what to do then.
    """

    whose: ClassVar[str]
    output: ClassVar[str] = "output"
    when_quiet: ClassVar[str]

    def __init__(self, place: Place) -> None:
        self.place = place
        self._streams = False
        self._heard_s = 0.0
        self._quiet_after_s = SHORTEST_SILENCE_S
        self._newest_degC: float | None = None

    @abstractmethod
    def _look(self) -> None:
        """Hear the newest output that nobody has taken yet, and leave it to whoever drains."""

    def _begin_to_hear(self, interval_s: float) -> None:
        """Take note that outputs begin, one every interval."""
        self._quiet_after_s = max(SHORTEST_SILENCE_S, SILENT_INTERVALS * interval_s)
        self._heard_s, self._newest_degC = self.place.clock.now(), None
        self._streams = True

    def _hear(self, arrival_s: float, temperature_degC: float | None) -> None:
        """Take note of the newest output: NaN where a sensor is missing, None where it has none."""
        self._heard_s = max(self._heard_s, arrival_s)
        if temperature_degC is None:
            return
        self._newest_degC = temperature_degC
        if not math.isnan(temperature_degC):
            self.place.publish("temperature", temperature_degC, "degC")

    def _temperature_degC(self) -> float | None:
        """Return the temperature of the newest output; None while there is none.

        Raises InstrumentError when no output has come for a while, or a sensor is missing.
        """
        if not self._streams:
            return None
        self._look()
        attempted = f"looked for the {self.whose} temperature"
        quiet_s = self.place.clock.now() - self._heard_s
        if quiet_s > self._quiet_after_s:
            came_back = f"no {self.output} came for {quiet_s:.3g} s"
            raise self.error(attempted, came_back, self.when_quiet)
        if self._newest_degC is not None and math.isnan(self._newest_degC):
            raise self.error(
                attempted,
                f"the {self.output}s say that a sensor is missing",
                "check the sensor's cable, or take that interlock out of the bench file",
            )
        return self._newest_degC

    # It is published when it is heard, and not again when it is asked for.
    quantities: ClassVar = {"temperature": _temperature_degC}
