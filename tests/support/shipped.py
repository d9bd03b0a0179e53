"""The shipped benches."""

from __future__ import annotations

from station import registry
from station.files.lookup import BENCHES, find
from station.instruments.bench import Bench, read_bench


def shipped_bench() -> Bench:
    return read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
