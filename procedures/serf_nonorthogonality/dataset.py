"""What the analysis of coil angles needs, whoever recorded it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .shots import AXES
from .spins import GAMMA_HZ_PER_NT

Array = NDArray[np.float64]


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
class SerfDataset:
    """All shots of a calibration with what was commanded and what the cell is.

    `constants_known`: commanded fields are exact; otherwise each coil has a factor. `mains_Hz`:
    frequency of the pick-up, None where there is none. `repeated`: names of shots that were taken
    again, with the reason of each. `start_u_s`: standard uncertainty of each record's time zero.
    `coil_u`: relative standard uncertainties of the coil constants; None where nobody states them.
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
