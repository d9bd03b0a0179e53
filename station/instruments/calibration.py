"""The calibration record of an instrument: what its certificate says, and what follows from it."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Annotated, TypeVar

from pydantic import Field, ValidationInfo, field_serializer, field_validator

from station.errors import InputError
from station.fields import AnyQuantity, StrictModel, Unit
from station.files.faults import listed, nearest
from station.units import UnitError, convert, dimension_of, format_quantity, parse_as

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Number = TypeVar("Number", float, "NDArray[np.float64]")

UNIT_OF_QUANTITY = {
    "field": "mT",
    "current": "A",
    "voltage": "V",
    "resistance": "ohm",
    "frequency": "Hz",
    "time": "s",
    "time_offset": "s",
    "angle": "deg",
    "graduation": "deg",
    "rate": "deg/s",
    "temperature": "degC",
    "acceleration": "g",
    "coil_constant": "mT/A",
    "pulse_weight": "arcsec",
    "scale": "1",
}
"""What a certificate may speak of, and the unit in which it is kept."""

Ratio = Annotated[float, Unit("1"), Field(ge=0, le=1)]
LARGEST_COVERAGE = 250.0
"""That of 99.73 % at one degree of freedom is 235.8 (GUM, table G.2); more is a slip."""
QuantityName = Annotated[str, Field(json_schema_extra={"enum": [*UNIT_OF_QUANTITY]})]


class NotCalibrated(InputError):
    """A value for which the calibration record states no uncertainty."""


def _known_quantity(name: str) -> str:
    if name not in UNIT_OF_QUANTITY:
        hint = nearest(name, UNIT_OF_QUANTITY)
        what = f"'{name}' is not known" + (
            "" if hint else f"; known are {listed(UNIT_OF_QUANTITY)}"
        )
        raise UnitError(what, hint and f"'{hint}'")
    return name


def _in_its_unit(value: object, info: ValidationInfo, *, difference: bool) -> object:
    """Read a value in the unit of the entry's `quantity`."""
    quantity = info.data.get("quantity")
    if value is None or quantity is None:
        return None
    return parse_as(value, UNIT_OF_QUANTITY[quantity], difference=difference)


class UncertaintyEntry(StrictModel):
    """An uncertainty over a range, as on a certificate: `relative` of the reading + `absolute`.

    `coverage_factor` is the k by which the stated uncertainty is larger than a standard one; for
    a specification without one, limits of a uniform distribution, it is 1.732.
    """

    quantity: QuantityName
    lower: float | None = Field(default=None, alias="from")
    up_to: float | None = None
    relative: Ratio = 0.0
    absolute: float = Field(default=0.0, ge=0)
    coverage_factor: float = Field(ge=1, le=LARGEST_COVERAGE)

    known_quantity = field_validator("quantity")(_known_quantity)

    @field_validator("lower", "up_to", mode="before", json_schema_input_type=AnyQuantity | None)
    @classmethod
    def read_bound(cls, value: object, info: ValidationInfo) -> object:
        """Read the end of a range."""
        return _in_its_unit(value, info, difference=False)

    @field_validator("up_to")
    @classmethod
    def range_is_not_empty(cls, up_to: float | None, info: ValidationInfo) -> float | None:
        """Refuse a range that ends before it begins."""
        lower = info.data.get("lower")
        if up_to is not None and up_to <= 0 and info.data.get("quantity") != "temperature":
            raise ValueError("must be above zero: ranges are of the magnitude")
        if up_to is not None and lower is not None and up_to <= lower:
            raise ValueError("the range ends before it begins; exchange from and up_to")
        return up_to

    @field_validator("absolute", mode="before", json_schema_input_type=AnyQuantity)
    @classmethod
    def read_absolute(cls, value: object, info: ValidationInfo) -> object:
        """Read the part that does not grow with the reading."""
        read = _in_its_unit(value, info, difference=True)
        return 0.0 if read is None else read

    @field_validator("coverage_factor")
    @classmethod
    def states_something(cls, coverage_factor: float, info: ValidationInfo) -> float:
        """Refuse an entry that states no uncertainty at all."""
        if info.data.get("relative") == 0.0 and info.data.get("absolute") == 0.0:
            raise ValueError("the entry states no uncertainty; give relative, absolute, or both")
        return coverage_factor

    @field_serializer("lower", "up_to", "absolute", when_used="json")
    def with_unit(self, value: float | None) -> str | float | None:
        """Write a value with the unit of its quantity."""
        unit = UNIT_OF_QUANTITY[self.quantity]
        return value if value is None or unit == "1" else format_quantity(value, unit)

    def covers(self, value: float) -> bool:
        """Tell whether a value in the quantity's unit lies in the range.

        Ranges are of the magnitude, except those of a temperature.
        """
        shown = value if self.quantity == "temperature" else abs(value)
        above = self.lower is None or shown >= self.lower
        return above and (self.up_to is None or shown <= self.up_to)


class CorrectionEntry(StrictModel):
    """A known deviation: true value = `gain` x reading + `offset`."""

    quantity: QuantityName
    gain: float = Field(default=1.0, ge=1e-3, le=1e3)
    offset: float = 0.0

    known_quantity = field_validator("quantity")(_known_quantity)

    @field_validator("offset", mode="before", json_schema_input_type=AnyQuantity)
    @classmethod
    def read_offset(cls, value: object, info: ValidationInfo) -> object:
        """Read the part that does not grow with the reading."""
        read = _in_its_unit(value, info, difference=True)
        return 0.0 if read is None else read

    @field_serializer("offset", when_used="json")
    def with_unit(self, value: float) -> str | float:
        """Write the offset with the unit of its quantity."""
        unit = UNIT_OF_QUANTITY[self.quantity]
        return value if unit == "1" else format_quantity(value, unit)


class Calibration(StrictModel):
    """What is known of an instrument's errors, from its certificate or its specification."""

    certificate: str | None = None
    calibrated_by: str | None = None
    date: dt.date | None = None
    due: dt.date
    uncertainty: tuple[UncertaintyEntry, ...] = ()
    corrections: tuple[CorrectionEntry, ...] = ()
    notes: str | None = None

    @field_validator("due")
    @classmethod
    def due_after_calibration(cls, due: dt.date, info: ValidationInfo) -> dt.date:
        """Refuse a calibration that was due before it was made."""
        made = info.data.get("date")
        if made is not None and due <= made:
            raise ValueError(f"is not after the date of the calibration, {made}")
        return due

    @field_validator("corrections")
    @classmethod
    def one_for_each_quantity(
        cls, corrections: tuple[CorrectionEntry, ...]
    ) -> tuple[CorrectionEntry, ...]:
        """Refuse two corrections of the same quantity: which of them would hold?"""
        names = [entry.quantity for entry in corrections]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"two corrections of {twice[0]}; combine them into one")
        return corrections

    @property
    def source(self) -> str:
        """What an uncertainty budget names as the source of its numbers."""
        made = f" of {self.date}" if self.date else ""
        if self.certificate:
            return f"certificate {self.certificate}{made}"
        return f"calibration record{made}, due {self.due}"

    def overdue(self, on: dt.date) -> bool:
        """Tell whether the calibration has run out on a day; on the due date it still holds."""
        return on > self.due

    def covers(self, quantity: str, value: float, unit: str) -> bool:
        """Tell whether an uncertainty is stated for a value."""
        return self._entry(quantity, convert(value, unit, UNIT_OF_QUANTITY[quantity])) is not None

    def standard_uncertainty(self, quantity: str, value: float, unit: str) -> float:
        """Return the type B standard uncertainty of a value, in its unit.

        The relative part and the absolute part are added, as certificates and data sheets mean
        them, and divided by the coverage factor (GUM 4.3.3). The first entry of the record whose
        range holds the value counts. Raises NotCalibrated where no entry does.
        """
        own = UNIT_OF_QUANTITY[quantity]
        reading = convert(value, unit, own)
        entry = self._entry(quantity, reading)
        if entry is None:
            stated = [entry for entry in self.uncertainty if entry.quantity == quantity]
            reach = [format_quantity(e.up_to, own) for e in stated if e.up_to is not None]
            tail = f", only up to {reach[-1]}" if reach else ""
            raise NotCalibrated(
                f"{self.source}: states no uncertainty of {quantity} at "
                f"{format_quantity(value, unit)}{tail}; add an entry to `uncertainty`"
            )
        stated_uncertainty = entry.relative * abs(reading) + entry.absolute
        return convert(stated_uncertainty / entry.coverage_factor, own, unit, difference=True)

    def corrected(self, quantity: str, value: Number, unit: str) -> Number:
        """Return readings with the correction of their quantity applied, in the same unit.

        Unchanged where the record has none. A number or an array of any shape.
        """
        for entry in self.corrections:
            if entry.quantity == quantity:
                own = UNIT_OF_QUANTITY[quantity]
                if dimension_of(own) == "temperature" and unit != own:
                    raise ValueError(f"temperatures are corrected in {own}")
                offset = convert(entry.offset, own, unit, difference=True)
                corrected: Number = value * entry.gain + offset
                return corrected
        return value

    def _entry(self, quantity: str, value: float) -> UncertaintyEntry | None:
        for entry in self.uncertainty:
            if entry.quantity == quantity and entry.covers(value):
                return entry
        return None
