"""Faults of a laser gyro and its acquisition, as a simulated bench is given them."""

from __future__ import annotations

import random

from plants import BOTH, Bench, Plant, Planted


def pulse_weight_off(bench: Bench, rng: random.Random) -> Planted:
    off_by = rng.choice((-1.0, 1.0)) * rng.uniform(0.01, 0.05)
    gyro = bench["simulation"]["gyro"]
    weight_arcsec = float(gyro["pulse_weight"].split()[0])
    gyro["pulse_weight"] = f"{weight_arcsec * (1.0 + off_by):.8f} arcsec"
    return "pulse-weight-off", None


def other_channel(bench: Bench, rng: random.Random) -> Planted:
    bench["simulation"]["gyro"]["channel"] = rng.choice((2, 3))
    return "gyro-on-other-channel", None


PLANTS = (
    Plant("pulse weight off", "gyro", pulse_weight_off, BOTH),
    Plant("gyro on another channel", "gyro", other_channel, BOTH),
)
