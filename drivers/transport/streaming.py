"""Instruments that stream: numbered commands and their acknowledgements, and the newest output."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from station.errors import InstrumentError, InstrumentTimeout
from station.roles import Identity, Place

ANSWER_WITHIN_S = 0.5


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
        told = self._acknowledgement(attempted)
        result = str(told["result"])
        if result != "ok":
            raise InstrumentError(
                self._place.name,
                attempted,
                f"it refused with {result}",
                self._refusals.get(result, self._refusals["unknown_command"]),
            )
        return told

    def ask(self, command: str, answer: str, attempted: str) -> Mapping[str, Any]:
        """Send a command and return the newest answer of a kind that follows it."""
        self._line.take(answer)
        self.command(command)
        found = self._line.wait_for(answer, self._deadline_s())
        if not found:
            raise self._silent(answer, attempted)
        return found[-1]

    def start_at(self, rate_Hz: float, step_Hz: float, /, **values: float) -> None:
        """Send a start; raises InstrumentError where what it says it outputs is another rate."""
        told = self.command("start", **values)
        if not math.isclose(float(told["rate"]), rate_Hz, abs_tol=step_Hz / 2):
            raise InstrumentError(
                self._place.name,
                f"started it at {rate_Hz:g} Hz",
                f"it says that it outputs {told['rate']:g} Hz",
                self._refusals["already_running"],
            )

    def identity(self, model: str) -> Identity:
        """Ask an instrument of our own who it is."""
        told = self.ask("identify", "identity", "asked who it is")
        firmware = f"{told['firmware_major']}.{told['firmware_minor']}"
        return Identity("house-made", model, str(told["serial_number"]), firmware)

    def _acknowledgement(self, attempted: str) -> Mapping[str, Any]:
        """Return the acknowledgement of the last command; a late one of another is passed over."""
        deadline_s = self._deadline_s()
        while found := self._line.wait_for("acknowledgement", deadline_s):
            for told in found:
                if told["request_id"] == self._number:
                    return told
        raise self._silent("acknowledgement", attempted)

    def _deadline_s(self) -> float:
        clock = self._place.clock
        return clock.now() + clock.patience_s(ANSWER_WITHIN_S)

    def _silent(self, answer: str, attempted: str) -> InstrumentTimeout:
        return InstrumentTimeout(
            self._place.name,
            attempted,
            f"no {answer} came within {ANSWER_WITHIN_S:g} s",
            self._when_silent,
        )


SHORTEST_SILENCE_S = 3.0
SILENT_INTERVALS = 3


class StreamWatch:
    """When a stream was last heard, and the temperature that it told.

    `whose` temperature it is and what an `output` is called stand in what is said of a fault;
    `when_silent` is what to do then.
    """

    def __init__(self, place: Place, whose: str, output: str, when_silent: str) -> None:
        self._place = place
        self._whose, self._output, self._when_silent = whose, output, when_silent
        self.runs = False
        self._heard_s = 0.0
        self._silent_after_s = SHORTEST_SILENCE_S
        self._temperature_degC: float | None = None

    def begin(self, interval_s: float) -> None:
        """Take note that outputs begin, one every interval."""
        self._silent_after_s = max(SHORTEST_SILENCE_S, SILENT_INTERVALS * interval_s)
        self._heard_s, self._temperature_degC = self._place.clock.now(), None
        self.runs = True

    def end(self) -> None:
        """Take note that no output is expected any more."""
        self.runs = False

    def hear(self, arrival_s: float, temperature_degC: float | None) -> None:
        """Take note of the newest output: NaN where a sensor is missing, None where it has none."""
        self._heard_s = max(self._heard_s, arrival_s)
        if temperature_degC is None:
            return
        self._temperature_degC = temperature_degC
        if not math.isnan(temperature_degC):
            self._place.publish("temperature", temperature_degC, "degC")

    def temperature_degC(self) -> float | None:
        """Return the temperature of the newest output; None while none has told it.

        Raises InstrumentError when none has come for a while, or a sensor is missing.
        """
        attempted = f"looked for the {self._whose} temperature"
        silent_s = self._place.clock.now() - self._heard_s
        if silent_s > self._silent_after_s:
            raise InstrumentError(
                self._place.name,
                attempted,
                f"no {self._output} came for {silent_s:.3g} s",
                self._when_silent,
            )
        if self._temperature_degC is not None and math.isnan(self._temperature_degC):
            raise InstrumentError(
                self._place.name,
                attempted,
                f"the {self._output}s say that a sensor is missing",
                "check the sensor's cable, or take that interlock out of the bench file",
            )
        return self._temperature_degC
