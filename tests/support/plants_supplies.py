"""Faults of the coils' supplies, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import BOTH, Bench, Plant, Planted

COILS = ("x", "y", "z")


def own_limit_broken(bench: Bench, rng: random.Random) -> Planted:
    coil = rng.choice(COILS)
    bench["instruments"][f"coil_supply.{coil}"]["simulator"]["own_limit_broken"] = True
    return "own-limit-does-not-act", coil


def output_stays_on(bench: Bench, rng: random.Random) -> Planted:
    coil = rng.choice(COILS)
    bench["instruments"][f"coil_supply.{coil}"]["simulator"]["output_stays_on"] = True
    return "output-stays-on", coil


PLANTS = (
    Plant("own limit that does not act", "supplies", own_limit_broken, BOTH),
    Plant("output that stays on", "supplies", output_stays_on, BOTH),
)
