"""Where flags are raised, and the choices of the estimator; a plan has the same defaults."""

from __future__ import annotations

from dataclasses import dataclass

from station.findings import FlagThresholds

PUBLISHED_ORDER = 4
"""Of the curve over temperature."""
USUAL_REFERENCE_DEGC = 20.0
"""Where the curve is zero unless plan or dataset say otherwise."""


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags and choices of the estimator, each with its default.

    `outlier` is in robust standard deviations of a turn, `gap` in nominal intervals between sets,
    `model_too_stiff` a correlation, `temperature_gap_degC` a stretch without a turn,
    `noise_beyond_statement` the noise of a turn over the stated one.
    """

    highest_order: int = 20
    temperature_gap_degC: float = 10.0
    noise_beyond_statement: float = 3.0
