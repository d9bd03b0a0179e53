"""The command `station`; each verb imports what it needs when it is used."""

from __future__ import annotations

import os
import sys

SHOW_TRACEBACK = "STATION_TRACEBACK"


def main() -> None:
    """Run the command line and exit with the contract's code."""
    from station.cli.app import app
    from station.errors import EXIT_ABORTED, EXIT_FAULT, StationError

    try:
        app()
    except StationError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except Exception as error:  # a fault of ours must not look like a result outside its limit
        if os.environ.get(SHOW_TRACEBACK):
            raise
        print(
            f"a fault of the program: {error!r}; set {SHOW_TRACEBACK}=1 and run again to see where",
            file=sys.stderr,
        )
        sys.exit(EXIT_FAULT)
    except KeyboardInterrupt:
        print("ended by the operator", file=sys.stderr)
        sys.exit(EXIT_ABORTED)
