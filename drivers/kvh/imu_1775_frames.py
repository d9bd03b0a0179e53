"""What a KVH 1775 puts on its line: frames of format C, of its built-in test, and lines of text."""

from __future__ import annotations

import re

import numpy as np

from drivers.transport.serial_stream import Split, ends_with_its_crc

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
