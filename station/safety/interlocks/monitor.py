"""Watch the interlocks of a run, whatever its steps do meanwhile.

One thread takes part in the run's time and looks at each interlock at its own period. A trip ends
the run at its next wait; a run that does not react in time is brought to rest from here.
"""

from __future__ import annotations

import _thread
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from station.clock import Clock, ClockError, ClockStopped
from station.errors import InputError, InstrumentError, InterlockTripped, reason_of
from station.roles.role import energised_states
from station.safety.interlocks.conditions import Judgement, QuantityReader
from station.safety.interlocks.contact_test import ContactTest
from station.safety.interlocks.reading import Interlock
from station.safety.readings import Readings

IDLE_PERIOD_S = 10.0
"""How often a quantity that only an energised bench can change is looked at on one at rest."""
REACTS_WITHIN_S = 1.5
"""Run time that a run has to react to a trip; longer than any of its waits is in one piece."""
MAX_SILENCE_S = 10.0
"""Real time without a sign of life of the thread that watches."""
MAX_LOOKS_OF_PATIENCE = 10.0
ROUNDING_S = 1e-9
LOOKS_AGAIN_S = 0.1


class InterlockLook(NamedTuple):
    """An interlock as it was seen last: `clear`, `waits` (true within its grace) or `tripped`."""

    name: str
    state: str
    said: str


class Watch:
    """One interlock: when it is looked at next, and since when its condition is true."""

    def __init__(self, interlock: Interlock, reader: QuantityReader) -> None:
        self.interlock = interlock
        self.reader = reader
        self.due_s = 0.0
        self.looked_s = -math.inf
        self.since_s: float | None = None
        self.said = ""
        self.own_state = [
            instrument
            for instrument in sorted(interlock.instruments)
            if energised_states(instrument)
        ]

    def look_at_states(self) -> None:
        """Find out which instruments are energised; one that does not say so is left out."""
        for instrument in list(self.own_state):
            for quantity in sorted(energised_states(instrument)):
                try:
                    self.reader.look(instrument, quantity)
                except InputError:
                    self.own_state.remove(instrument)
                    break

    def judge(self) -> Judgement:
        """Look now."""
        judged = self.interlock.when.evaluate(self.reader)
        self.said = judged.said
        return judged


class Monitor:
    """The interlocks of one run; `trip` is what tripped first, None while all is well."""

    def __init__(
        self,
        interlocks: Sequence[Interlock],
        instruments: Mapping[str, object],
        readings: Readings,
        clock: Clock,
        make_safe: Callable[[], object],
    ) -> None:
        self.trip: InterlockTripped | None = None
        self._clock = clock
        self._make_safe = make_safe
        self._now = QuantityReader(readings, instruments, clock, 0.0)
        self._watches = [
            Watch(interlock, QuantityReader(readings, instruments, clock, interlock.period_s))
            for interlock in interlocks
        ]
        self._energised = {
            name
            for name in instruments
            for quantity, state in energised_states(name).items()
            if (newest := readings.newest(name, quantity)) and newest.value == state
        }
        self._checking = clock.lock("the interlocks")
        self._stopped = False
        self._turn = 0
        self._instruments = instruments
        self._test: ContactTest | None = None
        readings.on_change(self._changed)

    def check_once(self) -> None:
        """Look at every interlock now; raises InterlockTripped, before anything is energised.

        No grace is given here: what is wrong already is not going to be made better by a run.
        Raises InputError where the bench file watches what a driver cannot be asked for.
        """
        for watch in self._watches:
            for watched in sorted(watch.interlock.when.watched):
                # The condition itself does not always look at all of its parts.
                watch.reader.look(*watched)
            watch.look_at_states()
            judged = watch.judge()
            if judged.true is not False:
                self.trip = self._tripped(watch, judged)
                raise self.trip
            watch.due_s = self._clock.now() + self._period_s(watch)

    def start(self) -> None:
        """Begin to watch."""
        if self._watches:
            self._turn = 1
            self._clock.start("interlocks", lambda: self._watch(1))

    def looks(self) -> list[InterlockLook]:
        """Return each interlock as it was seen last; any thread may ask."""
        tripped = self.trip.name if self.trip else None
        return [
            InterlockLook(
                watch.interlock.name,
                "tripped"
                if watch.interlock.name == tripped
                else "clear"
                if watch.since_s is None
                else "waits",
                watch.said,
            )
            for watch in self._watches
        ]

    @contextmanager
    def testing(self, test: ContactTest) -> Iterator[None]:
        """Excuse the contact that a person opens, while the bench is verified off.

        It ends where something becomes energised. Raises InterlockTripped where a contact is open
        once it is over.
        """
        self._test = test
        try:
            yield
        finally:
            self._test = None
        ended_s = self._clock.now()
        contacts = [watch for watch in self._watches if watch.interlock.on_contacts]
        while any(contact.looked_s <= ended_s for contact in contacts):
            self._clock.sleep(LOOKS_AGAIN_S)
            self.raise_trip()

    def raise_trip(self) -> None:
        """Raise what tripped, if anything did."""
        if self.trip is not None:
            raise self.trip

    def look_at_chains(self) -> None:
        """Look once at the contacts, also those that nobody watches any more.

        Levels are left out, since a bench at rest no longer has those at which a run failed; so is
        what cannot be read.
        """
        for watch in self._watches:
            if watch.interlock.on_contacts:
                judged = watch.interlock.when.evaluate(self._now)
                if judged.true:
                    self.trip = self._tripped(watch, judged)
                    return

    def stop(self) -> None:
        """Watch no more; from now on the bench is being made safe, which nothing delays."""
        self._stopped = True

    def wait_until_stopped(self) -> None:
        """Return when no instrument is being asked any more, so that lines may be closed."""
        with self._checking:
            pass

    @property
    def stopped(self) -> bool:
        """Whether the run itself has begun to make the bench safe."""
        return self._stopped

    def _watch(self, turn: int) -> None:
        with self._clock.pulse("the watching of the interlocks", MAX_SILENCE_S):
            self._watch_until_stopped(turn)

    def _watch_until_stopped(self, turn: int) -> None:
        try:
            while self.trip is None:
                self._clock.sleep_until(min(watch.due_s for watch in self._watches))
                with self._checking:
                    if self._stopped or turn != self._turn:
                        return
                    self._look_where_due()
        except (ClockStopped, ClockError):
            raise
        except Exception as error:  # interlocks that nobody watches any more must end the run
            sentence = (
                "the interlocks cannot be watched any more, a fault of the program: "
                f"{reason_of(error)}"
            )
            self.trip = InterlockTripped("monitor", sentence, self._clock.now())
        self._alarm(self.trip)

    def _look_where_due(self) -> None:
        now_s = self._clock.now()
        for watch in self._watches:
            if watch.due_s > now_s:
                continue
            if self._stopped:
                return
            judged = self._judged(watch)
            watch.looked_s, now_s = now_s, self._clock.now()
            watch.due_s = now_s + self._period_s(watch)
            if judged.true is False:
                watch.since_s = None
                continue
            watch.since_s = now_s if watch.since_s is None else watch.since_s
            trips_s = watch.since_s + watch.interlock.grace_s
            if now_s >= trips_s - ROUNDING_S:
                self.trip = self._tripped(watch, judged)
                return
            watch.due_s = min(watch.due_s, trips_s)

    def _judged(self, watch: Watch) -> Judgement:
        """Look now; what is true because of the contact under test is false."""
        judged, test = watch.judge(), self._test
        if test is None or not judged.true or not watch.interlock.on_contacts:
            return judged
        try:
            refusal = test.refuses(watch.interlock, self._instruments)
        except InstrumentError as error:
            refusal = str(error)
        sentence = f"{judged.said}, {refusal or 'opened by hand for its test'}"
        watch.said = sentence
        return judged._replace(true=bool(refusal), said=sentence)

    def _tripped(self, watch: Watch, judged: Judgement) -> InterlockTripped:
        sentence = judged.said
        if watch.since_s is not None and watch.interlock.grace_s:
            sentence += f" (for {self._clock.now() - watch.since_s:.3g} s)"
        sentence += watch.reader.explained(watch.interlock.when.watched)
        return InterlockTripped(
            watch.interlock.name,
            sentence,
            self._clock.now(),
            value=judged.value,
            limit=judged.limit,
        )

    def _alarm(self, trip: InterlockTripped | None) -> None:
        """End the run; where it does not react, bring the bench to rest without it."""
        self._clock.interrupt(trip)
        self._clock.sleep(self._clock.patience_s(REACTS_WITHIN_S))
        if self._stopped:
            return
        _thread.interrupt_main()  # a run that lost the error is asked once more
        self._make_safe()

    def _period_s(self, watch: Watch) -> float:
        """Return the time to the next look, in s."""
        period_s = watch.interlock.period_s
        if watch.interlock.only_while_on and not self._is_on(watch):
            return max(period_s, IDLE_PERIOD_S)
        # Where time runs faster than real, looks must not crowd out the run itself.
        return max(period_s, self._clock.patience_s(period_s) / MAX_LOOKS_OF_PATIENCE)

    def _is_on(self, watch: Watch) -> bool:
        """Whether what is watched may be energised: itself, or anything where it does not say."""
        says = set(watch.own_state) == watch.interlock.instruments
        return bool(self._energised & set(watch.own_state) if says else self._energised)

    def _changed(self, instrument: str, quantity: str, state: str) -> None:
        """Look at once, and then often, when something becomes energised."""
        energised = energised_states(instrument).get(quantity)
        if energised is None:
            return
        if state != energised:
            self._energised.discard(instrument)
            return
        self._energised.add(instrument)
        self._test = None
        if not self._turn or self._stopped or self.trip is not None:
            return
        now_s = self._clock.now()
        for watch in self._watches:
            if watch.interlock.only_while_on and self._is_on(watch):
                watch.due_s = min(watch.due_s, now_s)
        # The thread that sleeps towards a later time returns when it wakes.
        self._turn = turn = self._turn + 1
        self._clock.start(f"interlocks {turn}", lambda: self._watch(turn))
