"""Clocks that are off, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import BOTH, Bench, Plant, Planted


def gaussmeter_clock(bench: Bench, rng: random.Random) -> Planted:
    off = rng.choice((-1, 1)) * rng.uniform(200, 2000)
    bench["instruments"]["gaussmeter"]["simulator"]["clock_error"] = f"{off:.1f} ppm"
    return "clock-off", "gaussmeter"


def board_clock(bench: Bench, rng: random.Random) -> Planted:
    off = rng.choice((-1, 1)) * rng.uniform(200, 2000)
    bench["instruments"]["gyro_acquisition"]["simulator"]["clock_error"] = f"{off:.1f} ppm"
    return "clock-off", "gyro_acquisition"


PLANTS = (
    Plant("gaussmeter's clock off", "clocks", gaussmeter_clock),
    Plant("pulse board's clock off", "gyro", board_clock, BOTH),
)
