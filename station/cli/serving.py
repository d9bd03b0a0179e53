"""`station sim`."""

from __future__ import annotations

import json
import math
import signal
import sys
from threading import Event, Thread
from typing import Any

from station import registry
from station.cli.validating import read_bench_named
from station.clock import RealClock
from station.errors import InputError
from station.runner.signals import wishes
from station.runner.simulation import serve_bench


def serve(bench_name: str, procedure: str, speed: float) -> None:
    """Serve a simulated bench until interrupted; the first line says where everything is."""
    if not 0 < speed < math.inf:
        raise InputError(f"--speed {speed:g}: give a number above 0, such as 1 or 50")
    bench = read_bench_named(bench_name)
    if bench.simulation is None:
        raise InputError(f"{bench.name} is a real bench: its file has no `simulation`")
    if procedure not in registry.names(registry.PROCEDURES):
        registry.procedure(procedure)  # says which there are
    clock = RealClock(speed)
    simulation = serve_bench(bench, clock, procedure)
    simulation.make_ready()
    if not sys.stdin.isatty():
        Thread(target=answer_lines, args=(simulation,), name="faults", daemon=True).start()
    ended = Event()
    for number in wishes():
        signal.signal(number, lambda *_: ended.set())
    head = {
        "instruments": simulation.instruments,
        "clock": {"speed": clock.speed, "epoch_unix": clock.epoch_unix},
        "procedure": procedure,
        "acts": simulation.serve_acts(),
    }
    try:
        print(json.dumps(head), flush=True)
        print(f"serving {bench.name}; Ctrl-C ends it", file=sys.stderr)
        ended.wait()
    finally:
        simulation.close()
        clock.stop()


def answer_lines(simulation: Any) -> None:
    """Inject the fault that each line of standard input describes; `report` asks for the world."""
    for line in sys.stdin:
        if line.strip():
            print(simulation.answer(line), file=sys.stderr, flush=True)
