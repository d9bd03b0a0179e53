"""What must be true after a run with a fault, whatever the fault was: one oracle for every case.

It asks the simulated world, the exit code, what the operator was told, the folder on disk and the
operating system; never a driver.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from campaign_helpers import raw_content
from fault_cases import Case, Reference, bench_data
from fault_runs import Ended
from fault_truths import off_the_truth

from station.method.work import POLL_S
from station.runner.evaluation import evaluate_run

NOTHING_LEFT_A = 0.001
GOOD, FAULT, TRIPPED = frozenset({0, 1, 6}), 3, 5
SAFE_STATE_S, STEP_WAITS_S = 120.0, 420.0
"""Bench time that the safe state of one instrument, and the waits of a step, may take."""
LONG_WAITS_S: Mapping[str, float] = {"fog-scale-factor-temperature": 2700.0}
"""Procedures whose steps wait longer: 20 min for a temperature, then 20 min for an alignment."""
STEP_OF_A_RAMP_A = 0.25
STEPS_BY_ITSELF = frozenset({"compliance", "overdrive"})
ITS_OWN_STEP_S, OVERDRIVEN = 0.5, 3.5
"""The current of a supply with such a fault jumps when the fault begins."""
PROTECTED = "the output went off"
"""Its own protection cuts a coil that is driven beyond the supply's limit."""
UNREACHABLE = frozenset({"port-gone", "stuck-open"})
"""Nobody can do anything to an instrument with this fault any more."""
TOGGLED = frozenset({"pump_laser"})
"""One command opens and closes it: while nothing it says is understood, nobody may send that."""
LOST_WHILE_LASTING = frozenset({"lost-command"})
MUST_TRIP_WITHIN_S = {"chain-open": 1.5, "overheating": 15.0}
"""What puts somebody or something at risk ends a run, in the time between two looks at it."""
MUST_BE_FOUND_WITHIN_S = {("imu", "frozen"): 15.0}
"""What no measurement can be made with ends a run, in the time between two records of one."""


@dataclass
class Verdict:
    """What became of a case: how the run ended and what is wrong with that."""

    case: Case
    struck: bool
    exit_code: int
    energised: bool
    to_zero_s: float | None
    """Bench time from the fault to the last coil's driven current being zero, where one flowed."""
    to_verified_s: float | None
    """Bench time from the fault to the end of the safe state, all read back."""
    sentence: str
    violations: list[str] = field(default_factory=list)


def judge(case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference) -> Verdict:
    """Return what is wrong with how a run with a fault ended."""
    first_s = ended.first_s
    coils = ended.world["coils"].values()
    zero_s = [one["at_zero_since_s"] for one in coils if one["largest_current_A"] > NOTHING_LEFT_A]
    energised = first_s is not None and any(since is None or since > first_s for since in zero_s)
    to_zero_s = to_verified_s = None
    if energised and first_s is not None and ended.exit_code in (FAULT, TRIPPED):
        if None not in zero_s:
            to_zero_s = max(zero_s) - first_s
        if ended.folder is not None and ended.outcome is not None and not ended.outcome.unsafe:
            (safe,) = ended.folder.events_of("safe-state")
            to_verified_s = safe.time_s - first_s
    verdict = Verdict(
        case, first_s is not None, ended.exit_code, energised, to_zero_s, to_verified_s, ended.error
    )
    for check in (world_is_safe, told_well, recorded, results_are_right, nothing_is_left):
        verdict.violations += check(case, entry, ended, reference)
    return verdict


def is_safe(world: Mapping[str, Any]) -> bool:
    """Whether nothing that can harm is energised in a simulated world."""
    driven = [abs(coil["driven_A"]) for coil in world["coils"].values()]
    return not any(world["outputs"].values()) and max(driven, default=0.0) < NOTHING_LEFT_A


def world_is_safe(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """The world is at rest, and came there gently; only what nobody reaches may be left, named."""
    unsafe = {one.instrument for one in ended.outcome.unsafe} if ended.outcome else set()
    lost = case.kind in LOST_WHILE_LASTING or case.role in TOGGLED
    lasting = "for" in entry or case.kind == "chatter"
    out_of_reach = case.kind in UNREACHABLE or (lost and lasting)
    if not is_safe(ended.world):
        on = sorted(name for name, is_on in ended.world["outputs"].items() if is_on)
        if not (out_of_reach and on == [case.instrument] and case.instrument in unsafe):
            yield f"the world is not safe: {on} on, unverified {sorted(unsafe)}"
    if unsafe:
        if ended.exit_code != FAULT:
            yield f"{sorted(unsafe)} was not verified and the exit code is {ended.exit_code}"
        for name in unsafe:
            if f"NOT VERIFIED: {name} " not in ended.said:
                yield f"{name} was not verified and the operator was not told"
        return
    for name, coil in ended.world["coils"].items():
        allowed_A = max(
            STEP_OF_A_RAMP_A,
            1.2 * largest_step_A(reference.world["coils"][name]) + NOTHING_LEFT_A,
        )
        if case.kind == "overdrive":
            allowed_A *= OVERDRIVEN
        at_the_fault = abs(coil["largest_slew_at_s"] - (ended.first_s or 0.0)) < ITS_OWN_STEP_S
        if case.kind in STEPS_BY_ITSELF and (at_the_fault or PROTECTED in ended.error):
            continue
        if f"coil_supply.{name}" in switched_off_at_once(ended):
            continue
        if largest_step_A(coil) > allowed_A:
            yield f"coil {name} was cut: a step of {largest_step_A(coil):.2f} A"


def switched_off_at_once(ended: Ended) -> set[str]:
    """Return the instruments that did not do what they were asked: these may be cut off."""
    if ended.folder is None:
        return set()
    events = ended.folder.events_of("switched-off-at-once")
    return {str(one.details["instrument"]) for one in events}


def largest_step_A(coil: Mapping[str, Any]) -> float:
    """Return the largest step that a supply made against the current of a coil."""
    return float(coil["largest_slew_A_per_s"] * coil["time_constant_s"])


def told_well(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """The exit code is one that the fault may have, and the sentence helps."""
    code = ended.exit_code
    if code not in GOOD | {FAULT, TRIPPED}:
        yield f"exit code {code}"
    if "Traceback" in ended.said or "a fault of the program" in ended.said:
        yield f"a fault of the program: {ended.error}"
    yield from ended.warned
    if code in GOOD:
        still_s = reference.marks[-1].time_s - (ended.first_s or math.inf)
        found_s = MUST_BE_FOUND_WITHIN_S.get((case.role, case.kind), math.inf)
        if still_s > min(MUST_TRIP_WITHIN_S.get(case.kind, math.inf), found_s):
            yield f"{case.kind} {still_s:.1f} s before the end did not end the run"
        return
    if code == TRIPPED and "interlock" not in ended.error:
        yield f"exit code 5 without an interlock: {ended.error}"
    if ended.outcome and ended.outcome.unsafe:
        return  # the sentence is that about the safe state
    document = ended.outcome.document if ended.outcome else None
    if document and any(flag.code == "wrong-excitation" for flag in document.flags):
        return  # the sentence is that of the flag: no verdict on the device
    if ended.error == "":
        yield f"exit code {code} without a sentence"
    head, *more = ended.error.split("\n")
    if any(not line.startswith("  - ") for line in more):
        yield f"more than one line: {ended.error!r}"
    if case.instrument not in ended.error:
        yield f"the sentence does not name {case.instrument}: {ended.error}"
    if code == FAULT and ";" not in ended.error:
        yield f"the sentence does not say what to do: {head}"
    if len(ended.error) > 500:
        yield f"a sentence of {len(ended.error)} characters"


def recorded(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """The folder opens, what was recorded before the fault is in it, and it can be analysed."""
    folder = ended.folder
    if folder is None or ended.outcome is None:
        return
    if not folder.events or folder.events[-1].kind != "run-ended":
        yield "the log does not end with the end of the run"
    until_s = (math.inf if ended.first_s is None else ended.first_s) - 2 * POLL_S
    for name, content in reference.raw.items():
        file = folder.path / "raw" / name
        there = raw_content(file).rows if file.is_file() else {}
        for unit, blocks in content.rows.items():
            wanted = sum(int((block["arrival_time_s"] < until_s).sum()) for block in blocks)
            kept = sum(
                int((block["arrival_time_s"] < until_s).sum()) for block in there.get(unit, [])
            )
            if kept < wanted:
                yield f"{name} {unit}: {kept} of {wanted} rows from before the fault"
    try:
        document, _ = evaluate_run(folder)
    except Exception as error:
        yield f"it cannot be analysed: {error!r}"
        return
    unsafe = not is_safe(ended.world) or bool(ended.outcome.unsafe)
    for one in (document, ended.outcome.document):
        if one is not None and unsafe and one.verdict == "pass":
            yield "the verdict is pass and the bench is not safe"


def results_are_right(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """Results that are called good are right."""
    document = ended.outcome.document if ended.outcome else None
    if ended.exit_code != 0 or document is None or document.verdict != "pass":
        return
    data = document.to_data()
    values = {(one["name"], one["axis"]): one["value"] for one in reference_results(reference)}
    for result in data["results"]:
        if result["value"] is None and values[result["name"], result["axis"]] is not None:
            yield f"pass without a value of {result['name']} {result['axis']}"
    flags = sorted({flag.code for flag in document.flags})
    for off in off_the_truth(bench_data(case.bench), data):
        yield f"{off}, pass; flags {flags}"


def reference_results(reference: Reference) -> list[dict[str, Any]]:
    """Return the results of the run without faults."""
    assert reference.outcome.document is not None
    results: list[dict[str, Any]] = reference.outcome.document.to_data()["results"]
    return results


def nothing_is_left(
    case: Case, entry: Mapping[str, Any], ended: Ended, reference: Reference
) -> Iterator[str]:
    """No thread, no process, and no more bench time than the waits of the procedure allow."""
    if ended.left_behind:
        yield f"left behind: {ended.left_behind}"
    allowed_s = (
        max(reference.marks[-1].time_s, ended.first_s or 0.0)
        + LONG_WAITS_S.get(case.plan, STEP_WAITS_S)
        + SAFE_STATE_S * len(ended.world["outputs"])
    )
    if ended.world["time_s"] > allowed_s:
        yield f"it took {ended.world['time_s']:.0f} s of bench time, {allowed_s:.0f} s are allowed"
