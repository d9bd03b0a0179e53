"""Where wire faults sit: between an instrument's logic and its socket."""

from __future__ import annotations

from collections.abc import Callable
from threading import get_ident
from typing import NamedTuple

from sim_instruments.faults.instrument import InstrumentFaults
from sim_instruments.faults.trigger import frame_name
from sim_instruments.faults.wire import Reply, WireFault


class Outgoing(NamedTuple):
    """What a line server does after a message: send a reply, end the connection, or neither."""

    reply: Reply | None
    drops: bool = False
    resets: bool = False


class LineTap:
    """The faults of an instrument that answers lines with lines."""

    def __init__(self, faults: InstrumentFaults | None) -> None:
        self._faults = faults
        self._previous = b""

    def exchange(self, line: bytes, execute: Callable[[bytes], bytes], now_s: float) -> Outgoing:
        """Carry out a line, or not, and return what goes out for it."""
        faults = self._faults
        if faults is None or faults.none_to_come():
            answer = execute(line)
            self._previous = answer or self._previous
            return Outgoing(self.parted(answer))
        message = self.named(line)
        if faults.arrives(message):
            return Outgoing(None)
        answer = execute(line)
        live = faults.live()
        reply, drops, resets = self.parted(answer), False, False
        for fault in live:
            if reply is None:
                if fault.needs_reply or not fault.drops_line:
                    continue
            elif fault.loses_messages or not fault.touches(reply):
                continue
            if fault.trigger.meets(now_s, message):
                drops = drops or fault.drops_line
                resets = resets or fault.resets_line
                reply = reply and fault.change(reply, self.parted(self._previous))
        self._previous = answer or self._previous
        return Outgoing(None if drops else reply, drops, resets)

    def named(self, line: bytes) -> str:
        """Return a message as the text that faults are matched against."""
        return line.decode("ascii", "replace").strip()

    def parted(self, answer: bytes) -> Reply | None:
        """Return what may be changed of an answer, and its end; None for no answer."""
        return reply_of(answer)


class Batch(NamedTuple):
    """What becomes of frames on their way out: those that go now, those that go later."""

    frames: list[str]
    late: list[tuple[float, str]]
    drops: bool


class FrameTap:
    """The faults of an instrument on a CAN bus.

    A fault that meets a frame to the instrument changes all that the instrument sends while it
    deals with it; else a fault meets the frames that the instrument sends.
    """

    def __init__(self, faults: InstrumentFaults | None) -> None:
        self._faults = faults
        self._previous: dict[str, Reply] = {}
        self._answering: tuple[int, list[WireFault]] = (0, [])

    def arrives(
        self, identifier: int, data: bytes, receive: Callable[[int, bytes], None], now_s: float
    ) -> bool:
        """Give a frame to the instrument, or not; return whether the connections end with it."""
        if self._faults is None:
            receive(identifier, data)
            return False
        message = frame_name(identifier)
        if self._faults.arrives(message):
            return False
        others = [fault for fault in self._faults.live() if not fault.loses_messages]
        met = [fault for fault in others if fault.trigger.meets(now_s, message)]
        self._answering = (get_ident(), met)
        try:
            receive(identifier, data)
        finally:
            self._answering = (0, [])
        return any(fault.drops_line for fault in met)

    def leaves(self, text: str, now_s: float) -> Batch | None:
        """Return what becomes of frames `< frame ID TIME DATA >< … >`; None: as they are."""
        thread, met = self._answering
        met = met if thread == get_ident() else []
        live = self._faults.live() if self._faults is not None else []
        if not live and not met and not (self._faults and self._faults.waited_for):
            return None
        batch, drops = Batch([], [], False), False
        for frame in text.split(">")[:-1]:
            _, _, name, time_text, data, _ = frame.split(" ")
            if self._faults is not None:
                self._faults.is_on_the_line(name)
            true = reply = Reply(bytes.fromhex(data))
            going: Reply | None = reply
            for fault in [*met, *(one for one in live if one not in met)]:
                if going is None:
                    break
                if fault in met or fault.trigger.meets(now_s, name):
                    drops = drops or fault.drops_line
                    going = fault.change(going, self._previous.get(name))
            self._previous[name] = true
            if going is None:
                continue
            text = f"< frame {name} {time_text} {going.body.hex()} >"
            if going.delay_s > 0:
                batch.late.append((going.delay_s, text))
            else:
                batch.frames.append(text)
        return batch._replace(drops=drops)


def reply_of(answer: bytes) -> Reply | None:
    """Return the line and its end apart; None for no answer."""
    if not answer:
        return None
    body = answer.rstrip(b"\r\n")
    return Reply(body, answer[len(body) :])
