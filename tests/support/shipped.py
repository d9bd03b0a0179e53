"""The shipped benches."""

from __future__ import annotations

from station import registry
from station.bench import Bench, read_bench
from station.lookup import BENCHES, find


def shipped_bench() -> Bench:
    return read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
