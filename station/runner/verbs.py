"""What every procedure does on a bench beside single commands: follow, fetch, wait, prove.

Sampled sources are followed into the record, bursts are fetched, moving instruments are waited for,
what was switched off is read back. There is one rule for an instrument that falls silent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Protocol

from station.errors import InstrumentError
from station.method.work import POLL_S
from station.roles import MadeSafe, RotaryStage, Turntable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.runner.run import Run

SILENT_AFTER_S = 10.0
LOOK_S, MAX_LOOK_S = 0.25, 2.0
BURST_PATIENCE, MIN_PATIENCE_S = 3.0, 10.0
"""A burst may take so many times what is expected, and so many seconds more."""


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


class Burst(Protocol):
    """A source that takes a number of readings, or a record, and then gives them at once."""

    source: str
    columns: Mapping[str, str]

    def fetch(self) -> Block | None:
        """Return what was taken, None while it is being taken."""
        ...


def to_rows(block: Block) -> NDArray[Any]:
    """Return a block as a structured array, shape (rows,), the arrival time as last column."""
    import numpy as np

    from station.record.raw import ARRIVAL

    fields = [(name, values.dtype) for name, values in block.columns.items()]
    rows = np.empty(len(block), dtype=[*fields, (ARRIVAL, np.float64)])
    for name, values in block.columns.items():
        rows[name] = values
    rows[ARRIVAL] = block.arrival_time_s
    return rows


def keep(run: Run, unit: str, source: Source | Burst, block: Block) -> NDArray[Any]:
    """Record the rows of a block for a unit, where there are any; return them."""
    rows = to_rows(block)
    if len(rows):
        run.record.block(source.source, unit, source.columns, rows)
        run.live.came(source.source, rows)
        run.witnesses.came(source.source, rows)
    return rows


def keep_row(
    run: Run, unit: str, instrument: str, columns: Mapping[str, str], *values: float
) -> None:
    """Record one row of numbers that an instrument was asked for, with the time of now."""
    import numpy as np

    from station.record.raw import ARRIVAL

    names = [(name, np.float64) for name in (*columns, ARRIVAL)]
    row = np.array([(*values, run.clock.now())], dtype=names)
    run.record.block(instrument, unit, columns, row)
    run.live.came(instrument, row)


class Follower:
    """Sampled sources, by instrument name, whose rows go to the record as they come.

    `newest` has the last row of each that gave any, as an array of shape (1,).
    """

    def __init__(self, run: Run, sources: Mapping[str, Source]) -> None:
        self._run = run
        self._sources = sources
        self._heard_s = dict.fromkeys(sources, run.clock.now())
        self.newest: dict[str, NDArray[Any]] = {}

    def take(self, unit: str) -> dict[str, NDArray[Any]]:
        """Record what has come; return it by instrument, shape (rows,) each.

        Raises InstrumentError for a source that is silent for longer than `SILENT_AFTER_S`, counted
        from when its last row arrived.
        """
        from station.record.raw import ARRIVAL

        came = {}
        for name, source in self._sources.items():
            rows = keep(self._run, unit, source, source.drain())
            now_s = self._run.clock.now()
            if len(rows):
                came[name], self.newest[name] = rows, rows[-1:]
                self._heard_s[name] = float(rows[ARRIVAL][-1])
            elif now_s - self._heard_s[name] > self._run.clock.patience_s(SILENT_AFTER_S):
                raise InstrumentError(
                    name,
                    f"record {unit}",
                    f"no sample came for {SILENT_AFTER_S:g} s",
                    "check its cable, its power and that the device under test is on",
                )
        return came

    def follow(self, until_s: float, unit: str, doing: str = "", every_s: float = POLL_S) -> None:
        """Record until a run time; `said` is what the operator reads meanwhile."""
        look_until(self._run, until_s, lambda: self.take(unit), doing, every_s)


def look_until(
    run: Run, until_s: float, look: Callable[[], object], doing: str = "", every_s: float = POLL_S
) -> None:
    """Look at what came, again and again until a run time: what waits in memory can be lost."""
    while run.clock.now() < until_s:
        run.clock.sleep_until(min(run.clock.now() + run.clock.holding_s(every_s), until_s))
        look()
        run.say_progress(doing)


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
    follower = Follower(run, sources)
    while True:
        follower.take(unit)
        run.say_progress(detail())
        if len(follower.newest) == len(sources) and enough(follower.newest):
            return
        # What has reached the computer waits in memory until here.
        run.clock.sleep(run.clock.holding_s(POLL_S))


def fetch_bursts(
    run: Run,
    unit: str,
    bursts: Mapping[str, Burst],
    *,
    lasts_s: float = 0.0,
    every_s: float = LOOK_S,
    meanwhile: Callable[[], object] = lambda: None,
    doing: str = "",
    look_at: str = "look at its display: it may wait for a trigger that does not come",
) -> Iterator[tuple[str, Block]]:
    """Yield each burst that was started, by instrument, once it is there; none is asked before.

    `lasts_s` is what the longest is expected to take; `meanwhile` is done at each look. Raises
    InstrumentError for one that does not come.
    """
    clock = run.clock
    expected_s = clock.now() + lasts_s
    longest_s = (BURST_PATIENCE - 1.0) * lasts_s + MIN_PATIENCE_S
    until_s = expected_s + clock.patience_s(longest_s)
    left = dict(bursts)
    while left:
        early_s = expected_s - clock.now()
        clock.sleep(min(early_s, MAX_LOOK_S) if early_s > 0 else every_s)
        if early_s <= 0:
            fetched = {name: burst.fetch() for name, burst in left.items()}
            for name, block in fetched.items():
                if block is not None:
                    del left[name]
                    yield name, block
        meanwhile()
        run.say_progress(doing)
        if left and clock.now() > until_s:
            raise InstrumentError(min(left), f"record {unit}", "its readings never came", look_at)


def come_to_rest(
    run: Run, instrument: str, doing: str, *, axis: int | None = None, every_s: float = LOOK_S
) -> None:
    """Wait until a stage, or an axis of a table, rests; its driver raises where it never does."""

    def moves() -> bool:
        if axis is None:
            return run.role(instrument, RotaryStage).is_moving()
        return run.role(instrument, Turntable).is_moving(axis)

    while moves():
        run.clock.sleep(every_s)
        run.say_progress(doing)


def require_off(run: Run, *instruments: str) -> None:
    """Raise InstrumentError for an instrument that does not read back as brought to rest."""
    for name in instruments:
        reading = run.role(name, MadeSafe).read_safety()
        if not reading.safe:
            raise InstrumentError(
                name,
                "switched the coil off",
                f"it reads back {reading.read_back}",
                "switch the supply off by hand",
            )


def record_published(run: Run, value: float | None, unit: str, **of: Any) -> None:
    """Record what the source's own formula gives, null for nothing; `of` is its `name`, `axis`."""
    run.record.event("published-value", **of, value=value, unit=unit)
