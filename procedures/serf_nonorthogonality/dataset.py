"""What the analysis of coil angles takes, whoever recorded it, and what it says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis

from .angles import NAMES, Solution
from .joint import JointFit
from .shots import AXES, GAMMA_HZ_PER_NT
from .spin_motion import Lean
from .tone import ToneFit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ANGLE, RESIDUAL = "nonorthogonality_angle", "residual_field"
FACTOR, SLOWING_DOWN = "coil_factor", "slowing_down_factor"
WEIGHTED, JOINT, LAW_OF_COSINES = "weighted", "joint-chirp", "law-of-cosines"
MODULATION = "modulation"


@dataclass(frozen=True)
class Shot:
    """One free precession: the commanded field along the coils x, y, z, and what was seen of it.

    `field_nT` (3,), `time_s` (n,) rising, zero where field on and pump light off, `voltage_V` (n,)
    the detector's voltage. `full_scale_V`: where the recorder ends; None where nobody knows.
    """

    name: str
    field_nT: Array
    time_s: Array
    voltage_V: Array
    full_scale_V: float | None = None

    @property
    def axes(self) -> str:
        """The coils that are driven: `x`, `yz` and so on."""
        return "".join(
            axis for axis, field in zip(AXES, self.field_nT, strict=True) if field != 0.0
        )


@dataclass(frozen=True)
class CellTemperature:
    """What the cell's sensor read right before each shot, in degC, corrected by its record.

    `u_K` is the standard uncertainty of the record, None where none is stated; the plan wanted
    `wanted_degC` within `within_K`.
    """

    seen_degC: tuple[float, ...]
    u_K: float | None
    wanted_degC: float
    within_K: float


@dataclass(frozen=True)
class SerfDataset:
    """All shots of a calibration with what was commanded and what the cell is.

    `constants_known`: commanded fields are exact; otherwise each coil has a factor. `mains_Hz`:
    frequency of the pick-up, None where there is none. `repeated`: names of shots that were taken
    again, with the reason of each. `start_u_s`: standard uncertainty of each record's time zero.
    `coil_u`: relative standard uncertainties of the coil constants; None where nobody states them.
    `modulated_nT`: the residual field by coil that tones told right before the shots, if any.
    `cell`: its temperature where its heater was driven.
    """

    shots: Sequence[Shot]
    pump_axis: str
    probe_axis: str
    nuclear_spin: float
    constants_known: bool
    sample_rate_Hz: float
    gamma_Hz_per_nT: float = GAMMA_HZ_PER_NT
    mains_Hz: float | None = None
    repeated: Sequence[tuple[str, str]] = ()
    start_u_s: float = 0.0
    coil_u: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    modulated_nT: Mapping[str, float] = field(default_factory=dict)
    cell: CellTemperature | None = None

    @property
    def gamma_rad_per_s_nT(self) -> float:
        """The gyromagnetic ratio as an angular one."""
        return 2.0 * float(np.pi) * self.gamma_Hz_per_nT

    def __len__(self) -> int:
        """Return the number of shots."""
        return len(self.shots)

    @property
    def commanded_nT(self) -> Array:
        """The commanded fields, shape (shots, 3)."""
        return np.array([shot.field_nT for shot in self.shots], dtype=np.float64).reshape(-1, 3)


@dataclass(frozen=True)
class Precession:
    """A shot, its fit or None, how many samples were saturated, and why it is not to be used.

    `usable` (n,) marks the samples that are neither saturated nor too early.
    """

    shot: Shot
    fit: ToneFit | None
    saturated: int
    rejected: str | None
    usable: Mask

    @property
    def name(self) -> str:
        """The name of the shot."""
        return self.shot.name

    @property
    def used(self) -> bool:
        """Whether the shot can be used."""
        return self.rejected is None and self.fit is not None

    @property
    def used_fit(self) -> ToneFit:
        """The fit of a shot that has one."""
        if self.fit is None:
            raise ValueError(f"{self.name} has no fit")
        return self.fit


@dataclass(frozen=True)
class Frequencies:
    """What all usable shots give: frequencies (n,) freed from the pull of spin exchange.

    `used` are these shots, `covariance` is (n, n); `chirp` is the relative fall over the decay with
    its u, `rate_per_s` and `beta_s` give the decay of a shot as rate + beta w². `joint` and `lean`,
    that of the spins and the probe, are None where every shot was fitted alone. `kept` and
    `residual_V` are by shot: which samples were used, and what is left of these. `drift_per_s` is a
    steady drift of all frequencies, relative, beside a chirp; `fading` by how much the last tone
    fades faster than the first, relative, beside its broadening; `exchanged` tells that the shots
    fit pump and probe light much better the other way round. `failed` says why a joint fit was
    wanted but is not there.
    """

    used: tuple[Precession, ...]
    omega_rad_per_s: Array
    covariance: Array
    solution: Solution
    chirp: tuple[float, float]
    rate_per_s: float
    beta_s: float
    kept: tuple[Mask, ...]
    residual_V: tuple[Array, ...]
    drift_per_s: tuple[float, float]
    fading: tuple[float, float]
    joint: JointFit | None = None
    lean: Lean | None = None
    exchanged: bool = False
    failed: str | None = None

    @property
    def commanded_nT(self) -> Array:
        """The commanded fields of the used shots, shape (n, 3)."""
        return np.array([precession.shot.field_nT for precession in self.used])


@dataclass(frozen=True)
class ShotResult(Precession):
    """A shot with its fit and what became of it.

    `omega_rad_per_s` with `omega_u` is what goes into the solution, NaN where nothing does, freed
    from the pull of spin exchange; `field_nT` what it says of the field; `misfit` by how much it is
    more than the solution's, over its u. `kept` (n,) marks the samples that were used, `residual_V`
    is what the final fit leaves of these.
    """

    kept: Mask
    residual_V: Array
    omega_rad_per_s: float = np.nan
    omega_u: float = np.nan
    field_nT: float = np.nan
    misfit: float = np.nan


@dataclass(frozen=True)
class Check:
    """A test of the result against something it should agree with: passed, failed or not made."""

    what: str
    value: str
    wanted: str
    passed: bool | None


@dataclass(frozen=True)
class SerfAnalysis(Analysis):
    """The whole outcome; `frequencies` is None where no shot can be used.

    Sensitivities of the estimates are derivatives by `coil_x`, `coil_y`, `coil_z`,
    `gyromagnetic_ratio`, `sample_clock` (relative errors), `residual_x_nT` and so on, and
    `trigger_delay_s`.
    """

    shots: tuple[ShotResult, ...]
    frequencies: Frequencies | None
    checks: tuple[Check, ...]
    residual_field_nT: float | None
    """Magnitude, None where it is not determined."""


def scale_axis(dataset: SerfDataset, solution: Solution) -> str | None:
    """Return the coil whose factor is one by convention, None where no factor is determined.

    That of the first shot with a single coil; where its factor is not determined, or there is no
    such shot, the first that is.
    """
    single = [shot.axes for shot in dataset.shots if len(shot.axes) == 1]
    for axis in [*single, *AXES]:
        if solution.determined[NAMES.index(axis)]:
            return axis
    return None
