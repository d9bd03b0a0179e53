"""Make the bench of a dead run safe: end its process, open, bring to rest, verify, say so.

Whatever is needed for that is in memory before the run energises anything: its disk may be gone.
"""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

from station import registry
from station.clock import RealClock
from station.errors import EXIT_DONE, EXIT_FAULT, StationError, reason_of
from station.guardian.messages import DONE, WAITS, Instructions
from station.guardian.notes import LEAVE, AtWork, Background, GuardianLock, Notes, Words
from station.guardian.opening import OPENS_WITHIN_S, Reopening, rehearse
from station.guardian.processes import OtherProcess, end_all, let_end
from station.guardian.watching import Peer, SafingOrder
from station.instruments.bench import read_bench
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.last_look import LastLook, look_last
from station.instruments.opening import Probe, put_settings_back
from station.instruments.whole_bench import BenchReading, LeftOut, UnusedInstruments
from station.record.events import AT_REST_AGAIN, BENCH_READ, LEFT, SAFE_STATE, whole_bench
from station.roles.base import MadeSafe
from station.safety.acknowledgement import WITNESS, remember
from station.safety.safe_state import ATTEMPTS, Hurry, SafeOutcome, make_bench_safe
from station.safety.witness import Sighting, WitnessReport, judge, not_asked

ENDS_WITHIN_S, LEAVES_WITHIN_S = 10.0, 5.0
FIRST_ATTEMPTS = 4
PAUSES_S = (0.0, 0.0, 3.0, 5.0, 10.0)
"""Real time before each attempt, the last before all that follow, for as long as it takes.

The second follows at once: the first met what was on the line.
"""
SLICE_S = 0.1
BALLAST_BYTES = 16_000_000
"""Memory that is given back when the guardian has to act, so that it has some then."""
SAYS_WITHIN_S = 1.0
"""Who holds the locks is written where a disk may hang; nothing waits for that."""
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")


class MakeSafe:
    """Everything that is needed to make a bench safe, made ready while its run still lives.

    Raises FaultList or InputError where the bench file or a driver of it cannot be loaded.
    """

    def __init__(self, instructions: Instructions, words: Words, peer: Peer) -> None:
        self._folder = Path(instructions.folder)
        self._words = words
        self._peer = peer
        self._addresses = instructions.addresses
        self._bench = read_bench(Path(instructions.bench), registry.names(registry.DRIVERS))
        self._order = self._bench.safe_order()
        self._clock = RealClock(instructions.speed, instructions.epoch_unix)
        self._locks = InstrumentLocks(f"the guardian of {self._folder}", instructions.world)
        self._reopening = Reopening(self._bench, self._addresses, self._clock, self._locks)
        self._at_work = GuardianLock(instructions.folder)
        self._saying = Background("who holds the locks")
        self._bystanders = UnusedInstruments(
            self._bench,
            self._addresses,
            self._clock,
            f"the guardian of {self._folder}",
            self._locks,
        )
        self._bench_file = Path(instructions.bench_file) if instructions.bench_file else None
        self._real_instruments = instructions.real
        self._sightings: list[Sighting] = []
        self._harmless: set[str] = set()
        self._rehearsed: set[str] = set()
        self._leave = Event()
        self._real = RealClock()
        self._until_s = 0.0
        # While the run lives there is room for a thread; it says nothing before `_until_s`.
        self._beating = peer.beat_while(lambda: self._real.now() < self._until_s)
        self._ballast = bytearray(BALLAST_BYTES)
        self.prepare(instructions.instruments or self._bench.instruments)
        for entry in self._bench.instruments.values():
            with suppress(StationError):  # what the run does not use is named where it is read
                registry.load(registry.DRIVERS, entry.driver)

    def hold(self, names: list[str], files: list[int]) -> None:
        """Hold a lock together with the run: it is free when both are gone."""
        self._locks.handed_on(names, files)

    def see(self, sightings: Sequence[Mapping[str, Any]]) -> None:
        """Know what witnesses saw of the sources that the run drives."""
        self._sightings = [Sighting(**sighting) for sighting in sightings]

    def leave_to_peer(self) -> None:
        """Say nothing more where somebody waits for the end of what is said."""
        self._words.leave_pipes()

    def prepare(self, names: Iterable[str]) -> None:
        """Load all that instruments need, and find out which of them have no safe state.

        Raises InputError where a driver cannot be loaded.
        """
        for name in names:
            if name not in self._bench.instruments or name in self._rehearsed:
                continue
            self._rehearsed.add(name)
            entry = self._bench.instruments[name]
            driver = registry.load(registry.DRIVERS, entry.driver)
            if isinstance(driver, type) and not issubclass(driver, MadeSafe):
                self._harmless.add(name)
            elif not entry.shares:
                address = self._addresses.get(name, entry.address or "")
                rehearse(name, self._bench, address)

    def make_safe(self, duty: SafingOrder, runner: OtherProcess) -> int:
        """End who is in the way, make safe until all is, and return the exit code."""
        self._ballast.clear()
        self._until_s = self._real.now() + 2 * ENDS_WITHIN_S
        self._say_who_holds()
        peer = self._peer
        if hasattr(signal, LEAVE):
            signal.signal(getattr(signal, LEAVE), lambda *_: self._leave.set())
        # Serial ports are exclusive, and some instruments serve one client.
        in_the_way = [] if duty.let_go else [runner]
        in_the_way += [peer.process] if peer.process is not None and not peer.can_act else []
        ended = end_all(in_the_way, ENDS_WITHIN_S)
        wanted = [name for name in duty.instruments if name not in self._harmless]
        notes = Notes(self._folder, self._clock, self._words, runner if duty.let_go else None)
        kind = "handed-over" if duty.let_go else "runner-gone"
        notes.note(kind, message=duty.why, process_ended=ended, instruments=wanted)
        self._words.tell(f"{duty.why}; the bench is being made safe")
        if not ended:
            self._words.tell(
                "the run's process does not end and may keep instruments from answering"
            )
        outcomes, look = self._until_proven(wanted, notes)
        others = look.bench
        notes.note(BENCH_READ, **look.to_data())
        self._saying.finish(SAYS_WITHIN_S)
        self._locks.release()
        self._at_work.end()
        peer.say(DONE)
        self._beating.set()
        self._words.tell(summary(list(outcomes.values()), others, look.when, look.witness_reports))
        if peer.process is not None:  # one that stands still would keep the instruments
            let_end(peer.process, LEAVES_WITHIN_S)
        notes.close()
        rests = all(map(is_verified, outcomes.values())) and not others.energised
        return EXIT_DONE if rests else EXIT_FAULT

    def _until_proven(
        self, wanted: Sequence[str], notes: Notes
    ) -> tuple[dict[str, SafeOutcome], LastLook]:
        """Try until everything is verified and is so still at a last look, or a person ends it.

        What a witness alone contradicts is named, and tried no more: it may be wrong itself.
        """
        outcomes: dict[str, SafeOutcome] = {}
        attempts = 0
        while True:
            attempts = self._until_safe(wanted, notes, outcomes, attempts)
            ends = self._leave.is_set()
            look = self._look_last(outcomes, notes)
            outcomes |= {outcome.instrument: outcome for outcome in look.used}
            proven = all(map(is_verified, outcomes.values()))
            if not proven:
                notes.note(SAFE_STATE, outcomes=[o.to_data() for o in outcomes.values()])
            if ends and not proven:
                notes.note(LEFT, message="a person ended the guardian")
            if ends or all(map(is_settled, outcomes.values())):
                return outcomes, look
            if attempts >= FIRST_ATTEMPTS:
                self._say_what_is_left(outcomes)

    def _look_last(self, outcomes: Mapping[str, SafeOutcome], notes: Notes) -> LastLook:
        """Open everything once more and look; what cannot be opened is not verified."""
        self._allow(len(outcomes))
        names = [name for name, outcome in outcomes.items() if is_verified(outcome)]
        witnesses = [sighting.instrument for sighting in self._sightings if sighting.expected]
        probes = self._reopening.open([*names, *(w for w in witnesses if w not in names)])
        opened = {
            name: probe.identified.instrument
            for name, probe in probes.items()
            if probe.ok and probe.identified is not None
        }
        known = [
            outcome
            if outcome.instrument in opened or not is_verified(outcome)
            else replace(outcome, verified=False, read_back=probes[outcome.instrument].said)
            for outcome in outcomes.values()
        ]
        harmful = {n: device for n, device in opened.items() if isinstance(device, MadeSafe)}
        look = look_last(
            harmful,
            [o for o in known if o.instrument in harmful or not o.verified],
            self._order,
            self._clock,
            Hurry(self._clock),
            lambda only: self._read_others(list(outcomes), only),
            lambda: [judge(s, opened.get(s.instrument), self._clock) for s in self._sightings],
        )
        put_settings_back(opened.values())
        for instrument in opened.values():
            with suppress(Exception):  # a line that is gone keeps no other from being closed
                instrument.close()
        for words in look.again:
            notes.note(AT_REST_AGAIN, message=words)
        if doubted := [outcome for outcome in look.used if outcome.doubted]:
            self._refuse_bench("; ".join(f"{o.instrument}: {o.read_back}" for o in doubted), probes)
        return look

    def _refuse_bench(self, words: str, probes: Mapping[str, Probe]) -> None:
        """Have the bench refused until a person acknowledges what a witness saw."""
        instruments = None
        if self._real_instruments:
            instruments = {
                self._bench.instruments[name].address or "": (
                    probe.identified.identity.model,
                    probe.identified.identity.serial,
                )
                for name, probe in probes.items()
                if probe.identified is not None
            }
        if self._bench_file is not None:
            with suppress(OSError):
                remember(self._bench_file, WITNESS, words, self._folder, instruments)

    def _until_safe(
        self,
        wanted: Sequence[str],
        notes: Notes,
        outcomes: dict[str, SafeOutcome],
        attempt: int,
    ) -> int:
        """Try until all is settled, a person ends it, or the first attempts are made.

        `attempt` were made before; what is verified is to be looked at once, whatever else is left.
        Return how many have been made, with their `outcomes`.
        """
        known = shape_of(outcomes)
        while True:
            left = [name for name in wanted if not is_settled(outcomes.get(name))]
            if attempt and not left:
                return attempt
            last = self._leave.is_set()
            self._allow(len(left))
            self._pause(PAUSES_S[min(attempt, len(PAUSES_S) - 1)])
            attempt += 1
            outcomes |= self._attempt_or_say_why(left)
            if (now := shape_of(outcomes)) != known or attempt <= FIRST_ATTEMPTS:
                data = [outcomes[name].to_data() for name in wanted]
                notes.note(SAFE_STATE, attempt=attempt, outcomes=data)
            if attempt > FIRST_ATTEMPTS and now != known:
                self._say_what_is_left(outcomes)
            known = now
            if last or attempt == FIRST_ATTEMPTS:
                return attempt

    def _read_others(self, names: Sequence[str], only: Sequence[str] | None) -> BenchReading:
        """Read what else on the bench can harm, where there is room for the threads of that."""
        self._until_s = max(self._until_s, self._real.now() + 2 * ENDS_WITHIN_S)
        try:
            return self._bystanders.read(names, only=only)
        except Exception as error:  # what the run used is safe, whatever this says
            why = f"{self._bench.name}: {reason_of(error)}"
            others = [
                instrument for instrument in self._bench.instruments if instrument not in names
            ]
            return BenchReading(left_out=[LeftOut(other, "not read", why) for other in others])

    def _say_what_is_left(self, outcomes: Mapping[str, SafeOutcome]) -> None:
        unverified = [name for name, outcome in outcomes.items() if not outcome.verified]
        if not unverified:
            return
        self._say_who_holds(unverified)
        self._words.tell(
            f"{summary([outcomes[name] for name in unverified])}\n  This process goes on trying, "
            f"every {PAUSES_S[-1]:g} s, and keeps the instruments of the run; "
            f"`station abort {self._folder}` ends it"
        )
        self._words.leave_pipes()
        self._peer.say(WAITS)

    def _say_who_holds(self, waits_for: Sequence[str] = ()) -> None:
        """Let whoever is refused an instrument, or asks how the run stands, read why."""
        sentence = AtWork(os.getpid(), tuple(waits_for)).sentence()

        def say() -> None:
            self._at_work.say(waits_for)
            self._locks.say(f"{sentence}; run folder {self._folder}")

        self._saying.do(say)

    def _allow(self, instruments: int) -> None:
        """Declare how long the next attempt may take, with its pause: then the peer takes over."""
        within_s = sum(seconds for _, seconds in self._order) + 60.0 * instruments
        self._until_s = (
            self._real.now()
            + PAUSES_S[-1]
            + OPENS_WITHIN_S
            + ATTEMPTS * within_s / min(self._clock.speed, 1.0)
        )

    def _pause(self, seconds: float) -> None:
        until_s = self._real.now() + seconds
        while self._real.now() < until_s and not self._leave.is_set():
            self._real.sleep(SLICE_S)

    def _attempt_or_say_why(self, names: Sequence[str]) -> dict[str, SafeOutcome]:
        """As `_attempt`; whatever that fails of, as a lack of memory, it is tried again."""
        try:
            return self._attempt(names)
        except Exception as error:
            fault = f"a fault of the program: {reason_of(error)}"
            return {name: SafeOutcome(name, False, fault, 0.0) for name in names}

    def _attempt(self, names: Sequence[str]) -> dict[str, SafeOutcome]:
        """Open what answers, make it safe, and close it again."""
        outcomes: dict[str, SafeOutcome] = {}
        opened: dict[str, Any] = {}
        for name, probe in self._reopening.open(names).items():
            if probe.ok and probe.identified is not None:
                opened[name] = probe.identified.instrument
                continue
            outcomes[name] = SafeOutcome(name, False, probe.said, 0.0)
            if probe.identified is not None:  # another instrument stands there: not ours to touch
                with suppress(Exception):
                    probe.identified.instrument.close()
        made_safe = make_bench_safe(opened, self._order, self._clock)
        outcomes |= {outcome.instrument: outcome for outcome in made_safe}
        for name, instrument in opened.items():
            # What was opened but has no safe state cannot harm.
            outcomes.setdefault(name, SafeOutcome(name, True, "it cannot harm", 0.0))
            with suppress(Exception):  # a line that is gone keeps no other from being closed
                instrument.close()
        return outcomes


def is_settled(outcome: SafeOutcome | None) -> bool:
    """Whether nothing more is to be tried: it is at rest, or a witness alone contradicts that."""
    return is_verified(outcome) or (outcome is not None and outcome.doubted)


def is_verified(outcome: SafeOutcome | None) -> bool:
    """Whether an instrument is known to be at rest."""
    return outcome is not None and outcome.verified


def shape_of(outcomes: Mapping[str, SafeOutcome]) -> str:
    """Return how a bench stands, numbers aside: what changes in it is worth a word."""
    states = (
        f"{name} {outcome.verified} {outcome.read_back}"
        for name, outcome in sorted(outcomes.items())
    )
    return NUMBER.sub("#", "; ".join(states))


def summary(
    outcomes: Sequence[SafeOutcome],
    others: BenchReading | None = None,
    when: str = "",
    witness_reports: Sequence[WitnessReport] = (),
) -> str:
    """Return what an operator must know of how the bench was left, `when` it was looked at last.

    `others` is what was read of the instruments that the run did not use.
    """
    others = others or BenchReading()
    unverified = [outcome for outcome in (*outcomes, *others.energised) if not outcome.verified]
    if not unverified:
        read_back = "; ".join(f"{outcome.instrument} {outcome.read_back}" for outcome in outcomes)
        whole = whole_bench(left.to_data() for left in others.left_out)
        unasked = "".join(f"\n  - {words}" for words in map(not_asked, witness_reports) if words)
        return f"{whole}: {read_back or 'nothing can harm'}{when}{unasked}"
    read_back = "".join(
        f"\n  - {outcome.instrument}: {outcome.read_back}" for outcome in unverified
    )
    acknowledge = (
        "; then `station acknowledge` the bench"
        if any(outcome.doubted for outcome in unverified)
        else ""
    )
    return f"NOT VERIFIED as safe; go to the bench and switch off by hand{acknowledge}:{read_back}"
