"""One process of a run on an open bench: open, watch, walk the steps, bring the bench to rest."""

from __future__ import annotations

import math
import os
import traceback
from collections.abc import Iterable, Set
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from station.clock import RealClock
from station.console import tell
from station.control.requests import Control
from station.control.signals import AbortSignals
from station.errors import EXIT_FAULT, InterlockTripped, StationError
from station.guardian.supervisor import Guardian
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.last_look import LastLook, look_last
from station.instruments.opening import Identified, open_instruments, put_settings_back
from station.instruments.trace import Trace
from station.instruments.whole_bench import BenchReading, UnusedInstruments, read_used
from station.method.set_points import Envelope
from station.record.events import AT_REST_AGAIN, SAFE_STATE, TIME_MISSED, WITNESS_READ
from station.roles.base import MadeSafe
from station.runner.outcome import Outcome, in_one_sentence
from station.runner.room import prompts_of_room
from station.runner.run import ActingRun
from station.runner.session import BenchSession
from station.runner.watchers import FolderWatch, StallWatch, StayingAwake
from station.safety.acknowledgement import WITNESS, refuse_identified, remember
from station.safety.interlocks.monitor import Monitor
from station.safety.interlocks.reading import watched_in_a_run
from station.safety.safe_state import SafeOutcome, make_bench_safe, unhurried

if TYPE_CHECKING:
    from station.method.prompts import Prompt
    from station.procedure import Procedure

READS_THE_REST_WITHIN_S = 20.0
"""Real time without a sign of life while all is read once more and settings are put back."""


class StepRunner:
    """The steps of a procedure on a bench, from the first byte to the last line closed.

    `bench_file` is the bench file as the operator named it: a trip is remembered for that. `first`
    is asked before the first step.
    """

    def __init__(
        self,
        run: ActingRun,
        procedure: Procedure,
        session: BenchSession,
        bench_file: Path,
        trace: Trace | None,
        first: Prompt | None = None,
    ) -> None:
        self._first = first
        self._run = run
        self._procedure = procedure
        self._session = session
        self._bench_file = bench_file
        self._trace = trace
        self._opened: dict[str, Identified] = {}
        self._walk = procedure.walk(run.parameters)
        needed = self._walk.used_on(run.bench)
        self._interlocks = watched_in_a_run(run.bench.interlocks, needed)
        self._needed = {*needed}.union(*(interlock.instruments for interlock in self._interlocks))
        self._guardian: Guardian | None = None
        self._awake: StayingAwake | None = None
        self._monitor: Monitor | None = None
        self._trip: InterlockTripped | None = None
        holder = f"the run {run.record.path.resolve()} (process {os.getpid()})"
        self._locks = InstrumentLocks(holder, session.world)
        self._bystanders = UnusedInstruments(
            run.bench,
            session.addresses,
            run.clock,
            holder,
            None if session.here else self._locks,
            trace,
        )
        self._stillness: StallWatch | None = None
        self._folder_watch: FolderWatch | None = None
        self._making_safe = run.clock.lock("the safe state")
        self._failed_s = 0.0

    def go(self, outcome: Outcome) -> None:
        """Do every step; the bench comes to rest in every case. `outcome` says how it went.

        Until that is read back nothing is written and nothing said: the disk, the terminal or the
        memory may be what ended the run.
        """
        run = self._run
        failure: Exception | None = None
        with ExitStack() as stack:
            stack.enter_context(run.clock.participant("run"))
            signals = stack.enter_context(AbortSignals(run.clock))
            control = run.listen_to(stack.enter_context(Control(run.record.path, run.clock)))
            control.hurry = signals.hurry.ask
            signals.hang_up = lambda: self._guardian is not None and run.hang_up()
            if isinstance(run.clock, RealClock):
                self._stillness = stack.enter_context(
                    StallWatch(run.clock, signals, lambda: self._make_safe(signals), self._missed)
                )
                self._folder_watch = stack.enter_context(FolderWatch(run.record, run.clock))
            try:
                run.envelope = Envelope.of(self._walk.set_points(run.bench))
                self._guard()
                self._open()
                self._watch(signals)
                if self._first is not None:
                    run.ask_again(self._first)
                for prompt in prompts_of_room(run.plan):
                    run.ask(prompt)
                left = self._procedure.walk(run.parameters, run.past)
                for step in self._procedure.steps:
                    expected_s = left.duration(step.number).expected_s
                    run.do(step.number, step.title, expected_s, step.body)
                outcome.exit_code = 0
            except Exception as error:  # a bug in a step must still leave a safe bench
                failure = error
            finally:
                if self._folder_watch is not None:
                    self._folder_watch.end()
                control.hold()
                unheard = signals.hold()
                failure = failure or unheard
                self._failed_s = run.clock.now()
                if self._stillness is not None:
                    self._stillness.run_ends()
                if self._monitor is not None:
                    self._monitor.stop()
                look = self._bring_to_rest(outcome, signals)
                run.clock.interrupt(None)
                self._conclude(outcome, failure, look)
        if outcome.unsafe:
            outcome.exit_code = EXIT_FAULT

    def _missed(self, seconds: float) -> None:
        """Take note that the run and whoever watches it did not run; called from any thread."""
        self._run.record.later(TIME_MISSED, seconds=round(seconds, 1))
        self._run.progress.say(
            f"WARNING: this run did not run for {seconds:.0f} s, and nobody watched the bench: its "
            "process was stopped, or the computer slept; look at the instruments"
        )

    def _conclude(self, outcome: Outcome, failure: Exception | None, look: LastLook) -> None:
        """Write how the run ended, and give everything back; the bench is as it will be.

        The guardian stays until all of that is done: a disk that stands still ends no run.
        """
        run = self._run
        if failure is not None:
            for cause in self._causes(run.record.presence.cause_of(failure)):
                self._failed(outcome, cause)
        run.log_notes()
        self._remember_trip()
        for words in look.again:
            run.record.note(AT_REST_AGAIN, message=words)
        run.record.note(SAFE_STATE, **look.to_data())
        if doubted := outcome.doubted:
            words = "; ".join(f"{reading.instrument}: {reading.read_back}" for reading in doubted)
            self._remember(WITNESS, words, set())
        self._close()
        # What is no fault ends steps, too: SystemExit of one that calls exit().
        complete = outcome.error is None and outcome.exit_code == 0
        run.record.note("run-ended", complete=complete)
        run.record.close()
        if self._stillness is not None:
            self._stillness.end()
        if self._guardian is not None:
            self._let_guardian_go(self._guardian, outcome)
        self._locks.release()  # a guardian that goes on has them, too

    def _let_guardian_go(self, guardian: Guardian, outcome: Outcome) -> None:
        """Dismiss the guardian from what was proven safe; else it is to go on."""
        left = [reading for reading in outcome.left_unsafe if not reading.doubted]
        if not left:
            guardian.dismiss()
            return
        names = ", ".join(reading.instrument for reading in left)
        outcome.left_to = guardian.hand_over(f"the run could not verify as safe: {names}")

    def _guard(self) -> None:
        """Start the process that makes the bench safe if this one dies.

        Raises GuardianFailed. A bench that is simulated in this process ends with it.
        """
        if not self._session.here:
            self._awake = StayingAwake()
            self._guardian = Guardian(
                self._run.record.path,
                None,
                self._session.addresses,
                self._run.clock,
                instruments=sorted(self._needed),
                wait=False,
                world=self._session.world,
                on_lost=self._run.progress.say,
                note=self._run.record.later,
                may_beat=self._stillness.may_beat if self._stillness else lambda: True,
                bench_file=self._bench_file,
                real=self._session.real,
            )

    def _open(self) -> None:
        """Open and identify what the plan needs and what its interlocks look at."""
        run, bench = self._run, self._run.bench
        self._opened = open_instruments(
            bench,
            self._needed,
            self._session.addresses,
            run.clock,
            self._run.ask_for_driver,
            self._trace,
            self._run.readings,
            None if self._session.here else self._locks,
        )
        run.instruments = {name: opened.instrument for name, opened in self._opened.items()}
        for name, opened in self._opened.items():
            run.record.event("identified", instrument=name, **vars(opened.identity))
        if self._session.real:
            refuse_identified(self._bench_file, self._said(self._opened))
        self._read_before()

    def _said(self, names: Iterable[str]) -> dict[str, tuple[str, str]]:
        """Return what instruments say of themselves: address to model and serial number."""
        entries = self._run.bench.instruments
        by_address = {}
        for name in names:
            for shared in entries[name].shares or (name,):
                identity = self._opened[shared].identity if shared in self._opened else None
                known = (identity.model, identity.serial) if identity else ("", "")
                by_address[entries[shared].address or ""] = known
        return by_address

    def _watch(self, signals: AbortSignals) -> None:
        """Look at every interlock once, then watch them beside the steps."""
        self._monitor = self._run.monitor = Monitor(
            self._interlocks,
            self._run.instruments,
            self._run.readings,
            self._run.clock,
            lambda: self._make_safe(signals),
        )
        self._run.live.interlocks = self._monitor.looks
        if self._guardian is not None:
            # What is reached over another's line has no rest of its own to be brought to.
            names = [name for name in self._opened if not self._run.bench.instruments[name].shares]
            self._guardian.watch(names, self._locks)
            self._run.witnesses.informs(self._guardian.sees)
        if self._awake is not None and (why := self._awake.refused()):
            self._run.record.event("sleep-allowed", message=f"the computer may go to sleep: {why}")
        self._monitor.check_once()
        self._monitor.start()
        if self._stillness is not None:
            self._stillness.begin()

    def _read_before(self) -> None:
        """Read everything that can harm, and refuse what is energised outside the plan.

        Raises BenchEnergised, and InstrumentError for an instrument of the plan.
        """
        run = self._run
        others = self._bystanders.read(run.instruments, run.clock)
        used = read_used(run.instruments, run.clock)
        read = BenchReading(used, others.outside, others.left_out)
        run.record.event("bench-read", **read.to_data())
        for left in others.left_out:
            run.progress.say(f"WARNING: not read before the run: {left.said}")
        read.refuse_energised()
        run.witnesses.open(run.instruments)
        for sighting in run.witnesses.sightings.values():
            seen = [value if math.isfinite(value) else None for value in sighting.before]
            run.record.event(
                WITNESS_READ, instrument=sighting.instrument, unit=sighting.unit, before=seen
            )
        run.refuse_energised()

    def _bring_to_rest(self, outcome: Outcome, signals: AbortSignals) -> LastLook:
        """Make the bench safe, put settings back, and look at everything once more.

        The witnesses' settings come last: they are asked in the units that the run has set.
        """
        run = self._run
        outcomes = self._make_safe(signals, says_so=False)
        devices = run.instruments.values()
        harmful = [device for device in devices if isinstance(device, MadeSafe)]
        with run.clock.allow(READS_THE_REST_WITHIN_S):
            unhurried(lambda: put_settings_back(harmful))
            look = look_last(
                run.instruments,
                outcomes,
                run.bench.safe_order(),
                run.clock,
                signals.hurry,
                lambda only: self._bystanders.read(run.instruments, only=only),
                run.witnesses.testify,
            )
            others = [device for device in devices if device not in harmful]
            unhurried(lambda: put_settings_back(others))
        outcome.take(look)
        if run.control is not None:
            run.control.made_safe(look.used)
        return look

    def _make_safe(self, signals: AbortSignals, *, says_so: bool = True) -> list[SafeOutcome]:
        """Bring the bench to rest from this thread; others that want to wait for that.

        `says_so`: whether others learn now how the bench was left, since nobody looks again.
        """
        run = self._run
        with run.clock.allow(math.inf):  # whoever is at it gives signs of life
            self._making_safe.__enter__()
        try:
            order = run.bench.safe_order()
            outcomes = make_bench_safe(run.instruments, order, run.clock, signals.hurry)
            if says_so and run.control is not None:
                run.control.made_safe(outcomes)
            return outcomes
        finally:
            self._making_safe.__exit__(None, None, None)

    def _close(self) -> None:
        if self._monitor is not None:
            self._monitor.wait_until_stopped()
        for opened in self._opened.values():
            with suppress(Exception):  # a line that is gone keeps no other from being closed
                opened.instrument.close()
        if self._awake is not None:
            self._awake.end()
        if self._trace is not None:
            self._trace.close()

    def _failed(self, outcome: Outcome, error: Exception) -> None:
        """Note what ended the run."""
        if isinstance(error, InterlockTripped):
            self._tripped(error)
        outcome.error = in_one_sentence(error)
        outcome.exit_code = error.exit_code if isinstance(error, StationError) else EXIT_FAULT
        self._run.record.note_at(
            self._failed_s,
            "failed",
            message=outcome.error,
            exit_code=outcome.exit_code,
            traceback="".join(traceback.format_exception(error)),
        )

    def _causes(self, failure: Exception) -> list[Exception]:
        """Return what ended a run that failed, the last of which counts: an interlock's trip.

        An emergency stop cuts power: the run may fail of that before the chain is looked at.
        """
        if self._monitor is None:
            return [failure]
        if self._monitor.trip is not None:
            return [self._monitor.trip]
        if getattr(failure, "exit_code", EXIT_FAULT) == EXIT_FAULT:
            with suppress(Exception):  # that the bench is safe must be reported, whatever this does
                self._monitor.look_at_chains()
        return [failure] if self._monitor.trip is None else [failure, self._monitor.trip]

    def _tripped(self, trip: InterlockTripped) -> None:
        """Record a trip; the bench is refused because of it once it is at rest."""
        self._run.record.note(
            "interlock-tripped",
            interlock=trip.name,
            said=trip.said,
            value=trip.value,
            limit=trip.limit,
            tripped_s=round(trip.time_s, 6),
        )
        self._trip = trip

    def _remember_trip(self) -> None:
        """Keep the bench from being used until a person acknowledges what tripped.

        A real one is known by its instruments: those that can harm, and those the interlock sees.
        """
        trip = self._trip
        if trip is not None:
            concerned = set[str]()
            for interlock in self._interlocks:
                if interlock.name == trip.name:
                    concerned |= interlock.instruments
            self._remember(trip.name, str(trip), concerned)

    def _remember(self, name: str, message: str, concerned: Set[str]) -> None:
        """Have this bench refused until a person acknowledges; a real one by its instruments.

        `concerned` are instruments that this is about beside those that can harm.
        """
        if self._session.replayed:
            return
        opened, instruments = self._run.instruments, None
        if self._session.real:
            harmful = {name for name in opened if isinstance(opened[name], MadeSafe)}
            instruments = self._said(sorted(harmful | concerned))
        try:
            remember(self._bench_file, name, message, self._run.record.path, instruments)
        except OSError as error:
            tell(f"this could not be noted ({error}): the bench will not be refused")
