"""`station acknowledge`."""

from __future__ import annotations

import json
from dataclasses import asdict

from station.errors import InputError
from station.files.lookup import BENCHES, find
from station.safety.acknowledgement import acknowledge, addresses_in


def acknowledge_bench(name: str, *, as_json: bool) -> None:
    """Take back the refusal of a bench whose interlock tripped, and say what it was.

    Only the file's place and the addresses in it count, so that a bench file with a fault can be
    acknowledged too.
    """
    bench = find(BENCHES, name)
    try:
        trip = acknowledge(bench, addresses_in(bench))
    except OSError as error:
        raise InputError(
            f"the acknowledgement cannot be written: {error}; make that folder writable for "
            "everybody who uses the bench"
        ) from error
    if as_json:
        told = asdict(trip) if trip else None
        print(json.dumps({"bench": str(bench), "acknowledged": told}, indent=1, ensure_ascii=False))
    elif trip is None:
        print(f"{name}: no interlock waits to be acknowledged")
    else:
        print(f"{name}: acknowledged: {trip.message} ({trip.tripped_utc}, {trip.run})")
