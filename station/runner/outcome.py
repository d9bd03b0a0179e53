"""How a run ended."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from station.clock import ClockError
from station.errors import EXIT_FAULT, StationError, place_of, reason_of

if TYPE_CHECKING:
    from station.instruments.last_look import LastLook
    from station.instruments.whole_bench import LeftOut
    from station.results import ResultDocument
    from station.safety.safe_state import SafeOutcome
    from station.safety.witness import WitnessReport

NO_MEMORY = "this computer has no memory left; end other programs"
WITHOUT_MEMORY = (
    "annot allocate memory",
    "failed to map segment",
    "emory allocation",
    "ut of memory",
    "not enough memory",
    "insufficient memory",
    "can't start new thread",
    "can't allocate lock",
    "without setting an exception",
    "without exception set",
)
"""What the system, a C library or Python says where it got no memory; the last two are Python's
words of a C function that failed and had no memory to say why."""
FROM_C = (ImportError, OSError, RuntimeError, SystemError)
"""As what such words come."""


@dataclass
class Outcome:
    """How a run ended: its folder, the exit code, results or what went wrong, the safe state."""

    folder: Path
    exit_code: int = EXIT_FAULT
    document: ResultDocument | None = None
    error: str | None = None
    safe: list[SafeOutcome] = field(default_factory=list)
    """Of what the run used; and of what it did not use, where that is not at rest."""
    outside: list[SafeOutcome] = field(default_factory=list)
    """How everything else on the bench that can harm was read."""
    left_out: list[LeftOut] = field(default_factory=list)
    """What can harm and was not read back: another run holds it, or it does not answer."""
    witness_reports: list[WitnessReport] = field(default_factory=list)
    """What a second instrument said of what was switched off."""
    read_when: str = ""
    """When the bench was looked at last, and how old the oldest reading was then."""
    left_to: str = ""
    """Who goes on trying where not everything could be verified as safe, for the operator."""

    ask_at_the_end: Callable[[], None] = lambda: None
    """Asks a person for what nothing waited for; called once the results are printed."""

    @property
    def sentence(self) -> str:
        """Return in one line how the run ended, for somebody who is not there."""
        unsafe = ", ".join(reading.instrument for reading in self.unsafe)
        at_bench = f"NOT VERIFIED as safe: {unsafe}" if unsafe else "the bench is safe"
        verdict = f"verdict {self.document.verdict}" if self.document else "no results"
        return "; ".join(sentence for sentence in (self.error, verdict, at_bench) if sentence)

    @property
    def unsafe(self) -> list[SafeOutcome]:
        """Instruments whose safe state could not be verified."""
        return [outcome for outcome in self.safe if not outcome.verified]

    def take(self, look: LastLook) -> None:
        """Take how the bench was left."""
        self.safe = [*look.used, *look.bench.energised]
        self.outside, self.left_out = list(look.bench.outside), list(look.bench.left_out)
        self.witness_reports, self.read_when = list(look.witness_reports), look.when

    @property
    def doubted(self) -> list[SafeOutcome]:
        """Those that read back as safe themselves, and a second instrument contradicts."""
        return [outcome for outcome in self.unsafe if outcome.doubted]

    @property
    def left_unsafe(self) -> list[SafeOutcome]:
        """Those of them that the run used, and answers for."""
        return [outcome for outcome in self.unsafe if outcome.used]


def in_one_sentence(error: Exception) -> str:
    """Return what ended a run, for a person."""
    if is_lack_of_memory(error):
        return f"{NO_MEMORY}, then go on with `station resume`"
    known = isinstance(error, StationError | ClockError)
    return str(error) if known else f"a fault of the program: {reason_of(error)}{place_of(error)}"


def is_lack_of_memory(error: BaseException | None) -> bool:
    """Whether there was no memory: for data, for a library, for a thread, or to say what failed.

    Of an error that is not one of ours, what it came of counts, too.
    """
    if error is None:
        return False
    full = isinstance(error, OSError) and error.errno == errno.ENOMEM
    if isinstance(error, MemoryError) or full:
        return True
    if isinstance(error, StationError | ClockError):
        return False
    by_c = isinstance(error, FROM_C) and any(sign in str(error) for sign in WITHOUT_MEMORY)
    return by_c or is_lack_of_memory(error.__cause__ or error.__context__)
