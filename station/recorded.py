"""What a run folder says of its plan, its bench, and how the bench was left."""

from __future__ import annotations

from collections.abc import Mapping

from station.files.plan import Plan, read_plan
from station.files.yaml.reading import read_yaml
from station.instruments.bench import Bench, bench_of
from station.procedure import Procedures
from station.record.folder import RunFolder
from station.record.layout import BENCH, PLAN
from station.roles.role import role_of

NEVER_REACHED = "the run ended without making it safe"


def read_plan_and_bench(folder: RunFolder) -> tuple[Plan, Bench]:
    """Return the plan and the bench of a run from its folder alone.

    The resolved copies are read: a plan as given may extend another that is not in the folder. The
    packages of the drivers need not be installed.
    """
    plan = read_plan(folder.path / PLAN, Procedures())
    document = read_yaml(folder.path / BENCH)
    return plan, bench_of(document)


def used_instruments(folder: RunFolder) -> list[str]:
    """Return the instruments that a run opened, in the bench's order."""
    return [event.details["instrument"] for event in folder.events_of("identified")]


def left_out(folder: RunFolder) -> Mapping[str, str]:
    """Return the instruments that can harm and were not read back at the end, and why."""
    return {entry["instrument"]: entry["why"] for entry in folder.state.left_out()}


def left_unverified(folder: RunFolder, bench: Bench) -> Mapping[str, str]:
    """Return the instruments whose safe state was not verified, and what is known of each.

    A run that was killed left no word of its safe state. Where its guardian did not act in its
    place, it is all those of the bench's list. One that goes on has left nothing yet.
    """
    outcomes = folder.state.safe_state()
    if folder.goes_on:
        return {}
    if outcomes is None:
        listed = {name for name, _ in bench.safe_order()}
        return {
            name: NEVER_REACHED
            for name in used_instruments(folder)
            if name in listed or role_of(name) in listed
        }
    return {
        outcome["instrument"]: outcome["read_back"]
        for outcome in outcomes
        if not outcome["verified"]
    }
