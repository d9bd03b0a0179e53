"""Go through a raw file block by block, past whatever in it is damaged.

Everything in a raw file has a second witness: a block's records their check sum, its lengths each
other, its times each other, its number those of the blocks around it, beginning and end of the file
what every raw file begins and ends with. What disagrees is a damaged part; the next whole block is
looked for behind it.
"""

from __future__ import annotations

import io
import math
import os
import re
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.records import Channel, DataEnd, Footer, Header, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from station.record.scan import (
    CUT,
    DAMAGED_BLOCK,
    DAMAGED_END,
    DAMAGED_HEAD,
    MISPLACED,
    MISSING,
    NAMELESS,
    NEVER,
    BlockOrder,
    Part,
    Scan,
)

NANOSECONDS = 1_000_000_000


def _head() -> bytes:
    records = RecordBuilder()
    Header(profile="", library="").write(records)
    return bytes(MCAP0_MAGIC + records.end())


def _end() -> bytes:
    records = RecordBuilder()
    DataEnd(data_section_crc=0).write(records)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(records)
    return bytes(records.end() + MCAP0_MAGIC)


def _schema() -> bytes:
    records = RecordBuilder()
    SCHEMA.write(records)
    return bytes(records.end())


SCHEMA = Schema(id=1, name="npy", encoding="", data=b"")
SCHEMA_RECORD = _schema()
HEAD, END = _head(), _end()
"""With what every raw file begins, and ends where its process came to its end."""

CHUNK = struct.Struct("<BQQQQIIQ")
"""Kind, length, first and last time, size, check sum, compression (none), length of the records."""
CHUNK_KIND, MESSAGE_KIND, CHANNEL_KIND = 6, 5, 4
BEFORE_RECORDS = CHUNK.size - 9
MESSAGE = struct.Struct("<BQHIQQ")
"""Kind, length, channel, number, time of the log, time of publication; the rows follow."""
CHANNEL = struct.Struct("<BQHHI")
"""Kind, length, channel, schema, length of its topic; the topic follows."""
MAX_OF_A_NAME = 1 << 12
FEW = 4
CHUNK_BEGINS = re.compile(rb"\x06.{8}(.{8})\1(.{8}).{4}\x00\x00\x00\x00\2", re.DOTALL)
WINDOW = 1 << 20


@dataclass(frozen=True)
class _RawBlock:
    """A whole block as it stands in a file; `named` is the unit of work that it announces.

    `number` counts the blocks of a file from 0; `source` is announced with the unit.
    """

    length: int
    channel: int
    number: int
    time_ns: int
    named: str | None = None
    source: str | None = None


@dataclass(frozen=True)
class _Loose:
    """A damaged part, with time and channel of its block where these can be read."""

    began: int
    length: int
    what: str
    time_ns: int | None = None
    channel: int | None = None
    named: str | None = None


def scan(path: Path) -> Scan:
    """Return the blocks and the damaged parts of a raw file; each block's check sum is proven.

    The file is read once, a block at a time, and once more where its blocks are not in their order.
    Raises OSError where it cannot be.
    """
    order = BlockOrder()
    scanned = _scan(path, order, ())
    misplaced = order.misplaced()
    return _scan(path, BlockOrder(), misplaced) if misplaced else scanned


def _scan(path: Path, order: BlockOrder, misplaced: Collection[int]) -> Scan:
    """Return what a raw file holds; `misplaced` are the bytes where blocks begin that do not count.

    The order of all its whole blocks is added to `order`.
    """
    scan = Scan()
    units: dict[int, str] = {}
    guessed: dict[int, str] = {}
    loose: list[_Loose] = []
    last: str | None = None
    number = -1
    with path.open("rb") as file:
        scan.size = os.fstat(file.fileno()).st_size
        if file.read(len(HEAD)) != HEAD and scan.size:
            scan.parts.append(Part(0, len(HEAD), DAMAGED_HEAD, *NEVER))
        file.seek(max(scan.size - len(END), 0))
        tail = file.read()
        scan.sealed = tail == END
        end = scan.size - len(END) if scan.sealed else scan.size
        at = min(len(HEAD), end)
        while at < end:
            block = block_at(file, at, end)
            if block is None:
                damaged = _damaged(file, at, end)
                loose.append(damaged)
                if damaged.named is not None and damaged.channel is not None:
                    guessed[damaged.channel] = damaged.named
                at += damaged.length
                continue
            order.add(at, block.number, block.time_ns)
            if block.source is not None:
                scan.sources.add(block.source)
            if at in misplaced:
                loose.append(_Loose(at, block.length, MISPLACED))
                at += block.length
                continue
            if block.named is not None:
                units[block.channel] = block.named
            if block.channel in units:
                time_s = block.time_ns / NANOSECONDS
                around = (last, units[block.channel])
                if _lacks(block.number - number - 1, loose):
                    loose.append(_Loose(at, 0, MISSING))
                scan.add_parts([_bounded(part, scan, time_s, units, around) for part in loose])
                loose.clear()
                scan.add(units[block.channel], at, block.length)
                last, scan.last_s, number = units[block.channel], time_s, block.number
            else:
                name = guessed.get(block.channel)
                loose.append(_Loose(at, block.length, NAMELESS, block.time_ns, None, name))
            at += block.length
    scan.add_parts([_bounded(part, scan, math.inf, units, (last,)) for part in loose])
    if scan.parts and scan.parts[-1].what == CUT and _is_end(tail, scan):
        scan.parts[-1] = Part(end - len(END), len(END), DAMAGED_END, *NEVER)
    return scan


def _lacks(between: int, loose: Sequence[_Loose]) -> bool:
    """Whether fewer blocks stand between two whole ones than their numbers say.

    Where the length of a block is damaged nobody knows how many there were.
    """
    return between > len(loose) and all(part.what != DAMAGED_BLOCK for part in loose)


def _is_end(tail: bytes, scan: Scan) -> bool:
    """Whether what stands behind the last block is a file's end, but for a few bytes."""
    alike = sum(byte == right for byte, right in zip(tail, END, strict=False))
    return scan.parts[-1].length == len(END) and alike >= len(END) - FEW


def _bounded(
    part: _Loose,
    scan: Scan,
    after_s: float,
    units: Mapping[int, str],
    around: tuple[str | None, ...],
) -> Part:
    """Return a damaged part with its times and units: its own, or those around it."""
    time_s = math.nan if part.time_ns is None else part.time_ns / NANOSECONDS
    stated = units.get(part.channel) if part.channel is not None else None
    if part.what == NAMELESS:  # all but its name is proven, its time too
        guessed = () if part.named is None else (part.named,)
        return Part(part.began, part.length, part.what, time_s, time_s, guessed)
    if part.what in (MISPLACED, MISSING):  # what it says of itself is true of another place
        known = tuple(dict.fromkeys(unit for unit in around if unit is not None))
        return Part(part.began, part.length, part.what, scan.last_s, after_s, known)
    beside = tuple(
        dict.fromkeys(unit for unit in (stated, part.named, *around) if unit is not None)
    )
    if not scan.sealed and part.began + part.length == scan.size and part.time_ns is None:
        return Part(part.began, part.length, CUT, scan.last_s, math.inf, beside)
    if scan.last_s <= time_s <= after_s:
        sure = beside if stated is None else (stated,)
        return Part(part.began, part.length, part.what, time_s, time_s, sure)
    return Part(part.began, part.length, part.what, scan.last_s, after_s, beside)


def block_at(file: IO[bytes], at: int, end: int) -> _RawBlock | None:
    """Return the whole block that begins at a byte of a file and ends before `end`, or None."""
    file.seek(at)
    head = file.read(CHUNK.size)
    if len(head) < CHUNK.size:
        return None
    kind, length, first_ns, last_ns, size, crc, compression, inner = CHUNK.unpack(head)
    right = kind == CHUNK_KIND and length == inner + BEFORE_RECORDS and size == inner
    if not right or first_ns != last_ns or compression or at + CHUNK.size + inner > end:
        return None
    records = file.read(inner)
    if len(records) != inner or zlib.crc32(records) != crc:
        return None
    return _message_in(records, first_ns)


def _message_in(records: bytes, time_ns: int) -> _RawBlock | None:
    """Return the message of proven records where its times are those of its chunk."""
    length = CHUNK.size + len(records)
    if records[:1] == bytes([MESSAGE_KIND]) and len(records) >= MESSAGE.size:
        _, inner, channel, number, logged_ns, published_ns = MESSAGE.unpack_from(records)
        if inner + 9 == len(records) and logged_ns == published_ns == time_ns:
            return _RawBlock(length, channel, number, time_ns)
        return None
    source = named = None
    try:
        for record in StreamReader(io.BytesIO(records), skip_magic=True).records:
            if isinstance(record, Channel):
                source, named = record.topic.split("/", 1)
            elif isinstance(record, Message):
                if not record.log_time == record.publish_time == time_ns:
                    return None
                return _RawBlock(length, record.channel_id, record.sequence, time_ns, named, source)
    except (McapError, struct.error, ValueError, IndexError):
        return None
    return None


def _damaged(file: IO[bytes], at: int, end: int) -> _Loose:
    """Return how far the damage at a byte reaches, and time and channel where they can be read.

    A block whose lengths agree, two of the three, ends where they say. Else all is damaged as far
    as the next whole block.
    """
    file.seek(at)
    head = file.read(CHUNK.size + MAX_OF_A_NAME)
    if len(head) < CHUNK.size:
        return _Loose(at, end - at, DAMAGED_BLOCK)
    _, length, _, _, size, _, _, inner = CHUNK.unpack_from(head)
    lengths = (length - BEFORE_RECORDS, size, inner)
    likely, count = Counter(lengths).most_common(1)[0]
    stops = at + CHUNK.size + likely
    if count < 2 or likely <= 0 or stops > end or not _may_begin(file, stops, end):
        stops = next_block(file, at + 1, end)
        if stops - at - CHUNK.size not in lengths:
            return _Loose(at, stops - at, DAMAGED_BLOCK)
    return _Loose(at, stops - at, DAMAGED_BLOCK, *_said(head))


def _may_begin(file: IO[bytes], at: int, end: int) -> bool:
    """Whether a block may begin at a byte, or the file end there."""
    file.seek(at)
    return at == end or file.read(1) == bytes([CHUNK_KIND])


def _said(head: bytes) -> tuple[int | None, int | None, str | None]:
    """Return what a damaged block says of itself: its time, its channel, the unit it announces.

    The time is the one that two of its four copies agree on.
    """
    _, _, first_ns, last_ns, *_ = CHUNK.unpack_from(head)
    times, channel, named = [first_ns, last_ns], None, None
    records = head[CHUNK.size :]
    if records[:1] == bytes([MESSAGE_KIND]) and len(records) >= MESSAGE.size:
        _, _, channel, _, *more = MESSAGE.unpack_from(records)
        times += more
    else:
        channel, named = _announced(records)
    time_ns, count = Counter(times).most_common(1)[0]
    return (time_ns if count >= 2 else None), channel, named


def _announced(records: bytes) -> tuple[int | None, str | None]:
    """Return the channel and the unit that damaged records announce, None where none is read."""
    at = len(SCHEMA_RECORD) if records[:1] == SCHEMA_RECORD[:1] else 0
    if len(records) < at + CHANNEL.size:
        return None, None
    kind, _, channel, _, length = CHANNEL.unpack_from(records, at)
    topic = records[at + CHANNEL.size : at + CHANNEL.size + length].decode("utf-8", "replace")
    if kind != CHANNEL_KIND or "/" not in topic:
        return None, None
    return channel, topic.split("/", 1)[1]


def next_block(file: IO[bytes], at: int, end: int) -> int:
    """Return where the first whole block at or behind a byte begins, `end` where there is none."""
    while at < end:
        file.seek(at)
        window = file.read(min(WINDOW, end - at))
        for match in CHUNK_BEGINS.finditer(window):
            if block_at(file, at + match.start(), end) is not None:
                return at + match.start()
        if len(window) <= CHUNK.size:
            break
        at += len(window) - CHUNK.size + 1
    return end
