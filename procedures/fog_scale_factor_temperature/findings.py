"""What the analysis of a gyro over temperature says, and the settings of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from station.findings import Flag

from .curve import Curve
from .dataset import Array, Index, Mask


@dataclass(frozen=True)
class AnalysisSettings:
    """Thresholds of the flags and choices of the estimator, each with its default.

    `outlier` is in robust standard deviations of a turn, `gap` in nominal intervals between sets,
    `model_too_stiff` a correlation, `temperature_gap_degC` a stretch without a turn,
    `noise_beyond_statement` the noise of a turn over the stated one.
    """

    outlier: float = 5.0
    gap: float = 1.5
    model_too_stiff: float = 0.3
    highest_order: int = 20
    temperature_gap_degC: float = 10.0
    noise_beyond_statement: float = 3.0


@dataclass(frozen=True)
class Misfit:
    """What the curve does not follow: `size_ppm` is the largest that it leaves.

    Where it is not `sure` chance makes it now and then.
    `kink` says whether the slope changes at `at_degC`, by `slope_ppm_per_degC`; else it is a bump
    whose standard deviation is `width_degC`. `left_ppm` (n,) is what the curve leaves at the
    `CHECKED` even temperatures of its range.
    """

    sure: bool
    kink: bool
    at_degC: float
    width_degC: float
    slope_ppm_per_degC: float
    size_ppm: float
    left_ppm: Array


@dataclass(frozen=True)
class AxisFit:
    """One axis: its rows of the turn table, those that the model uses, and the model.

    `rows` are row numbers of the table, the other arrays belong to them: `error_ppm` (n,) is the
    turn error over the commanded turn, NaN for a wait; `residual_ppm` (n,) what the model and the
    wandering bias leave of it. `curve` is None where the turns do not determine one. `noise_ppm` is
    the standard deviation of a turn, by the scatter of the sets that tell their bias.
    `walk_deg_per_h_per_sqrt_h` and `bias_deg_per_h` are None where turns of one sense cannot tell
    them. `misfit` is what the curve does not follow, `gaps_degC` are the stretches of temperature
    without a turn, each from and until, that are wider than `temperature_gap_degC`.
    """

    axis: str
    rows: Index
    kept: Mask
    temperature_degC: Array
    error_ppm: Array
    residual_ppm: Array
    curve: Curve | None
    paired: bool
    noise_ppm: float | None = None
    lag_one_correlation: float | None = None
    sets: int = 0
    walk_deg_per_h_per_sqrt_h: float | None = None
    bias_deg_per_h: float | None = None
    misfit: Misfit | None = None
    gaps_degC: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class PublishedFit:
    """The published polynomial of one axis, None where there are too few turns."""

    axis: str
    curve: Curve | None


@dataclass(frozen=True)
class Verified:
    """Turns of a verification ramp, one axis: errors before and after compensation.

    `before_ppm` and `after_ppm` (n,) have the bias taken off where turns of both senses tell it;
    `u_ppm` (n,) is the type A uncertainty of `after_ppm`, `by_bias_ppm` (n,) what a bias of 1 deg/h
    would add. `beyond_ppm` is the rms of `after_ppm` that all this does not explain, zero where it
    may be chance. `worst` is the place of the largest magnitude after compensation; `outside`
    counts turns that lie more than a degree outside the calibrated range.
    """

    axis: str
    temperature_degC: Array
    before_ppm: Array
    after_ppm: Array
    u_ppm: Array
    by_bias_ppm: Array
    worst: int
    outside: int
    beyond_ppm: float = 0.0


@dataclass(frozen=True)
class Driven:
    """The vehicle test: error of heading at its end, without and with compensation, in deg.

    `time_s`, `raw_deg` and `compensated_deg` (n,) are the courses of the heading. Errors are None
    where they are too large to be those of a drive that closes. `noise_u_deg` comes of the rates'
    noise, `model_u_deg` of the model, `by_bias_deg` is what a bias of 1 deg/h in the model takes
    off; `outside` is the part of the time outside the calibrated range.
    """

    time_s: Array
    raw_deg: Array
    compensated_deg: Array
    raw_error_deg: float | None
    compensated_error_deg: float | None
    noise_u_deg: float
    model_u_deg: float
    by_bias_deg: float
    duration_h: float
    turned_deg: float
    outside: float


@dataclass(frozen=True)
class FogAnalysis:
    """The whole outcome, axes in the order x, y, z as far as the turns concern them."""

    fits: Mapping[str, AxisFit]
    published: Mapping[str, PublishedFit]
    verified: Mapping[str, Verified]
    driven: Driven | None
    flags: tuple[Flag, ...]
