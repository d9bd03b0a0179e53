"""CAN frames through python-can: a reader thread that stamps, and requests with a reply frame."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

import can

from drivers.transport.can_adapter import Adapter, StampedTime
from drivers.transport.kept_frames import KeptFrames
from drivers.transport.ports import CONNECT_DEADLINE_S, SocketPort, connected
from station.clock import FarEnd, boot_seconds
from station.errors import InstrumentError, reason_of
from station.roles import Place
from station.roles.can_addresses import SCHEME, can_address

GREETING, OPENED, FRAME = b"< hi >", b"< ok >", b"< frame "
MAX_MESSAGE = 256
"""A frame of eight bytes takes less than 60 characters."""

EXTENDED_ID_DIGITS = 8
LARGEST_ID = 0x1FFFFFFF
"""The bits above it say what kind of frame it is."""


class Socketcand(can.BusABC):  # type: ignore[misc]  # python-can is not typed here
    """A CAN bus behind the public socketcand daemon; OSError where none opens it within 2 s.

    From the daemon's protocol: it greets with `< hi >`, answers `< open BUS >` and `< rawmode >`
    with `< ok >`, then sends `< frame ID TIME DATA >` for every frame on the bus and takes
    `< send ID LENGTH DATA >`. Bytes come as TCP cuts them: a frame may come before the last
    `< ok >` or lie in one segment with it, and any message may come in pieces. The bus of that
    name in python-can refuses to open there, and takes a daemon that hangs up for a bus without
    traffic.

    `passed_over` is called with bytes that are no message.
    """

    def __init__(
        self, host: str, port: int, bus: str, passed_over: Callable[[bytes], None]
    ) -> None:
        self._passed_over = passed_over
        self._pending = b""
        self._messages: deque[can.Message] = deque()
        self._port: SocketPort = connected(host, port)
        try:
            self._expect(GREETING, f"no socketcand with a bus {bus}")
            for request in (f"< open {bus} >", "< rawmode >"):
                self._port.write(request.encode("ascii"))
                self._expect(OPENED, f"no socketcand with a bus {bus}")
            super().__init__(channel=bus)
        except BaseException:
            self._is_shutdown = True  # there is nothing to be shut down
            self._port.close()
            raise

    @property
    def waiting(self) -> bool:
        """Whether a message has come that nobody has taken yet."""
        return bool(self._messages)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Return the next message that has come, or comes within a real time; raises OSError."""
        if not self._messages:
            self._messages.extend(self._read(timeout or 0.0))
        return (self._messages.popleft() if self._messages else None), False

    def _read(self, within_s: float) -> list[can.Message]:
        whole = b">" in self._pending  # they came with the end of the opening
        self._pending += self._port.read(0.0 if whole else within_s)
        *texts, self._pending = self._pending.split(b">")
        if len(self._pending) > MAX_MESSAGE:
            self._passed_over(self._pending)
            self._pending = b""
        return [message for text in texts if (message := self._message(text)) is not None]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a frame on the bus; raises OSError."""
        identifier = msg.arbitration_id
        name = f"{identifier:08X}" if msg.is_extended_id else f"{identifier:03X}"
        octets = " ".join(f"{byte:x}" for byte in msg.data)
        self._port.write(f"< send {name} {msg.dlc:X} {octets} >".encode("ascii"))

    def shutdown(self) -> None:
        """Close the connection."""
        super().shutdown()
        self._port.close()

    def _expect(self, wanted: bytes, otherwise: str) -> None:
        """Wait for a message of the opening; frames before it, and what comes behind, are kept."""
        until_s = boot_seconds() + CONNECT_DEADLINE_S
        while True:
            while b">" not in self._pending and len(self._pending) <= MAX_MESSAGE:
                left_s = until_s - boot_seconds()
                if left_s <= 0.0:
                    raise TimeoutError(f"{otherwise}: {self._pending[:40]!r} came back")
                self._pending += self._port.read(left_s)
            text, _, behind = self._pending.partition(b">")
            if not text.lstrip().startswith(FRAME):
                break
            self._pending = behind
            if (message := self._message(text)) is not None:
                self._messages.append(message)
        if (text + b">").strip() != wanted:
            raise ConnectionError(f"{otherwise}: {self._pending[:40]!r} came back")
        self._pending = behind

    def _message(self, text: bytes) -> can.Message | None:
        """Return what a message says, None for what is no frame."""
        words = text.partition(b"<")[2].decode("ascii", "replace").split()
        try:
            if words[0] not in ("frame", "error"):
                raise ValueError
            return can.Message(
                timestamp=float(words[2]),
                arbitration_id=int(words[1], 16) & LARGEST_ID,
                is_extended_id=len(words[1]) == EXTENDED_ID_DIGITS,
                is_error_frame=words[0] == "error",
                data=bytes.fromhex("".join(words[3:])),
                check=True,
            )
        except (IndexError, ValueError):
            self._passed_over(text)
            return None


MAX_TRACE = 80


class TextBus(can.BusABC):  # type: ignore[misc]  # python-can is not typed here
    """A CAN bus whose far end gives and takes frames as a trace has them: `100#0300 NAME`."""

    def __init__(self, far: FarEnd) -> None:
        self._far = far
        self._messages: deque[can.Message] = deque()
        super().__init__(channel="a transcript")

    @property
    def waiting(self) -> bool:
        """Whether a message has come that nobody has taken yet."""
        return bool(self._messages)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Return the next message that has come; raises OSError."""
        if not self._messages:
            self._messages.extend(map(message_of, self._far.messages()))
        return (self._messages.popleft() if self._messages else None), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Give a frame to the far end."""
        self._far.write(frame_text(msg.arbitration_id, bytes(msg.data)).encode())


Bus = Socketcand | TextBus | Adapter


def frame_text(identifier: int, data: bytes) -> str:
    """Return a frame as a trace has it."""
    return f"{identifier:03X}#{data.hex().upper()}"


def message_of(text: bytes) -> can.Message:
    """Return the frame that a trace has written."""
    name, _, rest = text.decode("ascii").partition("#")
    data = bytes.fromhex(rest.partition(" ")[0])
    return can.Message(arbitration_id=int(name, 16), data=data, is_extended_id=len(name) > 3)


@dataclass(frozen=True)
class Frame:
    """A received frame: identifier, data and the run time at which it reached the computer."""

    identifier: int
    data: bytes
    arrival_s: float


class CanLine(KeptFrames[Frame]):
    """One connection to a CAN bus: `socketcand://host:port/channel`, or `can://INTERFACE/CHANNEL`.

    Frames of the kernel's or the adapter's stamps arrive when they were stamped, others when they
    are taken; the log has which. `names` are the frames that the instrument sends or takes, by
    identifier: what else is on the bus is not kept.
    """

    line = "the CAN bus"
    when_broken = "check the adapter, its cable and socketcand, then start again"

    def __init__(self, place: Place, names: Mapping[int, str]) -> None:
        parts = urlsplit(place.address)
        is_adapter = parts.scheme == SCHEME
        wire = place.address if is_adapter else parts.netloc
        super().__init__(place, wire, lambda frame: frame.identifier)
        self._names = names
        self._stamped: StampedTime | None = None
        try:
            self._bus: Bus = self._adapter() if is_adapter else self._daemon()
        except OSError as error:
            do = "check the adapter, its driver and that nobody else has it open"
            raise self._nobody_answers(
                reason_of(error), do if is_adapter else "start socketcand, check the adapter"
            ) from error
        self._begin_to_read()

    def _daemon(self) -> Bus:
        parts = urlsplit(self._place.address)
        channel = parts.path.strip("/")
        if parts.scheme != "socketcand" or not parts.hostname or not parts.port or not channel:
            raise self._no_address("this is no CAN address", "write socketcand://host:port/channel")
        if far := self._wire.port():
            return TextBus(far)
        return Socketcand(parts.hostname, parts.port, channel, self._passed_over)

    def _adapter(self) -> Bus:
        try:
            address = can_address(self._place.address)
        except ValueError as error:
            raise self._no_address(str(error), "correct the address") from error
        if far := self._wire.port():
            return TextBus(far)
        bus = Adapter(address)
        self._stamped = None if address.stamps == "computer" else StampedTime()
        self._place.note("can-time-stamps", of=address.stamps, interface=address.interface)
        return bus

    def _no_address(self, why: str, do: str) -> InstrumentError:
        return self._fault(f"open {self._place.address!r}", why, f"{do} in the bench file")

    def send(self, identifier: int, data: bytes) -> None:
        """Put a frame on the bus."""
        self._traced_frame(">", identifier, data)
        self._wire.sent(1)
        try:
            message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            self._bus.send(message)
        except OSError as error:
            raise self._broken(reason_of(error)) from error

    def _shut(self) -> None:
        self._bus.shutdown()

    def _read(self, within_s: float) -> bool:
        try:
            messages = self._received(within_s)
        except (OSError, ValueError) as error:
            return self._died(error)
        arrival_s, frames = self._clock.now(), []
        for message in messages:
            identifier, data = message.arbitration_id, bytes(message.data)
            if message.is_error_frame:
                self._traced("!", f"error frame {identifier:X}".encode())
                continue
            self._traced_frame("<", identifier, data)
            if identifier in self._names:
                stamped = self._stamped
                came_s = stamped.run_time(message.timestamp, arrival_s) if stamped else arrival_s
                frames.append(Frame(identifier, data, came_s))
        self._keep(frames)
        self._wire.picked_up(sum(not message.is_error_frame for message in messages))
        return bool(messages)

    def _received(self, within_s: float) -> list[can.Message]:
        """Return all messages that have come, or the first that come within a real time."""
        message = self._bus.recv(within_s)
        messages = [] if message is None else [message]
        while self._bus.waiting:
            messages.append(self._bus.recv(0.0))
        return messages

    def _passed_over(self, data: bytes) -> None:
        self._traced("!", data[:MAX_TRACE] + b": no message of socketcand")

    def _traced_frame(self, direction: str, identifier: int, data: bytes) -> None:
        if self._trace is not None:
            name = self._names.get(identifier, "")
            text = f"{frame_text(identifier, data)} {name}".rstrip()
            self._trace(direction, text.encode())
