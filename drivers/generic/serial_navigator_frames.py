"""The frames of the navigator's RS-422 line, laid out as by `serial_navigator.py` beside it."""

from __future__ import annotations

import struct

from drivers.transport.serial_stream import Split, crc32_stim300

SYNC = b"\x9a\x65"
LONGEST_PAYLOAD = 32
COMMAND, OUTPUT, ACKNOWLEDGEMENT, STATUS, IDENTITY = 0x10, 0x90, 0x91, 0x92, 0x93

HEAD = struct.Struct(">2sBB")
CHECKSUM = struct.Struct(">I")
COMMAND_PAYLOAD = struct.Struct(">BHi")
PAYLOADS = {
    OUTPUT: struct.Struct(">HIii3hH"),
    ACKNOWLEDGEMENT: struct.Struct(">BBHB"),
    STATUS: struct.Struct(">HHHB"),
    IDENTITY: struct.Struct(">I4B"),
}


def frame(kind: int, payload: bytes) -> bytes:
    """Return a whole frame."""
    data = HEAD.pack(SYNC, kind, len(payload)) + payload
    return data + CHECKSUM.pack(crc32_stim300(data))


def split(pending: bytes) -> Split:
    """Return the frames that bytes hold; after a wrong checksum the next sync bytes are looked for.

    A frame with the length of none, or of a kind whose payload has another, counts as damaged.
    """
    frames: list[tuple[int, bytes]] = []
    position, skipped = 0, 0
    while True:
        begin = pending.find(SYNC, position)
        if begin < 0:
            # The last byte may be the first of a sync.
            end = len(pending) - (pending[-1:] == SYNC[:1] and position < len(pending))
            return Split(frames, pending[end:], skipped + end - position)
        skipped += begin - position
        if len(pending) < begin + HEAD.size:
            return Split(frames, pending[begin:], skipped)
        _, kind, length = HEAD.unpack_from(pending, begin)
        end = begin + HEAD.size + length + CHECKSUM.size
        if length <= LONGEST_PAYLOAD:
            if len(pending) < end:
                return Split(frames, pending[begin:], skipped)
            body = pending[begin : end - CHECKSUM.size]
            right = crc32_stim300(body) == CHECKSUM.unpack_from(pending, end - CHECKSUM.size)[0]
            if right and kind in PAYLOADS and PAYLOADS[kind].size == length:
                frames.append((kind, body[HEAD.size :]))
                position = end
                continue
        skipped += 1
        position = begin + 1
