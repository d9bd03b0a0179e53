"""What the analysis of an accelerometer's magnetic sensitivity needs, whoever recorded it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Names = NDArray[np.str_]

OVERLOAD_V = 1e30
"""A voltmeter says 9.9e37 where its range did not suffice; nothing real comes near."""


@dataclass(frozen=True)
class AccelerometerDataset:
    """All measured points, one row each, in the order in which they were measured.

    Every array has shape (rows,). `time_s` rises; `plane` is one of `model.PLANES`; `theta_deg` is
    the encoder's reading and `theta_commanded_deg` the plan's angle; `field_T` is measured, signed,
    along the coil's axis, `field_commanded_T` the plan's; `output_V` is the voltmeter's reading,
    NaN or beyond 1e30 where it was overloaded. `temperature_degC` is None where none was measured.
    `noise_group` numbers rows that share one noise, as the range of the voltmeter decides it; None
    where all share one.
    """

    time_s: Array
    plane: Names
    theta_deg: Array
    theta_commanded_deg: Array
    field_T: Array
    field_commanded_T: Array
    output_V: Array
    temperature_degC: Array | None = None
    noise_group: NDArray[np.int64] | None = None
    evenly_timed: bool = False
    """Whether rows were taken at equal intervals, so that a longer one is a gap."""
    gravity_g: float = 1.0
    """Local gravity in g; 1 where accelerations are in units of the local g."""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time_s)

    @property
    def overloaded(self) -> NDArray[np.bool_]:
        """Rows whose output is no reading, shape (rows,)."""
        return ~np.isfinite(self.output_V) | (np.abs(self.output_V) >= OVERLOAD_V)
