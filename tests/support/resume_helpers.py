"""What a resumed run must be: finished, with what there was untouched and results as before."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from campaign_helpers import station, whole_events
from fault_truths import off_the_truth
from quick_yaml import load_yaml

from station.record.folder import RunFolder

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
        warmer = PER_DEGC.get(one["name"], 0.0) and warmth_K(folder) - warmth_K(reference)
        expected_value = other["value"] + warmer * PER_DEGC.get(one["name"], 0.0)
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
