"""Runs that are killed at moments that a seed chooses, what they leave, and how they go on."""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from campaign_helpers import (
    compare_with_reference,
    finished_units,
    only_run,
    opens,
    raw_content,
    station,
    whole_events,
)
from command_line import station_command
from guardian_helpers import until, world
from quick_yaml import load_yaml

from campaigns.truths import off_the_truth
from station.record.folder import RunFolder

STARTING, EVALUATING = 0.1, 0.15
"""Share of the kills before the run has a folder to show, and after its last step."""
MAX_START_S, MAX_EVALUATION_S = 1.5, 1.5
LOOKS_EVERY_S = 0.001
GIVES_UP_AFTER_S = 120.0


@dataclass(frozen=True)
class Kill:
    """What a kill met: the run's folder if there was one, and when it came."""

    folder: Path | None
    phase: str
    was_running: bool
    unix_s: float
    left: tuple[str, ...] = ()
    """The process numbers of its children, such as its guardian."""


def written_bytes(parent: Path) -> int:
    """Return how many bytes of log and raw data a run has written by now."""
    files = [*parent.glob("[!.]*/events.jsonl"), *parent.glob("[!.]*/raw/*.mcap")]
    return sum(file.stat().st_size for file in files)


def kill_at_random_moment(
    command: list[str],
    parent: Path,
    expected_bytes: int,
    rng: np.random.Generator,
    *,
    longest_delay_s: float = 0.02,
) -> Kill:
    """Start a run that writes below `parent`, kill it, and say what the kill met.

    The moment is drawn: a time after the start, an amount of written data (most of them), or a
    time after all data are written, while they are evaluated. `longest_delay_s` lets a drawn part
    of it pass after the amount is reached, so that the kill does not always follow a write.
    """
    draw = rng.random()
    amount, delay_s = rng.random() * expected_bytes, rng.random()
    if draw < STARTING:
        phase, reached, delay_s = "starting", _always, delay_s * MAX_START_S
    elif draw > 1 - EVALUATING:
        phase, delay_s = "evaluating", delay_s * MAX_EVALUATION_S
        reached = _written(parent, expected_bytes)
    else:
        phase, delay_s = "measuring", delay_s * longest_delay_s
        reached = _written(parent, amount)
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    wrote, written = time.monotonic(), 0
    while not reached() and process.poll() is None:
        if (now := written_bytes(parent)) != written:
            wrote, written = time.monotonic(), now
        assert time.monotonic() - wrote < GIVES_UP_AFTER_S, "the run writes nothing more"
        time.sleep(LOOKS_EVERY_S)
    time.sleep(delay_s)
    was_running = process.poll() is None
    left = children_of(process.pid)
    unix_s = time.time()
    process.kill()
    process.wait()
    folder = only_run(parent) if parent.is_dir() else None
    return Kill(folder, phase, was_running, unix_s, left)


def children_of(process: int) -> tuple[str, ...]:
    """Return the numbers of a process's children; none where the system does not tell."""
    lists = Path(f"/proc/{process}/task").glob("*/children")
    with suppress(OSError):
        return tuple(child for one in lists for child in one.read_text(encoding="utf-8").split())
    return ()


def guardian_at_work(kill: Kill) -> bool:
    """Whether a child of the killed process still lives."""
    for child in kill.left:
        with suppress(OSError):
            state = Path(f"/proc/{child}/stat").read_text(encoding="utf-8").rpartition(")")[2]
            if state.split()[0] != "Z":
                return True
    return False


def _always() -> bool:
    return True


def _written(parent: Path, amount: float) -> Callable[[], bool]:
    return lambda: written_bytes(parent) >= amount


def unfinished_unit(folder: Path) -> str | None:
    """Return the unit of work that was under way when the log ended."""
    begun = [event["unit"] for event in whole_events(folder) if event["event"] == "unit-started"]
    return begun[-1] if begun and begun[-1] not in finished_units(folder) else None


def gyro_rows(folder: Path) -> dict[str, list[np.ndarray]]:
    """Return the recorded blocks of the laser gyro by unit of work."""
    file = folder / "raw" / "gyro_acquisition-000.mcap"
    return raw_content(file).rows if file.is_file() else {}


def lost_real_s(kill: Kill, epoch_unix: float, speed: float) -> float | None:
    """Return how old, in real time, the youngest gyro sample was that a kill left on disk.

    None where no sample of a laser gyro was being recorded. One sample interval is no loss:
    nothing came.
    """
    if kill.folder is None or not kill.was_running:
        return None
    finished, rows = set(finished_units(kill.folder)), gyro_rows(kill.folder)
    recorded = [unit for unit in rows if unit not in finished]
    if not recorded:
        return None
    last_arrival_s = float(rows[recorded[-1]][-1]["arrival_time_s"][-1])
    return kill.unix_s - epoch_unix - last_arrival_s / speed


UNITS_OF_UNCERTAINTY = 3.0
GOOD = (0, 1, 6)
"""What a run that went to its end may end with; `wrong_verdicts` says what it may have decided."""
UNDECIDED = "inconclusive"
SERVED = "--served"
"""The option by which a run's time is scaled, in another process than its instruments."""
CONDITIONS = frozenset({"warm-up"})
"""Units that bring conditions about, and do so again in every process of a run."""
PER_DEGC = {"K0": 30e-6, "Ki": 1e-4}
"""An accelerometer's K0 and Ki are values at the mean temperature of the samples, and the simulated
one changes by so much: one that was killed and resumed is measured later, and warmer."""
NEVER_BEGAN, FINISHED = "never began", "is finished"


def raw_hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each raw file."""
    files = sorted((folder / "raw").glob("*.mcap"))
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def results_of(folder: Path) -> dict[str, Any]:
    """Return the stored result document of a run."""
    document: dict[str, Any] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    return document


def what_is_wrong(
    folder: Path,
    raw_before: dict[str, str],
    finished_before: list[str],
    reference: Path,
    *,
    scaled: bool = False,
) -> Iterator[str]:
    """Yield what a resumed run lacks, held against the same run that nothing interrupted."""
    raw_after = raw_hashes(folder)
    for name, digest in raw_before.items():
        if raw_after.get(name) != digest:
            yield f"{name} was changed"
    if "resumed" not in {flag["code"] for flag in results_of(folder)["flags"]}:
        yield "no flag says that it was resumed"
    yield from wrong_results(folder, reference, scaled=scaled)
    events = whole_events(folder)  # asserts that the chain of hashes holds across the gap
    units = [event["unit"] for event in events if event["event"] == "unit-finished"]
    again = {unit for unit in units if units.count(unit) > 1} - CONDITIONS
    if again:
        yield f"measured again though it was finished: {sorted(again)}"
    segments = {name: one["segment"] for name, one in RunFolder(folder).finished_units().items()}
    last = max(one["segment"] for one in events if one["event"] == "resumed")
    early = [unit for unit in finished_before if unit not in CONDITIONS]
    if any(segments[unit] >= last for unit in early):
        yield f"segments {segments}, of the last process {last}, finished before {early}"
    if not (folder / "manifest.json").is_file():
        yield "no manifest"


def resume_and_judge(folder: Path, reference: Path, *options: str | Path) -> tuple[str, list[str]]:
    """Resume what a kill left by the command line; return how it ended and what is wrong with it.

    How it ended: `resumed`, `never began`, `finished`, or what was said instead.
    """
    raw_before = raw_hashes(folder)
    began = any(event["event"] == "run-started" for event in whole_events(folder))
    was_finished = (folder / "results.json").is_file()
    finished = [one["unit"] for one in whole_events(folder) if one["event"] == "unit-finished"]
    done = station("resume", folder, "--non-interactive", "--json", *options)
    if not began or was_finished:
        said = FINISHED if was_finished else NEVER_BEGAN
        right = done.returncode == 2 and said in done.stderr
        right &= not was_finished or (folder / "manifest.json").is_file()
        return said, [] if right else [f"exit code {done.returncode}: {done.stderr.strip()}"]
    if done.returncode not in GOOD:
        return "failed", [f"resume ended with {done.returncode}: {done.stderr.strip()}"]
    measured = any(
        event["event"] == "run-ended" and event["complete"] for event in whole_events(folder)
    )
    wrong = [] if measured else ["the log does not say that the run is complete"]
    scaled = SERVED in options
    if not any(event["event"] == "resumed" for event in whole_events(folder)):
        # Measured to its end before: only the evaluation was missing.
        return "evaluated", [*wrong, *wrong_results(folder, reference, scaled=scaled)]
    lacks = what_is_wrong(folder, raw_before, finished, reference, scaled=scaled)
    return "resumed", [*wrong, *lacks]


def wrong_results(folder: Path, reference: Path, *, scaled: bool) -> Iterator[str]:
    """Yield what is wrong with a run's results, held against the undisturbed run and the truth."""
    bench = load_yaml((folder / "bench.yaml").read_text(encoding="utf-8"))
    yield from unlike(folder, reference)
    yield from off_the_truth(bench, results_of(folder))
    yield from wrong_verdicts(results_of(folder), results_of(reference), scaled=scaled)


def wrong_verdicts(
    document: dict[str, Any], expected: dict[str, Any], *, scaled: bool
) -> Iterator[str]:
    """Yield where a run decides otherwise than the undisturbed one, on virtual time.

    On scaled time the instants at which a computer reads, an angle of a turning table for one, are
    as many times less sure as time is faster, and u is larger. A result may then be undecided where
    its U is larger than undisturbed; it may not be decided otherwise.
    """
    others = {(one["name"], one["axis"]): one for one in expected["results"]}
    allowed = {expected["verdict"]}
    for one in document["results"]:
        other = others[one["name"], one["axis"]]
        if one["verdict"] == other["verdict"]:
            continue
        own_U, other_U = one["expanded_uncertainty"], other["expanded_uncertainty"]
        if scaled and one["verdict"] == UNDECIDED and own_U > other_U:
            allowed.add(UNDECIDED)
            continue
        what = f"{one['name']} {one['axis'] or ''}".rstrip()
        yield (
            f"{what}: the verdict is {one['verdict']} with U = {own_U}, undisturbed "
            f"{other['verdict']} with U = {other_U}"
        )
    if document["verdict"] not in allowed:
        yield f"the verdict is {document['verdict']}, undisturbed {expected['verdict']}"


def largest_u_ratio(folder: Path, reference: Path) -> float:
    """Return the largest standard uncertainty of a run's results over that of the undisturbed."""
    others = {(one["name"], one["axis"]): one for one in results_of(reference)["results"]}
    ratios = [
        one["standard_uncertainty"] / others[one["name"], one["axis"]]["standard_uncertainty"]
        for one in results_of(folder)["results"]
        if one["standard_uncertainty"] and others[one["name"], one["axis"]]["standard_uncertainty"]
    ]
    return float(max(ratios, default=1.0))


def unlike(folder: Path, reference: Path) -> Iterator[str]:
    """Yield where the results of a run are not those of the reference, within both's uncertainty.

    On scaled time no two runs meet the same noise.
    """
    expected = {(one["name"], one["axis"]): one for one in results_of(reference)["results"]}
    for one in results_of(folder)["results"]:
        other = expected[one["name"], one["axis"]]
        what = f"{one['name']} {one['axis'] or ''}".rstrip()
        if one["value"] is None or other["value"] is None:
            if one["value"] is not other["value"]:
                yield f"{what} is {one['value']}, undisturbed {other['value']}"
            continue
        u = math.hypot(one["standard_uncertainty"], other["standard_uncertainty"])
        per_degC = PER_DEGC.get(one["name"], 0.0)
        if (one["name"], one["unit"]) == ("bias", "g"):
            per_degC = PER_DEGC["K0"]  # over a scale factor of 1 V/g
        warmer_K = per_degC and warmth_K(folder) - warmth_K(reference)
        expected_value = other["value"] + warmer_K * per_degC
        allowed = UNITS_OF_UNCERTAINTY * u + of_another_mean(one, other, expected)
        if abs(one["value"] - expected_value) > allowed:
            yield f"{what} is {one['value']}, undisturbed {other['value']}, u {u}"


def of_another_mean(
    one: dict[str, Any], other: dict[str, Any], undisturbed: dict[Any, dict[str, Any]]
) -> float:
    """Return by how much a nine-axis sensor's K may differ because it is another mean.

    By its definition it is the weighted mean of its rates where they agree, and the less sure they
    are the sooner they do, else the plain one: they differ by the nonlinearity, at most.
    """
    if one["name"] != "scale_factor" or one["method"] == other["method"]:
        return 0.0
    nonlinearity = undisturbed["nonlinearity", one["axis"]]["value"]
    return float(1e-6 * nonlinearity * other["value"])


def warmth_K(folder: Path) -> float:
    """Return by how much the device was warmer, on average, than where its truth is given."""
    run = RunFolder(folder)
    units = list(run.finished_units())
    temperatures = [run.rows("thermometer", unit)["temperature_degC"].mean() for unit in units]
    return float(np.mean(temperatures)) - 25.0


@dataclass(frozen=True)
class Case:
    """A run that is killed at a moment that its seed draws, on virtual or on scaled time.

    `plan` are the words after `station run`, `reference` is the folder of the same run undisturbed.
    Scaled time is that of a bench of this name which another process serves, so much faster.
    """

    seed: int
    plan: tuple[str, ...]
    reference: Path
    bench: str = "sim"
    speed: float | None = None

    @property
    def clock(self) -> str:
        """Whose time it is."""
        return "virtual" if self.speed is None else "scaled"


def cases(
    plan: tuple[str, ...],
    reference: Path,
    bench: str,
    seeds: tuple[range, range],
    speeds: Sequence[float],
) -> Iterator[Case]:
    """Yield the kills on virtual and on scaled time, a seed each."""
    virtual, scaled = seeds
    for seed in virtual:
        yield Case(seed, plan, reference, bench)
    for seed in scaled:
        yield Case(seed, plan, reference, bench, speeds[seed % len(speeds)])


def judge(case: Case, folder: Path) -> dict[str, Any]:
    """Kill a run, look at what it left, resume it; return what followed, `faults` among it."""
    folder.mkdir(parents=True)
    return _on_virtual_time(case, folder) if case.speed is None else _on_scaled_time(case, folder)


def _on_virtual_time(case: Case, folder: Path) -> dict[str, Any]:
    parent = folder / "runs"
    command = station_command("run", *case.plan, "--non-interactive", "--output", parent)
    expected = written_bytes(case.reference.parent)
    kill = kill_at_random_moment(command, parent, expected, np.random.default_rng(case.seed))
    line = _described(case, kill)
    if kill.folder is not None:
        try:
            left = compare_with_reference(kill.folder, case.reference)
            line["share_of_the_data"] = round(sum(left.raw_bytes.values()) / expected, 3)
        except AssertionError as fault:
            line["faults"].append(str(fault))
    _go_on(line, kill, case.reference)
    return line


def _on_scaled_time(case: Case, folder: Path) -> dict[str, Any]:
    assert case.speed is not None
    parent = folder / "runs"
    expected = written_bytes(case.reference.parent)
    with world(folder, case.speed, case.bench, results_of(case.reference)["procedure"]) as bench:
        command = station_command(
            "run", *case.plan, SERVED, bench.head, "--non-interactive", "--output", parent
        )
        rng = np.random.default_rng(1000 + case.seed)
        kill = kill_at_random_moment(
            command, parent, round(0.9 * expected), rng, longest_delay_s=0.3
        )
        line = {**_described(case, kill), "speed": case.speed, "guardian": bool(kill.left)}
        until(lambda: not guardian_at_work(kill))
        line["safe"] = bench.at_rest()
        lost_s = lost_real_s(kill, bench.epoch_unix, case.speed)
        _go_on(line, kill, case.reference, SERVED, bench.head)
        line["safe_after"] = bench.at_rest()
    line["faults"] += [f"not {one}" for one in ("safe", "safe_after") if not line[one]]
    if lost_s is not None:
        interval_and_batch_s = 0.2 / case.speed
        line["youngest_sample_real_s"] = round(lost_s, 4)
        line["lost_real_s"] = round(max(lost_s - interval_and_batch_s, 0.0), 4)
    return line


def _described(case: Case, kill: Kill) -> dict[str, Any]:
    return {
        "benchmark": "kill_campaign",
        "clock": case.clock,
        "seed": case.seed,
        "phase": kill.phase,
        "was_running": kill.was_running,
        "has_folder": kill.folder is not None,
        "finished": finished_units(kill.folder) if kill.folder else [],
        "under_way": unfinished_unit(kill.folder) if kill.folder else None,
        "faults": list(opens(kill.folder)) if kill.folder else [],
    }


def _go_on(line: dict[str, Any], kill: Kill, reference: Path, *options: str | Path) -> None:
    """Resume what a kill left and add how that ended."""
    if kill.folder is not None:
        line["then"], wrong = resume_and_judge(kill.folder, reference, *options)
        line["faults"] += wrong
        if line["then"] in ("resumed", "evaluated"):
            line["verdict"] = results_of(kill.folder)["verdict"]
            line["largest_u_over_undisturbed"] = round(largest_u_ratio(kill.folder, reference), 1)
