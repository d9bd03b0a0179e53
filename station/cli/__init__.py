"""The command `station`; each verb imports what it needs when it is used."""

from __future__ import annotations

import atexit
import json
import os
import signal
import sys
from contextlib import suppress
from io import StringIO
from typing import NoReturn

SHOW_TRACEBACK = "STATION_TRACEBACK"

INTERRUPTED = 130
ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Our matrices are small: more threads cost time, and another number of them other last digits."""
NO_PLUGINS = {"PYDANTIC_DISABLE_PLUGINS": "__all__"}
"""Pydantic looks for plug-ins in every installed package, and fails where the metadata is odd."""


def main() -> None:
    """Run the command line and exit with the contract's code."""
    for name, value in (ONE_BLAS_THREAD | NO_PLUGINS).items():
        os.environ.setdefault(name, value)
    from station.console import take_over_streams

    take_over_streams()
    # The exit code is known then; the system's own reaction to Ctrl-C would replace it.
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
    from station.cli.app import app
    from station.console import holds_every_sign, tell
    from station.errors import (
        EXIT_ABORTED,
        EXIT_FAULT,
        EXIT_WRONG_INPUT,
        NotPermitted,
        StationError,
        reason_of,
    )
    from station.packages import clashes, why_broken
    from station.speech import HERE, of_environment

    if all(map(holds_every_sign, (sys.stdout, sys.stderr))):  # else signs would be numbers
        HERE.language = of_environment()
    try:
        if (broken := why_broken()) is not None:
            raise StationError(broken)
        for sentence in clashes():
            tell(f"WARNING: {sentence}")
        code = app(standalone_mode=False)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        sys.exit(code if isinstance(code, int) else 0)
    except StationError as error:
        tell(str(error))
        _exit(str(error), error.exit_code)
    except Exception as error:  # a fault of ours must not look like a result outside its limit
        show = getattr(error, "show", None)
        if show is not None:  # a wrong command line, in the words of the library that reads it
            from station.cli.wrong_words import say_what_was_meant

            say_what_was_meant(error)
            words = StringIO()
            show(file=words)
            tell(words.getvalue(), end="")
            _exit(str(getattr(error, "format_message", error.__str__)()), EXIT_WRONG_INPUT)
        if os.environ.get(SHOW_TRACEBACK):
            raise
        from station.runner.outcome import NO_MEMORY, is_lack_of_memory

        if is_lack_of_memory(error):
            tell(NO_MEMORY)
            _exit(NO_MEMORY, EXIT_FAULT)
        if isinstance(error, PermissionError) and error.filename is not None:
            refused = NotPermitted(error.filename)
            tell(str(refused))
            _exit(str(refused), refused.exit_code)
        message = f"a fault of the program: {reason_of(error)}"
        tell(f"{message}; set {SHOW_TRACEBACK}=1 and run again to see where")
        _exit(message, EXIT_FAULT)
    except KeyboardInterrupt:
        tell("ended by the operator")
        _exit("ended by the operator", EXIT_ABORTED)


def _exit(error: str, code: int) -> NoReturn:
    """Exit; a program that asked for a document gets one in every case."""
    from station.errors import StationError

    if "--json" in sys.argv:
        with suppress(StationError):  # standard output itself is what is wrong
            print(json.dumps({"error": error, "exit_code": code}))
    sys.exit(code)
