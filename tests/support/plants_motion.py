"""Faults of a table, and of the sensor on it, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import BOTH, Bench, Plant, Planted

TABLE_AXES = ("outer", "middle", "inner")


def reversed_sense(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(TABLE_AXES)
    bench["simulation"]["fog"]["table"][axis]["reversed"] = True
    return "table-sense-reversed", axis


def zero_off(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(("middle", "inner"))
    number = bench["instruments"]["turntable"]["settings"][f"{axis}_axis"]
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.05, 0.5)
    controller = bench["instruments"]["turntable"]["simulator"]
    controller[f"axis_{number}"]["encoder_offset"] = f"{off_deg:.4f} deg"
    return "table-zero-off", axis


LEANS = {
    "outer": ("towards_x", "towards_y"),
    "middle": ("towards_z",),
    "inner": ("towards_z",),
}
"""What gravity feels of each."""


def leaning(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(TABLE_AXES)
    towards = rng.choice(LEANS[axis])
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.1, 0.5)
    bench["simulation"]["fog"]["table"][axis]["lean"][towards] = f"{off_deg:.4f} deg"
    return "table-axis-leans", axis


def off_square(bench: Bench, rng: random.Random) -> Planted:
    axis, towards = rng.choice((("middle", "towards_x"), ("inner", "towards_y")))
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.15, 0.5)
    bench["simulation"]["fog"]["table"][axis]["lean"][towards] = f"{off_deg:.4f} deg"
    return "table-axes-not-square", None


def swapped_gyros(bench: Bench, rng: random.Random) -> Planted:
    one, other = rng.sample(("x", "y", "z"), 2)
    gyros = bench["simulation"]["nine_axis"]["sensor"]["gyros"]
    gyros["wiring"] = {one: other, other: one}
    return "gyro-channels-swapped", None


def reversed_gyro(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(("x", "y", "z"))
    bench["simulation"]["nine_axis"]["sensor"]["gyros"]["wiring"] = {axis: f"-{axis}"}
    return "gyro-channel-reversed", axis.upper()


PLANTS = (
    Plant("reversed table sense", "motion", reversed_sense, BOTH),
    Plant("encoder zero off", "motion", zero_off, BOTH),
    Plant("axis leaning", "motion", leaning, BOTH),
    Plant("axes off square", "motion", off_square, BOTH),
    Plant("swapped gyro channels", "motion", swapped_gyros, BOTH),
    Plant("reversed gyro channel", "motion", reversed_gyro, BOTH),
)
