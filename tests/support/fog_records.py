"""Simulated turns of a fibre-optic gyro over temperature, by equations of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procedures.fog_scale_factor_temperature.dataset import FogDataset, TurnTable

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]

SET_S, RAMP_S, TURN_S, PAUSE_S, AXIS_S = 600.0, 18000.0, 47.0, 2.0, 173.0
NOISE_DEG = 0.00036
"""One ppm of a turn."""


def quartic(heat_degC: Array) -> Array:
    """Return a scale-factor error in ppm, 500 ppm at the cold end."""
    u = (np.asarray(heat_degC) - 10.0) / 50.0
    return np.asarray(60.0 - 170.0 * u + 140.0 * u**2 + 40.0 * u**3 + 110.0 * u**4)


def other(heat_degC: Array) -> Array:
    """Return another one, of the second order."""
    u = (np.asarray(heat_degC) - 10.0) / 50.0
    return np.asarray(-30.0 + 200.0 * u - 90.0 * u**2)


CURVES: dict[str, Curve] = {"x": quartic, "y": other, "z": lambda heat: -quartic(heat)}


def record(
    seed: int = 0,
    turns: Sequence[int] = (360, -360),
    *,
    axes: Sequence[str] = ("x",),
    sets: int = 54,
    bias_deg_per_h: float = 0.02,
    walk: float = 0.0,
    noise_deg: float = NOISE_DEG,
    gyro_bias_deg_per_h: float | None = 0.02,
    first_degC: float = -38.0,
    last_degC: float = 59.0,
    curves: dict[str, Curve] | None = None,
) -> FogDataset:
    """Return a log of turns whose sense is that of the heading, headings wrapped at 360 deg."""
    generator = np.random.default_rng([seed, 5])
    rows = []
    for number in range(sets):
        for place, axis in enumerate(axes):
            for order, commanded in enumerate(turns):
                start = RAMP_S + SET_S * number + AXIS_S * place + (TURN_S + PAUSE_S) * order
                rows.append((number, start, axis, float(commanded)))
    number, start, axis, commanded = (np.array(column) for column in zip(*rows, strict=True))
    part = (start - start[0]) / max(float(start[-1] - start[0]), 1.0)
    heat = first_degC + (last_degC - first_degC) * part
    truth = np.zeros(len(rows))
    for name, curve in (curves or CURVES).items():
        truth = np.where(axis == name, curve(heat), truth)
    steps = np.diff(start, prepend=start[0]) / 3600.0
    bias = bias_deg_per_h + np.cumsum(walk * np.sqrt(steps) * generator.standard_normal(len(rows)))
    error = commanded * truth * 1e-6 + bias * TURN_S / 3600.0
    error = error + noise_deg * generator.standard_normal(len(rows))
    before = generator.uniform(0.0, 360.0, len(rows))
    nothing = np.full(len(rows), np.nan)

    def attitude(heading: Array) -> Array:
        return np.column_stack((np.mod(heading, 360.0), nothing, nothing))

    table = TurnTable(
        set_number=number.astype(np.int64),
        before_s=start,
        after_s=start + TURN_S,
        axis=axis,
        commanded_deg=commanded,
        attitude_before_deg=attitude(before),
        attitude_after_deg=attitude(before + commanded + error),
        temperature_before_degC=heat - 0.08,
        temperature_after_degC=heat + 0.08,
        chamber_degC=heat + 3.0,
    )
    return FogDataset(
        table, "heading", full_attitude=False, gyro_bias_deg_per_h=gyro_bias_deg_per_h
    )


def only(dataset: FogDataset, rows: NDArray[np.bool_]) -> FogDataset:
    """Return the dataset with some of its turns."""
    table = dataset.turns
    return replace(
        dataset,
        turns=TurnTable(**{name: getattr(table, name)[rows] for name in vars(table)}),
    )


def knocked(dataset: FogDataset, rows: Sequence[int], size_deg: float) -> FogDataset:
    """Return the dataset with some turns' heading after the turn moved."""
    after = dataset.turns.attitude_after_deg.copy()
    after[list(rows), 0] += size_deg
    return replace(dataset, turns=replace(dataset.turns, attitude_after_deg=after))
