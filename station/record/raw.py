"""Raw samples in MCAP: one file per source and process, one block of rows per message.

Each message is a NumPy `.npy` byte string of a structured array, so any tool that reads MCAP and
NumPy reads it; the channel's metadata gives each column's unit. A block is one chunk and one
write: nothing is held back in memory, and a file cut short loses its last block at most. The
records are put together here, since the MCAP package's writer keeps a note of every chunk in
memory until the file's end.
"""

from __future__ import annotations

import io
import struct
import zlib
from array import array
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, Message, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from station.record.files import AppendOnlyFile, sync_folder

ARRIVAL = "arrival_time_s"
NANOSECONDS = 1_000_000_000
SCHEMA = Schema(id=1, name="npy", encoding="", data=b"")


class RawFile:
    """One source's raw file of this process; all its calls may raise RecordError."""

    def __init__(self, path: Path, source: str, columns: Mapping[str, str]) -> None:
        self._file = AppendOnlyFile(path, new=True)
        self._topic = source
        self._columns = {**columns, ARRIVAL: "s of run time at which the row reached the computer"}
        self._channels: dict[str, int] = {}
        self._sequence = 0
        self._to_sync = True
        head = RecordBuilder()
        Header(profile="", library="").write(head)
        self._file.append(MCAP0_MAGIC + head.end())
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

    def sync(self) -> None:
        """Wait until the disk has all that was written."""
        if self._to_sync:
            self._file.sync()
            self._to_sync = False

    def close(self) -> None:
        """Write the file's end and close it."""
        end = RecordBuilder()
        DataEnd(data_section_crc=0).write(end)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(end)
        try:
            self._file.append(end.end() + MCAP0_MAGIC)
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

    A file without its end (a crash, a full disk) is read up to its last whole block. A block takes
    16 bytes of memory here, however many rows it has.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._places: dict[str, array[int]] = {}
        with path.open("rb") as file:
            for channel, message in whole_messages(file):
                unit = channel.topic.split("/", 1)[1]
                length = len(message.data)
                # One block is one chunk, chunks are read whole, and the rows end the chunk.
                places = self._places.setdefault(unit, array("q"))
                places.extend((file.tell() - length, length))

    def __contains__(self, unit: str) -> bool:
        return unit in self._places

    def blocks(self, unit: str, every: int = 1) -> Iterator[NDArray[Any]]:
        """Yield the blocks of a unit of work, or every so-manieth, as they were written."""
        places = self._places.get(unit, array("q"))
        with self._path.open("rb") as file:
            for k in range(0, len(places), 2 * every):
                file.seek(places[k])
                yield decoded(file.read(places[k + 1]))


def read_raw(path: Path, unit: str) -> Iterator[NDArray[Any]]:
    """Yield the blocks of one unit of work; who reads several keeps the index."""
    return RawIndex(path).blocks(unit)


def read_blocks(path: Path) -> Iterator[tuple[str, dict[str, str], NDArray[Any]]]:
    """Yield all blocks of a file in the order they were written.

    Each comes with its unit of work and with what the driver says of each column. A file without
    its end is read up to its last whole block, and never more of it than a block at a time.
    """
    with path.open("rb") as file:
        for channel, message in whole_messages(file):
            yield channel.topic.split("/", 1)[1], channel.metadata, decoded(message.data)


def whole_messages(file: IO[bytes]) -> Iterator[tuple[Channel, Message]]:
    """Yield the messages of an open file, each with its channel, up to the last whole one."""
    reader = NonSeekingReader(file, validate_crcs=True)
    try:
        for _, channel, message in reader.iter_messages(log_time_order=False):
            yield channel, message
    except (McapError, struct.error, ValueError):
        return
