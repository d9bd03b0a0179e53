"""Runs that are killed, run out of disk or are repeated, and what their folders then hold.

What a folder holds is read here by code of its own, not by the station's: an error in writing
that its reader makes up for would show.
"""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from command_line import station_command
from for_people import need_sentences
from mcap.exceptions import McapError
from mcap.stream_reader import StreamReader
from quick_yaml import dump_yaml, load_yaml

from sim_instruments.bench import SimulatedBench
from station import registry
from station.clock import VirtualClock
from station.control.questions import Operator
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.instruments.opening import InstrumentPlace
from station.method.duration import NO_TIME
from station.method.verbs import Recording
from station.procedure import Procedures
from station.record.folder import RunRecord
from station.runner.progress import Progress
from station.runner.run import ActingRun

PROCEDURE = "rlg-magnetic-sensitivity"
STREAM_PERIODS_S = {"gyro.a": 0.013, "gyro.b": 0.02, "gyro.c": 0.05, "gyro.d": 0.1}
FIRST_PREVIOUS = "0" * 64


def shipped(kind: str, name: str) -> dict[str, Any]:
    """Return the data of a shipped plan or bench."""
    text = (files("config") / kind / f"{name}.yaml").read_text(encoding="utf-8")
    data: dict[str, Any] = load_yaml(text)
    return data


def short_plan(folder: Path, **parameters: Any) -> Path:
    """Write the shipped laser-gyro plan with a short warm-up and short records."""
    plan = shipped("plans", PROCEDURE)
    warm_up = {"slope_limit": "10 deg/h^2", "window": "1 min", "at_most": "5 min"}
    plan["parameters"] |= {"duration": "100 s", "warm_up": warm_up, **parameters}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "plan.yaml"
    path.write_text(dump_yaml(plan), encoding="utf-8")
    return path


def station(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Do a verb in a process of its own; what it says is held to be sentences for a person."""
    done = subprocess.run(
        station_command(*arguments), capture_output=True, text=True, encoding="utf-8", check=False
    )
    need_sentences(done.stdout + done.stderr, f"station {' '.join(map(str, arguments))}")
    return done


def finished_run(parent: Path, axes: list[str]) -> Path:
    """Run the short plan with some axes to its end, and return the run folder."""
    plan = short_plan(parent / "plan", axes=axes)
    done = station("run", plan, "--non-interactive", "--output", parent / "runs")
    assert done.returncode == 0, done.stderr
    folder = only_run(parent / "runs")
    assert folder is not None
    return folder


REVISED_LINE = b'"event": "revision-written"'
"""Of the lines that list all files of a run, and so differ from one execution to the next."""


def file_hashes(folder: Path, *more: str) -> dict[str, str]:
    """Return the SHA-256 of the raw files, the log, and more files of a run folder.

    The line that names the run's own revision is left out: it lists all files, and so the time.
    """
    names = [*sorted((folder / "raw").iterdir()), *(folder / name for name in more)]
    log = (folder / "events.jsonl").read_bytes().splitlines(keepends=True)
    own = b"".join(line for line in log if REVISED_LINE not in line)
    return {
        "events.jsonl": hashlib.sha256(own).hexdigest(),
        **{file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in names},
    }


def whole_events(folder: Path) -> list[dict[str, Any]]:
    """Return the whole lines of a log, each proven to follow the one before."""
    *lines, _ = (folder / "events.jsonl").read_bytes().split(b"\n")
    previous, events = FIRST_PREVIOUS, []
    for line in lines:
        event = json.loads(line)
        assert event["previous"] == previous, "the chain of hashes breaks"
        previous = hashlib.sha256(line).hexdigest()
        events.append(event)
    return events


def finished_units(folder: Path) -> list[str]:
    """Return the units of work that the log calls finished."""
    return [event["unit"] for event in whole_events(folder) if event["event"] == "unit-finished"]


@dataclass
class RawContent:
    """The rows of a raw file by unit of work, and whether its last block was cut short."""

    rows: dict[str, list[np.ndarray]]
    cut: bool


def raw_content(path: Path) -> RawContent:
    """Read a raw file record by record, by the MCAP package alone."""
    content = RawContent({}, False)
    units: dict[int, str] = {}
    try:
        for record in StreamReader(io.BytesIO(path.read_bytes()), validate_crcs=True).records:
            kind = type(record).__name__
            if kind == "Channel":
                units[record.id] = record.topic.partition("/")[2]
            elif kind == "Message":
                rows = rows_of(record.data)
                content.rows.setdefault(units[record.channel_id], []).append(rows)
    except (McapError, ValueError, OSError):
        content.cut = True
    except Exception as error:  # the package raises struct.error, and once a bare Exception
        if "unpack" not in str(error):
            raise
        content.cut = True
    return content


def rows_of(data: bytes) -> np.ndarray:
    """Return the rows of a `.npy` byte string, as NumPy reads its header."""
    end = 10 + int.from_bytes(data[8:10], "little")
    dtype, count = npy_header(data[:end])
    return np.frombuffer(data, dtype, count, offset=end)


@cache
def npy_header(header: bytes) -> tuple[np.dtype, int]:
    """Return type and number of rows; NumPy parses a header as source, and most are alike."""
    stream = io.BytesIO(header)
    np.lib.format.read_magic(stream)
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    return dtype, shape[0]


@dataclass(frozen=True)
class Remainder:
    """How much of a reference run a killed one holds: bytes of log and raw files, units."""

    events: int
    raw_bytes: dict[str, int]
    finished: list[str]


def compare_with_reference(killed: Path, reference: Path) -> Remainder:
    """Hold what a kill left against the same run that was not disturbed (virtual time).

    Every file must be a beginning of the reference's, the log in whole lines, and every finished
    unit must have all of its rows. Raises AssertionError.
    """
    log = (killed / "events.jsonl").read_bytes()
    whole = log[: log.rfind(b"\n") + 1]
    lines = [line for line in whole.splitlines(keepends=True) if REVISED_LINE not in line]
    own = b"".join(lines)
    assert (reference / "events.jsonl").read_bytes().startswith(own), "the log differs"
    sizes = {}
    finished = finished_units(killed)
    for file in sorted((reference / "raw").iterdir()):
        left = killed / "raw" / file.name
        data = left.read_bytes() if left.is_file() else b""
        assert file.read_bytes().startswith(data), f"{file.name} is no beginning of the reference's"
        sizes[file.name] = len(data)
        expected = raw_content(file).rows
        there = raw_content(left).rows if data else {}
        for unit in finished:
            assert joined(there.get(unit)) == joined(expected.get(unit)), f"{unit} lost rows"
    return Remainder(len(whole_events(killed)), sizes, finished)


def joined(blocks: list[np.ndarray] | None) -> bytes:
    """Return blocks of rows as one byte string."""
    return b"".join(block.tobytes() for block in blocks or [])


def streams_bench(seed: int) -> dict[str, Any]:
    """Return the shipped bench with four pulse boards in place of one."""
    bench = shipped("benches", "sim")
    board = bench["instruments"].pop("gyro_acquisition")
    for number, name in enumerate(STREAM_PERIODS_S):
        bench["instruments"][name] = {**board, "serial": str(1042 + number)}
    bench["simulation"]["seed"] = seed
    # It is asked after the clock was stopped, too, when nothing comes that takes time.
    bench["instruments"]["coil_supply.x"]["simulator"]["command_time"] = "0 s"
    return bench


def four_streams(parent: Path, *, seed: int = 1, duration_s: float = 60.0) -> Path:
    """Record four streams while two more participants ask two of the instruments; return the run.

    The two watch a coil's current and read the gaussmeter through the locks of their lines, at
    periods of their own, and write what they see as interlocks would.
    """
    clock = VirtualClock()
    data = streams_bench(seed)
    simulated = SimulatedBench(data, clock, PROCEDURE)
    record = RunRecord(parent, "four-streams", "SN-1", clock)
    opened: list[Any] = []

    def open_instrument(name: str) -> Any:
        entry = data["instruments"][name]
        limits = {"current": 8.0, "voltage": 30.0, "slew": 2.0, "zero_current": 0.02}
        place = InstrumentPlace(
            name,
            simulated.instruments[name]["address"],
            clock,
            entry.get("settings", {}),
            limits if name.startswith("coil") else {},
        )
        opened.append(registry.load(registry.DRIVERS, entry["driver"])(place))
        return opened[-1]

    def watch_current() -> None:
        while True:
            clock.sleep(0.2)
            record.event("current", durable=False, said=supply.read_safety().read_back)

    def watch_field() -> None:
        while True:
            clock.sleep(0.3)
            record.event("gaussmeter", durable=False, rows=len(gaussmeter.drain()))

    with clock.participant("run"), Progress(duration_s, quiet=True) as progress:
        supply = open_instrument("coil_supply.x")
        gaussmeter = open_instrument("gaussmeter")
        simulated.act("dut-power-on")
        boards = {name: open_instrument(name) for name in STREAM_PERIODS_S}
        supply.programme_limits()
        supply.load_sine(0.1, 1.0)
        gaussmeter.start(2.0)
        for name, board in boards.items():
            board.source = name
            board.start(STREAM_PERIODS_S[name], 1)
        supply.start_sine()
        watchers = [clock.start("watch current", watch_current)]
        watchers += [clock.start("watch field", watch_field)]
        run = undirected_run(clock, record, progress)
        end_s = clock.now() + duration_s
        run.instruments = boards
        recording = Recording(run, "all", dict.fromkeys(boards, None))
        recording.until(lambda _: clock.now() >= end_s, takes=NO_TIME)
        clock.stop()
        for watcher in watchers:
            watcher.join(10.0)
        supply.stop()
        record.finish_unit("all")
    for instrument in opened:
        instrument.close()
    simulated.close()
    record.close()
    return record.path


def undirected_run(clock: VirtualClock, record: RunRecord, progress: Progress) -> ActingRun:
    """Return a run without steps, for code that records by itself."""
    plan = read_plan(Path(str(files("config") / "plans" / f"{PROCEDURE}.yaml")), Procedures())
    bench = read_bench(
        Path(str(files("config") / "benches" / "sim.yaml")), registry.names(registry.DRIVERS)
    )
    operator = Operator(clock, {}, interactive=False, act=None)
    return ActingRun(plan, bench, clock, record, progress, operator)


def only_run(parent: Path) -> Path | None:
    """Return the run folder below `parent`, or None when the run had not yet made one."""
    found = sorted(path for path in parent.glob("*") if not path.name.startswith("."))
    assert len(found) <= 1, found
    return found[0] if found else None


def opens(folder: Path) -> Iterator[str]:
    """Yield every fault of a run folder that a kill left: what cannot be opened or analysed."""
    for name in ("plan.yaml", "bench.yaml", "run.json", "events.jsonl"):
        if not (folder / name).is_file():
            yield f"{name} is missing"
    done = station("analyse", folder, "--json")
    if done.returncode not in (0, 1, 6):
        yield f"analyse ended with {done.returncode}: {done.stderr.strip()}"
        return
    document = json.loads(done.stdout)
    finished = set(finished_units(folder))
    # The units of work of the laser gyro are named by their axes, several driven at once by all.
    measured = {axis for unit in finished for axis in unit.split("-")}
    for entry in document["results"]:
        name, axis, value = entry["name"], entry["axis"], entry["value"]
        if document["procedure"] == PROCEDURE and (value is not None) != (axis in measured):
            yield f"{axis} is {value}, finished units are {sorted(finished)}"
        flagged = any(
            (flag["axis"] == axis and name in flag.get("coefficients", [name]))
            or (flag["axis"] is None and name in flag.get("coefficients", ()))
            or f"{name} {axis}" in flag.get("coefficients", ())
            for flag in document["flags"]
        )
        if value is None and not flagged:
            yield f"{name} {axis or ''} is missing and no flag says so"
