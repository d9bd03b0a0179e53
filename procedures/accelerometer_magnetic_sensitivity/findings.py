"""What the analysis of an accelerometer's magnetic sensitivity says, and the settings of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate, Flag, Published

from .identifiability import Identifiability

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class AnalysisSettings:
    """Thresholds of the flags and choices of the estimator, each with its default.

    `not_significant` is in standard uncertainties of a magnetic coefficient, `outlier` in robust
    standard deviations, `gap` in nominal intervals, `field_differs_from_commanded` relative.
    `window` is the number of rows of the finite-memory solution, chosen where it is None.
    """

    not_significant: float = 2.0
    gap: float = 1.5
    field_differs_from_commanded: float = 0.01
    model_too_stiff: float = 0.3
    outlier: float = 5.0
    max_drift_order: int = 8
    window: int | None = None

    def too_stiff_beyond(self, rows: int) -> float:
        """Return the correlation of neighbouring residuals above which the model is too stiff.

        With few rows a correlation as large as the threshold is no rarity.
        """
        return max(self.model_too_stiff, 3.0 / math.sqrt(rows))


@dataclass(frozen=True)
class Nuisance:
    """A term that is fitted beside the coefficients, so that it does not pass for one of them."""

    name: str
    value: float
    standard_uncertainty: float
    unit: str


@dataclass(frozen=True)
class LeftOut:
    """A row that the solution does not use, 0-based, and why."""

    row: int
    reason: str


@dataclass(frozen=True)
class Path:
    """The course of the finite-memory solution: one row of coefficients after each row of data.

    `estimates` (rows, kept), NaN where the window did not determine them; `rows` are the data rows;
    `window` the memory; `resolved` how often the window was solved anew by QR.
    """

    names: tuple[str, ...]
    rows: NDArray[np.int64]
    estimates: Array
    window: int
    resolved: int


@dataclass(frozen=True)
class AccelerometerAnalysis:
    """The whole outcome.

    An estimate is of one coefficient, or of the combination `terms` in its `extra` that its column
    really measures; its sensitivities are derivatives by `field_gain` and `voltage_gain` (relative
    errors), `field_offset_T`, `voltage_offset_V`.
    `covariance` (k, k) is that of the kept coefficients, type A; `residual_V` (rows,) is NaN for
    rows that cannot be judged; `used` marks the rows of the solution. `drift_V` (rows,) is the slow
    part that was taken off, None where there is none. `condition` is that of the scaled design.
    """

    identifiability: Identifiability
    estimates: tuple[Estimate, ...]
    covariance: Array
    published: tuple[Published, ...]
    nuisances: tuple[Nuisance, ...]
    not_separable: tuple[str, ...]
    left_out: tuple[LeftOut, ...]
    flags: tuple[Flag, ...]
    used: Mask
    residual_V: Array
    noise_V: float | None
    lag_one_correlation: float | None
    condition: float | None
    drift_order: int
    path: Path | None
