"""The command `station`; each verb imports what it needs when it is used."""

from __future__ import annotations

import json
import os
import sys

SHOW_TRACEBACK = "STATION_TRACEBACK"


def main() -> None:
    """Run the command line and exit with the contract's code."""
    from station.cli.app import app
    from station.console import tell
    from station.errors import EXIT_ABORTED, EXIT_FAULT, StationError

    try:
        app()
    except StationError as error:
        tell(str(error))
        if "--json" in sys.argv:  # a program that asked for a document gets one in every case
            print(json.dumps({"error": str(error), "exit_code": error.exit_code}))
        sys.exit(error.exit_code)
    except Exception as error:  # a fault of ours must not look like a result outside its limit
        if os.environ.get(SHOW_TRACEBACK):
            raise
        tell(
            f"a fault of the program: {error!r}; set {SHOW_TRACEBACK}=1 and run again to see where"
        )
        sys.exit(EXIT_FAULT)
    except KeyboardInterrupt:
        tell("ended by the operator")
        sys.exit(EXIT_ABORTED)
