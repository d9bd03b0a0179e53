"""What a step may do: the verbs of one walk through a procedure's steps.

The same steps are walked by a dry run, which has no bench and adds up what they would do, and by a
run that acts. What only an instrument or the data know is behind `read`: a dry run never calls it,
and takes what is assumed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from station.method.duration import NO_TIME, Duration

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.clock import Clock
    from station.files.plan import Plan
    from station.instruments.bench import Bench
    from station.method.prompts import Prompt
    from station.method.set_points import Bounded, Command
    from station.record.folder import RunFolder

Role = TypeVar("Role")
State = TypeVar("State")
Result = TypeVar("Result")
Item = TypeVar("Item")
Rates = Mapping[str, float | None]
"""Rows per second of bench time, by instrument; None: as many as a gaussmeter's averaging gives."""
NO_ROWS: Rates = {}


@dataclass(frozen=True)
class EarlierProgress:
    """What earlier processes of the same run left: units they finished, prompts that still hold.

    `finished` maps each unit to the details of its event; `answered` each prompt id to its answer,
    none where the acts must be done again (a simulated world that ended with its process);
    `witnessed` what each witness saw before anything was energised.
    """

    finished: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    answered: Mapping[str, str] = field(default_factory=dict)
    witnessed: Mapping[str, Sequence[float]] = field(default_factory=dict)


class Run(ABC):
    """One walk through the steps of a procedure: dry, or acting on a bench."""

    def __init__(self, parameters: Any, past: EarlierProgress | None = None) -> None:
        self.parameters = parameters
        """The plan's parameters, an instance of the procedure's own model."""
        self.past = past or EarlierProgress()
        self._states: dict[type[Any], Any] = {}

    # What a step commands, waits for, asks and reads.

    @abstractmethod
    def apply(self, command: Command[Result], takes: Duration = NO_TIME) -> Result:
        """Send a command; `takes` is the bench time until its driver has done it.

        A dry run returns what the command assumes. Raises InputError for a command beyond the dry
        run, which was held against no limit of the bench.
        """

    @abstractmethod
    def prepare(self, command: Command[Result]) -> Result | None:
        """Load what is to start together with others, before the first of them is applied."""

    @abstractmethod
    def declare(self, *bounds: Bounded) -> None:
        """Say how far commands go that data decide; nothing is sent."""

    @abstractmethod
    def read(
        self,
        function: Callable[[], Result],
        assumed: Any = None,
        takes: Duration = NO_TIME,
        rates: Rates = NO_ROWS,
    ) -> Result:
        """Return what only instruments or data know, and do what depends on it.

        A dry run calls nothing: it returns what is `assumed`, lets pass the bench time that this
        `takes`, and counts the rows that come at `rates` meanwhile.
        """

    @abstractmethod
    def count_rows(self, instrument: str, rows: float) -> None:
        """Say how many rows come that no rate says, such as those of a burst."""

    @abstractmethod
    def wait(self, seconds: float, detail: str = "") -> None:
        """Let bench time pass, with progress."""

    @abstractmethod
    def ask(self, prompt: Prompt) -> str:
        """Ask the operator for an act or an answer; what was answered before still holds."""

    @abstractmethod
    def ask_again(self, prompt: Prompt) -> str:
        """Ask the operator, whatever was answered before."""

    @abstractmethod
    def role(self, name: str, kind: type[Role]) -> Role:
        """Return the instrument `name`, which has the verbs of role `kind`.

        That of a dry run does nothing, and what it says cannot be looked at.
        """

    @abstractmethod
    def optional(self, name: str, kind: type[Role], setting: str) -> Role | None:
        """Return the instrument `name` where the bench has it with a `setting` of its driver.

        A dry run, which has no bench, returns None. What it gives is recorded behind `read`; no
        command depends on it.
        """

    @abstractmethod
    def testing_contact(
        self, contact: str, opens: Mapping[str, str]
    ) -> AbstractContextManager[None]:
        """Let a person open a contact of the interlocks by hand, while the bench is off."""

    # Units of work.

    def is_finished(self, unit: str) -> bool:
        """Whether an earlier process of this run finished a unit of work: it stays as it is.

        The steps of a resumed run are walked again; what they measured is not measured again.
        """
        return unit in self.past.finished

    def unfinished(
        self, items: Iterable[Item], unit: Callable[[Item], str] = str, *, pauses: bool = True
    ) -> Iterator[Item]:
        """Go through items whose `unit` of work is not finished; all that is done is for that unit.

        Before each may be paused where `pauses`: once a unit, before its conditions are set.
        """
        for item in items:
            if self.is_finished(unit(item)):
                continue
            if pauses:
                self.may_pause()
            with self.toward(unit(item)):
                yield item

    @abstractmethod
    def repeats(self, items: Iterable[Item], takes: Duration) -> Iterator[Item]:
        """Go through items until the data end it; all together takes `takes`.

        A dry run goes through the first item alone, for its commands; units of work in it are known
        by nobody before.
        """

    @abstractmethod
    def toward(self, unit: str) -> AbstractContextManager[None]:
        """Count the bench time of what is done within as the unit's."""

    @abstractmethod
    def unit(self, name: str, **details: Any) -> AbstractContextManager[dict[str, Any]]:
        """Measure one unit of work; it is finished once its event is on disk.

        What is only known at its end may be added to the details that are yielded.
        """

    @abstractmethod
    def finish(self, unit: str, **details: Any) -> None:
        """Finish a unit of work that no `unit` encloses."""

    @abstractmethod
    def may_pause(self) -> None:
        """Pause here where somebody wishes it: between units of work, before conditions are set."""

    def state(self, kind: type[State], *arguments: Any) -> State:
        """Return what the steps of this process keep from one to the next, made when first asked.

        A class of the procedure's own; nothing that results are computed from.
        """
        if kind not in self._states:
            self._states[kind] = kind(*arguments)
        kept: State = self._states[kind]
        return kept

    # What the operator reads, and what the record keeps.

    @property
    @abstractmethod
    def now_s(self) -> float:
        """Run time in s; that of a dry run is what is expected."""

    @abstractmethod
    def say(self, text: str) -> None:
        """Tell the operator something that stays."""

    @abstractmethod
    def say_progress(self, detail: str = "") -> None:
        """Say how much of the present step's bench time is over, and how it stands."""

    @abstractmethod
    def event(self, kind: str, **details: Any) -> None:
        """Add an event to the log."""

    @abstractmethod
    def keep_rows(
        self, instrument: str, unit: str, columns: Mapping[str, str], rows: NDArray[np.void]
    ) -> None:
        """Record rows of a source, shape (n,), with the columns that it says it has."""

    @abstractmethod
    def write_text(self, name: str, text: str) -> None:
        """Leave a table or text in the run folder."""

    # What a run that acts has beside; asked for behind `read` alone.

    @property
    @abstractmethod
    def plan(self) -> Plan:
        """The plan."""

    @property
    @abstractmethod
    def bench(self) -> Bench:
        """The bench."""

    @property
    @abstractmethod
    def instruments(self) -> Mapping[str, object]:
        """The open instruments by name."""

    @property
    @abstractmethod
    def clock(self) -> Clock:
        """What waits and stamps."""

    @abstractmethod
    def read_back(self) -> RunFolder:
        """Return the folder as it is on disk now: nothing is analysed from memory."""


@dataclass(frozen=True)
class Step:
    """One step with the source document's own number; dry runs and runs walk its `body`."""

    number: str
    title: str
    body: Callable[[Run], None]
