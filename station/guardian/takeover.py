"""Make the bench of a dead run safe: end its process, open, bring to rest, verify, say so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from station import registry
from station.bench import read_bench
from station.clock import RealClock
from station.errors import EXIT_DONE, EXIT_FAULT
from station.guardian.log import SAFE_STATE
from station.guardian.messages import Instructions
from station.guardian.notes import Notes
from station.guardian.runner_process import RunnerProcess
from station.runner.instrument_locks import InstrumentLocks
from station.runner.opening import Probe, open_one
from station.safety.safe_state import MadeSafe, SafeOutcome, make_bench_safe

RUNNER_ENDS_WITHIN_S = 10.0
PAUSES_S = (0.0, 0.0, 3.0, 5.0)
"""Real time before each attempt. The second follows at once: the first met what was on the line."""


class Takeover:
    """Everything that is needed to make a bench safe, made ready while its run still lives.

    Raises FaultList or InputError where the bench file or a driver of it cannot be loaded.
    """

    def __init__(self, instructions: Instructions) -> None:
        self._folder = Path(instructions.folder)
        self._addresses = instructions.addresses
        self._bench = read_bench(Path(instructions.bench), registry.names(registry.DRIVERS))
        self._clock = RealClock(instructions.speed, instructions.epoch_unix)
        self._locks = InstrumentLocks(f"the guardian of {self._folder}")
        self._harmless: set[str] = set()
        self.prepare(instructions.instruments or self._bench.instruments)

    def prepare(self, names: Iterable[str]) -> None:
        """Import the drivers of instruments, and find out which of them have no safe state.

        Raises InputError where a driver cannot be loaded.
        """
        for name in names:
            if name in self._bench.instruments:
                driver = registry.load(registry.DRIVERS, self._bench.instruments[name].driver)
                if isinstance(driver, type) and not issubclass(driver, MadeSafe):
                    self._harmless.add(name)

    def take_over(self, why: str, watched: Sequence[str], runner: RunnerProcess) -> int:
        """End the run's process, make what it had safe, and return the exit code."""
        # Serial ports are exclusive, and some instruments serve one client.
        runner_ended = runner.end(RUNNER_ENDS_WITHIN_S)
        notes = Notes(self._folder, self._clock)
        wanted = [name for name in watched if name not in self._harmless]
        notes.note("runner-gone", message=why, process_ended=runner_ended, instruments=wanted)
        notes.tell(f"{why}; the bench is being made safe")
        if not runner_ended:
            notes.tell("the run's process does not end and may keep instruments from answering")
        outcomes: dict[str, SafeOutcome] = {}
        for attempt, pause_s in enumerate(PAUSES_S, start=1):
            left = [name for name in wanted if not is_verified(outcomes.get(name))]
            if attempt > 1 and not left:
                break
            RealClock().sleep(pause_s)
            outcomes |= self._attempt(left)
            told = [outcomes[name].to_data() for name in wanted]
            notes.note(SAFE_STATE, attempt=attempt, outcomes=told)
        self._locks.release()
        unverified = [one for one in outcomes.values() if not one.verified]
        notes.tell(summary(list(outcomes.values())))
        notes.close()
        return EXIT_FAULT if unverified else EXIT_DONE

    def _attempt(self, names: Sequence[str]) -> dict[str, SafeOutcome]:
        """Open instruments on fresh lines, bring them to rest in the bench's order, close them."""
        began_s = self._clock.now()
        outcomes: dict[str, SafeOutcome] = {}
        opened: dict[str, Any] = {}
        for name in names:
            probe = self._open(name)
            if probe.ok and probe.found is not None:
                opened[name] = probe.found.instrument
                continue
            said = probe.said.removeprefix(f"{name}: ")
            outcomes[name] = SafeOutcome(name, False, said, self._clock.now() - began_s)
            if probe.found is not None:  # another instrument stands there: not ours to touch
                with suppress(Exception):
                    probe.found.instrument.close()
        made_safe = make_bench_safe(opened, self._bench.safe_order(), self._clock)
        outcomes |= {one.instrument: one for one in made_safe}
        for name, instrument in opened.items():
            # What was opened but has no safe state cannot harm.
            outcomes.setdefault(name, SafeOutcome(name, True, "it cannot harm", 0.0))
            with suppress(Exception):  # a line that is gone keeps no other from being closed
                instrument.close()
        return outcomes

    def _open(self, name: str) -> Probe:
        try:
            return open_one(name, self._bench, self._addresses, self._clock, locks=self._locks)
        except Exception as error:  # a fault of one driver keeps no other from its work
            return Probe(name, False, f"{name}: a fault of its driver: {error!r}")


def is_verified(outcome: SafeOutcome | None) -> bool:
    """Whether an instrument is known to be at rest."""
    return outcome is not None and outcome.verified


def summary(outcomes: Sequence[SafeOutcome]) -> str:
    """Return what an operator must know of how the bench was left."""
    unverified = [one for one in outcomes if not one.verified]
    if not unverified:
        said = "; ".join(f"{one.instrument} {one.read_back}" for one in outcomes)
        return f"the bench is safe, read back from every instrument: {said or 'nothing can harm'}"
    said = "".join(f"\n  - {one.instrument}: {one.read_back}" for one in unverified)
    return f"NOT VERIFIED as safe; go to the bench and switch off by hand:{said}"
