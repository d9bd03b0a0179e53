"""`station identify`, `scan`, `sim`: instruments that answer, real or simulated."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from typing import Any

from station import registry
from station.cli.validating import read_bench_named, read_served
from station.clock import RealClock
from station.console import tell
from station.control.signals import wishes
from station.errors import EXIT_DONE, EXIT_FAULT, InputError
from station.instruments.bench import Bench
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.opening import Probe, explained, probe
from station.instruments.scan import draft, scan
from station.procedure import procedure_of
from station.runner.session import BenchSession, serve_bench
from station.speech import said

MAX_AT_ONCE = 1 << 16
LOOKS_EVERY_S = 0.2


def identify_bench(bench_name: str, mounted: str, *, as_json: bool) -> int:
    """Identify every instrument of a bench; exit code 3 when one is missing or wrong."""
    bench = read_bench_named(bench_name)
    rows = identified(bench, mounted, bench.instruments, "`station identify`")
    if as_json:
        print(json.dumps([row.to_data() for row in rows], indent=1, ensure_ascii=False))
    else:
        for row in rows:
            print(f"{said('ok   ' if row.ok else 'WRONG')} {row.name:<27} {said(row.said)}")
    return EXIT_DONE if all(row.ok for row in rows) else EXIT_FAULT


def identified(bench: Bench, mounted: str, names: Iterable[str], who: str) -> list[Probe]:
    """Ask instruments of a bench who they are; nothing is set. `who` asks, for others to read."""
    locks = InstrumentLocks(who)
    with BenchSession(bench, mounted) as session, session.clock.participant("run"):
        taken = None if session.here else locks
        return explained(
            bench,
            [probe(name, bench, session.addresses, session.clock, taken) for name in names],
        )


def print_scan(hosts: Sequence[str], library: str, served: Path | None, *, as_json: bool) -> int:
    """Print what is attached on standard error and a bench-file draft on standard output.

    Returns exit code 3 when nothing answers.
    """
    seen = scan(hosts, library, read_served(served) if served else None)
    answered = any(answer.answered for answer in seen)
    if as_json:
        rows = [vars(answer) for answer in seen]
        print(json.dumps({"seen": rows, "draft": draft(seen)}, indent=1, ensure_ascii=False))
    else:
        for answer in seen:
            mark = "     " if not answer.answered else "ok   " if answer.driver else "?    "
            answer_text = f"{answer.driver}: {answer.said}" if answer.driver else answer.said
            tell(f"{mark} {answer.address:<36} {answer_text}")
        print(draft(seen), end="")
    if not answered:
        tell("nothing answers; switch the instruments on, or name hosts with --host")
    return EXIT_DONE if answered else EXIT_FAULT


def serve(bench_name: str, procedure: str, speed: float, *, until_stdin_closes: bool) -> None:
    """Serve a simulated bench until interrupted; the first line says where everything is.

    `until_stdin_closes`: it ends, too, when standard input does, with whoever started it.
    """
    if not 0 < speed < math.inf:
        raise InputError(f"--speed {speed:g}: give a number above 0, such as 1 or 50")
    bench = read_bench_named(bench_name)
    if bench.simulation is None:
        raise InputError(f"{bench.name} is a real bench: its file has no `simulation`")
    if procedure not in registry.names(registry.PROCEDURES):
        procedure_of(procedure)  # says which there are
    clock = RealClock(speed)
    simulation = serve_bench(bench, clock, procedure)
    simulation.make_ready()
    ended = Event()
    if hasattr(signal, "SIGTTIN"):  # a read in the background of a terminal fails, and stops nobody
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    answering = (simulation, ended, until_stdin_closes)
    Thread(target=answer_lines, args=answering, name="faults", daemon=True).start()
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
        tell(f"serving {bench.name}; Ctrl-C ends it")
        ended.wait()
    finally:
        simulation.close()
        clock.stop()


def answer_lines(simulation: Any, ended: Event, until_stdin_closes: bool) -> None:
    """Inject the fault that each line of standard input describes; `report` asks for the world."""
    for line in lines_of_input(ended):
        if line.strip():
            tell(simulation.answer(line))
    if until_stdin_closes:
        ended.set()
    elif not ended.is_set() and sys.stdin is not None and sys.stdin.isatty():
        tell("the input has ended: no further fault is taken; Ctrl-C ends this")


def lines_of_input(ended: Event) -> Iterator[str]:
    """Yield the lines of standard input, from a pipe or typed, until it ends or `ended` is set.

    In the background of its terminal the command goes on without; brought back it reads on.
    """
    rest = b""
    with suppress(OSError, ValueError, AttributeError):  # no input at all, or one that is gone
        handle = sys.stdin.fileno()
        while not ended.is_set():
            try:
                piece = os.read(handle, MAX_AT_ONCE)
            except OSError as error:
                if not (isinstance(error, BlockingIOError) or in_background(handle)):
                    raise
                ended.wait(LOOKS_EVERY_S)
                continue
            *lines, rest = (rest + piece).split(b"\n")
            yield from (line.decode(errors="replace") for line in lines)
            if not piece:
                break
    yield rest.decode(errors="replace")


def in_background(handle: int) -> bool:
    """Whether a terminal belongs to another command just now."""
    return os.isatty(handle) and os.tcgetpgrp(handle) != os.getpgrp()
