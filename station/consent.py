"""What a person is asked, and what the answer means: to go on, to end the run, or nothing."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import dataclass

DONE, ABORT = "done", "abort"
GO_ON = frozenset(("", DONE, "y", "yes"))
END = frozenset(("no", "n", "q", "quit", ABORT))
HINT = f"Enter or `{DONE}` to go on, `{ABORT}` to end the run"
HINT_AT_THE_END = f"Enter or `{DONE}` once it is, `{ABORT}` to leave it; nothing else waits"


@dataclass(frozen=True)
class Prompt:
    """A request to the operator: a stable id, the sentence, and whether it is a physical act.

    A simulated bench does physical acts itself.
    """

    id: str
    text: str
    physical: bool = True


def meaning(text: str) -> str | None:
    """Return `done`, `abort`, or None for what is neither: nobody guesses at a safety question."""
    word = text.strip().lower()
    if word in GO_ON:
        return DONE
    # In doubt towards the end: `abort!` is meant.
    return ABORT if word.rstrip("!.") in END else None


def discard_typed() -> None:
    """Forget the keys that were pressed before a prompt was shown; they answer something else."""
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            msvcrt.getwch()
        return
    import termios

    # No terminal: nothing was typed.
    with suppress(AttributeError, OSError, ValueError, termios.error):
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
