"""Raw samples in MCAP: one file per source and process, one block of rows per message.

Each message is a NumPy `.npy` byte string of a structured array, so any tool that reads MCAP and
NumPy reads it; the channel's metadata gives each column's unit. A block is one chunk: what was
written is never held back in memory, and a file cut short loses its last block at most.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, IndexType, Writer
from numpy.typing import NDArray

ARRIVAL = "arrival_time_s"
NANOSECONDS = 1_000_000_000


class RawFile:
    """One source's raw file of this process."""

    def __init__(self, path: Path, source: str, columns: Mapping[str, str]) -> None:
        self._file = path.open("wb")
        self._writer = Writer(
            self._file,
            chunk_size=1,
            compression=CompressionType.NONE,
            index_types=IndexType.NONE,
            use_statistics=False,
        )
        self._writer.start(profile="", library="")
        schema = self._writer.register_schema(name="npy", encoding="", data=b"")
        self._topic = source
        self._columns = {**columns, ARRIVAL: "s of run time at which the row reached the computer"}
        self._schema = schema
        self._channels: dict[str, int] = {}
        self._sequence = 0

    def write(self, unit: str, rows: NDArray[Any]) -> None:
        """Append a block: a structured array, shape (rows,), that belongs to a unit of work."""
        if unit not in self._channels:
            self._channels[unit] = self._writer.register_channel(
                topic=f"{self._topic}/{unit}",
                message_encoding="npy",
                schema_id=self._schema,
                metadata=self._columns,
            )
        data = io.BytesIO()
        np.save(data, rows, allow_pickle=False)
        time_ns = round(float(rows[ARRIVAL][-1]) * NANOSECONDS)
        self._writer.add_message(
            self._channels[unit], time_ns, data.getvalue(), time_ns, self._sequence
        )
        self._sequence += 1
        self._file.flush()

    def sync(self) -> None:
        """Wait until the disk has all that was written."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write the file's end and close it."""
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()


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


def read_raw(path: Path, unit: str) -> Iterator[NDArray[Any]]:
    """Yield the blocks of a unit of work, in the order they were written.

    A file without its end (a crash, a full disk) is read up to its last whole block.
    """
    reader = NonSeekingReader(io.BytesIO(path.read_bytes()), validate_crcs=True)
    try:
        for _, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic.split("/", 1)[1] == unit:
                yield decoded(message.data)
    except (McapError, struct.error):
        return
