"""The conditions of the room that a person reads from an instrument and types."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from typing import Annotated, NamedTuple

from pydantic import Field

from station.fields import StrictModel, Unit

Words = Annotated[str, Field(min_length=1)]


class RoomReading(StrictModel):
    """What reads a condition of the room, and the certificate of that."""

    instrument: Words
    certificate: Words
    due: dt.date


class RoomTemperature(RoomReading):
    """The temperature of the room; a run asks for it where the value is left out."""

    value_degC: Annotated[float, Unit("degC"), Field(ge=-40, le=60)] | None = None
    uncertainty_degC: Annotated[float, Unit("degC", True), Field(gt=0, le=10)]


class RoomHumidity(RoomReading):
    """The relative humidity of the room; a run asks for it where the value is left out."""

    value_percent: Annotated[float, Unit("%"), Field(ge=0, le=100)] | None = None
    uncertainty_percent: Annotated[float, Unit("%"), Field(gt=0, le=50)]


class RoomPressure(RoomReading):
    """The air pressure in the room; a run asks for it where the value is left out."""

    value_hPa: Annotated[float, Unit("hPa"), Field(ge=300, le=1100)] | None = None
    uncertainty_hPa: Annotated[float, Unit("hPa"), Field(gt=0, le=100)]


class Condition(NamedTuple):
    """A condition of the room: its name, unit and bounds, value and standard uncertainty."""

    name: str
    unit: str
    low: float
    high: float
    value: float | None
    uncertainty: float
    read: RoomReading

    @property
    def prompt_id(self) -> str:
        """The id of the prompt that asks for its value."""
        return f"room.{self.name.split()[-1]}"


class Room(StrictModel):
    """The conditions of the room; `uncertainty` is a standard one."""

    temperature: RoomTemperature | None = None
    humidity: RoomHumidity | None = None
    pressure: RoomPressure | None = None

    def conditions(self) -> Iterator[Condition]:
        """Yield each condition that is stated, or asked for."""
        if (t := self.temperature) is not None:
            yield Condition("temperature", "degC", -40, 60, t.value_degC, t.uncertainty_degC, t)
        if (h := self.humidity) is not None:
            yield Condition(
                "relative humidity", "%", 0, 100, h.value_percent, h.uncertainty_percent, h
            )
        if (p := self.pressure) is not None:
            yield Condition("air pressure", "hPa", 300, 1100, p.value_hPa, p.uncertainty_hPa, p)
