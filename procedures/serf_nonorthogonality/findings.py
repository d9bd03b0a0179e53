"""What the analysis of coil angles says, and the settings of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .angles import Solution
from .joint import JointFit
from .light import Lean
from .tone import ToneFit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AnalysisSettings:
    """Thresholds of the flags, each with its default.

    `few_cycles` within the 1/e time; `residual_field_nT` magnitude; `chirp` relative change of the
    frequency over the decay, which must also be `chirp_u` of its uncertainties; `gap` in nominal
    intervals; `model_too_stiff` lag-1 correlation of a shot's residuals. Samples before `skip_s`,
    while the coils' currents rise, are left out.
    """

    few_cycles: float = 1.5
    residual_field_nT: float = 1.5
    chirp: float = 0.01
    chirp_u: float = 5.0
    gap: float = 1.5
    model_too_stiff: float = 0.3
    skip_s: float = 0.0


@dataclass(frozen=True)
class Estimate:
    """One result; value and type A uncertainty are None where the shots do not determine it.

    `sensitivities` are derivatives by the inputs of type B: `coil_x`, `coil_y`, `coil_z`,
    `gyromagnetic_ratio`, `sample_clock` (relative errors), `residual_x_nT` and so on, `pump_deg`,
    `probe_deg` (leans of the light), `trigger_delay_s`.
    """

    name: str
    axis: str | None
    unit: str
    value: float | None
    standard_uncertainty: float | None
    degrees_of_freedom: float | None
    method: str
    sensitivities: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Published:
    """An angle in deg by the published rule, None where it cannot run."""

    axis: str
    value: float | None


@dataclass(frozen=True)
class Flag:
    """Something that the reader of the results must know; `message` is one sentence."""

    code: str
    message: str
    axis: str | None = None
    details: Mapping[str, object] = field(default_factory=dict)


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

    `chirp` with `chirp_u` is by how much the frequency falls over the decay, relative; `joint` is
    None where every shot was fitted alone, and so is `lean`, that of spins and probe. `rate_per_s`
    and `beta_s` give the decay of a shot as rate + beta w².
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
