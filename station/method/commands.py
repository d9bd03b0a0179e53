"""The commands of the roles: sines and steady fields, ranges, power, sampling.

Here, and nowhere else, a field becomes a current.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

from station.errors import InputError
from station.method.set_points import Bounds, Command, SetPoint, Station
from station.roles import (
    CoilSupply,
    DirectCurrentSupply,
    DutPower,
    Gaussmeter,
    GyroAcquisition,
    Multimeter,
    RotaryStage,
)
from station.units import parse_as

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def coil_current_A(bench: Bench, supply: str, field_mT: float) -> float:
    """Return the current in A that makes a field at a supply's coil, by the bench's constant."""
    constant = str(bench.instruments[supply].settings["coil_constant"])
    return field_mT / parse_as(constant, "mT/A")


@dataclass(frozen=True)
class SineCurrent(Command[float]):
    """A sine of a peak current in a coil; applied, it returns the frequency in Hz that is given."""

    frequency_Hz: float
    amplitude_A: float

    @property
    def assumed(self) -> float:
        """The frequency that is asked for."""
        return self.frequency_Hz

    def words(self, bench: Bench) -> str:
        """Return frequency and peak."""
        return f"sine {self.frequency_Hz:.6g} Hz, {self.amplitude_A:.3g} A"

    def bounds(self, bench: Bench) -> Bounds:
        """Return peak and effective current."""
        return sine_bounds(self.amplitude_A)

    def prepare(self, station: Station) -> float:
        """Load the sine at zero output."""
        return load_sine(station, self.instrument, self.frequency_Hz, self.amplitude_A)

    def apply(self, station: Station, prepared: float | None) -> float:
        """Start it."""
        return start_sine(station, self.instrument, prepared)


@dataclass(frozen=True)
class SineField(Command[float]):
    """A sine of a peak field at a coil; applied, it returns the frequency in Hz that is given."""

    frequency_Hz: float
    amplitude_mT: float

    def current_A(self, bench: Bench) -> float:
        """Return the peak current."""
        return coil_current_A(bench, self.instrument, self.amplitude_mT)

    @property
    def assumed(self) -> float:
        """The frequency that is asked for."""
        return self.frequency_Hz

    def words(self, bench: Bench) -> str:
        """Return frequency, peak current and peak field."""
        current_A = self.current_A(bench)
        return f"sine {self.frequency_Hz:.6g} Hz, {current_A:.3g} A, {self.amplitude_mT:.4g} mT"

    def bounds(self, bench: Bench) -> Bounds:
        """Return field, peak and effective current."""
        return {"field_mT": self.amplitude_mT, **sine_bounds(self.current_A(bench))}

    def prepare(self, station: Station) -> float:
        """Load the sine at zero output."""
        amplitude_A = self.current_A(station.bench)
        return load_sine(station, self.instrument, self.frequency_Hz, amplitude_A)

    def apply(self, station: Station, prepared: float | None) -> float:
        """Start it."""
        return start_sine(station, self.instrument, prepared)


def sine_bounds(amplitude_A: float) -> Bounds:
    """Return peak and effective current of a sine."""
    return {"current_A": amplitude_A, "rms_current_A": amplitude_A / math.sqrt(2.0)}


def load_sine(station: Station, supply: str, frequency_Hz: float, amplitude_A: float) -> float:
    """Prepare a sine at zero output; return the frequency in Hz that the supply gives."""
    return station.role(supply, CoilSupply).load_sine(frequency_Hz, amplitude_A)


def start_sine(station: Station, supply: str, given_Hz: float | None) -> float:
    """Start the sine that was prepared; return its frequency in Hz."""
    if given_Hz is None:
        raise InputError(f"{supply}: a sine is prepared before it is started")
    station.role(supply, CoilSupply).start_sine()
    return given_Hz


@dataclass(frozen=True)
class SteadyField(Command[None]):
    """A steady field at a coil. `rms_mT` is what heats the coil, where fields follow each other."""

    field_mT: float
    rms_mT: float | None = None

    def words(self, bench: Bench) -> str:
        """Return field and current."""
        return self._words(bench, [self.field_mT])

    def bounds(self, bench: Bench) -> Bounds:
        """Return field and current in magnitude, and the effective current."""
        current_A = abs(coil_current_A(bench, self.instrument, self.field_mT))
        bounds: Bounds = {"field_mT": abs(self.field_mT), "current_A": current_A}
        if self.rms_mT is not None:
            bounds["rms_current_A"] = coil_current_A(bench, self.instrument, self.rms_mT)
        return bounds

    def apply(self, station: Station, prepared: None) -> None:
        """Go there within the supply's slew limit."""
        current_A = coil_current_A(station.bench, self.instrument, self.field_mT)
        station.role(self.instrument, DirectCurrentSupply).ramp_to(current_A)

    @classmethod
    def declare(cls, step: str, commands: Sequence[Self], bench: Bench) -> Iterator[SetPoint]:
        """Yield the fields that follow each other at a coil as one, with the largest's bounds."""
        largest = max(commands, key=lambda command: abs(command.field_mT))
        words = largest._words(bench, [command.field_mT for command in commands])
        bounds = largest.bounds(bench)
        yield SetPoint(step, largest.instrument, words, decided_by=largest.decided_by, **bounds)

    def _words(self, bench: Bench, fields_mT: Sequence[float]) -> str:
        current_A = abs(coil_current_A(bench, self.instrument, self.field_mT))
        return f"{', '.join(f'{field_mT:g}' for field_mT in fields_mT)} mT, up to {current_A:.3g} A"


@runtime_checkable
class Stops(Protocol):
    """An instrument that brings its output to zero."""

    def stop(self) -> None:
        """Bring the output to zero within the limits, and off."""
        ...


@dataclass(frozen=True)
class CoilOff(Command[None]):
    """The current of a coil to zero within the slew limit, output off."""

    def words(self, bench: Bench) -> str:
        """Return that it is off."""
        return "0 A, output off"

    def apply(self, station: Station, prepared: None) -> None:
        """Stop the supply."""
        station.role(self.instrument, Stops).stop()


@dataclass(frozen=True)
class FieldRange(Command[None]):
    """The range of a gaussmeter, whose readings begin with it; `along` turns a one-axis probe.

    `reaches_mT` is what several coils make together.
    """

    range_mT: float
    along: str | None = None
    reaches_mT: float | None = None

    def words(self, bench: Bench) -> str:
        """Return the range."""
        text = f"range for {self.range_mT:.4g} mT"
        if self.reaches_mT is None:
            return text
        return f"{text}; the coils together reach {self.reaches_mT:.4g} mT"

    def bounds(self, bench: Bench) -> Bounds:
        """Return what several coils make together."""
        return {} if self.reaches_mT is None else {"field_mT": self.reaches_mT}

    def apply(self, station: Station, prepared: None) -> None:
        """Turn the probe where it is to be turned, choose the range and begin to read."""
        gaussmeter = station.role(self.instrument, Gaussmeter)
        if self.along is not None:
            gaussmeter.turn_to(self.along)
        gaussmeter.start(self.range_mT)


@dataclass(frozen=True)
class Power(Command[None]):
    """The supply of the device under test, on or off."""

    on: bool

    def words(self, bench: Bench) -> str:
        """Return on or off."""
        return "on" if self.on else "off"

    def apply(self, station: Station, prepared: None) -> None:
        """Switch it."""
        power = station.role(self.instrument, DutPower)
        if self.on:
            power.switch_on()
        else:
            power.switch_off()


@dataclass(frozen=True)
class GyroSampling(Command[None]):
    """A gyro's channel, read out every `interval_s`."""

    interval_s: float
    channel: int

    def words(self, bench: Bench) -> str:
        """Return channel and interval."""
        return f"channel {self.channel}, a row every {self.interval_s:g} s"

    def apply(self, station: Station, prepared: None) -> None:
        """Begin to sample."""
        station.role(self.instrument, GyroAcquisition).start(self.interval_s, self.channel)


@dataclass(frozen=True)
class CoilOn(Command[None]):
    """The output of a steady supply on, at zero current: no limit concerns it."""

    def words(self, bench: Bench) -> str:
        """Return that it is on."""
        return "0 A, output on"

    def apply(self, station: Station, prepared: None) -> None:
        """Switch it on."""
        station.role(self.instrument, DirectCurrentSupply).switch_on()


@dataclass(frozen=True)
class MeterRange(Command[float]):
    """Range and integration time of a voltmeter; applied, it returns the range in V."""

    largest_V: float
    nplc: float
    readings: int

    @property
    def assumed(self) -> float:
        """The range that is asked for."""
        return self.largest_V

    def words(self, bench: Bench) -> str:
        """Return how a burst is read."""
        return f"{self.readings} readings of {self.nplc:g} NPLC"

    def apply(self, station: Station, prepared: float | None) -> float:
        """Choose range and integration time."""
        return station.role(self.instrument, Multimeter).configure(self.largest_V, self.nplc)


@dataclass(frozen=True)
class Homing(Command[bool]):
    """A stage looks for its encoder's zero; applied, it returns whether it had to begin to."""

    @property
    def assumed(self) -> bool:
        """That the zero is not known."""
        return True

    def words(self, bench: Bench) -> str:
        """Return that the zero is looked for."""
        return "look for the encoder's zero"

    def apply(self, station: Station, prepared: bool | None) -> bool:
        """Begin, where the zero is not known."""
        stage = station.role(self.instrument, RotaryStage)
        if stage.is_homed():
            return False
        stage.home()
        return True


@dataclass(frozen=True)
class Angle(Command[None]):
    """An angle of a stage; `of` says what is turned to it, such as a plane."""

    angle_deg: float
    of: str

    def words(self, bench: Bench) -> str:
        """Return the angle."""
        return f"{self.of}: turn to {self.angle_deg:g} deg"

    def bounds(self, bench: Bench) -> Bounds:
        """Return the angle."""
        return {"angle_deg": self.angle_deg}

    def apply(self, station: Station, prepared: None) -> None:
        """Begin to turn."""
        station.role(self.instrument, RotaryStage).move_to(self.angle_deg)
