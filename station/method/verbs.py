"""What every procedure does on a bench beside single commands: record, fetch, wait, prove.

Sampled sources are recorded as they come, bursts are fetched, moving instruments are waited for,
what was switched off is read back. There is one rule for an instrument that falls silent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from station.errors import InstrumentError
from station.method.duration import NO_TIME, Duration, exactly
from station.roles import MadeSafe, RotaryStage, Turntable
from station.roles.base import SampledSource

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.method.motion import AxisCommand
    from station.method.run import Rates, Run
    from station.roles.base import Block

POLL_S = 1.037
"""Run time between two looks at a source. It is no multiple of any reading period, so that over a
minute some reading is fetched just after it was made: the alignment of clocks lives on those."""
SILENT_AFTER_S = 10.0
LOOK_S, MAX_LOOK_S = 0.25, 2.0
BURST_PATIENCE, MIN_PATIENCE_S = 3.0, 10.0
"""A burst may take so many times what is expected, and so many seconds more."""


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

    from station.roles.base import ARRIVAL

    fields = [(name, values.dtype) for name, values in block.columns.items()]
    rows = np.empty(len(block), dtype=[*fields, (ARRIVAL, np.float64)])
    for name, values in block.columns.items():
        rows[name] = values
    rows[ARRIVAL] = block.arrival_time_s
    return rows


def keep(run: Run, unit: str, source: SampledSource | Burst, block: Block) -> NDArray[Any]:
    """Record the rows of a block for a unit, where there are any; return them."""
    rows = to_rows(block)
    if len(rows):
        run.keep_rows(source.source, unit, source.columns, rows)
    return rows


def keep_row(
    run: Run, unit: str, instrument: str, columns: Mapping[str, str], *values: float
) -> None:
    """Record one row of numbers that an instrument was asked for, with the time of now.

    A dry run counts the row: what the instrument would say may be given as it is.
    """

    def act() -> None:
        import numpy as np

        from station.roles.base import ARRIVAL

        names = [(name, np.float64) for name in (*columns, ARRIVAL)]
        row = np.array([(*values, run.now_s)], dtype=names)
        run.keep_rows(instrument, unit, columns, row)

    run.count_rows(instrument, 1)
    run.read(act)


class Recording:
    """Sampled sources whose rows go to the record as they come, for a unit of work.

    `rates` has the sources by instrument, each with the rows that it gives in a second. `newest`
    has the last row of each that gave any, as an array of shape (1,).
    """

    def __init__(self, run: Run, unit: str, rates: Rates) -> None:
        self.unit = unit
        self._run = run
        self.rates = rates
        self._sources = {name: run.role(name, SampledSource) for name in rates}
        self._heard_s = dict.fromkeys(rates, run.now_s)
        self.newest: dict[str, NDArray[Any]] = {}

    def take(self) -> dict[str, NDArray[Any]]:
        """Record what has come; return it by instrument, shape (rows,) each.

        Raises InstrumentError for a source that is silent for longer than `SILENT_AFTER_S`, counted
        from when its last row arrived.
        """
        from station.roles.base import ARRIVAL

        came = {}
        for name, source in self._sources.items():
            rows = keep(self._run, self.unit, source, source.drain())
            if len(rows):
                came[name], self.newest[name] = rows, rows[-1:]
                self._heard_s[name] = float(rows[ARRIVAL][-1])
                continue
            silent_s = self._run.now_s - self._heard_s[name]
            if silent_s > self._run.clock.patience_s(SILENT_AFTER_S):
                raise InstrumentError(
                    name,
                    f"record {self.unit}",
                    f"no sample came for {SILENT_AFTER_S:g} s",
                    "check its cable, its power and that the device under test is on",
                )
        return came

    def follow(
        self,
        duration_s: float,
        doing: str = "",
        *,
        every_s: float = POLL_S,
        look: Callable[[], object] | None = None,
    ) -> None:
        """Record for a time; `doing` is what the operator reads meanwhile.

        `look` is what is done at each look, which takes what has come unless it says otherwise.
        """

        def act() -> None:
            look_until(self._run, self._run.now_s + duration_s, look or self.take, doing, every_s)

        self._run.read(act, takes=exactly(duration_s), rates=self.rates)

    def until(
        self,
        enough: Callable[[Mapping[str, NDArray[Any]]], bool],
        takes: Duration,
        detail: Callable[[], str] = str,
    ) -> None:
        """Record until `enough` of the last rows is True, which is expected to take `takes`.

        `enough` gets, per instrument, the newest row as an array of shape (1,).
        """

        def act() -> None:
            while True:
                self.take()
                self._run.say_progress(detail())
                if len(self.newest) == len(self._sources) and enough(self.newest):
                    return
                # What has reached the computer waits in memory until here.
                self._run.clock.sleep(self._run.clock.holding_s(POLL_S))

        self._run.read(act, takes=takes, rates=self.rates)


def look_until(
    run: Run, until_s: float, look: Callable[[], object], doing: str = "", every_s: float = POLL_S
) -> None:
    """Look at what came, again and again until a run time: what waits in memory can be lost."""
    while run.now_s < until_s:
        run.clock.sleep_until(min(run.now_s + run.clock.holding_s(every_s), until_s))
        look()
        run.say_progress(doing)


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
    InstrumentError for one that does not come. A run that acts alone can do this.
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


def axis_of(run: Run, command: AxisCommand[Any]) -> int:
    """Return the number that the table of this bench gives the axis of a command."""
    return run.read(lambda: command.axis_number(run.bench), assumed=0)


def come_to_rest(
    run: Run,
    instrument: str,
    doing: str,
    *,
    axis: int | None = None,
    every_s: float = LOOK_S,
    takes: Duration = NO_TIME,
) -> None:
    """Wait until a stage, or an axis of a table, rests; its driver raises where it never does."""

    def moves() -> bool:
        if axis is None:
            return run.role(instrument, RotaryStage).is_moving()
        return run.role(instrument, Turntable).is_moving(axis)

    def wait() -> None:
        while moves():
            run.clock.sleep(every_s)
            run.say_progress(doing)

    run.read(wait, takes=takes)


def require_off(run: Run, *instruments: str) -> None:
    """Raise InstrumentError for an instrument that does not read back as brought to rest."""
    for name in instruments:
        device = run.role(name, MadeSafe)
        run.read(partial(raise_unless_off, name, device))


def raise_unless_off(name: str, device: MadeSafe) -> None:
    """Raise InstrumentError where it does not read back as brought to rest."""
    reading = device.read_safety()
    if not reading.safe:
        raise InstrumentError(
            name,
            "switched the coil off",
            f"it reads back {reading.read_back}",
            "switch the supply off by hand",
        )


def record_published(run: Run, value: float | None, unit: str, **of: Any) -> None:
    """Record what the source's own formula gives, null for nothing; `of` is its `name`, `axis`."""
    run.event("published-value", **of, value=value, unit=unit)
