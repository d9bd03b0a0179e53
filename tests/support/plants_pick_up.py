"""Pick-up of the voltmeter's leads, as a simulated bench is given it."""

from __future__ import annotations

import random

from plants import Bench, Plant, Planted


def picked_up(bench: Bench, rng: random.Random) -> Planted:
    # 0.5 mT at coils of 0.30 to 0.375 mT/A: 1.3 A to 1.7 A, a sine each.
    bench["instruments"]["multimeter"]["simulator"]["pick_up"] = f"{rng.uniform(8.0, 80.0):.1f} uV"
    return "pick-up", None


PLANTS = (Plant("pick-up at the drive frequency", "pick_up", picked_up),)
