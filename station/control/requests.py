"""The run's side of the channel: what others wish, and what the run does about it.

The channel's threads only note a wish. An abort ends the run at its next wait, as Ctrl-C does; a
pause waits until the run comes to the place between two units of work, and until every instrument
has said what it does meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from station.clock import Clock
from station.console import tell
from station.control.channel import Channel, Incoming
from station.control.questions import PromptQueue, wait_for_person
from station.control.signals import ended_by
from station.errors import Aborted, InstrumentError, PauseRefused
from station.roles.base import MadeSafe

if TYPE_CHECKING:
    from station.record.folder import RunRecord
    from station.safety.safe_state import SafeOutcome


@runtime_checkable
class Pausable(Protocol):
    """An instrument that can wait for any time and then go on with the next unit of work."""

    def pause(self) -> str:
        """Come to a state that may last for days and return its name: `holds 20 degC`.

        What the next unit of work does not set again itself must stay as it is. Raises
        PauseRefused, or InstrumentError, with the reason.
        """
        ...


@dataclass
class PauseAnswers:
    """What each instrument said to a pause: what it does meanwhile, or why it refuses."""

    acknowledged: dict[str, str] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


def ask_devices(instruments: Mapping[str, object]) -> PauseAnswers:
    """Ask every opened instrument that can harm whether it can be left alone now.

    One without a verb for that must read back as safe; these are asked first, and no other after
    one that refuses, so that none is changed for a pause that does not come.
    """
    words = PauseAnswers()
    for name, instrument in instruments.items():
        if isinstance(instrument, MadeSafe) and not isinstance(instrument, Pausable):
            ask_for_rest(name, instrument, words)
    if not words.refused:
        for name, instrument in instruments.items():
            if isinstance(instrument, Pausable):
                try:
                    words.acknowledged[name] = instrument.pause()
                except (PauseRefused, InstrumentError) as error:
                    words.refused[name] = str(error)
                    break
    return words


def ask_for_rest(name: str, instrument: MadeSafe, words: PauseAnswers) -> None:
    """Let the read-back of an instrument's safe state be its word."""
    try:
        reading = instrument.read_safety()
    except InstrumentError as error:
        words.refused[name] = str(error)
        return
    if reading.safe:
        words.acknowledged[name] = reading.read_back
    else:
        words.refused[name] = f"it is not at rest: {reading.read_back}"


MAX_CAUSE = 200
ABORT_VERB = "`station abort`"
ENDS_FIRST = "the run ends first"
NO_UNIT_FOLLOWS = "no pause comes: the run is in its last unit of work, or past it, and ends first"
TAKEN_BACK = "somebody let the run go on before the pause came"
RECEIVED = "the request was received: the run ends at its next wait, and then makes the bench safe"
ENDS_ALREADY = "the run is ending already: it makes the bench safe"


class PauseRequest:
    """The wish of one terminal, or of several, that the run pauses before its next unit."""

    def __init__(self, control: Control, wishes: list[Incoming]) -> None:
        self._control = control
        self._wishes = wishes

    @property
    def withdrawn(self) -> bool:
        """Whether everybody who asked has gone."""
        return all(wish.withdrawn for wish in self._wishes)

    def acknowledge(self, said: Mapping[str, str]) -> None:
        """Say that the run is paused, and what each device does meanwhile."""
        self._control.now_paused(said)
        for wish in self._wishes:
            wish.answer(outcome="paused", devices=dict(said))

    def refuse(self, reasons: Mapping[str, str]) -> None:
        """Say why the run goes on, by the name of each device that refuses."""
        for wish in self._wishes:
            wish.answer(outcome="refused", devices=dict(reasons))


class Says(Protocol):
    """Whatever shows the operator a sentence."""

    def say(self, text: str) -> None:
        """Show it."""
        ...


class PausableRun(Protocol):
    """What a pause needs of a run."""

    record: RunRecord

    @property
    def progress(self) -> Says:
        """What the operator reads."""
        ...

    @property
    def instruments(self) -> Mapping[str, object]:
        """The opened instruments by instance."""
        ...


class Control:
    """What other terminals ask of a run; a context that lasts until the bench is made safe.

    A run that nobody asks anything does exactly what it would do without.
    """

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._folder = folder
        self._clock = clock
        self._channel: Channel | None = None
        self._lock = Lock()
        self._wakes = Event()
        self._waiting: list[Incoming] = []
        self._paused: Mapping[str, str] | None = None
        self._goes_on = False
        self._ending = False
        self._abort: Aborted | None = None
        self._made_safe: list[dict[str, Any]] | None = None
        self.desk = PromptQueue(clock)
        self.hurry: Callable[[], None] = lambda: None
        """Cuts short the waits of making the bench safe."""
        self.live: Callable[[], Mapping[str, Any]] = dict
        """What the run sets and reads just now."""
        self.may_still_pause: Callable[[], bool] = lambda: True
        """Whether the run comes to a place between two units, as far as is known."""

    def __enter__(self) -> Control:
        try:
            self._channel = Channel(self._folder, self._take)
        except OSError as error:
            tell(f"WARNING: `station pause` and `station abort` cannot reach this run: {error}")
        return self

    def __exit__(self, *_: object) -> None:
        self.hold()
        if self._channel is not None:
            self._channel.close()

    def hold(self) -> None:
        """From now on the bench is made safe: a wish comes too late."""
        with self._lock:
            self._ending = True
            for wish in self._waiting:
                wish.answer(outcome="ended", said=ENDS_FIRST)
            self._waiting.clear()

    def made_safe(self, outcomes: Sequence[SafeOutcome]) -> None:
        """Let others know how the bench was left, whatever becomes of the log."""
        self._made_safe = [outcome.to_data() for outcome in outcomes]

    def between_units(self, run: PausableRun) -> None:
        """Pause before a unit of work where somebody asks for it.

        Raises what ends the run meanwhile: an abort, a signal, an interlock.
        """
        while (request := self.pause_wanted()) is not None:
            self._pause(run, request)

    def pause_wanted(self) -> PauseRequest | None:
        """Take the wish to pause, if there is one; every call may be the only one to get it."""
        if not self._waiting:
            return None
        with self._lock:
            wishes = [wish for wish in self._waiting if not wish.withdrawn]
            self._waiting.clear()
        return PauseRequest(self, wishes) if wishes else None

    def now_paused(self, said: Mapping[str, str]) -> None:
        """From now on the run waits for somebody to let it go on."""
        with self._lock:
            self._paused, self._goes_on = said, False
            self._wakes.clear()

    def wait_for_go_on(self, clock: Clock) -> None:
        """Wait until somebody lets the run go on; raises what ends it instead."""
        try:
            wait_for_person(clock, self._wakes, lambda: self._goes_on)
        finally:
            with self._lock:
                self._paused, self._goes_on = None, False

    def _pause(self, run: PausableRun, request: PauseRequest) -> None:
        run.progress.say("a pause was asked for")
        run.record.event("pause-requested", durable=False)
        words = ask_devices(run.instruments)
        if words.refused or request.withdrawn:
            reasons = words.refused or {"operator": "took the request back"}
            run.record.event("pause-refused", durable=False, reasons=reasons)
            request.refuse(reasons)
            run.progress.say(f"not paused: {in_words(reasons)}")
            return
        began_s = self._clock.now()
        run.record.event("paused", devices=words.acknowledged)
        request.acknowledge(words.acknowledged)
        run.progress.say(
            f"paused ({in_words(words.acknowledged)}); `station resume {self._folder}` goes on, "
            f"`station abort {self._folder}` or Ctrl-C ends the run"
        )
        self.wait_for_go_on(self._clock)
        run.record.event("went-on", paused_s=round(self._clock.now() - began_s, 6))
        run.progress.say("the run goes on")

    def _take(self, incoming: Incoming) -> None:
        """Note a wish; called by the channel's threads."""
        with self._lock:
            match incoming.asked:
                case "abort":
                    self._wish_to_abort(incoming)
                case "pause":
                    self._wish_to_pause(incoming)
                case "go-on":
                    self._wish_to_go_on(incoming)
                case "answer":
                    self.desk.take(incoming)
                case "status":
                    incoming.answer(
                        outcome="status",
                        paused=self._paused is not None,
                        devices=dict(self._paused or {}),
                        pause_requested=any(not wish.withdrawn for wish in self._waiting),
                        ending=self._ending,
                        safe_state=self._made_safe,
                    )
                case "live":
                    pausing = any(not wish.withdrawn for wish in self._waiting)
                    incoming.answer(outcome="live", pause_requested=pausing, **self.live())
                case other:
                    incoming.answer(outcome="unknown", said=f"unknown request {other!r}")

    def _wish_to_abort(self, incoming: Incoming) -> None:
        if self._ending:
            self.hurry()
            incoming.answer(outcome="ending", said=ENDS_ALREADY)
            return
        by = str(incoming.details.get("by", ABORT_VERB))
        self._abort = ended_by(by[:MAX_CAUSE] if by.isprintable() else ABORT_VERB)
        self._clock.interrupt(self._abort)
        self._wakes.set()
        incoming.answer(outcome="ending", said=RECEIVED)

    def _wish_to_pause(self, incoming: Incoming) -> None:
        if self._ending or self._abort is not None:
            incoming.answer(outcome="ended", said=ENDS_FIRST)
        elif self._paused is not None and not self._goes_on:
            incoming.answer(outcome="paused", devices=dict(self._paused))
        elif not self.may_still_pause():
            incoming.answer(outcome="ended", said=NO_UNIT_FOLLOWS)
        else:
            incoming.meanwhile = {"said": "the run pauses before its next unit of work"}
            self._waiting.append(incoming)

    def _wish_to_go_on(self, incoming: Incoming) -> None:
        if self._paused is None and not self._waiting:
            incoming.answer(outcome="not-paused")
            return
        for wish in self._waiting:
            wish.answer(outcome="withdrawn", said=TAKEN_BACK)
        self._waiting.clear()
        self._goes_on = self._paused is not None
        self._wakes.set()
        incoming.answer(outcome="goes-on")


def in_words(words: Mapping[str, str]) -> str:
    """Return what each device said, in one line."""
    return "; ".join(f"{name}: {word}" for name, word in words.items()) or "nothing can harm"
