"""Roles that make a field and measure it."""

from __future__ import annotations

from typing import Annotated, ClassVar, Protocol, runtime_checkable

from pydantic import AfterValidator, Field

from station.fields import Unit
from station.roles.base import DriverSettings, Instrument, MadeSafe, SampledSource


def not_zero(value: float) -> float:
    """Return a number; raise ValueError for zero."""
    if value == 0.0:
        raise ValueError("may not be zero; what is commanded is divided by it")
    return value


class CoilSettings(DriverSettings):
    """What a bench file says of the coil at a supply, whatever its model."""

    coil_constant_mT_per_A: Annotated[float, Unit("mT/A"), AfterValidator(not_zero)] = Field(
        description="field at the device over the current"
    )
    coil_resistance_ohm: Annotated[float | None, Unit("ohm")] = Field(
        None, gt=0, description="of coil and cable; limits on voltage and heating need it"
    )
    coil_inductance_mH: Annotated[float | None, Unit("mH")] = Field(
        None, gt=0, description="over the resistance: how long a steady current takes to settle"
    )


@runtime_checkable
class CoilSupply(Instrument, MadeSafe, Protocol):
    """A bipolar current source with a coil at its output."""

    coil_constant_mT_per_A: float

    def programme_limits(self) -> None:
        """Write the bench file's current and voltage limits into the instrument itself."""
        ...

    def load_sine(self, frequency_Hz: float, amplitude_A: float) -> float:
        """Prepare a sine at zero output; return the frequency in Hz that its timing will give."""
        ...

    def start_sine(self) -> None:
        """Let the prepared sine run until it is stopped."""
        ...

    def stop(self) -> None:
        """Bring the current to zero within the slew limit, output off."""
        ...

    def current_A(self) -> float:
        """Return the measured output current in A."""
        ...


@runtime_checkable
class DirectCurrentSupply(Instrument, MadeSafe, Protocol):
    """A bipolar current source that holds a steady current in its coil."""

    coil_constant_mT_per_A: float

    def programme_limits(self) -> None:
        """Write the bench file's current and voltage limits into the instrument itself."""
        ...

    def switch_on(self) -> None:
        """Switch the output on at zero current."""
        ...

    def ramp_to(self, current_A: float) -> None:
        """Go to a current of either sign within the slew limit; return once it reads back."""
        ...

    def stop(self) -> None:
        """Bring the current to zero within the slew limit, output off."""
        ...

    def current_A(self) -> float:
        """Return the measured output current in A."""
        ...


@runtime_checkable
class Gaussmeter(SampledSource, Protocol):
    """A field meter; columns `instrument_time_s`, `x_T`, `y_T`, `z_T`, NaN what it cannot see."""

    axes: ClassVar[int]
    """How many components of the field it measures at once: 3, or 1 along which its probe is."""

    keeps_readings: ClassVar[bool]
    """Whether readings wait in it until they are drained; else each look brings the newest one."""

    averaging_s: float
    timestamp: str
    """Which instant of the averaging its time stamp means: interval-start, -middle, -end; or
    on-request: the stamp is when the newest average was asked for, which had ended since."""

    def turn_to(self, axis: str) -> None:
        """Measure along `axis` (x, y, z) from now on; returns once the probe stands so."""
        ...

    def start(self, largest_field_mT: float) -> None:
        """Choose the range, begin to buffer readings, and forget older ones."""
        ...
