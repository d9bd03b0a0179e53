"""Where flags are raised, and the choices of the estimator; a plan has the same defaults."""

from __future__ import annotations

from dataclasses import dataclass

from station.findings import FlagThresholds


@dataclass(frozen=True)
class AnalysisSettings(FlagThresholds):
    """Thresholds of the flags, each with its default.

    `few_cycles` within the 1/e time; `residual_field_large_nT` magnitude; `chirp` relative change
    of the frequency over the decay, which must also be `chirp_u` of its uncertainties; `gap` in
    nominal intervals; `model_too_stiff` lag-1 correlation of a shot's residuals. Samples before
    `skip_s`, while the coils' currents rise, are left out.
    """

    few_cycles: float = 1.5
    residual_field_large_nT: float = 1.5
    chirp: float = 0.01
    chirp_u: float = 5.0
    skip_s: float = 0.0
