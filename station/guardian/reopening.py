"""Open the instruments of a dead run side by side: one that hangs keeps no other from its turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from station.clock import Clock, RealClock
from station.guardian.notes import started
from station.instruments.bench import Bench
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.opening import Probe, open_one

OPENS_WITHIN_S = 5.0
"""Real time; a connection that nobody takes is given up after 2 s."""
HANGS = "{}: it was not open after {:g} s: its line or the computer's own port for it hangs"


class Opening:
    """One instrument that is opened in a thread of its own, or here where there is none."""

    def __init__(
        self,
        name: str,
        bench: Bench,
        addresses: Mapping[str, str],
        clock: Clock,
        locks: InstrumentLocks | None = None,
    ) -> None:
        self._name = name
        self._what = (bench, addresses, clock)
        self._locks = locks
        self.probe: Probe | None = None
        self._thread = started(self._open, f"open {name}")
        if self._thread is None:
            self._open()

    def wait(self, within_s: float) -> None:
        """Wait until it is known whether it answers, at most `within_s` of real time."""
        if self._thread is not None:
            self._thread.join(max(within_s, 0.0))

    def _open(self) -> None:
        try:
            self.probe = open_one(self._name, *self._what, locks=self._locks)
        except Exception as error:  # a fault of one driver keeps no other from its work
            self.probe = Probe(self._name, False, f"{self._name}: a fault of its driver: {error!r}")


class Reopening:
    """The instruments of a bench; one that still hangs is waited for, never opened twice."""

    def __init__(
        self, bench: Bench, addresses: Mapping[str, str], clock: Clock, locks: InstrumentLocks
    ) -> None:
        self._bench, self._addresses, self._clock = bench, addresses, clock
        self._locks = locks
        self._hanging: dict[str, Opening] = {}

    def open(self, names: Sequence[str]) -> dict[str, Probe]:
        """Return whether each answers, after 5 s of real time at most; those that do are open."""
        opening = {
            name: self._hanging.pop(name)
            if name in self._hanging
            else Opening(name, self._bench, self._addresses, self._clock, self._locks)
            for name in names
        }
        real = RealClock()
        until_s = real.now() + OPENS_WITHIN_S
        probes = {}
        for name, one in opening.items():
            one.wait(until_s - real.now())
            if one.probe is None:
                self._hanging[name] = one
            probes[name] = one.probe or Probe(name, False, HANGS.format(name, OPENS_WITHIN_S))
        return probes
