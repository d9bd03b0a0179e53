"""The checksum of frames on serial lines: CRC-32 as the data sheet of STIM300 (TS1524) has it.

Polynomial 0x04C11DB7, seed 0xFFFFFFFF, not reflected, no final XOR; written from that alone. Of as
many bytes as a multiple of four it is CRC-32/MPEG-2.
"""

from __future__ import annotations

POLYNOMIAL, SEED = 0x04C11DB7, 0xFFFFFFFF


def _table() -> list[int]:
    table = []
    for top in range(256):
        remainder = top << 24
        for _ in range(8):
            carry = remainder >> 31
            remainder = (remainder << 1 & 0xFFFFFFFF) ^ (POLYNOMIAL if carry else 0)
        table.append(remainder)
    return table


TABLE = _table()


def crc32(data: bytes) -> int:
    """Return the checksum of a frame: zero bytes fill it up to a multiple of four."""
    crc = SEED
    for byte in data + b"\0" * (-len(data) % 4):
        crc = (crc << 8 & 0xFFFFFFFF) ^ TABLE[crc >> 24 ^ byte]
    return crc
