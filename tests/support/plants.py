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
class Plant:
    """A fault of some size at some place: `plant` changes a bench's data and returns its flag.

    `part` is the part of the commissioning that must name it.
    """

    name: str
    part: str
    plant: Callable[[Bench, random.Random], Planted]


def named(outcome: Outcome) -> set[Planted]:
    """Return code and axis of each flag, that of the simulation aside."""
    assert outcome.document is not None, outcome.error
    flags = outcome.document.to_data()["flags"]
    return {(one["code"], one["axis"]) for one in flags if one["code"] != "simulated"}
