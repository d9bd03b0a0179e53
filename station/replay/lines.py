"""Which line of a transcript is not as it was recorded, and which byte of it.

Beside each transcript lie the check sums of its lines, Adler-32 and CRC-32 in hexadecimal: one byte
that is another is found by the first, and what it was is proved by the second.
"""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

from station.instruments.trace import LINE_SUMS, sums_of
from station.replay.deviations import MAX_SHOWN, shown

MODULUS = 65521
"""Of both halves of Adler-32."""
MESSAGE_AT = 16
"""Before the message of a line stand its time and direction."""


def changed_lines(transcript: Path) -> list[str]:
    """Return a sentence for each line, of many the first, that is not as its check sums have it."""
    sums = transcript.with_suffix(LINE_SUMS)
    if not sums.is_file():
        return []
    lines = transcript.read_bytes().split(b"\n")[:-1]
    recorded = sums.read_text(encoding="ascii", errors="replace").split()
    pairs = enumerate(zip(lines, recorded, strict=False), 1)
    changed = [(number, *pair) for number, pair in pairs if sums_of(pair[0]) != pair[1]]
    return [
        sentence(transcript.stem, number, line.rstrip(b"\r"), known)
        for number, line, known in changed[:MAX_SHOWN]
    ]


def sentence(instrument: str, number: int, line: bytes, known: str) -> str:
    """Return what is to be said about a line that is not as it was recorded."""
    time_s = line[:13].decode("ascii", "replace").strip()
    was = restored(line, known)
    if was is None:
        return (
            f"{instrument} at {time_s} s (line {number}): "
            "more than one byte was changed since it was recorded"
        )
    place = next(n for n, (old, new) in enumerate(zip(was, line, strict=True), 1) if old != new)
    begin = MESSAGE_AT if place > MESSAGE_AT else 0
    old, new = was[begin:], line[begin:]
    return (
        f"{instrument} at {time_s} s (line {number}), byte {place}: "
        f"recorded {once(shown(old, new))}, is {once(shown(new, old))}"
    )


def once(text: str) -> str:
    """Return what was shown of a transcript's text, which is escaped already, escaped once."""
    return text.replace("\\\\", "\\")


def restored(line: bytes, known: str) -> bytes | None:
    """Return the line as it was where one byte of it is another now, else None."""
    try:
        adler, crc = int(known[:8], 16), int(known[8:], 16)
    except ValueError:
        return None
    now = int(sums_of(line)[:8], 16)
    change = signed((adler & 0xFFFF) - (now & 0xFFFF))
    weighted = (adler >> 16) - (now >> 16)
    if not 0 < abs(change) < 256:
        return None
    from_end = weighted * pow(change, -1, MODULUS) % MODULUS or MODULUS
    for place in range(len(line) - from_end, -1, -MODULUS):
        if 0 <= line[place] + change < 256:
            was = line[:place] + bytes([line[place] + change]) + line[place + 1 :]
            if crc32(was) == crc:
                return was
    return None


def signed(difference: int) -> int:
    """Return the number nearest zero that is the difference, but for multiples of the modulus."""
    rest = difference % MODULUS
    return rest - MODULUS if rest > MODULUS // 2 else rest
