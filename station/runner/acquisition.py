"""Drain sampled sources into the record until the instrument's own counter says enough."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from station.errors import InstrumentError
from station.record.raw import ARRIVAL

if TYPE_CHECKING:
    from station.runner.run import Run

POLL_S = 1.037
"""Run time between two looks. It is no multiple of any reading period, so that over a minute some
reading is fetched just after it was made: the alignment of clocks lives on those."""

SILENT_AFTER_S = 10.0


class Block(Protocol):
    """Rows of a stream in the instrument's own units and time base."""

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """Arrays of shape (rows,) by name."""
        ...

    @property
    def arrival_time_s(self) -> NDArray[np.float64]:
        """Run time at which each row reached the computer, shape (rows,)."""
        ...

    def __len__(self) -> int: ...


class Source(Protocol):
    """A source of samples that number or stamp themselves."""

    source: str
    columns: Mapping[str, str]

    def drain(self) -> Block:
        """Return all rows that came since the last call."""
        ...


def to_rows(block: Block) -> NDArray[Any]:
    """Return a block as a structured array, shape (rows,), the arrival time as last column."""
    fields = [(name, values.dtype) for name, values in block.columns.items()]
    rows = np.empty(len(block), dtype=[*fields, (ARRIVAL, np.float64)])
    for name, values in block.columns.items():
        rows[name] = values
    rows[ARRIVAL] = block.arrival_time_s
    return rows


def acquire(
    run: Run,
    unit: str,
    sources: Mapping[str, Source],
    *,
    enough: Callable[[Mapping[str, NDArray[Any]]], bool],
    detail: Callable[[], str] = str,
) -> None:
    """Record `sources` (by instrument name) for `unit` until `enough` of the last rows is True.

    `enough` gets, per instrument, the newest row as an array of shape (1,). Raises
    InstrumentError when a source is silent for longer than `SILENT_AFTER_S`.
    """
    heard_s = dict.fromkeys(sources, run.clock.now())
    newest: dict[str, NDArray[Any]] = {}
    while True:
        for name, source in sources.items():
            rows = to_rows(source.drain())
            now_s = run.clock.now()
            if len(rows):
                run.record.block(source.source, unit, source.columns, rows)
                newest[name] = rows[-1:]
                heard_s[name] = now_s
            elif now_s - heard_s[name] > SILENT_AFTER_S:
                raise InstrumentError(
                    name,
                    f"record {unit}",
                    f"no sample came for {SILENT_AFTER_S:g} s",
                    "check its cable, its power and that the device under test is on",
                )
        run.say_progress(detail())
        if len(newest) == len(sources) and enough(newest):
            return
        # What has reached the computer waits in memory until here.
        run.clock.sleep(run.clock.holding_s(POLL_S))
