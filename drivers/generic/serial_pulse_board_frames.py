"""The datagrams of the serial pulse board, laid out as by `serial_pulse_board.py` beside it."""

from __future__ import annotations

import struct

from drivers.transport.serial_stream import Split, crc32_stim300

COMMAND, OUTPUT, ACKNOWLEDGEMENT, STATUS, IDENTITY = 0x60, 0x94, 0x61, 0x62, 0x63
CHECKSUM = struct.Struct(">I")
COMMAND_PAYLOAD = struct.Struct(">BBIH")
PAYLOADS = {
    OUTPUT: struct.Struct(">3s3s3sB3hBBH"),
    ACKNOWLEDGEMENT: struct.Struct(">BBHI"),
    STATUS: struct.Struct(">I4B"),
    IDENTITY: struct.Struct(">I4B"),
}
LENGTHS = {kind: 1 + one.size + CHECKSUM.size for kind, one in PAYLOADS.items()}


def frame(kind: int, payload: bytes) -> bytes:
    """Return a whole datagram."""
    data = bytes((kind,)) + payload
    return data + CHECKSUM.pack(crc32_stim300(data))


def split(pending: bytes) -> Split:
    """Return the datagrams that bytes hold.

    There are no sync bytes: a datagram is where an identifier, its length and the right checksum
    come together. What may be the beginning of one is kept, unless a whole one follows it.
    """
    frames: list[tuple[int, bytes]] = []
    position = taken = skipped = 0
    begun: int | None = None
    while position < len(pending):
        kind = pending[position]
        end = position + LENGTHS.get(kind, 0)
        if end > len(pending) and begun is None:
            begun = position
        if position < end <= len(pending):
            body = pending[position : end - CHECKSUM.size]
            if CHECKSUM.unpack_from(pending, end - CHECKSUM.size)[0] == crc32_stim300(body):
                frames.append((kind, body[1:]))
                skipped += position - taken
                position = taken = end
                begun = None
                continue
        position += 1
    end = len(pending) if begun is None else begun
    return Split(frames, pending[end:], skipped + end - taken)
