"""The prefix of an ACUTROL3000's answers: error code and length, in digits or in 32-bit words."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import NamedTuple

from drivers.transport.exchanges import Repeatable, shortened
from drivers.transport.ports import Port, SerialSettings, serial_port
from drivers.transport.text_line import ENCODING, TextLine
from station.errors import InstrumentError
from station.roles import Place

PREFIX_BYTES = 8
LONGEST = 32768
"""The characters of the longest message."""

DIGITS = re.compile(rb"(\d{4})(\d{4})")
ORDERS = {">": "32-bit words, high byte first", "<": "32-bit words, low byte first"}


class Prefix(NamedTuple):
    """Error code (0 for none) and length of an answer in bytes, and how both are coded."""

    code: int
    length: int
    coded: str


def prefix_of(answer: bytes) -> Prefix | None:
    """Return the prefix of an answer of 8 bytes at least; None where it has none.

    Words have the byte order in which the length is one that a message can have; where it is zero,
    the order in which the code is smaller.
    """
    head = answer[:PREFIX_BYTES]
    if digits := DIGITS.fullmatch(head):
        return Prefix(int(digits[1]), int(digits[2]), "digits")
    words = (
        Prefix._make((*struct.unpack(f"{order}II", head), name)) for order, name in ORDERS.items()
    )
    return min((word for word in words if word.length <= LONGEST), default=None)


class PrefixedLine(TextLine):
    """Answers of known length behind a prefix; `query` returns code, a blank, and the text."""

    def __init__(
        self,
        place: Place,
        serial: SerialSettings,
        met: Callable[[str], None],
        repeatable: Repeatable,
    ) -> None:
        self._met = met
        port = serial_port(place.address, serial)
        super().__init__(place, port, request_end="\r\n", answer_end="\r\n", repeatable=repeatable)

    def _is_whole(self, answer: bytes) -> bool:
        if len(answer) < PREFIX_BYTES:
            return False
        prefix = prefix_of(answer)
        return prefix is None or len(answer) >= PREFIX_BYTES + prefix.length

    def _read(self, port: Port, message: str, deadline_s: float) -> str:
        attempted = f"sent {shortened(message)!r}"
        answer = self._receive(port, attempted, deadline_s, self._is_whole)
        shown = repr(shortened(answer.decode(ENCODING, "backslashreplace")))
        if not self._is_whole(answer):
            what = f"only {shown} came, without the end of an answer,"
            raise self._silent(attempted, what, deadline_s)
        prefix = prefix_of(answer)
        if prefix is None:
            raise InstrumentError(
                self._place.name,
                attempted,
                f"{shown} came back, which does not begin with error code and length",
                "check that the address is the table's, and settings.framing in the bench file",
            )
        end = PREFIX_BYTES + prefix.length
        if answer[end:].strip(b"\r\n"):
            self._doubt(answer, attempted)
            raise self._doubtful(attempted, f"{shown} came back, more than one answer")
        if not answer[PREFIX_BYTES:end].isascii():
            raise self._wrong(attempted, f"{shown} came back, which is no text")
        if prefix.length:
            self._met(f"prefix of answers in {prefix.coded}")
        return f"{prefix.code} {answer[PREFIX_BYTES:end].decode(ENCODING)}"
