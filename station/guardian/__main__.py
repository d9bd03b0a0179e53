"""`python -m station.guardian`: the process that a run starts and nobody else."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from station.guardian.messages import GuardianLine
    from station.guardian.notes import OperatorOutput

# A person's wish ends the run, and the guardian after it; the last is for one that is at work.
POLITE = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK", "SIGUSR1")


def main() -> int:
    """Watch the run that is at the other end of standard input; 3 where not all could be safe."""
    # First of all: whatever ends the run politely ends it first, and the guardian after it.
    for name in POLITE:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    from station.errors import reason_of
    from station.guardian.messages import GuardianLine, given_by_parent
    from station.guardian.notes import OperatorOutput

    run = GuardianLine(given_by_parent())
    words = OperatorOutput(os.dup(2))
    silence(0, 1, 2)
    try:
        return watch(run, words)
    except Exception as error:  # the other guardian, or a new one, does what this one cannot
        run.send({"failed": reason_of(error)})
        words.tell(f"a fault of the program: {reason_of(error)}")
        words.finish(LAST_WORDS_S)
        return 3


LAST_WORDS_S = 2.0


def watch(run: GuardianLine, words: OperatorOutput) -> int:
    """Get ready, watch, and do what is to be done."""
    from station.guardian.make_safe import MakeSafe
    from station.guardian.messages import Instructions
    from station.guardian.watching import OtherProcess, Peer, Watching, first_message

    first = first_message(run)
    if first is None:
        return 0
    instructions = Instructions(**first)
    runner, peer = OtherProcess(instructions.runner_pid), Peer()
    bench_guard = MakeSafe(instructions, words, peer)
    run.send({"ready": True})
    watching = Watching(run, peer, instructions.rank, bench_guard)
    duty = watching.until_end()
    if duty is None:
        return 0
    exit_code = bench_guard.make_safe(duty, runner)
    words.finish(LAST_WORDS_S)
    return exit_code


def silence(*numbers: int) -> None:
    """Let what drivers print go nowhere: a stopped terminal must not stop whoever prints."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in numbers:
        os.dup2(nowhere, number)


if __name__ == "__main__":
    # Nothing is waited for: a thread that is stuck in a write would keep the process for ever.
    os._exit(main())
