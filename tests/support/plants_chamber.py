"""Faults of the chamber and of the thermometers in it, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import BOTH, Bench, Plant, Planted


def overshooting(bench: Bench, rng: random.Random) -> Planted:
    bench["simulation"]["fog"]["chamber"]["overshoot"] = f"{rng.uniform(35.0, 80.0):.0f} %"
    return "chamber-overshoots", None


def wrong_channel(bench: Bench, rng: random.Random) -> Planted:
    axis, shows = rng.choice("xyz"), rng.choice(("room", "air"))
    bench["simulation"]["fog"]["gyros"]["sensor_wiring"] = {axis: shows}
    return "thermometer-wrong-channel", axis


PLANTS = (
    Plant("chamber that overshoots", "chamber", overshooting),
    Plant("thermometer on the wrong channel", "chamber", wrong_channel, BOTH),
)
