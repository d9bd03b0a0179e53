"""`python -m station.guardian`: the process that a run starts and nobody else."""

from __future__ import annotations

import os
import signal
import sys
from io import FileIO

POLITE = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def main() -> int:
    """Watch the run that is on the other end of standard input; 3 where not all could be safe."""
    # First of all: whatever ends the run politely ends it first, and the guardian after it.
    for name in POLITE:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    # A driver that prints must neither be taken for an answer nor fill a pipe that nobody reads.
    answers = os.dup(1)
    os.dup2(2, 1)
    from station.guardian.messages import Instructions, line_of

    # Unbuffered: what a reading thread would hold at the end of the process cannot be in its way.
    pipe = FileIO(0, closefd=False)
    first = pipe.readline()
    if not first.endswith(b"\n"):
        return 0
    instructions = Instructions.from_line(first)
    from station.guardian.runner_process import RunnerProcess
    from station.guardian.takeover import Takeover
    from station.guardian.watching import watch_until_end

    try:
        runner = RunnerProcess(instructions.runner_pid)
        takeover = Takeover(instructions)
    except Exception as error:  # whatever it is, the run is told and energises nothing
        os.write(answers, line_of({"failed": str(error)}))
        return 3
    os.write(answers, line_of({"ready": True}))
    os.close(answers)
    why, watched = watch_until_end(pipe, takeover.prepare)
    if why is None or not watched:
        return 0
    return takeover.take_over(why, watched, runner)


if __name__ == "__main__":
    sys.exit(main())
