"""A dry run: the steps walked without a bench, and what they would do added up.

Nothing is opened, written or computed. Limits, durations, units of work, disk and memory, prompts
and the instruments that a plan needs are read from the walk.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import groupby, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from station import registry
from station.errors import InputError, StationError, reason_of
from station.method.duration import NO_TIME, Duration, exactly
from station.method.prompts import DONE, Prompt
from station.method.run import NO_ROWS, EarlierProgress, Item, Rates, Result, Role, Run, Step
from station.method.set_points import Bounded, Command, SetPoint
from station.method.verbs import POLL_S
from station.units import UnitError, parse_as

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.clock import Clock
    from station.files.plan import Plan
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

USUAL_AVERAGING_S = 0.1
STATION = Path(__file__).parents[1]
MAX_ACTS = 1_000_000
"""Many times what the longest procedure does; a step that does more does not come to its end."""


@dataclass(frozen=True)
class Rows:
    """The rows that a source gives over `duration_s` of bench time.

    `count` of None: as many as a gaussmeter's own averaging gives in that time.
    """

    instrument: str
    duration_s: float
    count: float | None = None


@dataclass(frozen=True)
class Act:
    """One thing that a step does, in whose unit of work, and how long it takes.

    What `repeats` is done again as often as the data decide, under names that nobody knows before.
    """

    step: str
    unit: str | None = None
    command: Command[Any] | None = None
    rows: tuple[Rows, ...] = ()
    duration: Duration = NO_TIME
    repeats: bool = False


@dataclass(frozen=True)
class ExpectedRows:
    """The rows that a source is expected to give, and the bench time in s over which they come."""

    instrument: str
    rows: int
    duration_s: float


@dataclass(frozen=True)
class Forecast:
    """What a run of a plan on a bench will command and record, in the order of its steps.

    `held_bytes` is the most that the evaluation holds of the record at once; where it is None, that
    is all rows.
    """

    set_points: tuple[SetPoint, ...] = ()
    recordings: tuple[ExpectedRows, ...] = ()
    held_bytes: int | None = None


@dataclass(frozen=True)
class Walk:
    """What a dry run found: each act in its order, who is asked what, which instruments are used.

    `units` are the units of work in their order, those that nobody knows before left out. What is
    `optional` is used where a bench has it, each with the setting of its driver that it needs.
    """

    acts: tuple[Act, ...] = ()
    prompts: tuple[Prompt, ...] = ()
    instruments: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    optional: tuple[tuple[str, str], ...] = ()

    def used_on(self, bench: Bench) -> tuple[str, ...]:
        """Return what is used on a bench: the instruments needed, and what it has of the others."""
        more = (name for name, setting in self.optional if has_setting(bench, name, setting))
        return tuple(dict.fromkeys((*self.instruments, *more)))

    @property
    def commands(self) -> tuple[Command[Any], ...]:
        """The commands in their order."""
        return tuple(act.command for act in self.acts if act.command is not None)

    @property
    def units_expected(self) -> dict[str, float]:
        """The expected bench time in s of each unit of work, in their order."""
        expected_s = dict.fromkeys(self.units, 0.0)
        for act in self.acts:
            if act.unit in expected_s:
                expected_s[act.unit] += act.duration.expected_s
        return {unit: round(seconds, 6) for unit, seconds in expected_s.items()}

    def duration(self, step: str | None = None) -> Duration:
        """Return how long a step, or all of them, take; what a person does is beside."""
        acts = (act for act in self.acts if step is None or act.step == step)
        return sum((act.duration for act in acts), NO_TIME)

    def set_points(self, bench: Bench) -> tuple[SetPoint, ...]:
        """Return what is commanded on a bench, in order."""
        sent = [(act.step, act.command) for act in self.acts if act.command is not None]
        set_points: list[SetPoint] = []
        alike = groupby(sent, key=lambda pair: (pair[0], type(pair[1]), pair[1].instrument))
        for (step, kind, _), group in alike:
            set_points += kind.declare(step, [command for _, command in group], bench)
        return tuple(set_points)

    def recordings(self, bench: Bench) -> tuple[ExpectedRows, ...]:
        """Return the rows of each source over a whole run."""
        by_source: dict[str, list[Rows]] = {}
        for rows in (rows for act in self.acts for rows in act.rows):
            by_source.setdefault(rows.instrument, []).append(rows)
        return tuple(recording_of(source, rows, bench) for source, rows in by_source.items())


def has_setting(bench: Bench, name: str, setting: str) -> bool:
    """Whether a bench has an instrument, and gives its driver a setting."""
    return name in bench.instruments and setting in bench.instruments[name].settings


def recording_of(source: str, rows: Sequence[Rows], bench: Bench) -> ExpectedRows:
    """Return all rows of one source."""
    count = sum(row.count for row in rows if row.count is not None)
    uncounted_s = sum(row.duration_s for row in rows if row.count is None)
    if uncounted_s:
        count += uncounted_s / reading_period_s(bench, source)
    return ExpectedRows(source, math.ceil(count - 1e-6), sum(row.duration_s for row in rows))


def reading_period_s(bench: Bench, gaussmeter: str) -> float:
    """Return the seconds between two readings of a gaussmeter: its averaging time.

    Of one that keeps no readings each look brings one.
    """
    instrument = bench.instruments[gaussmeter]
    if not registry.load(registry.DRIVERS, instrument.driver).keeps_readings:
        return POLL_S
    try:
        averaging_s = parse_as(instrument.settings.get("averaging"), "s")
    except UnitError:
        return USUAL_AVERAGING_S
    return averaging_s if averaging_s > 0 else USUAL_AVERAGING_S


class Unread:
    """What an instrument would answer; InputError where a step of a dry run looks at it."""

    def __init__(self, what: str) -> None:
        self._what = what

    def __getattr__(self, name: str) -> Unread:
        if name.startswith("__"):
            raise AttributeError(name)
        return Unread(f"{self._what}.{name}")

    def __call__(self, *_: Any, **__: Any) -> Unread:
        """Do nothing."""
        return Unread(f"{self._what}()")

    def _refuse(self, *_: Any) -> NoReturn:
        raise InputError(
            f"a dry run cannot know `{self._what}`, which only the instrument does; put what "
            "depends on it behind `run.read(function, assumed=…)`"
        )

    __bool__ = __len__ = __iter__ = __float__ = __int__ = __index__ = __getitem__ = _refuse
    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = __hash__ = _refuse
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = _refuse
    __rtruediv__ = __neg__ = __abs__ = __contains__ = __array__ = __format__ = _refuse
    __pow__ = __rpow__ = __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = __round__ = _refuse
    __str__ = __next__ = __enter__ = __exit__ = __setitem__ = _refuse


class DryRun(Run):
    """A walk that does nothing and takes note of everything."""

    def __init__(self, parameters: Any, past: EarlierProgress | None = None) -> None:
        super().__init__(parameters, past)
        self._now_s = 0.0
        self._step = ""
        self._unit: str | None = None
        self._repeating = False
        self._acts: list[Act] = []
        self._units: dict[str, None] = {}
        self._prompts: dict[Prompt, None] = {}
        self._instruments: dict[str, None] = {}
        self._optional: dict[tuple[str, str], None] = {}
        self._prepared: dict[Command[Any], Act] = {}
        self._measured: set[str] = set()
        self._calls = 0

    def walk(self, steps: Iterable[Step]) -> Walk:
        """Walk steps and return what they would do.

        Raises InputError that names the step where one needs an instrument or the data.
        """
        for step in steps:
            self._step = step.number
            try:
                step.body(self)
            except StationError as error:
                raise InputError(f"step {step.number}: {error}") from error
            except MemoryError:
                raise
            except Exception as error:
                raise InputError(
                    f"step {step.number}: {type(error).__name__}, {reason_of(error)}, at "
                    f"{place_of(error)}; a dry run has to come through it with what is assumed"
                ) from error
        self._acts += self._prepared.values()  # loaded, and started by nobody
        return Walk(
            tuple(self._acts),
            tuple(self._prompts),
            tuple(self._instruments),
            tuple(self._units),
            tuple(self._optional),
        )

    def _act(self, duration: Duration = NO_TIME, **of: Any) -> Act:
        for seconds in (duration.expected_s, duration.shortest_s, duration.longest_s):
            if not 0.0 <= seconds < math.inf:
                raise InputError(f"{seconds:g} s is no time that something can take")
        return Act(self._step, self._unit, duration=duration, repeats=self._repeating, **of)

    def _note(self, **of: Any) -> None:
        self._count_call()
        self._acts.append(self._act(**of))

    def _count_call(self) -> None:
        self._calls += 1
        if self._calls > MAX_ACTS:
            raise InputError(
                f"it does not come to its end: {MAX_ACTS} things are done; a loop that a reading "
                "ends goes through `run.repeats`, or behind `run.read`"
            )

    def apply(self, command: Command[Result], takes: Duration = NO_TIME) -> Result:
        """Take note of a command."""
        refuse_unsendable(command)
        self._instruments[command.instrument] = None
        self._prepared.pop(command, None)
        self._note(command=command, duration=takes)
        self._now_s += takes.expected_s
        assumed: Result = command.assumed
        return assumed

    def prepare(self, command: Command[Result]) -> Result | None:
        """Take note of a command that may never be applied."""
        refuse_unsendable(command)
        self._instruments[command.instrument] = None
        self._prepared[command] = self._act(command=command)
        assumed: Result = command.assumed
        return assumed

    def declare(self, *bounds: Bounded) -> None:
        """Take note of how far data may go."""
        for bound in bounds:
            self._instruments[bound.instrument] = None
            self._note(command=bound)

    def read(
        self,
        function: Callable[[], Result],
        assumed: Any = None,
        takes: Duration = NO_TIME,
        rates: Rates = NO_ROWS,
    ) -> Result:
        """Return what is assumed."""
        self._instruments.update(dict.fromkeys(rates))
        came = tuple(
            Rows(name, takes.expected_s, None if rate is None else rate * takes.expected_s)
            for name, rate in rates.items()
        )
        self._note(rows=came, duration=takes)
        self._now_s += takes.expected_s
        result: Result = assumed
        return result

    def count_rows(self, instrument: str, rows: float) -> None:
        """Take note of rows, which come with one look at the source."""
        self._instruments[instrument] = None
        self._note(rows=(Rows(instrument, POLL_S, rows),))

    def wait(self, seconds: float, detail: str = "") -> None:
        """Let expected time pass."""
        self._note(duration=exactly(seconds))
        self._now_s += seconds

    def ask(self, prompt: Prompt) -> str:
        """Take note of a prompt; a value that is asked for is the smallest that may be typed."""
        self._prompts[prompt] = None
        return DONE if prompt.value is None else prompt.value.read(str(prompt.value.low)) or DONE

    ask_again = ask

    def role(self, name: str, kind: type[Role]) -> Role:
        """Take note that the instrument is needed."""
        self._instruments[name] = None
        nobody: Any = Unread(name)
        instrument: Role = nobody
        return instrument

    def optional(self, name: str, kind: type[Role], setting: str) -> Role | None:
        """Take note that the instrument is used where there is one."""
        self._optional[name, setting] = None
        return None

    def testing_contact(
        self, contact: str, opens: Mapping[str, str]
    ) -> AbstractContextManager[None]:
        """Return that nothing is opened."""
        return nullcontext()

    def repeats(self, items: Iterable[Item], takes: Duration) -> Iterator[Item]:
        """Go through the first item, if any; its rows are counted as often as all take `takes`."""
        first, began_s, repeating = len(self._acts), self._now_s, self._repeating
        self._repeating = True
        try:
            yield from islice(items, 1)
        finally:
            took_s = self._now_s - began_s
            often = takes.expected_s / took_s if took_s else 1.0
            self._acts[first:] = [
                replace(act, duration=NO_TIME, rows=tuple(times(row, often) for row in act.rows))
                for act in self._acts[first:]
            ]
            self._repeating, self._now_s = repeating, began_s
            self._note(duration=takes)
            self._now_s += takes.expected_s

    @contextmanager
    def toward(self, unit: str) -> Iterator[None]:
        """Count what is done within as the unit's."""
        before, self._unit = self._unit, unit
        if not self._repeating:
            self._units[unit] = None
        try:
            yield
        finally:
            self._unit = before

    @contextmanager
    def unit(self, name: str, **details: Any) -> Iterator[dict[str, Any]]:
        """Count what is done within as the unit's; raises InputError where it was measured."""
        if name in self._measured and not self._repeating:
            raise InputError(
                f"two units of work are named {name}: a resumed run could not tell them apart"
            )
        self._measured.add(name)
        with self.toward(name):
            yield details

    def finish(self, unit: str, **details: Any) -> None:
        """Do nothing."""

    def may_pause(self) -> None:
        """Do nothing."""

    @property
    def now_s(self) -> float:
        """Expected run time in s since the first step began."""
        self._count_call()
        return self._now_s

    def say(self, text: str) -> None:
        """Do nothing."""

    def say_progress(self, detail: str = "") -> None:
        """Do nothing."""

    def event(self, kind: str, **details: Any) -> None:
        """Do nothing."""

    def keep_rows(
        self, instrument: str, unit: str, columns: Mapping[str, str], rows: NDArray[np.void]
    ) -> None:
        """Do nothing."""

    def write_text(self, name: str, text: str) -> None:
        """Do nothing."""

    @property
    def plan(self) -> Plan:
        """Raise InputError: a dry run is given the parameters alone."""
        self._has_no("plan")

    @property
    def bench(self) -> Bench:
        """Raise InputError."""
        self._has_no("bench")

    @property
    def instruments(self) -> Mapping[str, object]:
        """Raise InputError."""
        self._has_no("open instruments")

    @property
    def clock(self) -> Clock:
        """Raise InputError."""
        self._has_no("clock")

    def read_back(self) -> RunFolder:
        """Raise InputError."""
        self._has_no("record")

    def _has_no(self, what: str) -> NoReturn:
        raise InputError(
            f"a dry run has no {what}; put what needs it behind `run.read(function, assumed=…)`"
        )


def refuse_unsendable(command: Command[Any]) -> None:
    """Raise InputError for what a run could not send: a bound, or what cannot be looked up."""
    if isinstance(command, Bounded):
        raise InputError(
            f"{command.instrument}: `{command.text}` says how far a step may go; give it to "
            "`run.declare`, and apply the command that the data decide"
        )
    try:
        hash(command)
    except TypeError as error:
        raise InputError(
            f"{command.instrument}: the fields of a {type(command).__name__} cannot be compared "
            f"({error}); give it tuples"
        ) from error


def place_of(error: BaseException) -> str:
    """Return file and line of the procedure where an error came up, not of a library it uses."""
    frames = traceback.extract_tb(error.__traceback__)
    outside = [frame for frame in frames if STATION not in Path(frame.filename).parents] or frames
    package = Path(outside[0].filename).parent
    frame = [call for call in outside if package in Path(call.filename).parents][-1]
    return f"{frame.filename}:{frame.lineno}"


def times(rows: Rows, often: float) -> Rows:
    """Return the rows of all repetitions."""
    count = None if rows.count is None else often * rows.count
    return Rows(rows.instrument, often * rows.duration_s, count)
