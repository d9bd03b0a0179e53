"""Faults of the probe's place, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import Bench, Plant, Planted


def off_centre(bench: Bench, rng: random.Random) -> Planted:
    axis, sense = rng.choice("xyz"), rng.choice((-1.0, 1.0))
    bench["simulation"]["probe_position"][axis] = f"{sense * rng.uniform(75.0, 95.0):.1f} mm"
    return "probe-off-centre", None


PLANTS = (Plant("probe off centre", "probe", off_centre),)
