"""Faults of coils and of the probe in them, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import BOTH, Bench, Plant, Planted

AXES = ("x", "y", "z")


def swapped_coils(bench: Bench, rng: random.Random) -> Planted:
    one, other = (bench["instruments"][f"coil_supply.{axis}"] for axis in rng.sample(AXES, 2))
    coils = one["simulator"]["coil"], other["simulator"]["coil"]
    other["simulator"]["coil"], one["simulator"]["coil"] = coils
    return "coils-swapped", None


def reversed_coil(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    bench["simulation"]["coils"][axis]["reversed"] = True
    return "coil-polarity-reversed", axis


def constant_off(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    off_by = rng.choice((-1.0, 1.0)) * rng.uniform(0.03, 0.06)
    settings = bench["instruments"][f"coil_supply.{axis}"]["settings"]
    stated = float(settings["coil_constant"].split()[0])
    settings["coil_constant"] = f"{stated * (1.0 + off_by):.6f} mT/A"
    return "coil-constant-off", axis


def swapped_probe(bench: Bench, rng: random.Random) -> Planted:
    one, other = rng.sample(AXES, 2)
    bench["instruments"]["gaussmeter"]["simulator"]["wiring"] = {one: other, other: one}
    return "probe-axes-swapped", None


def reversed_probe(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    bench["instruments"]["gaussmeter"]["simulator"]["wiring"] = {axis: f"-{axis}"}
    return "probe-axis-reversed", axis


def leaning_coil(bench: Bench, rng: random.Random) -> Planted:
    axis = rng.choice(AXES)
    normal = bench["simulation"]["coils"][axis]["normal"]
    towards = rng.choice(sorted(normal))
    normal[towards] = f"{rng.choice((-1.0, 1.0)) * rng.uniform(5.0, 10.0):.2f} deg"
    return "coil-leans", axis


PLANTS = (
    Plant("swapped coils", "coils", swapped_coils, BOTH),
    Plant("reversed polarity", "coils", reversed_coil, BOTH),
    Plant("coil constant off", "coils", constant_off, BOTH),
    Plant("swapped gaussmeter axes", "coils", swapped_probe),
    Plant("reversed probe axis", "coils", reversed_probe),
    Plant("leaning coil", "coils", leaning_coil, BOTH),
)
