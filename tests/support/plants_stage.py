"""Faults of a rotary stage, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import Bench, Plant, Planted


def reversed_stage(bench: Bench, rng: random.Random) -> Planted:
    bench["simulation"]["accelerometer"]["reversed"] = True
    return "stage-sense-reversed", None


def zero_off(bench: Bench, rng: random.Random) -> Planted:
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.05, 0.5)
    bench["instruments"]["rotary_stage"]["simulator"]["encoder_offset"] = f"{off_deg:.4f} deg"
    return "stage-zero-off", None


def leaning(bench: Bench, rng: random.Random) -> Planted:
    off_deg = rng.choice((-1.0, 1.0)) * rng.uniform(0.1, 0.5)
    bench["simulation"]["accelerometer"]["axis_tilt"] = f"{off_deg:.4f} deg"
    return "stage-axis-leans", None


PLANTS = (
    Plant("reversed stage sense", "stage", reversed_stage),
    Plant("stage encoder zero off", "stage", zero_off),
    Plant("stage axis leaning", "stage", leaning),
)
