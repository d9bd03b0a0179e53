"""Benches with faults, and raw clients that also see what is no proper reply."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sim_bench import Frames, Line, bench_with, served

from sim_instruments.bench import SimulatedBench
from station.clock import VirtualClock

SUPPLY, GAUSSMETER, BOARD = "coil_supply.y", "gaussmeter", "gyro_acquisition"
START, STOP = 1, 2
Entry = dict[str, Any]


@contextmanager
def faulty(*entries: Entry) -> Iterator[tuple[VirtualClock, SimulatedBench]]:
    clock = VirtualClock()
    with served(clock, bench_with(faults=list(entries))) as bench:
        yield clock, bench


@contextmanager
def line_with(instrument: str, **entry: Any) -> Iterator[tuple[RawLine, SimulatedBench]]:
    with (
        faulty({"instrument": instrument, **entry}) as (clock, bench),
        RawLine(bench, instrument, clock) as line,
    ):
        yield line, bench


@contextmanager
def board_with(**entry: Any) -> Iterator[tuple[VirtualClock, SimulatedBench, Frames]]:
    with faulty({"instrument": BOARD, **entry}) as (clock, bench):
        bench.act("dut-power-on")
        with Frames(bench, clock) as board:
            yield clock, bench, board


class RawLine(Line):
    """A client that also sees what is no proper reply."""

    def bytes_of(self, text: str, within_s: float = 1.0) -> bytes | None:
        """Return what comes back within a time, as it is; None for nothing at all."""
        self._send(text.encode("ascii") + b"\n")
        return self.what_comes(within_s)

    def what_comes(self, within_s: float = 1.0) -> bytes | None:
        """Return what comes back within a time; empty when the connection has ended."""
        if not self._wire.wait(self._clock.now() + within_s):
            return None
        self._wire.received()
        return self._socket.recv(65536)
