"""The line of an ACUTROL3000: framed or plain answers, its error queue, and its modes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, NamedTuple

from pydantic import Field

from drivers.acutronic.prefix import PrefixedLine
from drivers.generic.table_axis import AxesSettings
from drivers.transport.exchanges import NEVER, Repeatable, shortened
from drivers.transport.ports import SerialSettings
from drivers.transport.text_line import SerialLine, TextLine
from station.errors import InstrumentError
from station.roles import Place

EXCHANGES_APART_S = 2e-3
"""The shortest time between two messages by Ethernet."""

ERROR_QUERY = ":Status:MSG? QERROR;:Status:STB?"
"""The byte, which this query does not clear, shows that an empty queue answered with nothing."""

MAX_ERRORS = 32
SENT_DECIMALS = 6
BYTE = re.compile(r"\s*\d+\s*")
NUMBER = re.compile(r"[+-]?(?=\.?\d)\d*(?:\.(\d*))?")
ERROR = re.compile(r"\s*(?:(\d+)\s*(?:[,:]\s*)?\"?([^\"]*?)\"?)?\s*")
MODES = ("Position", "Rate", "Off", "Abort", "Arate", "Synthesis", "Track")
COMPARE = "compare the plan's and the bench file's values with the table's ranges"
INTERLOCK = (
    "make sure that nobody is in danger, close what is open (emergency stop, door, end switch), "
    "then home the axis again"
)


class AclSettings(AxesSettings):
    """What the bench file says of a table and its controller."""

    framing: Literal["framed", "line"] = Field(
        "framed", description="whether answers begin with error code and length, or are plain lines"
    )


class Answer(NamedTuple):
    """What came back for a message: its error, 0 for none, and its text."""

    code: int
    text: str


class AclLine:
    """Messages to one controller, each verified by what it says of errors.

    By `framed` every message is answered; else only queries are, and a command therefore asks for
    the error queue in the same message.
    """

    def __init__(
        self,
        place: Place,
        serial: SerialSettings,
        framed: bool,
        met: Callable[[str], None],
        repeatable: Repeatable = NEVER,
    ) -> None:
        self._place = place
        self._framed = framed
        if framed:
            self._line: TextLine = PrefixedLine(place, serial, met, repeatable)
        else:
            self._line = SerialLine(
                place, serial, request_end="\r\n", answer_end="\n", repeatable=repeatable
            )
        self.proof = self._line.proof
        self._free_s = -math.inf

    def query(self, message: str) -> str:
        """Send a message with queries and return their answers, which `;` joins."""
        answer = self._exchange(message)
        if answer.code:
            raise self._refused(message, answer)
        return answer.text

    def numbers(self, *queries: str) -> list[float]:
        """Ask several queries in one message, answered from one servo frame, each by a number."""
        message = ";".join(queries)
        return self._line.patiently(message, lambda: self._numbers(message, len(queries)))

    def _numbers(self, message: str, expected: int) -> list[float]:
        answer = self.query(message)
        try:
            values = [float(text) for text in answer.split(";")]
        except ValueError:
            values = []
        if len(values) != expected or not all(map(math.isfinite, values)):
            count = "a number belongs" if expected == 1 else f"{expected} numbers belong"
            raise InstrumentError(
                self._place.name,
                f"sent {shortened(message)!r}",
                f"{shortened(answer)!r} came back where {count}",
                "check the cable and that nobody else talks to the controller",
            )
        return values

    def printed(self, message: str, text: str) -> tuple[float, float]:
        """Return a number that came for a message, and half of its last printed digit."""
        match = NUMBER.fullmatch(text.strip())
        if match is None:
            raise self.odd(message, text)
        return float(match[0]), 0.5 * 10.0 ** -len(match[1] or "")

    def mode(self, axis: int) -> str:
        """Return the mode of an axis by its whole name, also where it is abbreviated."""
        message = f":Mode? {axis}"
        return self._line.patiently(message, lambda: self._mode(message))

    def _mode(self, message: str) -> str:
        answer = self.query(message)
        mode = whole_mode(answer)
        if not mode:
            raise self.odd(message, answer)
        return mode

    def verify(self, axis: int, what: str, demand: float, mode: str) -> float:
        """Read back a demand (Position or Rate) and the mode; return it as it is printed.

        Raises InstrumentError where they differ.
        """
        message = f":Demand:{what}? {axis};:Mode? {axis}"
        answer = self.query(message)
        value_text, _, found_mode = answer.partition(";")
        value, half_digit = self.printed(message, value_text)
        agrees = abs(value - demand) <= agrees_within(half_digit)
        if not agrees or whole_mode(found_mode) != mode:
            raise InstrumentError(
                self._place.name,
                f"set axis {axis} to {what.lower()} {demand:g} in the mode {mode}",
                f"{shortened(value_text)} and the mode {shortened(found_mode)} read back",
                "check that nobody else talks to the controller, then run again",
            )
        return value

    def command(self, message: str) -> None:
        """Send a command; a refusal is InstrumentError."""
        answer = self._told(message)
        if answer.code:
            raise self._refused(message, answer)

    def tell(self, message: str) -> None:
        """Send a command whose refusal is no fault here."""
        self._line.patiently(message, lambda: self._told(message))

    def blindly(self, message: str) -> None:
        """Send a command and wait for no answer: a last attempt."""
        self._line.last_attempt(message)

    def forget_errors(self) -> None:
        """Read errors until there is none."""
        for _ in range(MAX_ERRORS):
            if not self._next_error().code:
                return

    def next_error(self) -> str:
        """Take the oldest error from the queue; empty where there is none."""
        kept = self._next_error()
        return f"{kept.code}: {kept.text}" if kept.code else ""

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def odd(self, message: str, answer: str) -> InstrumentError:
        """Return the error of an answer that is none."""
        return self._line.odd(message, answer)

    def _told(self, message: str) -> Answer:
        if self._framed:
            return self._exchange(message)
        return self._next_error(message)

    def _exchange(self, message: str) -> Answer:
        clock = self._place.clock
        if clock.now() < self._free_s:
            clock.sleep_until(self._free_s)
        try:
            text = self._line.query(message)
        finally:
            self._free_s = clock.now() + EXCHANGES_APART_S
        if not self._framed:
            return Answer(0, text.rstrip("\r"))
        code, _, body = text.partition(" ")
        return Answer(int(code), body.rstrip("\r\n"))

    def _next_error(self, command: str = "") -> Answer:
        """Ask for the oldest error, after a command if there is one; code 0 where there is none."""
        text = self._exchange(f"{command};{ERROR_QUERY}" if command else ERROR_QUERY).text
        entry, parted, byte = text.rpartition(";")
        match = ERROR.fullmatch(entry)
        if match is None or not parted or not BYTE.fullmatch(byte):
            raise self.odd(ERROR_QUERY, text)
        return Answer(int(match[1] or 0), match[2] or "")

    def _refused(self, message: str, answer: Answer) -> InstrumentError:
        """Return the error of a refusal, in the controller's words, and empty its queue."""
        if self._framed:
            answer = self._first_kept(answer)
        self.forget_errors()
        open_now = "INTERLOCK" in answer.text.upper()
        meaning = "its interlock is open or was broken" if open_now else "it refused"
        return InstrumentError(
            self._place.name,
            f"sent {shortened(message)!r}",
            f"{meaning} (error {answer.code}, {shortened(answer.text)})",
            INTERLOCK if open_now else COMPARE,
        )

    def _first_kept(self, answer: Answer) -> Answer:
        """Return the queue's entry of an error, which has its words; the answer itself if none."""
        for _ in range(MAX_ERRORS):
            kept = self._next_error()
            if kept.code in (0, answer.code):
                return kept if kept.code else answer
        return answer


def whole_mode(text: str) -> str:
    """Return a mode by its whole name, whether or not it is abbreviated; empty for none."""
    short = text.strip().upper()
    return next((mode for mode in MODES if short and mode.upper().startswith(short)), "")


def number(value: float) -> str:
    """Return a number as the controller takes it: without an exponent, and no minus zero."""
    return f"{round(value, SENT_DECIMALS) + 0.0:.{SENT_DECIMALS}f}"


def agrees_within(half_digit: float) -> float:
    """Return by how much a value may differ from what reads back, both being rounded."""
    return half_digit + 0.5 * 10.0**-SENT_DECIMALS + 1e-9


SERVOED, SOFTWARE_ABORT, HARDWARE_ABORT = 1 << 4, 1 << 6, 1 << 7
AT_POSITION, AT_RATE = 1 << 8, 1 << 9
TRACKING_ERROR = 1 << 2 | 1 << 12
"""The first since build 1848, the second before."""

HOME_AGAIN = "then home the axis again"
FAULTS = {
    TRACKING_ERROR: (
        "the axis did not keep up with its profile (following error), and its servo is open",
        f"look whether a cable or the device blocks it, {HOME_AGAIN}",
    ),
    1 << 1: (
        "the axis turned faster than its rate trip, and its servo is open",
        f"compare limits.rate in the bench file with what else sets rates, {HOME_AGAIN}",
    ),
    1 << 3: (
        "the controller did not keep its frame time",
        f"switch the controller off and on, {HOME_AGAIN}",
    ),
    1 << 0: (
        "the movement was aborted at a limit of position or by a command, and the servo is open",
        f"compare the plan's angles with the axis' limits, {HOME_AGAIN}",
    ),
}
SOURCES = {
    1 << 0: "a safety interlock (SI)",
    1 << 1: "the ACP",
    1 << 2: "the SUP",
    1 << 3: "the RI",
}
"""The bits of the status byte that say whose interlock opened, in the manual's abbreviations."""


@dataclass(frozen=True)
class Status:
    """The registers of an axis: state, dynamic state, and faults of the software."""

    state: int
    dynamic: int
    fault: int

    @property
    def servoed(self) -> bool:
        """Whether the servo is closed."""
        return bool(self.state & SERVOED)

    @property
    def broken(self) -> bool:
        """Whether a break is reported that nobody has reset."""
        return bool(self.state & (SOFTWARE_ABORT | HARDWARE_ABORT) or self.fault)


def queries(axis: int) -> tuple[str, ...]:
    """Return the queries of an axis' registers, in the order of `Status`."""
    return tuple(f":Status:CSR? A{axis}{name}" for name in ("STATE", "DYN", "SWFLT"))


def fault_of(name: str, line: AclLine, axis: int, status: Status) -> InstrumentError:
    """Return what broke the servo of an axis, in plain words.

    Asks the status byte, which the controller forgets then, for whose interlock opened.
    """
    attempted = f"looked at axis {axis}"
    registers = f"state {status.state}, faults {status.fault}"
    for bit, (meaning, do_now) in FAULTS.items():
        if status.fault & bit:
            return InstrumentError(name, attempted, f"{meaning} ({registers})", do_now)
    if not status.state & HARDWARE_ABORT:
        meaning = "its servo is open, though nobody here opened it"
        do_now = f"find out who or what opened it, {HOME_AGAIN}"
        return InstrumentError(name, attempted, f"{meaning} ({registers})", do_now)
    byte = 0
    with suppress(InstrumentError):
        byte = int(line.numbers("*STB?")[0])
    source = " and ".join(whose for bit, whose in SOURCES.items() if byte & bit)
    opened = f"the interlock was opened{f' by {source}' if source else ''}, and the servo is open"
    return InstrumentError(
        name, attempted, f"{opened} ({registers}, status byte {byte})", INTERLOCK
    )
