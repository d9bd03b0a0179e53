"""KVH 1775 fibre-optic IMU on RS-422, nine axes in frames of format C.

921600 Bd, 8 data bits, no parity, one stop bit unless the bench file says otherwise. From public
clients: the frame (header FE 81 FF 57, three gyros and three accelerometers as floats, one further
float, status, sequence number 0 to 127, CRC-32/MPEG-2; 38 bytes), that the further float is by
turns the temperature and the magnetometers X, Y, Z in gauss, `=config,1` and `=config,0` about the
settings `=dr`, `=rotfmt`, `=tempunits`, and `?bit`, answered by a frame.

From general knowledge, not from the manual: `=outputfmt,C`, `=rotunits,DEG`, the queries `?is`
(serial number) and `?ws` (firmware); that accelerometers are in g; that a setting or query is
answered with its name, a comma and the value in force; that status bits 0, 1, 2 (gyros) and 4, 5, 6
(accelerometers) are set while the axis is valid; that a bit of a built-in test is set while the
part is well, the highest bit of each byte aside; which rates there are. Whatever is set is compared
with what the unit answers, so that a unit that does otherwise ends in an error and not in wrong
numbers.

The unit streams from power-up on. This driver keeps it in its configuration mode, where it is
quiet, until it is started, and lets it stream again when it is closed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.generic.nine_axis import ACCELEROMETERS, GYROS, MAGNETOMETERS, ROW, NineAxisSource
from drivers.transport.retry import Repeatable
from drivers.transport.serial_port import BaudRate, SerialSettings
from drivers.transport.serial_stream import (
    Counting,
    Numbering,
    SerialStream,
    Split,
    StreamFrame,
    ends_with_its_crc,
)
from station.errors import InputError, InstrumentError, InstrumentTimeout
from station.roles import Identity, Place, SensorStatus

MARK = b"\xfe\x81"
OUTPUT, TEXT, SELF_TEST = 0x57, 0x00, 0xAA
OUTPUT_HEADER, OUTPUT_BYTES = b"\xfe\x81\xff\x57", 38
HEADERS: dict[bytes, tuple[int, int]] = {
    OUTPUT_HEADER: (OUTPUT, OUTPUT_BYTES),
    b"\xfe\x81\x00\xaa": (SELF_TEST, 11),
}
"""By header: the kind of a frame and its length, header and check sum included."""
HEADER_BYTES = 4
CHECKSUM_BYTES = 4
LINE = re.compile(rb"([A-Z][ -~]{1,63})\r?\n")
UNFINISHED = re.compile(rb"[A-Z][ -~]{0,63}\r?\Z")
PAYLOAD = np.dtype(
    [("gyro", ">f4", 3), ("force", ">f4", 3), ("further", ">f4"), ("status", "u1"), ("seq", "u1")]
)
"""An output without header and checksum; `further` by `seq` modulo 4: temperature, field x y z."""


def split(pending: bytes) -> Split:
    """Return the frames and lines that bytes hold; outputs only with the right checksum.

    After a wrong one the next header is looked for. The check sum of a built-in test, whose rule
    is not known, is not looked at.
    """
    frames: list[tuple[int, bytes]] = []
    position, skipped = 0, 0
    while True:
        begin = pending.find(MARK, position)
        if begin < 0:
            rest = _beginning(pending[position:])
            end = len(pending) - len(rest)
            skipped += _lines(pending[position:end], frames)
            return Split(frames, rest, skipped)
        skipped += _lines(pending[position:begin], frames)
        header = pending[begin : begin + HEADER_BYTES]
        kind, length = HEADERS.get(header, (TEXT, 0))
        if len(header) < HEADER_BYTES or len(pending) < begin + length:
            return Split(frames, pending[begin:], skipped)
        position = begin + length
        if kind == OUTPUT:
            position = _outputs(pending, begin, frames)
        elif kind != TEXT:
            frames.append((kind, pending[begin + HEADER_BYTES : position - 1]))
        if position == begin:  # damaged, or no frame
            skipped += 1
            position = begin + 1


def _outputs(data: bytes, begin: int, frames: list[tuple[int, bytes]]) -> int:
    """Take the outputs that follow one another from a place on; return where they end.

    They are most of what comes, thousands a second.
    """
    while data.startswith(OUTPUT_HEADER, begin) and len(data) >= begin + OUTPUT_BYTES:
        end = begin + OUTPUT_BYTES
        if not ends_with_its_crc(data[begin:end]):
            break
        frames.append((OUTPUT, data[begin + HEADER_BYTES : end - CHECKSUM_BYTES]))
        begin = end
    return begin


def _lines(data: bytes, frames: list[tuple[int, bytes]]) -> int:
    """Take the lines of text out of bytes between frames; return how many bytes are none."""
    if not data:
        return 0
    found = [match.group(1) for match in LINE.finditer(data)]
    frames += [(TEXT, line) for line in found]
    return len(data) - sum(len(match.group(0)) for match in LINE.finditer(data))


def _beginning(data: bytes) -> bytes:
    """Return the end of bytes that may be the beginning of a header or of a line."""
    if data.endswith(MARK[:1]):
        return data[-1:]
    match = UNFINISHED.search(data)
    return match.group(0) if match else b""


ANSWER_WITHIN_S = 0.5
RATES_HZ = (10, 50, 100, 250, 500, 750, 1000)
SETTINGS = {"outputfmt": "C", "rotfmt": "RATE", "rotunits": "DEG", "tempunits": "C"}
NT_PER_GAUSS = 1e5
VALID_BITS = 0x77
BITS_IN_USE = 7
MODULUS = 128
"""Of the sequence number of frames."""


class Kvh1775(NineAxisSource):
    """A KVH 1775 whose gyros give deg/s, accelerometers g and magnetometers gauss."""

    class Settings(SerialSettings):
        """Its line."""

        baud_rate: BaudRate = 921600

    repeatable: ClassVar[Repeatable] = Repeatable("stop", "identify", "status")
    """Not the start, which sets the counter back."""
    identifies_on: ClassVar[str] = "socket"
    """Where a scan of served instruments may ask `identify`; it knows no `*IDN?`."""

    def __init__(self, place: Place) -> None:
        super().__init__(place)
        self._stream = SerialStream(place, self.Settings.of(place), split)
        self._sequence = Numbering(1.0, MODULUS)
        self._identity: Identity | None = None
        self._configures = False

    def identify(self) -> Identity:
        """Ask for serial number and firmware; a unit that streams is not disturbed twice."""
        if self._identity is None:
            runs = self._streams
            self._configure()
            serial, firmware = self._ask("?is", "IS"), self._ask("?ws", "WS")
            self._identity = Identity("KVH", "1775", serial, firmware)
            if runs:
                self._leave()
        return self._identity

    @classmethod
    def rates_said(cls, rate_Hz: float) -> str:
        """Return in words which rates it has where this is none of them, else nothing."""
        if rate_Hz in RATES_HZ:
            return ""
        there_are = ", ".join(str(one) for one in RATES_HZ)
        return f"a KVH 1775 outputs {there_are} times a second, not {rate_Hz:g} times"

    def start(self, rate_Hz: float) -> None:
        """Begin to output, the counter from 1; raises InputError for a rate it does not have."""
        if refusal := self.rates_said(rate_Hz):
            raise InputError(f"{self.place.name}: {refusal}; change the plan's sample_rate")
        self._configure()
        for name, value in {**SETTINGS, "dr": f"{rate_Hz:.0f}"}.items():
            answer = self._ask(f"={name},{value}", name.upper())
            if answer.upper() != value:
                raise self.error(
                    f"set {name} to {value}",
                    f"it answered {answer!r}",
                    "check that the unit is a 1775 and this driver fits its firmware",
                )
        self._stream.take(OUTPUT)
        self._sequence = Numbering(1.0 / rate_Hz, MODULUS)
        self._begin(rate_Hz)
        self._leave()

    def stop(self) -> None:
        """End the output; what came before can still be drained."""
        self._streams = False
        self._configure()

    def status(self) -> SensorStatus:
        """Ask for the built-in test."""
        self._stream.take(SELF_TEST)
        self._send("?bit")
        found = self._stream.wait_for(SELF_TEST, self._deadline_s())
        if not found:
            raise self._silent("?bit", "built-in test")
        failed = [
            f"built-in test, byte {place}, bit {bit}"
            for place, byte in enumerate(found[-1].payload, 1)
            for bit in range(BITS_IN_USE)
            if not byte >> bit & 1
        ]
        return SensorStatus(tuple(failed))

    def close(self) -> None:
        """Let it stream again as after power-up, and close the line."""
        if self._configures:
            with suppress(InstrumentError):
                self._send("=config,0")
        self._stream.close()

    def _take(self) -> NDArray[np.void]:
        return self._rows(self._stream.take(OUTPUT), self._sequence.numbers)

    def _newest(self) -> NDArray[np.void]:
        found = self._stream.newest(OUTPUT)
        return self._rows([] if found is None else [found], self._sequence.looked_at)

    def _rows(self, frames: Sequence[StreamFrame], count: Counting) -> NDArray[np.void]:
        """Return outputs of ROW; an output that comes twice or too late is left out."""
        data = np.frombuffer(b"".join(one.payload for one in frames), dtype=PAYLOAD)
        rows = np.zeros(len(data), dtype=ROW)
        arrival_s = np.array([one.arrival_s for one in frames], dtype=np.float64)
        rows["arrival_s"] = arrival_s
        for k, (gyro, force) in enumerate(zip(GYROS, ACCELEROMETERS, strict=True)):
            rows[gyro], rows[force] = data["gyro"][:, k], data["force"][:, k]
        turn = data["seq"] % 4
        further = data["further"].astype(np.float64)
        rows["temperature_degC"] = np.where(turn == 0, further, np.nan)
        for k, name in enumerate(MAGNETOMETERS, 1):
            rows[name] = np.where(turn == k, further * NT_PER_GAUSS, np.nan)
        rows["status"] = ~data["status"] & VALID_BITS
        numbers, new = count(data["seq"], arrival_s)
        rows["counter"] = numbers & 0xFFFF
        return np.asarray(rows[new])

    def _configure(self) -> None:
        self._ask("=config,1", "CONFIG")
        self._configures = True

    def _leave(self) -> None:
        self._ask("=config,0", "CONFIG")
        self._configures = False

    def _ask(self, text: str, name: str) -> str:
        """Send a line and return the value that is answered under a name."""
        self._stream.take(TEXT)
        self._send(text)
        deadline_s = self._deadline_s()
        while found := self._stream.wait_for(TEXT, deadline_s):
            for answer in (one.payload.decode("ascii") for one in found):
                key, _, value = answer.partition(",")
                if key == name:
                    return value.strip()
                if key.startswith("INVALID"):
                    raise self.error(
                        f"sent {text}",
                        f"it answered {answer!r}",
                        "check that the unit is a 1775 and this driver fits its firmware",
                    )
        raise self._silent(text, "answer")

    def _send(self, text: str) -> None:
        self._stream.send(f"{text}\n".encode("ascii"))

    def _deadline_s(self) -> float:
        clock = self.place.clock
        return clock.now() + clock.patience_s(ANSWER_WITHIN_S)

    def _silent(self, text: str, answer: str) -> InstrumentTimeout:
        return InstrumentTimeout(
            self.place.name,
            f"sent {text}",
            f"no {answer} came within {ANSWER_WITHIN_S:g} s",
            "check that the device under test is on, its cable and the baud rate",
        )
