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

MEASURED = re.compile(rb"[+-]?\d+\.(?:\d+E[+-]?\d+|\d{6}(?![\dE]))")
"""How instruments write what they measured: with an exponent, or six decimals.

Counts, states and versions look otherwise.
"""


@dataclass(frozen=True)
class Reply:
    """What goes out: the bytes, the end of the line, and how much later."""

    body: bytes
    end: bytes = b""
    delay_s: float = 0.0


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

    def __init__(self, trigger: Trigger, rng: np.random.Generator, truth: Truth) -> None:
        self.trigger = trigger
        self.rng = rng

    def touches(self, reply: Reply) -> bool:
        """Return whether there is anything in this reply to change."""
        return True

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return what goes out in place of `reply`; `previous` is the reply before it."""
        return reply


class NoReply(WireFault):
    """The command is carried out, its reply is lost."""

    kind = "no-reply"

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return nothing."""
        return None


class Late(WireFault):
    """The reply comes `delay` later, 2 s unless said."""

    kind = "late"
    options = ("delay",)

    def __init__(self, trigger: Trigger, rng: np.random.Generator, truth: Truth) -> None:
        super().__init__(trigger, rng, truth)
        self.delay_s = truth.quantity("delay", "s") if "delay" in truth else 2.0
        if self.delay_s <= 0:
            raise SimulationError(f"{truth.where}.delay: must be positive")

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
    # Replies in RTU frames have no number: one of the same length could not be told from another.
    protocols = LINES | CAN | MODBUS_TCP | FRAMES

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return the reply before this one."""
        return None if previous is None else replace(previous, delay_s=reply.delay_s)


class NotANumber(WireFault):
    """Every measured value in the reply reads `text`: NaN unless said; SCPI's own is 9.91E37."""

    kind = "nan"
    protocols = LINES
    options = ("text",)

    def __init__(self, trigger: Trigger, rng: np.random.Generator, truth: Truth) -> None:
        super().__init__(trigger, rng, truth)
        self._text = truth.text("text").encode() if "text" in truth else b"NaN"

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
    protocols = CAN | FRAMES
    loses_messages = True

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return nothing."""
        return None


class DroppedConnection(WireFault):
    """The message is carried out, then the connection ends in place of a reply."""

    kind = "dropped-connection"
    needs_reply = False
    drops_line = True

    def change(self, reply: Reply, previous: Reply | None) -> Reply | None:
        """Return nothing."""
        return None


WIRE_FAULTS: dict[str, type[WireFault]] = {
    fault.kind: fault
    for fault in (
        NoReply,
        Late,
        Partial,
        Garbled,
        WrongTerminator,
        PreviousReply,
        NotANumber,
        WrongChecksum,
        LostCommand,
        LostFrame,
        DroppedConnection,
    )
}
