"""Where the flags are raised that procedures share, unless a plan's `thresholds` say otherwise."""

from __future__ import annotations

from station.findings import FlagThresholds

NOT_SIGNIFICANT = FlagThresholds.not_significant
"""Standard uncertainties: what is smaller is no more than one in twenty by chance."""
GAP = FlagThresholds.gap
"""Nominal intervals: a row is missing."""
OUTLIER = FlagThresholds.outlier
"""Robust standard deviations: by chance once in two million."""
MODEL_TOO_STIFF = FlagThresholds.model_too_stiff
"""Correlation of neighbouring residuals."""
FIELD_DIFFERS = FlagThresholds.field_differs_from_commanded
"""Relative, of the commanded field."""
