"""The CRC-32 that is sent most significant bit first: CRC-32/MPEG-2."""

from __future__ import annotations

import zlib

REVERSED = bytes(int(f"{one:08b}"[::-1], 2) for one in range(256))
ALL_ONES = 0xFFFFFFFF


def crc32_mpeg2(data: bytes) -> int:
    """Return the CRC-32 of polynomial 0x04C11DB7 from all ones, most significant bit first.

    Neither input nor result is reflected, and nothing is XORed at the end. The library's CRC is the
    same one reflected: so are its input and its result here.
    """
    reflected = zlib.crc32(data.translate(REVERSED)) ^ ALL_ONES
    return int.from_bytes(reflected.to_bytes(4, "little").translate(REVERSED), "big")


def crc32_stim300(data: bytes) -> int:
    """Return the CRC-32 of STIM300: that of MPEG-2 over zero bytes, too, that are not sent.

    They fill up to a multiple of four (TS1524, table 5-22).
    """
    return crc32_mpeg2(data + bytes(-len(data) % 4))


def ends_with_its_crc(data: bytes) -> bool:
    """Return whether the last four bytes are the CRC of those before, most significant first.

    The CRC of all of them is zero then.
    """
    return zlib.crc32(data.translate(REVERSED)) == ALL_ONES
