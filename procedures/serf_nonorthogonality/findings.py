"""What the analysis of coil angles says, and the settings of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate, Flag, Published

from .angles import Solution
from .joint import JointFit
from .light import Lean
from .tone import ToneFit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AnalysisSettings:
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
    gap: float = 1.5
    model_too_stiff: float = 0.3
    skip_s: float = 0.0


@dataclass(frozen=True)
class Check:
    """A test of the result against something it should agree with: passed, failed or not made."""

    what: str
    found: str
    wanted: str
    passed: bool | None


@dataclass(frozen=True)
class ShotResult:
    """A shot with its fit; `rejected` says why it is not in the solution, None where it is.

    `omega_rad_per_s` with `omega_u` is what goes into the solution, NaN where nothing does, freed
    from the pull of spin exchange; `field_nT` what it says of the field.
    """

    name: str
    fit: ToneFit | None
    rejected: str | None
    omega_rad_per_s: float
    omega_u: float
    field_nT: float
    misfit: float
    """Frequency less the solution's, over its uncertainty."""
    kept: NDArray[np.bool_]
    residual_V: Array
    """Which samples (n,) were used, and what the final fit leaves of these."""

    @property
    def used(self) -> bool:
        """Whether the shot is in the solution."""
        return self.rejected is None


@dataclass(frozen=True)
class SerfAnalysis:
    """The whole outcome.

    Sensitivities of the estimates are derivatives by `coil_x`, `coil_y`, `coil_z`,
    `gyromagnetic_ratio`, `sample_clock` (relative errors), `residual_x_nT` and so on, and
    `trigger_delay_s`. `chirp` with `chirp_u` is by how much the frequency falls over the decay,
    relative; `joint` is None where every shot was fitted alone, and so is `lean`, that of spins and
    probe. `rate_per_s` and `beta_s` give the decay of a shot as rate + beta w².
    """

    shots: tuple[ShotResult, ...]
    solution: Solution | None
    joint: JointFit | None
    lean: Lean | None
    estimates: tuple[Estimate, ...]
    published: tuple[Published, ...]
    flags: tuple[Flag, ...]
    checks: tuple[Check, ...]
    chirp: float
    chirp_u: float
    rate_per_s: float | None
    beta_s: float
    residual_field_nT: float | None
    """Magnitude, None where it is not determined."""

    def estimate(self, name: str, axis: str | None = None) -> Estimate:
        """Return one estimate."""
        return next(one for one in self.estimates if (one.name, one.axis) == (name, axis))
