"""Make the bench of a dead run safe: end its process, open, bring to rest, verify, say so.

Whatever is needed for that is in memory before the run energises anything: its disk may be gone.
Drivers and the libraries below them load parts of themselves when they are first used; a rehearsal
against nobody has them in memory.

An instrument that hangs keeps no other from its turn. One that cannot be understood is switched off
all the same, by the command that its driver sends without waiting for an answer: it may hear, and
answer late. Who clearly is another model gets nothing, nor does what the command would toggle.
"""

from __future__ import annotations

import os
import re
import signal
import socket
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Any

from station import registry
from station.clock import Clock, RealClock
from station.errors import (
    EXIT_DONE,
    EXIT_FAULT,
    AnotherInstrument,
    InstrumentError,
    StationError,
    reason_of,
)
from station.guardian.messages import DONE, WAITS, Instructions
from station.guardian.notes import LEAVE, AtWork, Background, GuardianLock, Notes, OperatorOutput
from station.guardian.watching import OtherProcess, Peer, SafingOrder, end_all, let_end
from station.instruments.bench import Bench, read_bench
from station.instruments.beside import Beside
from station.instruments.instrument_locks import Identity, InstrumentLocks
from station.instruments.last_look import LastLook, look_last
from station.instruments.opening import Opened, Probe, open_one, put_settings_back
from station.instruments.whole_bench import BenchReading, LeftOut, UnusedInstruments
from station.record.events import AT_REST_AGAIN, BENCH_READ, LEFT, SAFE_STATE, whole_bench
from station.roles.base import MAX_DEADLINE_S, Driver, MadeSafe, SwitchedOffBlindly
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

    def __init__(self, instructions: Instructions, words: OperatorOutput, peer: Peer) -> None:
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


OPENS_WITHIN_S = 5.0
"""Real time; a connection that nobody takes is given up after 2 s."""
HANGS = "{}: it was not open after {:g} s: its line or the computer's own port for it hangs"
SWITCHED_OFF = "{}; it was sent the command to switch off all the same, which was not read back"


class Reopening:
    """Open the instruments of a bench beside one another; one that still hangs is waited for."""

    def __init__(
        self,
        bench: Bench,
        addresses: Mapping[str, str],
        clock: Clock,
        locks: InstrumentLocks | None = None,
    ) -> None:
        self._what = (bench, addresses, clock)
        self._locks = locks
        self._unproved: dict[str, str] = {}
        """What is known of those that were sent the command to switch off."""
        self._beside = Beside(self._open)

    def open(self, names: Sequence[str], within_s: float = OPENS_WITHIN_S) -> dict[str, Probe]:
        """Return whether each answers, after so much real time at most; those that do are open.

        A late answer of one that was switched off all the same is waited for the next time.
        """
        probes = self._beside.do([[name] for name in names], within_s)
        hangs = {name: Probe(name, False, HANGS.format(name, within_s)) for name in names}
        return hangs | probes

    def _open(self, name: str) -> Probe:
        try:
            identify = partial(self._identity, name, patient=name in self._unproved)
            probe = open_one(name, *self._what, locks=self._locks, identify=identify)
        except Exception as error:  # a fault of one driver keeps no other from its work
            probe = Probe(name, False, f"{name}: a fault of its driver: {reason_of(error)}")
        if name in self._unproved and not probe.ok and probe.identified is None:
            probe = replace(probe, said=SWITCHED_OFF.format(probe.said))
        return probe

    def _identity(self, name: str, instrument: Opened, *, patient: bool) -> Identity:
        """Return who answers; who cannot be understood is switched off, and may answer late.

        Who was late the last time has all the time for its first answer: it is not cut off again.
        """
        try:
            if not patient:
                return _asked_twice(instrument)
            be_patient_with(instrument)
            return instrument.identify()
        except AnotherInstrument:
            raise
        except InstrumentError as error:
            if not isinstance(instrument, SwitchedOffBlindly):
                raise
            instrument.last_attempt()
            self._unproved[name] = SWITCHED_OFF.format(error)
        self._beside.known_so_far(name, Probe(name, False, self._unproved[name]))
        be_patient_with(instrument)
        return instrument.identify()


def be_patient_with(instrument: Opened) -> None:
    """Wait for each answer as long as any bench may allow."""
    if isinstance(instrument, Driver):
        instrument.place.exchanges.deadline_s = MAX_DEADLINE_S


def _asked_twice(instrument: Opened) -> Identity:
    """Return who answers; the first question may meet what was on the line."""
    try:
        return instrument.identify()
    except AnotherInstrument:
        raise
    except InstrumentError:
        return instrument.identify()


REHEARSES_WITHIN_S = 2.0
"""Less than a guardian may be silent: an instrument may come to be watched late."""
RESOURCE = re.compile(r"tcpip\d*::.*", re.IGNORECASE)
URL = re.compile(r"(?P<scheme>[a-z-]+)://[^/]+(?P<path>.*)", re.IGNORECASE)


def rehearse(name: str, bench: Bench, address: str) -> None:
    """Open an instrument where its network address would be, on this computer, and fail.

    Nothing is sent to any instrument. Other kinds of line are left alone: what they need is
    loaded with their driver.
    """
    nobody = Nobody()
    with suppress(OSError, UnicodeError):  # what names of hosts are looked up with, too
        socket.getaddrinfo("localhost", None)
    if instead := at_port(address, nobody.port):
        Reopening(bench, {name: instead}, RealClock()).open([name], REHEARSES_WITHIN_S)
    nobody.leave()


def at_port(address: str, port: int) -> str | None:
    """Return an address of the same kind at a port of this computer, None for other kinds."""
    if RESOURCE.fullmatch(address):
        return f"TCPIP::127.0.0.1::{port}::SOCKET"
    if match := URL.fullmatch(address):
        return f"{match['scheme']}://127.0.0.1:{port}{match['path']}"
    return None


class Nobody:
    """Whoever connects finds the line closed at once."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        Thread(target=self._close_all, name="nobody", daemon=True).start()

    def leave(self) -> None:
        """Listen no more."""
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()

    def _close_all(self) -> None:
        with suppress(OSError):
            while True:
                self._listening.accept()[0].close()
