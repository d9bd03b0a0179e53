"""Open instruments beside one another in a thread each: those of a dead run, and in rehearsal.

One that hangs keeps no other from its turn. One that cannot be understood is switched off all the
same, by the command that its driver sends without waiting for an answer: it may hear, and answer
late. Who clearly is another model gets nothing, nor does what the command would toggle.

Drivers and the libraries below them load parts of themselves when they are first used; a rehearsal
against nobody has them in memory, for the disk that holds them may not answer later.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from threading import Event, Thread

from station.clock import Clock, RealClock
from station.errors import AnotherInstrument, InstrumentError, reason_of
from station.guardian.notes import started
from station.instruments.bench import Bench
from station.instruments.instrument_locks import Identity, InstrumentLocks
from station.instruments.opening import Opened, Probe, open_one
from station.roles.base import MAX_DEADLINE_S, Driver, SwitchedOffBlindly

OPENS_WITHIN_S = 5.0
"""Real time; a connection that nobody takes is given up after 2 s."""
HANGS = "{}: it was not open after {:g} s: its line or the computer's own port for it hangs"
SWITCHED_OFF = "{}; it was sent the command to switch off all the same, which was not read back"


class Opening:
    """One instrument that is opened in a thread of its own, or here where there is none."""

    def __init__(
        self,
        name: str,
        bench: Bench,
        addresses: Mapping[str, str],
        clock: Clock,
        locks: InstrumentLocks | None = None,
        unproved: str = "",
    ) -> None:
        self._name = name
        self._what = (bench, addresses, clock)
        self._locks = locks
        self.probe: Probe | None = None
        self._patient = bool(unproved)
        self.unproved = unproved
        """What is known of one that was sent the command to switch off, also the last time."""
        self._met = False
        self._known = Event()
        """Whether it answers, or was sent the command to switch off all the same."""
        self._thread = started(self._open, f"open {name}")
        if self._thread is None:
            self._open()

    def wait(self, within_s: float) -> Probe:
        """Return whether it answers, as far as is known after `within_s` of real time.

        A late answer of one that was switched off all the same is waited for the next time.
        """
        if self._thread is not None and self._met:
            self._thread.join(max(within_s, 0.0))
        self._met = self._known.wait(max(within_s, 0.0))
        words = self.unproved or HANGS.format(self._name, OPENS_WITHIN_S)
        return self.probe or Probe(self._name, False, words)

    def _open(self) -> None:
        try:
            probe = open_one(self._name, *self._what, locks=self._locks, identify=self._identity)
        except Exception as error:  # a fault of one driver keeps no other from its work
            why = f"{self._name}: a fault of its driver: {reason_of(error)}"
            probe = Probe(self._name, False, why)
        if self.unproved and not probe.ok and probe.identified is None:
            probe = replace(probe, said=SWITCHED_OFF.format(probe.said))
        self.probe = probe
        self._known.set()

    def _identity(self, instrument: Opened) -> Identity:
        """Return who answers; who cannot be understood is switched off, and may answer late.

        Who was late the last time has all the time for its first answer: it is not cut off again.
        """
        try:
            if self._patient:
                be_patient_with(instrument)
                return instrument.identify()
            return _asked_twice(instrument)
        except AnotherInstrument:
            raise
        except InstrumentError as error:
            if not isinstance(instrument, SwitchedOffBlindly):
                raise
            instrument.last_attempt()
            self.unproved = SWITCHED_OFF.format(error)
        self._known.set()
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


class Reopening:
    """The instruments of a bench; one that still hangs is waited for, never opened twice."""

    def __init__(
        self, bench: Bench, addresses: Mapping[str, str], clock: Clock, locks: InstrumentLocks
    ) -> None:
        self._bench, self._addresses, self._clock = bench, addresses, clock
        self._locks = locks
        self._hanging: dict[str, Opening] = {}
        self._unproved: dict[str, str] = {}

    def open(self, names: Sequence[str]) -> dict[str, Probe]:
        """Return whether each answers, after 5 s of real time at most; those that do are open."""
        opening = {
            name: self._hanging.pop(name) if name in self._hanging else self._begun(name)
            for name in names
        }
        real = RealClock()
        until_s = real.now() + OPENS_WITHIN_S
        probes = {}
        for name, attempt in opening.items():
            probes[name] = attempt.wait(until_s - real.now())
            if attempt.probe is None:
                self._hanging[name] = attempt
            if attempt.unproved:
                self._unproved[name] = attempt.unproved
        return probes

    def _begun(self, name: str) -> Opening:
        what = (self._bench, self._addresses, self._clock, self._locks)
        return Opening(name, *what, self._unproved.get(name, ""))


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
        Opening(name, bench, {name: instead}, RealClock()).wait(REHEARSES_WITHIN_S)
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
