"""Binary frames that an instrument sends unasked, over a serial port or the TCP port of one."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from threading import Event, Lock, Thread
from typing import NamedTuple

from drivers.roles import Place
from drivers.transport.serial_port import (
    Framing,
    Port,
    framing_of,
    one_line,
    open_port,
    wire_address,
)
from station.errors import InstrumentError

READ_SLICE_S = 0.2
LOOK_S = 0.005


class Split(NamedTuple):
    """What is found in bytes: whole frames by kind, the beginning of one, and bytes of none."""

    frames: list[tuple[int, bytes]]
    rest: bytes
    skipped: int


Splitter = Callable[[bytes], Split]


@dataclass(frozen=True)
class StreamFrame:
    """A received frame: its kind, its payload and the run time at which it reached the computer."""

    kind: int
    payload: bytes
    arrival_s: float


class SerialStream:
    """One instrument's line, read by a thread that stamps; frames wait until somebody takes them.

    `split` knows the instrument's frames. Bytes that belong to none are passed over and told to
    the trace: whoever counts frames sees what is missing. Settings that a bench file may give are
    those of a serial line: `baud_rate`, `data_bits`, `parity`, `stop_bits`, `hardware_handshake`.
    """

    def __init__(self, place: Place, framing: Framing, split: Splitter) -> None:
        self._place = place
        self._clock = place.clock
        self._trace = place.trace
        self._split = split
        self._frames: deque[StreamFrame] = deque()
        self._frames_lock = Lock()
        self._closing = Event()
        self._dead: str | None = None
        self._wire = place.clock.wire(wire_address(place.address))
        chosen = framing_of(place, framing)
        try:
            self._port: Port = open_port(place.address, chosen)
        except (OSError, ValueError) as error:
            raise self._fault(
                f"open {place.address}",
                f"nobody answers there ({one_line(error)})",
                "switch the instrument on, check its cable and the address in the bench file",
            ) from error
        self._wire.open()
        self._traced("-", b"opened")
        self._reader = Thread(target=self._read, name=f"{place.name} reader", daemon=True)
        self._reader.start()

    def send(self, data: bytes) -> None:
        """Put bytes on the line."""
        self._traced(">", data)
        self._wire.sent(len(data))
        try:
            self._port.write(data)
        except OSError as error:
            raise self._broken(one_line(error)) from error

    def take(self, *kinds: int) -> list[StreamFrame]:
        """Return the received frames of these kinds, in order, and keep the others.

        Raises InstrumentError when the line is gone and nothing is left to take.
        """
        with self._frames_lock:
            taken = [frame for frame in self._frames if frame.kind in kinds]
            if taken:
                kept = [frame for frame in self._frames if frame.kind not in kinds]
                self._frames.clear()
                self._frames.extend(kept)
        if not taken and self._dead is not None:
            raise self._broken(self._dead)
        return taken

    def newest(self, kind: int) -> StreamFrame | None:
        """Return the last received frame of a kind that nobody has taken yet, and keep it.

        Raises InstrumentError when the line is gone.
        """
        with self._frames_lock:
            found = next((one for one in reversed(self._frames) if one.kind == kind), None)
        if found is None and self._dead is not None:
            raise self._broken(self._dead)
        return found

    def wait_for(self, kind: int, deadline_s: float) -> list[StreamFrame]:
        """Return the frames of a kind as soon as there are any, or none at run time.

        Raises InstrumentError when the line is gone.
        """
        while not (frames := self.take(kind)) and self._clock.now() < deadline_s:
            self._clock.sleep(LOOK_S)
        return frames

    def close(self) -> None:
        """Close the line and end the reader; a line that is already gone is no error."""
        if not self._closing.is_set():
            self._traced("-", b"closed")
        self._closing.set()
        self._wire.close()
        self._reader.join(2 * READ_SLICE_S)
        with suppress(OSError):
            self._port.close()

    def _read(self) -> None:
        pending = b""
        while not self._closing.is_set():
            try:
                data = self._port.read(READ_SLICE_S)
            except (OSError, ValueError, TypeError) as error:  # pyserial on a port that vanished
                if not self._closing.is_set():
                    self._dead = one_line(error) or type(error).__name__
                # Nothing that is still on its way can come any more.
                self._wire.close()
                return
            if not data:
                continue
            self._traced("<", data)
            found = self._split(pending + data)
            pending = found.rest
            arrival_s = self._clock.now()
            if found.frames:
                with self._frames_lock:
                    self._frames.extend(
                        StreamFrame(kind, payload, arrival_s) for kind, payload in found.frames
                    )
            if found.skipped:
                self._traced("!", f"{found.skipped} bytes that belong to no frame".encode())
            self._wire.picked_up(len(data))

    def _traced(self, direction: str, data: bytes) -> None:
        if self._trace is not None:
            self._trace(direction, data)

    def _broken(self, why: str) -> InstrumentError:
        return self._fault(
            "used the line",
            f"it broke ({why})",
            "check the cable and the instrument's power, then start again",
        )

    def _fault(self, attempted: str, came_back: str, do_now: str) -> InstrumentError:
        self._traced("!", f"{attempted}: {came_back}".encode())
        return InstrumentError(self._place.name, attempted, came_back, do_now)
