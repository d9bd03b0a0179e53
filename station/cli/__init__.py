"""The command `station`; each verb imports what it needs when it is used."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and exit with the contract's code."""
    from station.cli.app import app
    from station.errors import EXIT_ABORTED, StationError

    try:
        app()
    except StationError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("ended by the operator", file=sys.stderr)
        sys.exit(EXIT_ABORTED)
