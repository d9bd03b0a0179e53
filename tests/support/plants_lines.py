"""Faults of lines, as a simulated bench is given them."""

from __future__ import annotations

import random
from typing import Any

from plants import Bench, Plant, Planted

ASKED_IN_ONE_QUERY = ("coil_supply.x", "coil_supply.dc", "gaussmeter", "multimeter")
"""Instruments whose identity is one answer to `*IDN?`."""
TRIES = 3
"""So often a driver asks before it gives an answer up."""


def faulty(bench: Bench, name: str, **fault: Any) -> None:
    bench["simulation"].setdefault("faults", []).append(
        {"instrument": name, "command": "*IDN?", **fault}
    )


def slow_line(bench: Bench, rng: random.Random) -> Planted:
    name, delay_s = rng.choice(ASKED_IN_ONE_QUERY), rng.uniform(0.27, 0.4)
    faulty(bench, name, fault="late", delay=f"{delay_s:.3f} s", **{"for": "1 h"})
    return "line-slow", name


def lost_answers(bench: Bench, rng: random.Random) -> Planted:
    name = rng.choice(ASKED_IN_ONE_QUERY)
    faulty(bench, name, fault="no-reply", nth=rng.randint(10, 40), count=TRIES)
    return "line-loses-answers", name


PLANTS = (
    Plant("slow line", "lines", slow_line),
    Plant("line that loses answers", "lines", lost_answers),
)
