"""A run that acts: the verbs of a step on an open bench, with progress, record and interlocks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any

from station.clock import Clock
from station.control.questions import Operator
from station.errors import InputError
from station.method.dry_run import has_setting
from station.method.duration import NO_TIME, Duration
from station.method.prompts import Prompt
from station.method.run import NO_ROWS, EarlierProgress, Item, Rates, Result, Role, Run
from station.record.folder import RunFolder, RunRecord
from station.roles.base import ANSWER_TIME
from station.roles.role import turns
from station.runner.live import LiveBoard
from station.runner.notices import Notices
from station.runner.progress import Progress
from station.safety.interlocks.contact_test import ContactTest
from station.safety.readings import Readings
from station.safety.safe_state import not_off
from station.safety.witness import Witnesses, witness_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.control.requests import Control
    from station.files.plan import Plan
    from station.instruments.bench import Bench
    from station.method.set_points import Bounded, Command, Envelope
    from station.safety.interlocks.monitor import Monitor

WAIT_SLICE_S = 1.0
SENTENCES = {
    "line-resynchronised": "something came that was not asked for; its line was resynchronised",
    "line-reopened": "its line broke; it is opened again",
    "switched-off-at-once": "it did not do what it was asked; it was sent the command to switch "
    "off, without a ramp",
    "frames-dropped": "more came than was taken; the oldest frames were dropped",
    "settings-stay": "settings that it keeps could not be put back; the log has what they were",
    "instrument-settings": "",
    "instrument-variant": "",
    ANSWER_TIME: "",
}
"""What the operator reads of the first event of a kind of an instrument; all are in the log."""
COMPUTES_WITHIN_S = 120.0
"""Real time that a step may work on what was recorded, without a sign of life."""


class ActingRun(Run):
    """One execution of a plan, as its steps see it."""

    def __init__(
        self,
        plan: Plan,
        bench: Bench,
        clock: Clock,
        record: RunRecord,
        progress: Progress,
        operator: Operator,
        past: EarlierProgress | None = None,
    ) -> None:
        super().__init__(plan.parameters, past)
        self._plan = plan
        self._bench = bench
        self._clock = clock
        self.record = record
        self.progress = progress
        self._instruments: Mapping[str, object] = {}
        self.envelope: Envelope | None = None
        """What the dry run held against the limits of the bench, None before it is known."""
        self._prepared: dict[Command[Any], Any] = {}
        self.monitor: Monitor | None = None
        """The interlocks, None before they are watched."""
        self.control: Control | None = None
        """What other terminals ask of this run, None where nobody can."""
        self._operator = operator
        self._step_began_s = clock.now()
        self.readings = Readings(clock)
        """What drivers published last, and what they noted."""
        self.live = LiveBoard(clock, self.readings, bench)
        self.witnesses = Witnesses(clock, self.past.witnessed)
        """What second instruments see of the sources that are driven."""
        command = bench.file.notify.command if bench.file.notify else ()
        self.notices = Notices(command, record.path, bench.name, plan.dut.serial)
        operator.record_in(record, self.notices.prompt)
        self._said: set[tuple[str, str]] = set()
        self._hung_up = False
        self._last_place: tuple[str, ...] | None = None
        """The units of work that were to be done at the last place to pause."""

    @property
    def plan(self) -> Plan:
        """The plan."""
        return self._plan

    @property
    def bench(self) -> Bench:
        """The bench."""
        return self._bench

    @property
    def clock(self) -> Clock:
        """The run's clock."""
        return self._clock

    @property
    def instruments(self) -> Mapping[str, object]:
        """The open instruments by name."""
        return self._instruments

    @instruments.setter
    def instruments(self, opened: Mapping[str, object]) -> None:
        self._instruments = opened

    @property
    def now_s(self) -> float:
        """Run time in s."""
        return self.clock.now()

    def listen_to(self, control: Control) -> Control:
        """Let other terminals act on this run from now on; returns what they act by."""
        self.control = control
        control.live = self.live.data
        control.may_still_pause = self.may_still_pause
        self._operator.listen_at(control.desk)
        return control

    def role(self, name: str, kind: type[Role]) -> Role:
        """Return the opened instrument `name`, proven to have the verbs of role `kind`."""
        if name not in self.instruments:
            raise InputError(
                f"{name}: a step uses it behind `run.read` alone, where no dry run sees it; take "
                "its role outside"
            )
        instrument = self.instruments[name]
        if not isinstance(instrument, kind):
            raise InputError(
                f"{name}: the driver {type(instrument).__name__} cannot do what this procedure "
                f"asks of a {kind.__name__}; choose another driver in the bench file"
            )
        return instrument

    def optional(self, name: str, kind: type[Role], setting: str) -> Role | None:
        """Return the opened instrument `name`; None where the bench does not have it so."""
        if not has_setting(self.bench, name, setting):
            return None
        return self.role(name, kind)

    def prepare(self, command: Command[Result]) -> Result | None:
        """Load what is to start together with others, before the first of them is applied."""
        if self.envelope is not None:
            self.envelope.require(command, self.bench)
        prepared = command.prepare(self)
        self._prepared[command] = prepared
        return prepared

    def apply(self, command: Command[Result], takes: Duration = NO_TIME) -> Result:
        """Send a command to its instrument."""
        if command not in self._prepared:
            self.prepare(command)
        words, bounds = command.words(self.bench), command.bounds(self.bench)
        self.live.commanded(command.instrument, words, bounds)
        if turns(command.instrument):
            self.witnesses.moved(f"the {command.instrument} turned since")
        else:
            expected = self._expected(command.instrument, {**bounds})
            self.witnesses.drives(command.instrument, expected)
        return command.apply(self, self._prepared.pop(command))

    def refuse_energised(self) -> None:
        """Raise BenchEnergised where a witness sees before the first step that something is on."""
        ranges = self.envelope.ranges if self.envelope else {}
        self.witnesses.refuse_energised(
            {
                source: self._expected(
                    source, {name: max(map(abs, ends)) for name, ends in of.items()}
                )
                for source, of in ranges.items()
            }
        )

    def _expected(self, source: str, bounds: Mapping[str, Any]) -> dict[str, float]:
        """Return the change that each witness should see of a source's command, by witness."""
        if witness_of(source) is not None:  # its range is no field that it makes
            return {}
        settings = self.bench.instruments[source].settings
        expected = {}
        for name in self.witnesses.sightings:
            if (witness := witness_of(name)) is not None:
                expected[name] = witness.expected(bounds, settings) or 0.0
        return expected

    def declare(self, *bounds: Bounded) -> None:
        """Do nothing: the dry run took note of it."""

    def read(
        self,
        function: Callable[[], Result],
        assumed: Any = None,
        takes: Duration = NO_TIME,
        rates: Rates = NO_ROWS,
    ) -> Result:
        """Do it."""
        return function()

    def count_rows(self, instrument: str, rows: float) -> None:
        """Do nothing: the record counts them."""

    def repeats(self, items: Iterable[Item], takes: Duration) -> Iterator[Item]:
        """Go through items."""
        yield from items

    def toward(self, unit: str) -> AbstractContextManager[None]:
        """Do nothing: the log says when a unit is finished."""
        return nullcontext()

    def finish(self, unit: str, **details: Any) -> None:
        """Finish a unit of work that no `unit` encloses."""
        self.record.finish_unit(unit, **details)

    def say(self, text: str) -> None:
        """Tell the operator something that stays."""
        self.progress.say(text)

    def event(self, kind: str, **details: Any) -> None:
        """Add an event to the log."""
        self.record.event(kind, **details)

    def keep_rows(
        self, instrument: str, unit: str, columns: Mapping[str, str], rows: NDArray[np.void]
    ) -> None:
        """Record rows of a source, and show them."""
        self.record.block(instrument, unit, columns, rows)
        self.live.came(instrument, rows)
        self.witnesses.came(instrument, rows)

    def write_text(self, name: str, text: str) -> None:
        """Leave a table or text in the run folder."""
        self.record.write_text(name, text)

    def do(self, number: str, title: str, expected_s: float, body: Callable[[Run], None]) -> None:
        """Do one step, with its beginning and end in the log.

        Both survive the death of the process at once. The disk itself is waited for where a unit
        of work is finished and where something is energised: some disks take 4 ms for that.
        """
        self.progress.step(number, title, expected_s)
        self._step_began_s = self.clock.now()
        self.live.now = ""
        self.record.event("step-started", durable=False, step=number, title=title)
        self.clock.expect(COMPUTES_WITHIN_S)  # libraries are loaded where they are first used
        body(self)
        self.log_notes()
        self.record.event("step-finished", durable=False, step=number)

    @contextmanager
    def unit(self, name: str, **details: Any) -> Iterator[dict[str, Any]]:
        """Measure one unit of work; it is finished once its event is on disk.

        What is only known at its end may be added to the details that are yielded.
        """
        self.record.event("unit-started", durable=False, unit=name)
        yield details
        self.record.finish_unit(name, **details)

    def hang_up(self) -> bool:
        """Take note that the terminal is gone; whether no prompt of this run needs it.

        Called in the middle of anything: the log has it with the next sign of progress.
        """
        self._hung_up = True
        return self._operator.needs_no_terminal

    def may_pause(self) -> None:
        """Pause here where somebody wishes it: between units of work, before conditions are set."""
        self._last_place = self.progress.units_left
        if self.control is not None:
            with self._not_working():
                self.control.between_units(self)

    def may_still_pause(self) -> bool:
        """Whether another place to pause may come; not after the one before the last unit.

        Where data decide what units there are, one may always come.
        """
        left = self.progress.units_left
        return left is None or len(left) > 1 or (len(left) == 1 and self._last_place != left)

    def wait(self, seconds: float, detail: str = "") -> None:
        """Let run time pass, with progress."""
        until_s = self.clock.now() + seconds
        while self.clock.now() < until_s:
            self.clock.sleep_until(min(self.clock.now() + WAIT_SLICE_S, until_s))
            self.say_progress(detail)

    def say_progress(self, detail: str = "") -> None:
        """Say how much of the present step's bench time is over, and how it stands."""
        self.record.write_later()
        self.log_notes()
        self.live.now = detail
        self.progress.at(self.clock.now() - self._step_began_s, detail)

    def log_notes(self) -> None:
        """Write what drivers noted of their lines to the log; the operator reads each kind once."""
        if self._hung_up:
            self._hung_up = False
            self.record.note("terminal-closed")
        notes, dropped = self.readings.take_notes()
        for note in notes:
            self.record.note(
                note.kind,
                instrument=note.instrument,
                noted_s=round(note.time_s, 6),
                **note.details,
            )
            sentence = SENTENCES.get(note.kind, note.kind)
            if sentence and (note.instrument, note.kind) not in self._said:
                self._said.add((note.instrument, note.kind))
                self.progress.say(f"{note.instrument}: {sentence}")
        if dropped:
            self.record.note("notes-dropped", count=dropped)

    def ask(self, prompt: Prompt) -> str:
        """Ask the operator for an act or an answer; both are recorded.

        What was answered in an earlier process of this run still holds, and is not asked again.
        """
        if prompt.id in self.past.answered:
            return self.past.answered[prompt.id]
        return self.ask_again(prompt)

    def ask_again(self, prompt: Prompt, of: str = "step") -> str:
        """Ask the operator, whatever was answered before; `of` a step or a driver."""
        with self._not_working(), self.progress.paused():
            answer = self._operator.ask(prompt, of)
        if of == "step" and prompt.physical:
            self.witnesses.moved(f"somebody was at the bench since ({prompt.id})")
        for name in self.witnesses.sightings:
            if prompt.id in getattr(self.instruments[name], "prompts", {}):
                self.witnesses.moved(f"the {name} was turned since ({prompt.id})", witness=name)
        return answer.text

    @contextmanager
    def testing_contact(self, contact: str, opens: Mapping[str, str]) -> Iterator[None]:
        """Let a person open a contact of the interlocks by hand, while the bench reads back as off.

        `opens`: the instruments that see it, each to the name that it gives the contact. Raises
        InputError where something is not off, InterlockTripped where another contact opens or one
        is still open afterwards.
        """
        test = ContactTest(opens, partial(not_off, self.instruments))
        if refusal := test.not_off():
            raise InputError(f"the contact {contact} is opened on a bench that is off; {refusal}")
        self.record.event("contact-test-started", contact=contact, opens=dict(opens))
        with self.monitor.testing(test) if self.monitor else nullcontext():
            yield
        self.record.event("contact-test-finished", contact=contact)

    def ask_at_the_end(self, prompt: Prompt, of: str = "step") -> str:
        """Ask for what no step waits for: a person when bench and results are done.

        What an answers file or the simulated world answers is answered now. Empty where it is not.
        """
        return "" if self._operator.ask_later(prompt, of) else self.ask_again(prompt, of)

    def ask_for_driver(self, prompt_id: str, text: str, at_the_end: bool) -> str:
        """Ask for an act that a driver needs of a person."""
        asks = self.ask_at_the_end if at_the_end else self.ask_again
        return asks(Prompt(prompt_id, text), of="driver")

    @contextmanager
    def _not_working(self) -> Iterator[None]:
        """Keep time in which a person is waited for out of the step's bench time."""
        began_s = self.clock.now()
        yield
        self._step_began_s += self.clock.now() - began_s

    def read_back(self) -> RunFolder:
        """Return the folder as it is on disk now: nothing is analysed from memory.

        What is computed from it may take its time.
        """
        self.clock.expect(COMPUTES_WITHIN_S)
        return RunFolder(self.record.path, self.record.segment)
