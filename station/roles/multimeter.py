"""Meters that take a burst of readings: a voltmeter, and a thermometer at the device."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar, Protocol, runtime_checkable

from station.roles.base import Block, Instrument
from station.roles.role import TEMPERATURE, Quantity, Role


@runtime_checkable
class Multimeter(Instrument, Protocol):
    """A voltmeter that takes a burst of readings on its own trigger; column `voltage_V`.

    A reading beyond the range is kept as the instrument says it (±9.9e37 V), with `overload` 1.
    """

    source: str
    columns: Mapping[str, str]
    integration_cycles: ClassVar[tuple[float, ...]]
    """The integration times that it can do, in power-line cycles."""
    highest_V: ClassVar[float]
    most_readings: ClassVar[int]
    """In one burst."""

    def configure(self, largest_V: float, nplc: float) -> float:
        """Choose range and integration time in power-line cycles; return the range in V."""
        ...

    def start(self, readings: int) -> None:
        """Begin a burst of readings; returns at once."""
        ...

    def fetch(self) -> Block | None:
        """Return the burst that was started, None while it is being taken."""
        ...


DEVICE = "device"
"""The place of a thermometer whose temperature is that of the device under test."""
RESISTANCE, TEMPERATURE_READ = "resistance_ohm", "temperature_degC"


def place_columns(place: str) -> tuple[str, str]:
    """Return the columns of resistance and temperature of a place: those of `device` have no name.

    So whoever reads the temperature of the device reads it of a thermometer with places, too.
    """
    before = "" if place == DEVICE else f"{place}_"
    return before + RESISTANCE, before + TEMPERATURE_READ


def places_in(columns: Iterable[str]) -> dict[str, str]:
    """Return the places whose temperatures are among some columns, each with its column."""
    named = (name for name in columns if name.endswith(TEMPERATURE_READ))
    return {name.removesuffix(TEMPERATURE_READ).rstrip("_") or DEVICE: name for name in named}


def is_at_device(place: str) -> bool:
    """Whether a place is at the device under test: `device`, `device_far`."""
    return place.split("_")[0] == DEVICE


@runtime_checkable
class Thermometer(Instrument, Protocol):
    """A thermometer at the device under test; columns `resistance_ohm`, `temperature_degC`.

    A model that reads several places in each reading has columns of the others beside these, such
    as `device_far_resistance_ohm` and `device_far_temperature_degC` (`place_columns`).
    """

    source: str
    columns: Mapping[str, str]

    def start(self, readings: int) -> None:
        """Begin a burst of readings; returns at once."""
        ...

    def fetch(self) -> Block | None:
        """Return the burst that was started, None while it is being taken."""
        ...


MULTIMETER = Role(
    "multimeter",
    Multimeter,
    quantities={"voltage": Quantity("V", magnitude=True)},
    reads_device=True,
)
THERMOMETER = Role("thermometer", Thermometer, quantities={"temperature": TEMPERATURE})
