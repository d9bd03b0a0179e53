"""Laser gyros in their coils: clean datasets with their truth, for faults to be planted in."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sabotage import Made

from procedures.estimation.sine import legendre_columns

Array = NDArray[Any]

AXES = ("IA", "NA", "LA")
FINE = (np.arange(16) + 0.5) / 16.0 - 0.5
FIELD_NOISE_MT = 3e-4


@dataclass(frozen=True)
class World:
    """One gyro in one field; rates in deg/h, fields in mT, times in s.

    `drive` maps axes to (Hz, mT); `lean` is the largest part of a coil's field on another axis;
    `delay_s` is that of the gyro's answer, `gain` (n,) what multiplies it, `coil` (times) the
    coil's current over the commanded one.
    """

    drive: Mapping[str, tuple[float, float]]
    interval_s: float
    samples: int
    sensitivity: tuple[float, float, float]
    pulse_arcsec: float = 0.0
    stamp: str = "interval-end"
    field_averaging_s: float = 0.0
    walk_deg_per_sqrt_h: float = 1e-3
    rate_walk: float = 0.0
    ramp_deg_per_h2: float = 0.0
    warm_up_deg_per_h: float = 0.0
    lean: float = 0.003
    bend: float = 0.0
    cubic: float = 0.0
    delay_s: float = 0.0
    earth_deg_per_h: float | None = None
    decimals: int = 4
    lag_s: float = 0.0
    coil: Callable[[Array], Array] = field(default=np.ones_like)


@dataclass(frozen=True)
class Table:
    """What stands in the file: stamps, the gyro's column, the field (n, 3), the conditions."""

    t_s: Array
    output: Array
    field_mT: Array
    conditions: Mapping[str, Any]


Spoil = Callable[[Table, np.random.Generator], Table]

ONE = World({"IA": (0.08, 1.2)}, 0.1, 2500, (0.3, 0.02, -0.03))
WEAK = replace(ONE, sensitivity=(0.031, 0.004, -0.003))
COUNTS = World(
    {"NA": (0.16, 0.8)}, 1.0, 500, (0.02, -0.5, 0.01), pulse_arcsec=0.4, earth_deg_per_h=9.345
)
FINE_COUNTS = World(
    {"LA": (0.1, 1.0)}, 0.1, 3000, (0.01, 0.02, 0.2), pulse_arcsec=0.02, stamp="interval-start"
)
THREE = World(
    {"IA": (0.07, 1.0), "NA": (0.11, 1.0), "LA": (0.17, 1.0)},
    0.1,
    2000,
    (0.4, -0.15, 0.22),
    lean=0.0175,
)
TWO = World({"IA": (0.1, 0.6), "LA": (0.13, 0.8)}, 0.2, 2000, (-0.2, 0.0, 0.35), lean=0.01)
SLOW = World(
    {"NA": (0.05, 2.0)},
    0.5,
    1200,
    (0.02, 0.15, 0.01),
    stamp="interval-middle",
    field_averaging_s=0.2,
    walk_deg_per_sqrt_h=2e-3,
    rate_walk=0.02,
    ramp_deg_per_h2=0.5,
    warm_up_deg_per_h=0.1,
)
FAST = replace(ONE, drive={"IA": (0.2, 1.2)}, samples=2000)
STAMP = {"interval-start": 0.5, "interval-middle": 0.0, "interval-end": -0.5}


def recorded(world: World, seed: int) -> tuple[Table, Array, Array]:
    """Return the table of a world, the model (4 n, p) of its readings and their noise (4 n,)."""
    generator = np.random.default_rng([seed, 31])
    count, tau = world.samples, world.interval_s
    middle_s = (np.arange(count) + 0.5) * tau
    stamp_s = middle_s - STAMP[world.stamp] * tau
    averaging_s = world.field_averaging_s
    coils = np.eye(3) + generator.uniform(-world.lean, world.lean, (3, 3)) * (1.0 - np.eye(3))
    ambient = generator.uniform(-0.03, 0.03, 3)
    phases = generator.uniform(0.0, 2.0 * np.pi, 3)
    lines = [(AXES.index(axis), *sine) for axis, sine in world.drive.items()]

    def coil_field(k: int, f: float, size: float, at_s: Array) -> Array:
        wave = size * np.sin(2.0 * np.pi * f * at_s + phases[k]) * world.coil(at_s)
        return np.asarray(wave[..., None] * coils[k])

    def total(at_s: Array) -> Array:
        return ambient + sum(coil_field(k, f, size, at_s) for k, f, size in lines)

    slopes = np.array(world.sensitivity)
    seen = total(middle_s[:, None] + FINE * tau - world.delay_s)
    along = seen @ slopes
    answer = (along + world.bend * along**2 + world.cubic * np.sum(seen**3, axis=-1)).mean(axis=1)
    earth = world.earth_deg_per_h
    rate = (generator.uniform(6.0, 11.0) if earth is None else earth) + answer
    sigma = 60.0 * world.walk_deg_per_sqrt_h / np.sqrt(tau)
    rate = rate + sigma * generator.standard_normal(count)
    step = world.rate_walk / 60.0 * np.sqrt(tau)
    rate = rate + np.cumsum(step * generator.standard_normal(count))
    rate = rate + world.ramp_deg_per_h2 * middle_s / 3600.0
    rate = rate + world.warm_up_deg_per_h * np.exp(-middle_s / 900.0)
    if world.lag_s:
        keep = np.exp(-tau / world.lag_s)
        for n in range(1, count):
            rate[n] = keep * rate[n - 1] + (1.0 - keep) * rate[n]
    output = np.round(rate, world.decimals)
    if world.pulse_arcsec:
        angle = np.concatenate(([0.0], np.cumsum(rate) * tau)) / world.pulse_arcsec
        output = np.diff(np.floor(angle + generator.random()))
    field_mT = total(stamp_s[:, None] - averaging_s * (FINE + 0.5)).mean(axis=1)
    field_mT = field_mT + FIELD_NOISE_MT * generator.standard_normal((count, 3))
    conditions: dict[str, Any] = {
        "drive": {
            a: {"frequency": f"{f!r} Hz", "amplitude": f"{m!r} mT"}
            for a, (f, m) in world.drive.items()
        },
        "sample_interval": f"{tau!r} s",
        "timestamp": world.stamp,
        "field_timestamp": "interval-end" if averaging_s else "instantaneous",
        "gyro_output": "counts" if world.pulse_arcsec else "rate",
    }
    if averaging_s:
        conditions["field_averaging"] = f"{averaging_s!r} s"
    if world.pulse_arcsec:
        conditions["pulse_weight"] = f"{world.pulse_arcsec!r} arcsec"
    table = Table(np.round(stamp_s, 4), output, np.round(field_mT, 4), conditions)
    rounding = world.pulse_arcsec / tau if world.pulse_arcsec else 10.0**-world.decimals
    noise = np.concatenate(
        (
            np.full(count, np.hypot(sigma, rounding / np.sqrt(12.0))),
            np.full(3 * count, FIELD_NOISE_MT),
        )
    )
    return table, free_columns(world, middle_s, stamp_s, seen.mean(axis=1)), noise


def free_columns(world: World, middle_s: Array, stamp_s: Array, seen: Array) -> Array:
    """Return the derivatives of rate and field by what a clean dataset leaves free.

    Drift and ambient field, slopes and squares; each coil's sine on each axis with its frequency,
    which the gyro follows.
    """
    count, slopes = len(middle_s), world.sensitivity
    nothing = np.zeros((count, 3))
    drift = legendre_columns(middle_s, 4, middle_s[0], middle_s[-1])
    columns = [(one, nothing) for one in drift.T]
    columns += [(seen[:, a] ** power, nothing) for a in range(3) for power in (1, 2)]
    for a in range(3):
        for one in drift[:, :3].T:
            columns.append((0.0 * one, np.outer(one, np.eye(3)[a])))
        for f, _ in world.drive.values():
            for turn in (0.0, 0.25):
                for slope in (0.0, 1.0):
                    rate, away = (
                        np.cos(2.0 * np.pi * (f * t + turn)) * (t / middle_s[-1]) ** slope
                        for t in (middle_s, stamp_s - 0.5 * world.field_averaging_s)
                    )
                    columns.append((slopes[a] * rate, np.outer(away, np.eye(3)[a])))
    return np.column_stack([np.concatenate((rate, away.T.ravel())) for rate, away in columns])


def made(world: World, seed: int, spoil: Spoil | None = None, **wrong: Any) -> Made:
    """Return a dataset of a world, its table spoilt and its conditions replaced where given."""
    table, model, noise = recorded(world, seed)
    if spoil is not None:
        table = spoil(table, np.random.default_rng([seed, 32]))
    conditions = {**table.conditions, **wrong}
    weight = world.pulse_arcsec / world.interval_s if world.pulse_arcsec else 1.0
    data = np.concatenate((table.output * weight, table.field_mT.T.ravel()))

    def write(folder: Path) -> None:
        document = {
            "dataset": 1,
            "procedure": "rlg-magnetic-sensitivity",
            "files": {"samples": "samples.csv"},
            "conditions": conditions,
        }
        text = json.dumps(document, indent=1)  # JSON is YAML
        (folder / "dataset.yaml").write_text(text, encoding="utf-8")
        counts = world.pulse_arcsec > 0.0
        head = f"t_s,{'counts' if counts else 'rate_deg_per_h'},b_ia_mT,b_na_mT,b_la_mT"
        form = ["%.4f", "%d" if counts else "%.10g", *["%.7g"] * 3]
        rows = np.column_stack((table.t_s, table.output, table.field_mT))
        np.savetxt(folder / "samples.csv", rows, form, ",", header=head, comments="")

    truth: dict[tuple[str, str | None, str | None], float] = {
        ("magnetic_sensitivity", a, None): world.sensitivity[AXES.index(a)] for a in world.drive
    }
    return Made(truth, write, data, model, noise)
