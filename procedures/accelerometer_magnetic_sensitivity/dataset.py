"""What the analysis of an accelerometer takes, whoever recorded it, and what it says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from procedures.common.helmholtz import FieldAtDevice
from procedures.common.places import AtPlaces
from station.findings import Analysis

from .model import Identifiability, Names, accelerations, accelerations_by_angle

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


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
    mounting_rad: float | None = None
    """Standard uncertainty of how the input axis is mounted; None where nobody states it."""
    at_device: FieldAtDevice | None = None
    """How the field was taken to the device from the probe; None where it stays as measured."""
    places: tuple[AtPlaces, ...] = ()
    """What a thermometer with places read, none where there was none."""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time_s)

    @property
    def overloaded(self) -> NDArray[np.bool_]:
        """Rows whose output is no reading, shape (rows,)."""
        return ~np.isfinite(self.output_V) | (np.abs(self.output_V) >= OVERLOAD_V)


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
class AccelerometerAnalysis(Analysis):
    """The whole outcome.

    An estimate is of one coefficient, or of the combination `terms` in its `extra` that its column
    really measures; its sensitivities are derivatives by `field_gain` and `voltage_gain` (relative
    errors), `field_offset_T`, `voltage_offset_V`.
    `covariance` (k, k) is that of the kept coefficients, type A; `residual_V` (rows,) is NaN for
    rows that cannot be judged; `used` marks the rows of the solution. `drift_V` (rows,) is the slow
    part that was taken off, None where there is none. `condition` is that of the scaled design.
    `temperature_lost` says that the thermometer stood still: no temperature of it is used.
    """

    identifiability: Identifiability
    covariance: Array
    nuisances: tuple[Nuisance, ...]
    not_separable: tuple[str, ...]
    left_out: tuple[LeftOut, ...]
    used: Mask
    residual_V: Array
    noise_V: float | None
    lag_one_correlation: float | None
    condition: float | None
    drift_order: int
    path: Path | None
    temperature_lost: bool = False


@dataclass(frozen=True)
class Rows:
    """The usable rows, each array (rows,): encoder angle, measured field, output in V.

    `root_weight` is one over the noise where it is known before anything is solved. `groups` names
    the rows that share an angle or a field.
    """

    time_s: Array
    plane: Names
    theta_rad: Array
    field_T: Array
    commanded_T: Array
    output_V: Array
    temperature_degC: Array | None
    noise_group: NDArray[np.int64] | None
    gravity_g: float = 1.0
    root_weight: Array | None = None
    groups: Mapping[str, Names] = field(default_factory=dict)

    @property
    def slope(self) -> Array:
        """Return the derivative of Ai by the angle, g/rad (rows,)."""
        return accelerations_by_angle(self.plane, self.theta_rad, self.gravity_g)[:, 0]

    def accelerations(self, offset_rad: Array | float = 0.0) -> Array:
        """Return Ai, Ao, Ap in g (rows, 3) at an encoder offset."""
        return accelerations(self.plane, self.theta_rad + offset_rad, self.gravity_g)
