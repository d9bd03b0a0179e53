"""Where flags are raised, and the choices of the estimator; a plan has the same defaults."""

from __future__ import annotations

from dataclasses import dataclass

from station.findings import FlagThresholds


@dataclass(frozen=True)
class PoseLimits:
    """How far means may lie from an ideal position before it counts as a wrong one.

    `rate_deg_per_h` is what remains once the biases are free; `bias_deg_per_h` is what a bias may
    be where one position is judged alone.
    """

    acceleration_g: float = 0.05
    rate_deg_per_h: float = 1.0
    bias_deg_per_h: float = 5.0


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags and choices of the estimator, each with its default.

    `not_significant` is in standard uncertainties, `outlier` in robust standard deviations, `gap`
    in nominal intervals.
    """

    pose: PoseLimits = PoseLimits()
