"""`station identify`."""

from __future__ import annotations

import json

from station.cli.validating import read_bench_named
from station.errors import EXIT_DONE, EXIT_FAULT
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.opening import probe
from station.runner.session import BenchSession


def identify_bench(bench_name: str, mounted: str, *, as_json: bool) -> int:
    """Ask every instrument of a bench who it is; exit code 3 when one is missing or wrong."""
    bench = read_bench_named(bench_name)
    locks = InstrumentLocks("`station identify`")
    with BenchSession(bench, mounted) as session, session.clock.participant("run"):
        rows = [
            probe(
                instance, bench, session.addresses, session.clock, None if session.here else locks
            )
            for instance in bench.instruments
        ]
    if as_json:
        print(json.dumps([row.to_data() for row in rows], indent=1, ensure_ascii=False))
    else:
        for row in rows:
            print(f"{'ok   ' if row.ok else 'WRONG'} {row.name:<27} {row.said}")
    return EXIT_DONE if all(row.ok for row in rows) else EXIT_FAULT
