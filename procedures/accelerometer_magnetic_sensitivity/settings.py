"""Where flags are raised, and the choices of the estimator; a plan has the same defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass

from station.findings import FlagThresholds


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags and choices of the estimator, each with its default.

    `not_significant` is in standard uncertainties of a magnetic coefficient, `outlier` in robust
    standard deviations, `gap` in nominal intervals, `field_differs_from_commanded` relative.
    `window` is the number of rows of the finite-memory solution, chosen where it is None.
    `scale_factor_V_per_g` stands for Ki where no row tells that.
    """

    max_drift_order: int = 8
    window: int | None = None
    scale_factor_V_per_g: float = 1.0

    def too_stiff_beyond(self, rows: int) -> float:
        """Return the correlation of neighbouring residuals above which the model is too stiff.

        With few rows a correlation as large as the threshold is no rarity.
        """
        return max(self.model_too_stiff, 3.0 / math.sqrt(rows))
