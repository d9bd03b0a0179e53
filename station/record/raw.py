"""Raw samples in MCAP: one file per source and process, one block of rows per message.

Each message is a NumPy `.npy` byte string of a structured array, so any tool that reads MCAP and
NumPy reads it; the channel's metadata gives each column's unit. A block is one chunk and one
write: nothing is held back in memory, and a file cut short loses its last block at most. The
records are put together here, since the MCAP package's writer keeps a note of every chunk in
memory until the file's end.
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from station.errors import DamagedRecord
from station.record.blocks import CHUNK, END, HEAD, NANOSECONDS, SCHEMA, block_at, scan
from station.record.files import AppendOnlyFile, sync_folder
from station.record.scan import Scan
from station.roles.base import ARRIVAL


class RawFile:
    """One source's raw file of this process; all its calls may raise RecordError."""

    def __init__(self, path: Path, source: str, columns: Mapping[str, str]) -> None:
        self._file = AppendOnlyFile(path, new=True)
        self._topic = source
        self._columns = {**columns, ARRIVAL: "s of run time at which the row reached the computer"}
        self._channels: dict[str, int] = {}
        self._sequence = 0
        self._to_sync = True
        self._file.append(HEAD)
        sync_folder(path.parent)

    def write(self, unit: str, rows: NDArray[Any]) -> None:
        """Append a block: a structured array, shape (rows,), that belongs to a unit of work."""
        block = RecordBuilder()
        channel = self._channels.get(unit)
        if channel is None:
            channel = len(self._channels) + 1
            self._announce(block, channel, unit)
        data = io.BytesIO()
        np.save(data, rows, allow_pickle=False)
        time_ns = round(float(rows[ARRIVAL][-1]) * NANOSECONDS)
        Message(
            channel_id=channel,
            log_time=time_ns,
            publish_time=time_ns,
            sequence=self._sequence,
            data=data.getvalue(),
        ).write(block)
        self._file.append(chunk_of(block.end(), time_ns))
        # Only now: a block that was taken back has announced nothing.
        self._channels[unit] = channel
        self._sequence += 1
        self._to_sync = True

    @property
    def size(self) -> int:
        """How many bytes were written."""
        return self._file.size

    def sync(self) -> None:
        """Wait until the disk has all that was written."""
        if self._to_sync:
            self._file.sync()
            self._to_sync = False

    def close(self) -> None:
        """Write the file's end and close it."""
        try:
            self._file.append(END)
            self._file.sync()
        finally:
            self._file.close()

    def _announce(self, block: RecordBuilder, channel: int, unit: str) -> None:
        if channel == 1:
            SCHEMA.write(block)
        Channel(
            id=channel,
            topic=f"{self._topic}/{unit}",
            message_encoding="npy",
            metadata=self._columns,
            schema_id=SCHEMA.id,
        ).write(block)


def chunk_of(records: bytes, time_ns: int) -> bytes:
    """Return the chunk that holds `records`, all of one time."""
    chunk = RecordBuilder()
    Chunk(
        compression="",
        data=records,
        message_start_time=time_ns,
        message_end_time=time_ns,
        uncompressed_crc=zlib.crc32(records),
        uncompressed_size=len(records),
    ).write(chunk)
    return bytes(chunk.end())


def decoded(data: bytes) -> NDArray[Any]:
    """Return the structured array of a `.npy` byte string."""
    length = 10 + int.from_bytes(data[8:10], "little")
    dtype, count = row_type(data[:length])
    return np.frombuffer(data, dtype, count, offset=length)


@lru_cache(maxsize=256)
def row_type(header: bytes) -> tuple[np.dtype[Any], int]:
    """Return type and number of the rows that a `.npy` header announces.

    NumPy parses each header as Python source, which for small blocks takes longer than the rows;
    the blocks of a file have but a few different headers.
    """
    stream = io.BytesIO(header)
    np.lib.format.read_magic(stream)
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    return dtype, int(shape[0])


class RawIndex:
    """Where in a raw file the rows of each unit of work stand; the file is gone through once.

    A file without its end (a crash, a full disk) is read up to its last whole block. A damaged
    block is passed over; `scan.parts` names each.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.scan: Scan = scan(path)

    def __contains__(self, unit: str) -> bool:
        return unit in self.scan.places

    def blocks(self, unit: str, every: int = 1) -> Iterator[NDArray[Any]]:
        """Yield the blocks of a unit of work, or one in `every` of them, as they were written.

        Raises DamagedRecord where a block is not any more what it was when the file was indexed.
        """
        if unit not in self.scan.places:
            return
        began, length = self.scan.places[unit]
        with self._path.open("rb") as file:
            for at, size in zip(began[::every], length[::every], strict=True):
                yield decoded(message_of(file, at, size, self._path).data)


def joined(blocks: Iterable[NDArray[Any]], rows: int) -> Iterator[NDArray[Any]]:
    """Yield blocks put together, `rows` and a block's more at most; one piece at least."""
    waiting: list[NDArray[Any]] = []
    count = 0
    for block in blocks:
        if count >= rows:
            yield np.concatenate(waiting)
            waiting, count = [], 0
        waiting.append(block)
        count += len(block)
    yield np.concatenate(waiting)


def read_blocks(path: Path) -> Iterator[tuple[str, dict[str, str], NDArray[Any]]]:
    """Yield all whole blocks of a file in the order they were written.

    Each comes with its unit of work and with what the driver says of each column. Never more of
    the file than a block at a time is read.
    """
    scanned = scan(path)
    ordered = sorted(
        (at, size, unit)
        for unit, (began, length) in scanned.places.items()
        for at, size in zip(began, length, strict=True)
    )
    described: dict[str, dict[str, str]] = {}
    with path.open("rb") as file:
        for at, size, unit in ordered:
            block = records_of(file, at, size, path)
            for message in block:
                if isinstance(message, Channel):
                    described[unit] = message.metadata
                elif isinstance(message, Message):
                    yield unit, described[unit], decoded(message.data)
                    break


def message_of(file: IO[bytes], at: int, size: int, path: Path) -> Message:
    """Return the message of a block whose check sum holds; raises DamagedRecord."""
    return next(
        record for record in records_of(file, at, size, path) if isinstance(record, Message)
    )


def records_of(file: IO[bytes], at: int, size: int, path: Path) -> Iterator[McapRecord]:
    """Yield the records of a block whose check sum holds; raises DamagedRecord."""
    if block_at(file, at, at + size) is None:
        raise DamagedRecord(f"{path} changed while it was read, at byte {at}; try again")
    file.seek(at + CHUNK.size)
    yield from StreamReader(io.BytesIO(file.read(size - CHUNK.size)), skip_magic=True).records
