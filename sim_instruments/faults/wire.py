"""Faults on the wire: what becomes of a message on its way in, of a reply on its way out.

A reply is one line of a text protocol, one Modbus or checksummed frame, or the data of one CAN
frame.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sim_instruments.faults.trigger import Trigger
from sim_instruments.truth import SimulationError, Truth

LINES = frozenset({"scpi", "acl", "ascii"})
CAN = frozenset({"socketcand"})
MODBUS_TCP = frozenset({"modbus-tcp"})
MODBUS_RTU = frozenset({"modbus-rtu"})
MODBUS = MODBUS_TCP | MODBUS_RTU
FRAMES = frozenset({"frames"})
"""Binary frames with a checksum, most of them sent unasked."""

PLACES = ("ahead", "before", "behind", "after")
"""Of a stray line among the replies."""

MEASURED = re.compile(rb"[+-]?\d+\.(?:\d+E[+-]?\d+|\d{6}(?![\dE]))")
"""How instruments write what they measured: with an exponent, or six decimals.

Counts, states and versions look otherwise.
"""


@dataclass(frozen=True)
class Reply:
    """What goes out: the bytes, the end of the line, and how much later.

    `ahead` goes out at once, before the reply; `afterwards` holds what goes out so much later, in
    s, and nobody waits for; `flood` is how many bytes without an end take the place of the reply.
    """

    body: bytes
    end: bytes = b""
    delay_s: float = 0.0
    ahead: bytes = b""
    afterwards: tuple[tuple[float, bytes], ...] = ()
    flood: int = 0


class WireFault:
    """One fault between an instrument's logic and its socket."""

    kind: ClassVar[str]
    protocols: ClassVar[frozenset[str]] = LINES | CAN | MODBUS | FRAMES
    options: ClassVar[tuple[str, ...]] = ()
    needs_reply: ClassVar[bool] = True
    """Only messages that are answered are met."""
    loses_messages: ClassVar[bool] = False
    """A message that is met never reaches the instrument."""
    drops_line: ClassVar[bool] = False
    """The connection ends with the message that is met."""
    resets_line: ClassVar[bool] = False
    """The connection is reset (TCP RST) with the message that is met."""
    silences: ClassVar[bool] = False
    """Nothing goes out in place of the reply."""

    def __init__(self, trigger: Trigger, rng: np.random.Generator, truth: Truth) -> None:
        self.trigger = trigger
        self.rng = rng
        self.read(truth)

    def read(self, truth: Truth) -> None:
        """Take the options of the fault from its entry; SimulationError where one is wrong."""

    def touches(self, reply: Reply) -> bool:
        """Return whether there is anything in this reply to change."""
        return True

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return what goes out in place of `reply`; `previous` is the reply before it."""
        return None if self.silences else reply


class NoReply(WireFault):
    """The command is carried out, its reply is lost."""

    kind = "no-reply"
    silences = True


class Late(WireFault):
    """The reply comes `delay` later, 2 s unless said."""

    kind = "late"
    options = ("delay",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.delay_s = truth.positive("delay", "s", 2.0)

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply with a delay."""
        return replace(reply, delay_s=reply.delay_s + self.delay_s)


class Partial(WireFault):
    """The reply breaks off in the middle, without its end."""

    kind = "partial"

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the first half."""
        return replace(reply, body=reply.body[: (len(reply.body) + 1) // 2], end=b"")


class Garbled(WireFault):
    """About a quarter of the bytes, one at least, are disturbed in their high bit and others."""

    kind = "garbled"
    # TCP has a check sum of its own, and Modbus TCP therefore none.
    protocols = LINES | CAN | MODBUS_RTU | FRAMES

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply with bytes that are no text."""
        body = np.frombuffer(reply.body, dtype=np.uint8).copy()
        if not body.size:
            return reply
        hit = self.rng.random(body.size) < 0.25
        hit[self.rng.integers(body.size)] = True
        body[hit] = (body[hit] ^ self.rng.integers(0, 128, int(hit.sum()), dtype=np.uint8)) ^ 0x80
        return replace(reply, body=body.tobytes())


class WrongTerminator(WireFault):
    """The line ends with a carriage return alone."""

    kind = "wrong-terminator"
    protocols = LINES

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply with another end."""
        return replace(reply, end=b"\r")


class PreviousReply(WireFault):
    """The reply is the one that the message before was given; the first one is lost."""

    kind = "previous-reply"
    # Replies in RTU frames have no number: one of the same length could not be distinguished.
    protocols = LINES | CAN | MODBUS_TCP | FRAMES

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply before this one."""
        return None if previous is None else replace(previous, delay_s=reply.delay_s)


class NotANumber(WireFault):
    """Every measured value in the reply reads `text`: NaN unless said; SCPI's own is 9.91E37."""

    kind = "nan"
    protocols = LINES
    options = ("text",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self._text = truth.text("text", "NaN").encode()

    def touches(self, reply: Reply) -> bool:
        """Return whether the reply holds a measured value."""
        return MEASURED.search(reply.body) is not None

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply without its values."""
        return replace(reply, body=MEASURED.sub(self._text, reply.body))


class WrongChecksum(WireFault):
    """The reply's check sum does not belong to it."""

    kind = "wrong-crc"
    protocols = MODBUS_RTU | FRAMES

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply with another last byte."""
        return replace(reply, body=reply.body[:-1] + bytes([reply.body[-1] ^ 0x5A]))


class LostCommand(WireFault):
    """The message never reaches the instrument, which neither acts nor answers."""

    kind = "lost-command"
    protocols = LINES | MODBUS
    needs_reply = False
    loses_messages = True


class LostFrame(WireFault):
    """The frame is on the bus for nobody, whether the instrument sends it or should get it."""

    kind = "lost-frame"
    silences = True
    protocols = CAN | FRAMES
    loses_messages = True


class DroppedConnection(WireFault):
    """The message is carried out, then the connection ends in place of a reply."""

    kind = "dropped-connection"
    silences = True
    needs_reply = False
    drops_line = True


class StrayLine(WireFault):
    """A line that nobody asked for: `text`, `+0.000000E+00` unless said.

    `where` is `ahead`, unless said: at once, while the reply follows `delay` later (1 ms unless
    said), so that whoever does not look takes one for the other. Else `before` or `behind` the
    reply, in one piece with it, or `after`: `delay` later than the reply.
    """

    kind = "stray-line"
    protocols = LINES
    options = ("text", "where", "delay")

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self._text = truth.text("text", "+0.000000E+00").encode()
        self._where = truth.text("where", PLACES[0])
        if self._where not in PLACES:
            raise SimulationError(f"{truth.where}.where: must be one of {', '.join(PLACES)}")
        self._delay_s = truth.positive("delay", "s", 1e-3)

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply with a line too many."""
        line = self._text + (reply.end or b"\r")
        if self._where == "before":
            return replace(reply, body=line + reply.body)
        if self._where == "behind":
            return replace(reply, end=reply.end + line)
        if self._where == "after":
            return replace(reply, afterwards=(*reply.afterwards, (self._delay_s, line)))
        return replace(reply, ahead=reply.ahead + line, delay_s=reply.delay_s + self._delay_s)


class DuplicateReply(WireFault):
    """The reply comes twice, in one piece, or the second one `delay` later."""

    kind = "duplicate-reply"
    protocols = LINES | MODBUS
    options = ("delay",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self._delay_s = truth.quantity("delay", "s", 0.0)
        if self._delay_s < 0:
            raise SimulationError(f"{truth.where}.delay: must not be negative")

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply and itself again."""
        again = reply.body + reply.end
        if not self._delay_s:
            return replace(reply, end=reply.end + again)
        return replace(reply, afterwards=(*reply.afterwards, (self._delay_s, again)))


class Flood(WireFault):
    """In place of the reply come `bytes` without an end of line, 100 million unless said."""

    kind = "flood"
    protocols = LINES | MODBUS
    options = ("bytes",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self._bytes = truth.integer("bytes", 1, 100_000_000)

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return a flood."""
        return replace(reply, flood=self._bytes)


class Reset(WireFault):
    """The message is carried out, then the connection is reset (TCP RST) in place of a reply."""

    kind = "reset"
    silences = True
    protocols = LINES | MODBUS
    needs_reply = False
    drops_line = True
    resets_line = True


WIRE_FAULTS = {fault.kind: fault for fault in WireFault.__subclasses__()}
