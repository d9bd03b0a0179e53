"""The analysis tried again: other noise of turns and drive, and inputs that deviate.

Each gyro and each accelerometer has a bias of its own, and the vehicle leans in two directions:
what is stated of them stands for many and is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from procedures.common.constants import (
    ARCMIN_PER_RAD,
    ARCSEC_PER_RAD,
    FULL_TURN_DEG,
    SECONDS_PER_HOUR,
)
from procedures.common.perturbing import drawn_size, shifted
from station.findings import Analysis, Trials

from .analysis import FogAnalysis
from .dataset import AXES, PPM, Array, Drive, FogDataset, TurnSense, TurnTable
from .navigation import (
    ACCELEROMETER_BIAS,
    GYRO_BIAS,
    HEADING,
    LEVEL,
    M_PER_S2_PER_UG,
    white_noise,
)
from .solution import AxisFit

LATITUDE = "latitude"


@dataclass(frozen=True)
class Noise:
    """The noise of an axis: of a turn in deg, known with `freedom` degrees of freedom, and the walk
    of its bias in deg/h per root of an hour."""

    turn_deg: float
    freedom: float
    walk: float


def trials_of(
    analysis: FogAnalysis, dataset: FogDataset, again: Callable[[FogDataset], Analysis]
) -> Trials:
    """Return how the analysis of a dataset is tried again; checks of the curve are linear."""
    noises = {axis: noise for axis, fit in analysis.fits.items() if (noise := noise_of(fit))}
    perturbed = {
        LATITUDE: partial(_of_drive, column="latitude_deg", unit=np.degrees(1.0)),
        HEADING: partial(
            _of_drive, column="first_heading_deg", unit=np.degrees(1.0 / ARCMIN_PER_RAD)
        ),
    }
    drawn = {GYRO_BIAS: _biases, ACCELEROMETER_BIAS: _accelerometers, LEVEL: _leans}
    return Trials(dataset, again, partial(noisy, noises=noises), perturbed, drawn)


def noise_of(fit: AxisFit) -> Noise | None:
    """Return the noise of an axis; None where it has no curve."""
    if fit.curve is None or fit.noise_ppm is None:
        return None
    turn_deg = fit.noise_ppm / PPM * FULL_TURN_DEG
    return Noise(turn_deg, fit.curve.degrees_of_freedom, fit.walk_deg_per_h_per_sqrt_h or 0.0)


def noisy(
    dataset: FogDataset, random: np.random.Generator, *, noises: Mapping[str, Noise]
) -> FogDataset:
    """Return turns and drive with more noise, of the size that theirs has."""
    sizes = {axis: drawn_size(noise.freedom, random) for axis, noise in noises.items()}

    def of_table(table: TurnTable) -> Array:
        off_deg = np.zeros(len(table))
        for axis, noise in noises.items():
            own = table.axis == axis
            steps_h = np.maximum(np.diff(table.middle_s[own], prepend=0.0), 0.0) / SECONDS_PER_HOUR
            # What the bias was at the first turn changes nothing.
            steps_h[:1] = 0.0
            walk = np.cumsum(np.sqrt(steps_h) * random.standard_normal(len(steps_h))) * noise.walk
            off_deg[own] = walk * table.duration_s[own] / SECONDS_PER_HOUR
            off_deg[own] += noise.turn_deg * sizes[axis] * random.standard_normal(len(walk))
        return off_deg

    turned = _turned(dataset, of_table)
    return replace(turned, drive=None if turned.drive is None else _noisy(turned.drive, random))


def _noisy(drive: Drive, random: np.random.Generator) -> Drive:
    def more(values: Array) -> Array:
        return values + white_noise(values) * random.standard_normal(values.shape)

    force = drive.specific_force_m_per_s2
    return replace(
        drive,
        rate_deg_per_s=more(drive.rate_deg_per_s),
        specific_force_m_per_s2=None if force is None else more(force),
    )


def _turned(dataset: FogDataset, off_deg: Callable[[TurnTable], Array]) -> FogDataset:
    """Return turns that went farther in the table's sense, by (rows,) in deg of each table."""

    def farther(table: TurnTable, sense: TurnSense) -> TurnTable:
        after = table.attitude_after_deg.copy()
        after[:, 0] += off_deg(table) * (1.0 if sense == "heading" else -1.0)
        return replace(table, attitude_after_deg=after)

    proof, sense = dataset.verification, dataset.turn_sense
    return replace(
        dataset,
        turns=farther(dataset.turns, sense),
        verification=None if proof is None else farther(proof, sense),
    )


def biased(dataset: FogDataset, bias_deg_per_h: Array) -> FogDataset:
    """Return turns and drive of gyros with other biases (3,)."""

    def of_table(table: TurnTable) -> Array:
        bias = np.zeros(len(table))
        for axis, own in zip(AXES, bias_deg_per_h, strict=True):
            bias[table.axis == axis] = own
        return bias * table.duration_s / SECONDS_PER_HOUR

    turned = _turned(dataset, of_table)
    if turned.drive is None:
        return turned
    rate = turned.drive.rate_deg_per_s + bias_deg_per_h / SECONDS_PER_HOUR
    return replace(turned, drive=replace(turned.drive, rate_deg_per_s=rate))


def _biases(dataset: FogDataset, u: float, random: np.random.Generator) -> FogDataset:
    return biased(dataset, u * random.standard_normal(len(AXES)))


def _accelerometers(dataset: FogDataset, u_ug: float, random: np.random.Generator) -> FogDataset:
    drive = dataset.drive
    if drive is None or drive.specific_force_m_per_s2 is None:
        return dataset
    bias = u_ug * M_PER_S2_PER_UG * random.standard_normal(len(AXES))
    return replace(dataset, drive=shifted(drive, bias, column="specific_force_m_per_s2"))


def _leans(dataset: FogDataset, u_arcsec: float, random: np.random.Generator) -> FogDataset:
    for column in ("first_pitch_deg", "first_roll_deg"):
        off_arcsec = u_arcsec * float(random.standard_normal())
        unit = float(np.degrees(1.0 / ARCSEC_PER_RAD))
        dataset = _of_drive(dataset, off_arcsec, column=column, unit=unit)
    return dataset


def _of_drive(dataset: FogDataset, off: float, *, column: str, unit: float) -> FogDataset:
    """Return a drive of which a number in deg is off; `unit` is that of `off`, in deg."""
    drive = dataset.drive
    if drive is None or getattr(drive, column) is None:
        return dataset
    return replace(dataset, drive=shifted(drive, off * unit, column=column))
