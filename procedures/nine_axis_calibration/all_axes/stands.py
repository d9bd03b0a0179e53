"""What the other six axes are calibrated by: stands at rest and turns, each with what points up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from procedures.common.helmholtz import FieldAtDevice, carried
from procedures.nine_axis_calibration.dataset import TurnRecord
from procedures.nine_axis_calibration.directions import up_of

Array = NDArray[np.float64]
FORCE, FIELD = "acceleration_g", "field_nT"
"""The samples of accelerometers and magnetometer in a stand or a record of turns."""


def direction(word: str) -> Array | None:
    """Return the unit vector (3,) in sensor axes of `X`, `-X`, `X+Y`, `-X-Y-Z`; None for others."""
    up = up_of(word)
    return None if up is None else np.array(up)


def plane_across(up: Array, near: Array | None = None) -> Array:
    """Return two unit vectors (2, 3) across `up`; of all directions near one in the same sense."""
    apart = int(np.argmin(np.abs(up if near is None else near)))
    first = np.cross(up, np.eye(3)[apart])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first)])


@dataclass(frozen=True)
class Rest:
    """A stand at rest: `up` (3,) nominal, samples (n, 3); `u_rad` is how well `up` is known.

    `field_nT` is None where no magnetometer was recorded. `name` is that of people.
    """

    name: str
    up: Array
    u_rad: float
    time_s: Array
    acceleration_g: Array
    field_nT: Array | None


@dataclass(frozen=True)
class Turned:
    """A record of turns: `turn` has the gyros and the encoder, samples (n, 3) of the others."""

    turn: TurnRecord
    acceleration_g: Array | None
    field_nT: Array | None


Record = TypeVar("Record", Rest, Turned)


@dataclass(frozen=True)
class Mounted:
    """One mounting on the table, `up` (3,) nominal along its axis, known to `u_rad`."""

    name: str
    up: Array
    u_rad: float
    records: tuple[Turned, ...]


@dataclass(frozen=True)
class CoilRecord:
    """Fields (n, 3) in nT as the gaussmeter reads them, and the magnetometer's output (n, 3).

    `commanded_nT` (n, 3) is what the coils were to add to the ambient field; None where that is not
    known. `reading` is what states gain and zero, where that is not what states the rest. Where
    `at_device` says how the coils' field at the sensor follows from that at the probe, `applied_nT`
    is that at the sensor.
    """

    applied_nT: Array
    output_nT: Array
    gain_u: float
    zero_u_nT: float
    alignment_u_rad: float
    commanded_nT: Array | None = None
    reading: str = ""
    at_device: FieldAtDevice | None = None

    @property
    def ambient_nT(self) -> Array:
        """The field (3,) that is there without the coils: the mean while all are at zero."""
        known = np.isfinite(self.applied_nT).all(axis=1)
        driven = self.commanded_nT.any(axis=1) if self.commanded_nT is not None else ~known
        off = known & ~driven
        return np.asarray(self.applied_nT[off if off.any() else known].mean(axis=0))

    def carried(self, matrix: Array) -> CoilRecord:
        """Return the record with the coils' part of its fields by a matrix (3, 3).

        The ambient field is uniform: it is the same at the probe and at the sensor.
        """
        ambient_nT = self.ambient_nT
        moved_nT = carried(self.applied_nT - ambient_nT, matrix)
        return replace(self, applied_nT=ambient_nT + moved_nT)


@dataclass(frozen=True)
class OtherAxes:
    """All stands and mountings, and what is known of gravity and of the earth's field there.

    Gravity in the accelerometers' g. Field in nT and its inclination, positive down, in rad; None
    where they are not known. `second_order_u` is the prior of the accelerometers' second order, in
    g/g^2. The table's axis is upright within `tilt_rad`. `source` is where all that is stated.
    """

    rests: tuple[Rest, ...]
    mountings: tuple[Mounted, ...]
    latitude_deg: float
    tilt_rad: float
    gravity_g: float = 1.0
    gravity_u_g: float = 0.0
    field_nT: float | None = None
    field_u_nT: float = 0.0
    inclination_rad: float | None = None
    inclination_u_rad: float = 0.0
    second_order_u: float = 0.0
    coil: CoilRecord | None = None
    source: str = "the dataset's conditions"

    def records(self, what: str) -> list[tuple[str, bool, Array]]:
        """Return name, whether it turned, samples (n, 3) of each record of a sensor."""
        every = [(rest.name, False, getattr(rest, what)) for rest in self.rests]
        for mounting in self.mountings:
            every += [(mounting.name, True, getattr(record, what)) for record in mounting.records]
        return [record for record in every if record[2] is not None]

    def with_records(self, what: str, samples: Sequence[Array]) -> OtherAxes:
        """Return the data with other samples in the place of those of `records`."""
        fresh = iter(samples)

        def changed(record: Record) -> Record:
            if getattr(record, what) is None:
                return record
            new: dict[str, Any] = {what: next(fresh)}
            return replace(record, **new)

        rests = tuple(map(changed, self.rests))
        mountings = tuple(
            replace(mounting, records=tuple(map(changed, mounting.records)))
            for mounting in self.mountings
        )
        return replace(self, rests=rests, mountings=mountings)
