"""Where flags are raised, and the choices of the estimator; a plan has the same defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass

from station.findings import FlagThresholds

from .frequencies import LARGEST_UNDRIVEN


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags and choices of the estimator, each with its default.

    Ratios are multiples of the standard uncertainty unless the name says otherwise;
    `non_integer_cycles` is in cycles, `gap` in nominal intervals,
    `field_differs_from_commanded` is relative; `undriven_sensitivity` (deg/h/mT) is the
    largest magnitude of the sensitivity of an axis that was not driven.
    """

    quadrature_significant: float = 3.0
    checks_differ: float = 3.0
    non_integer_cycles: float = 0.001
    max_drift_order: int = 4
    max_autoregression_order: int = 16
    fewest_cycles: float = 3.0
    highest_frequency: float = 0.45
    undriven_sensitivity: float = LARGEST_UNDRIVEN

    @property
    def undriven_u(self) -> float:
        """The standard uncertainty of such a sensitivity: uniform between the bounds."""
        return self.undriven_sensitivity / math.sqrt(3.0)
