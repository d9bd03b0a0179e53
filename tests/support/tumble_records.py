"""Made readings of an accelerometer that gravity turns in, with errors of stage and mounting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procedures.accelerometer_tumble.dataset import TumbleDataset
from procedures.accelerometer_tumble.model import COEFFICIENTS, model_columns

ARCSEC = np.pi / 180.0 / 3600.0
QUARTZ = {
    "K0": 2.1e-3,
    "Ki": 1.0002,
    "Kii": 12e-6,
    "Kiii": 6e-6,
    "Kio": -9e-6,
    "Kip": 5e-6,
    "Koo": 3e-6,
    "Kf": 2e-4,
    "Ko": 3.5e-4,
    "Kp": -2.1e-4,
}
Mounting = tuple[str, int, float]
FOUR: tuple[Mounting, ...] = (("io", 0, 0), ("io", 1, 0), ("ip", 0, 0), ("ip", 1, 0))


@dataclass(frozen=True)
class Stage:
    """A test: mountings (plane, reversed, head in deg), positions up and down, errors."""

    mountings: Sequence[Mounting] = FOUR
    positions: int = 24
    noise_V: float = 3e-6
    encoder_arcsec: float = 1.0
    mounting_arcsec: float = 1.0
    drift_V_per_h: float = 0.0
    warms_K: float = 0.0
    truth: Mapping[str, float] = field(default_factory=lambda: QUARTZ)


def made(rng: np.random.Generator, stage: Stage) -> TumbleDataset:
    """Return the readings of a test; encoder and mountings are off as far as stated."""
    up = 360.0 / stage.positions * np.arange(stage.positions)
    commanded = np.deg2rad(np.tile(np.concatenate((up, up[::-1])), len(stage.mountings)))
    each = 2 * stage.positions
    number = np.repeat(np.arange(len(stage.mountings)), each)
    plane = np.array([one[0] for one in stage.mountings])[number]
    reverse = 1.0 - 2.0 * np.array([one[1] for one in stage.mountings])[number]
    head = np.deg2rad(np.array([float(one[2]) for one in stage.mountings]))[number]
    time_s = 25.0 * np.arange(len(number))
    off = ARCSEC * stage.encoder_arcsec * rng.standard_normal(4)
    put = ARCSEC * stage.mounting_arcsec * rng.standard_normal(len(stage.mountings))
    waves = [wave(n * commanded) for n in (1, 2) for wave in (np.cos, np.sin)]
    theta = commanded + head + np.column_stack(waves) @ off + put[number]
    values = np.array([stage.truth.get(name, 0.0) for name in COEFFICIENTS])
    output = model_columns(plane, reverse, theta, 1.0) @ values
    hours = (time_s - time_s.mean()) / 3600.0
    warm = 23.0 + stage.warms_K * np.sin(2.0 * hours)
    output += stage.drift_V_per_h * hours + 30e-6 * (warm - warm.mean())
    output += 120e-6 * (warm - warm.mean()) * np.sin(theta)
    return TumbleDataset(
        time_s=time_s,
        plane=plane,
        reverse=reverse,
        head_rad=head,
        commanded_rad=commanded,
        encoder_rad=commanded.copy(),
        output_V=output + stage.noise_V * rng.standard_normal(len(output)),
        temperature_degC=warm + 0.003 * rng.standard_normal(len(output)),
        gravity_g=1.0,
        encoder_accuracy_rad=ARCSEC * stage.encoder_arcsec,
        mounting_rad=ARCSEC * stage.mounting_arcsec,
    )


def changed(dataset: TumbleDataset, **columns: np.ndarray) -> TumbleDataset:
    """Return the readings with some of the columns changed."""
    return replace(dataset, **columns)
