"""A raw file as it grows, for whoever watches a run from another process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from station.record.blocks import block_at, next_block
from station.record.raw import decoded, message_of


class RawTail:
    """Read what was added to a raw file since the last look; whole blocks alone."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._at = 0
        self._units: dict[int, str] = {}

    def new_rows(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield unit of work and rows of each new block; raises OSError where the file is gone."""
        with self._path.open("rb") as file:
            end = os.fstat(file.fileno()).st_size
            while self._at < end:
                block = block_at(file, self._at, end)
                if block is None:
                    later = next_block(file, self._at, end)
                    if later >= end:  # a block that is being written; it is read at the next look
                        return
                    self._at = later
                    continue
                if block.named is not None:
                    self._units[block.channel] = block.named
                at, self._at = self._at, self._at + block.length
                if block.channel in self._units:
                    rows = decoded(message_of(file, at, block.length, self._path).data)
                    yield self._units[block.channel], rows
