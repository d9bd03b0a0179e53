"""The pulse weight of a laser gyro by the earth's rate at rest: a pure function of a dataset."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, Flag, InputQuantity, undetermined

from .limits import COVERAGE, MIN_SHARE, PULSE_WEIGHT

Array = NDArray[np.float64]
EARTH_DEG_PER_H = 15.041067
"""The sidereal rate, IERS Conventions (2010)."""
BLOCKS = 10
SEEN = "the channel on which the board sees a lit gyro, less the plan's"
BIAS, DIRECTION, SCALE = "gyro_bias_deg_per_h", "input_axis_deg", "gyro_scale"


@dataclass(frozen=True)
class Earth:
    """What the gyro should feel in deg/h, and what changes it: d rate / d direction in deg/h/deg.

    `direction_u_deg` and `bias_u_deg_per_h` are standard uncertainties.
    """

    rate_deg_per_h: float
    per_deg: float
    direction_u_deg: float
    bias_u_deg_per_h: float


@dataclass(frozen=True)
class GyroDataset:
    """Pulses at rest: `counts` (n,) at `time_s` (n,) by the board's clock; lit channels.

    `earth` is None where the plan does not state the input axis.
    """

    time_s: Array
    counts: Array
    pulse_arcsec: float
    channel: int
    lit: tuple[int, ...]
    earth: Earth | None = None


def earth_of(
    latitude_deg: float,
    elevation_deg: float,
    azimuth_deg: float,
    direction_u_deg: float,
    bias_u_deg_per_h: float,
) -> Earth:
    """Return the earth's rate along an input axis.

    What a small turn of the axis changes it at most is the part of the earth's rate across it.
    """
    latitude, elevation, azimuth = map(math.radians, (latitude_deg, elevation_deg, azimuth_deg))
    along = math.cos(latitude) * math.cos(azimuth) * math.cos(elevation)
    along += math.sin(latitude) * math.sin(elevation)
    across = math.sqrt(max(1.0 - along**2, 0.0))
    return Earth(
        EARTH_DEG_PER_H * along,
        math.radians(EARTH_DEG_PER_H * across),
        direction_u_deg,
        bias_u_deg_per_h,
    )


def analyse(data: GyroDataset, inputs: Sequence[InputQuantity]) -> Analysis:
    """Return rate at rest, the pulse weight over the plan's, and causes; ValueError for no record.

    `inputs` are the type B inputs that the figures are sensitive to.
    """
    rate, u = rate_of(data)
    method = "pulses over time at rest"
    channel = next((channel for channel in data.lit if channel == data.channel), data.lit[0])
    estimates = [
        Estimate("gyro_channel_offset", None, float(channel - data.channel), "1", 0.0, None, SEEN),
        Estimate("rest_rate", None, rate, "deg/h", u, BLOCKS - 1.0, method),
    ]
    flags = list(_channel(data))
    earth = data.earth
    if earth is None:
        estimates.append(undetermined("pulse_weight_ratio", None, "1", method))
        return Analysis(estimates, (), flags)
    if abs(rate) < MIN_SHARE * abs(earth.rate_deg_per_h):
        message = (
            f"At rest the gyro counts {rate:.3g} deg/h; it should feel "
            f"{earth.rate_deg_per_h:.3g} deg/h of the earth's rate: it gives no pulses, or its "
            "input axis stands otherwise."
        )
        estimates.append(undetermined("pulse_weight_ratio", None, "1", method))
        return Analysis(estimates, (), [*flags, Flag("gyro-without-pulses", message)])
    ratio = earth.rate_deg_per_h / rate
    by = {BIAS: 1.0 / rate, DIRECTION: earth.per_deg / rate, SCALE: ratio}
    weight = Estimate(
        "pulse_weight_ratio",
        None,
        ratio,
        "1",
        abs(ratio * u / rate),
        BLOCKS - 1.0,
        "the earth's rate along the input axis over the rate at rest",
        by,
    )
    known = {input.name: input.standard_uncertainty or 0.0 for input in inputs}
    whole_u = math.hypot(ratio * u / rate, *(by[name] * known.get(name, 0.0) for name in by))
    return Analysis([*estimates, weight], (), [*flags, *_weight(ratio, whole_u, data)])


def rate_of(data: GyroDataset) -> tuple[float, float]:
    """Return the mean rate in deg/h (arcsec/s) and its standard uncertainty, from ten blocks."""
    if len(data.counts) <= BLOCKS:
        raise ValueError("the record at rest has too few samples")
    angle_arcsec = data.counts * data.pulse_arcsec
    edges = np.linspace(0, len(angle_arcsec) - 1, BLOCKS + 1).astype(int)
    blocks = np.diff(angle_arcsec[edges]) / np.diff(data.time_s[edges])
    whole = (angle_arcsec[-1] - angle_arcsec[0]) / (data.time_s[-1] - data.time_s[0])
    return float(whole), float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS)


def _channel(data: GyroDataset) -> Iterator[Flag]:
    if data.channel not in data.lit:
        channels = " and ".join(map(str, data.lit))
        message = (
            f"The pulse board sees the gyro on channel {channels}, the plan states {data.channel}: "
            "exchange the cables, or state that channel in the plans."
        )
        yield Flag("gyro-on-other-channel", message, details={"channels": list(data.lit)})


def _weight(ratio: float, u: float, data: GyroDataset) -> Iterator[Flag]:
    off_by = ratio - 1.0
    if ratio < 0.0:
        message = (
            "The gyro counts the earth's rate reversed: the sign of its pulses, or an input axis "
            "that points the other way."
        )
        yield Flag("gyro-sense-reversed", message)
    elif abs(off_by) - COVERAGE * u > PULSE_WEIGHT:
        message = (
            f"The pulse weight is off by {100.0 * off_by:+.2g} %: by the earth's rate it is "
            f"{ratio * data.pulse_arcsec:.4g} arcsec. Compare pulse_weight with the gyro's papers."
        )
        yield Flag("pulse-weight-off", message)
    elif COVERAGE * u > PULSE_WEIGHT:
        message = (
            f"At rest the pulse weight is known to {100.0 * COVERAGE * u:.2g} % only, which does "
            "not decide 1 %: state bias and direction of the input axis better, or turn the gyro "
            "on a table."
        )
        yield Flag("pulse-weight-undecided", message)
