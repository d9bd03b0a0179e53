"""Frames and lines of text of a KVH 1775: outputs, its built-in test, and what it answers."""

from __future__ import annotations

import re

import numpy as np

from drivers.transport.serial_stream import Split, ends_with_its_crc

MARK = b"\xfe\x81"
OUTPUT, TEXT, SELF_TEST, OTHER_OUTPUT = 0x57, 0x00, 0xAA, 0x55
OUTPUT_HEADER, OUTPUT_BYTES = b"\xfe\x81\xff\x57", 38
HEADERS: dict[bytes, tuple[int, int]] = {
    OUTPUT_HEADER: (OUTPUT, OUTPUT_BYTES),
    b"\xfe\x81\xff\x55": (OTHER_OUTPUT, 36),
    b"\xfe\x81\xff\x56": (OTHER_OUTPUT, 40),
    b"\xfe\x81\x00\xaa": (SELF_TEST, 11),
}
"""By header: the kind of a frame and its length, header and check sum included."""
HEADER_BYTES = 4
CHECKSUM_BYTES = 4
LINE = re.compile(rb"([A-Z0-9][ -~]{1,255})\r?\n")
UNFINISHED = re.compile(rb"[A-Z0-9][ -~]{0,255}\r?\Z")
PAYLOAD = np.dtype(
    [("gyro", ">f4", 3), ("force", ">f4", 3), ("further", ">f4"), ("status", "u1"), ("seq", "u1")]
)
"""An output without header and checksum; `further` by `seq` modulo 4: temperature, field x y z."""


def split(pending: bytes) -> Split:
    """Return the frames and lines that bytes hold, frames only with the right check sum.

    After a wrong one the next header is looked for. Of outputs in formats A and B only that they
    came is returned.
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
        elif kind == OTHER_OUTPUT and ends_with_its_crc(pending[begin:position]):
            frames.append((kind, b""))
        elif kind == SELF_TEST and ends_with_its_sum(pending[begin:position]):
            frames.append((kind, pending[begin + HEADER_BYTES : position - 1]))
        else:
            position = begin
        if position == begin:  # damaged, or no frame
            skipped += 1
            position = begin + 1


def ends_with_its_sum(data: bytes) -> bool:
    """Return whether the last byte is the sum of those before, modulo 256."""
    return sum(data[:-1]) % 256 == data[-1]


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
    lines = [match.group(1) for match in LINE.finditer(data)]
    frames += [(TEXT, line) for line in lines]
    return len(data) - sum(len(match.group(0)) for match in LINE.finditer(data))


def _beginning(data: bytes) -> bytes:
    """Return the end of bytes that may be the beginning of a header or of a line."""
    if data.endswith(MARK[:1]):
        return data[-1:]
    match = UNFINISHED.search(data)
    return match.group(0) if match else b""
