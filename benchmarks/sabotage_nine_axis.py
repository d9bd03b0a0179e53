"""Faults planted in datasets of the nine-axis calibration: what goes wrong on plate and table.

The clean datasets are those of `nine_axis_estimator.py`. Seeds go through three kinds of them in
turn: part turns with the turned gyro alone, all gyros in six positions on a bent sensor, and an
efficient dwell of whole turns. The faults themselves are in
`sabotage_nine_axis_rest.py` and `sabotage_nine_axis_turns.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from nine_axis_estimator import POSITIONS, Case, Truth, simulate
from numpy.typing import NDArray
from sabotage import Fault, Made
from sabotage_nine_axis_rest import STATIC_FAULTS, Plant
from sabotage_nine_axis_turns import TURNING_FAULTS

from procedures.nine_axis_calibration.dataset import AXES, NineAxisDataset, Prior

Array = NDArray[Any]
Block = tuple[Array, Array, Array]
"""Some of the readings (n,), their derivatives (n, p), their standard deviations (n,)."""

NOISE_deg_per_h = 0.6
NOISE_g = 1e-4
NOISE_deg = 1e-5
ARCMIN = np.pi / 10800.0
EARTH_deg_per_h = 15.041067
KINDS = (
    (Case("part turns", None, dwell_s=72.0, static_s=200), True),
    (
        Case("six positions", None, nonlinearity_ppm=20.0, dwell_s=72.0, static_s=120, places=6),
        False,
    ),
    (Case("whole turns", None, turns=2, static_s=150), False),
)
USUAL_FLAGS = frozenset(
    {"part-turns", "not-significant", "not-identifiable", "heading-differs-from-prior"}
)
"""What clean datasets of these kinds say: turns of 72 deg, asymmetries that are noise, no gyros
across the turned axis, a heading beyond two of its standard deviations once in twenty."""


def clean(seed: int, kind: int | None = None) -> tuple[NineAxisDataset, Truth]:
    """Return a dataset of a kind, the seed's own unless given, and the truth behind it."""
    case, alone = KINDS[seed % len(KINDS) if kind is None else kind]
    dataset, truth = simulate(case, seed)
    # A recorder writes so many decimals.
    static = tuple(
        replace(
            one,
            rate_deg_per_h=np.round(one.rate_deg_per_h, 4),
            acceleration_g=np.round(one.acceleration_g, 6),
        )
        for one in dataset.static
    )
    turns = []
    for one in dataset.turns:
        rate = np.round(one.rate_deg_per_s, 7)
        if alone:
            rate[:, [n for n in range(3) if n != one.axis]] = np.nan
        turns.append(replace(one, rate_deg_per_s=rate))
    return replace(dataset, static=static, turns=tuple(turns)), truth


def made(dataset: NineAxisDataset, truth: Truth) -> Made:
    """Return a dataset with its truth, and what a clean one like it leaves free."""
    known: dict[tuple[str, str | None, str | None], float] = {}
    arcsec = 60.0 / ARCMIN
    for axis, name in enumerate(AXES):
        known["bias", name, None] = truth.bias[axis]
        known["scale_factor", name, None] = truth.scale[axis]
        known["asymmetry", name, None] = 1e6 * truth.asymmetry[axis]
        for other in {0, 1, 2} - {axis}:
            known["misalignment", name + AXES[other], None] = arcsec * truth.cross[axis, other]
    blocks = [_at_rest(dataset), *(_turned(dataset, axis) for axis in range(3))]
    width = sum(one[1].shape[1] for one in blocks)
    model, start = [], 0
    for _, columns, _ in blocks:
        wide = np.zeros((len(columns), width))
        wide[:, start : start + columns.shape[1]] = columns
        model.append(wide)
        start += columns.shape[1]
    return Made(
        {key: float(value) for key, value in known.items()},
        lambda folder: write(dataset, folder),
        np.concatenate([one[0] for one in blocks]),
        np.vstack(model),
        np.concatenate([one[2] for one in blocks]),
    )


def _at_rest(dataset: NineAxisDataset) -> Block:
    """Return the readings at rest; free are biases, attitudes within the priors, accelerometers."""
    prior, count = dataset.prior, len(dataset.static)
    latitude = np.radians(dataset.latitude_deg)
    data, rows, noise = [], [], []
    width = 7 + 3 * count
    for place, one in enumerate(dataset.static):
        n = len(one.time_s)
        gyro, force = np.zeros((n, 3, width)), np.zeros((n, 3, width))
        gyro[:, range(3), range(3)] = 1.0
        force[:, range(3), range(4, 7)] = 1.0
        # Small turns about east, north, up move what the axes feel of the vectors v by e x v.
        axes = POSITIONS[one.position]
        turning = EARTH_deg_per_h * np.array([0.0, np.cos(latitude), np.sin(latitude)])
        for about in range(3):
            e = np.eye(3)[about]
            gyro[:, :, 7 + 3 * place + about] = axes @ np.cross(turning, e)
            force[:, :, 7 + 3 * place + about] = axes @ np.cross(np.array([0.0, 0.0, 1.0]), e)
        gyro[:, :, 3] = gyro[:, :, 7 + 3 * place + 2]
        data += [one.rate_deg_per_h.ravel(), one.acceleration_g.ravel()]
        rows += [gyro.reshape(-1, width), force.reshape(-1, width)]
        noise += [np.full(3 * n, NOISE_deg_per_h), np.full(3 * n, NOISE_g)]
    sizes = [prior.heading_rad, *[prior.accelerometer_bias_g] * 3]
    sizes += [prior.tilt_rad, prior.tilt_rad, prior.relative_heading_rad] * count
    data.append(np.zeros(width - 3))
    rows.append(np.eye(width)[3:])
    noise.append(np.array(sizes))
    return np.concatenate(data), np.vstack(rows), np.concatenate(noise)


def _turned(dataset: NineAxisDataset, axis: int) -> Block:
    """Return the readings of one turned axis.

    Free are, for each gyro, what it answers to every rate and sense, a constant, the modulation by
    the earth's rotation; for each record where its encoder began and the rate it turned at.
    """
    records = [one for one in dataset.turns if one.axis == axis]
    sizes = sorted({abs(one.commanded_deg_per_s) for one in records})
    per_gyro, own = 3 + 1 + len(sizes), 2 * len(records)
    width = 3 * per_gyro + own
    data, rows, noise = [], [], []
    for n, one in enumerate(records):
        count, rate = len(one.time_s), one.commanded_deg_per_s
        angle = np.radians(one.encoder_deg)
        for gyro in range(3):
            if not np.isfinite(one.rate_deg_per_s[:, gyro]).any():
                continue
            wide = np.zeros((count, width))
            first = gyro * per_gyro
            wide[:, first : first + 3] = np.column_stack(
                (np.ones(count), np.cos(angle), np.sin(angle))
            )
            wide[:, first + 3] = abs(rate)
            # A gyro across answers to every rate alike, the turned one may be bent.
            wide[:, first + 4 + (sizes.index(abs(rate)) if gyro == axis else 0)] = rate
            wide[:, 3 * per_gyro + 2 * n + 1] = 1.0 if gyro == axis else 0.0
            data.append(one.rate_deg_per_s[:, gyro])
            rows.append(wide)
            noise.append(np.full(count, NOISE_deg_per_h / 3600.0))
        wide = np.zeros((count, width))
        wide[:, 3 * per_gyro + 2 * n] = 1.0
        wide[:, 3 * per_gyro + 2 * n + 1] = one.time_s
        data.append(np.unwrap(one.encoder_deg - rate * one.time_s, period=360.0))
        rows.append(wide)
        noise.append(np.full(count, NOISE_deg))
    return np.concatenate(data), np.vstack(rows), np.concatenate(noise)


def write(dataset: NineAxisDataset, folder: Path) -> None:
    """Write a dataset in the import format."""
    prior = dataset.prior
    (folder / "dataset.yaml").write_text(
        "dataset: 1\nprocedure: nine-axis-calibration\n"
        "files: {static: static.csv, rate: rate.csv}\nconditions:\n"
        f"  latitude: {dataset.latitude_deg:.10g} deg\n" + _prior(prior),
        encoding="utf-8",
    )
    lines = ["position,t_s,gx_deg_per_h,gy_deg_per_h,gz_deg_per_h,ax_g,ay_g,az_g"]
    for still in dataset.static:
        table = np.column_stack((still.time_s, still.rate_deg_per_h, still.acceleration_g))
        lines += [",".join([str(still.position), *(f"{v:.10g}" for v in row)]) for row in table]
    (folder / "static.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    alone = not all(
        bool(np.isfinite(one.rate_deg_per_s).any(axis=0).all()) for one in dataset.turns
    )
    names = "rate_deg_per_s" if alone else "gx_deg_per_s,gy_deg_per_s,gz_deg_per_s"
    lines = [f"axis,commanded_deg_per_s,t_s,{names},encoder_deg"]
    for turn in dataset.turns:
        gyros = turn.rate_deg_per_s[:, [turn.axis]] if alone else turn.rate_deg_per_s
        table = np.column_stack((turn.time_s, gyros, turn.encoder_deg))
        start = f"{AXES[turn.axis]},{turn.commanded_deg_per_s:.10g}"
        lines += [",".join([start, *(f"{value:.10g}" for value in row)]) for row in table]
    (folder / "rate.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _prior(prior: Prior) -> str:
    angles = {
        "heading": prior.heading_rad,
        "relative_heading": prior.relative_heading_rad,
        "tilt": prior.tilt_rad,
    }
    lines = [f"    {name}: {value / ARCMIN:.10g} arcmin\n" for name, value in angles.items()]
    return (
        "  prior:\n"
        + "".join(lines)
        + f"    accelerometer_bias: {prior.accelerometer_bias_g:.10g} g\n"
    )


def _fault(plant: Plant) -> Fault:
    def whole(seed: int) -> Made:
        return made(*clean(seed))

    def planted(seed: int) -> Made:
        dataset, truth = clean(seed)
        return made(plant.spoil(dataset, np.random.default_rng([seed, 31])), truth)

    return Fault(plant.name, plant.flags, whole, planted, plant.detectable)


def _of_kind(kind: int) -> Callable[[int], Made]:
    return lambda seed: made(*clean(seed, kind))


FAULTS = tuple(_fault(one) for one in (*STATIC_FAULTS, *TURNING_FAULTS))
CLEAN = tuple(_of_kind(kind) for kind in range(len(KINDS)))
