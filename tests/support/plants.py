"""What a planted fault is, and what a commissioning of a bench that has it says."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from station.runner.outcome import Outcome

Bench = dict[str, Any]
Planted = tuple[str, str | None]
"""The code and the axis of the flag that names it."""


@dataclass(frozen=True)
class Ends:
    """A run that a fault ends: its exit code, and words of its sentence, which name the fault."""

    exit_code: int
    words: tuple[str, ...]


@dataclass(frozen=True)
class Plant:
    """A fault of some size at some place: `plant` changes a bench's data and returns its flag.

    `part` is the part of the commissioning that must name it, `benches` are the shipped ones that
    have what it needs.
    """

    name: str
    part: str
    plant: Callable[[Bench, random.Random], Planted | Ends]
    benches: tuple[str, ...] = ("sim",)


def named(outcome: Outcome) -> set[Planted]:
    """Return code and axis of each flag, that of the simulation aside."""
    assert outcome.document is not None, outcome.error
    flags = outcome.document.to_data()["flags"]
    return {(one["code"], one["axis"]) for one in flags if one["code"] != "simulated"}


BOTH = ("sim", "sim-alternate")


def is_named(outcome: Outcome, expected: Planted | Ends) -> bool:
    """Whether a commissioning names a fault, and nothing else."""
    if isinstance(expected, Ends):
        said = str(outcome.error)
        return outcome.exit_code == expected.exit_code and all(w in said for w in expected.words)
    return outcome.exit_code == 1 and named(outcome) == {expected}
