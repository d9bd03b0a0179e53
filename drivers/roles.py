"""What a procedure may ask of an instrument: Protocols of a few verbs, whatever the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from station.clock import Clock

Tracer = Callable[[str, bytes], None]
"""Takes a direction (`>` sent, `<` received, `!` fault, `-` remark) and the bytes or the words."""


class Place(Protocol):
    """Where an instrument is attached, and what the bench file says of it."""

    @property
    def name(self) -> str:
        """The instance name of the bench file, `coil_supply.x`."""
        ...

    @property
    def address(self) -> str:
        """A VISA resource name, `socketcand://host:port/channel`, or empty without a line."""
        ...

    @property
    def clock(self) -> Clock:
        """The run's clock; whatever waits or stamps uses it."""
        ...

    @property
    def settings(self) -> Mapping[str, Any]:
        """The driver's own settings, quantities as text: `2 A/s`."""
        ...

    @property
    def limits(self) -> Mapping[str, float]:
        """The bench's limits in A, V, A/s, mT, deg/s, degC."""
        ...

    def publish(self, quantity: str, value: float | str, unit: str = "") -> None:
        """Put up a reading, or the word of a state, for interlocks and panel."""
        ...

    @property
    def trace(self) -> Tracer | None:
        """Who is told what goes over the wire; None where nobody listens, as in most runs."""
        ...

    def ask(self, prompt_id: str, text: str) -> str:
        """Put a request to the operator and return the answer."""
        ...


@dataclass(frozen=True)
class Identity:
    """Who answered: maker, model, serial number and firmware, as the instrument says them."""

    maker: str
    model: str
    serial: str
    firmware: str


@dataclass(frozen=True)
class Block:
    """Rows of a stream in the instrument's own units and time base.

    `columns` maps names that carry their unit to arrays of shape (rows,); `arrival_time_s` is the
    run time, shape (rows,), at which each row reached the computer.
    """

    columns: Mapping[str, NDArray[Any]]
    arrival_time_s: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.arrival_time_s)


@dataclass(frozen=True)
class SafetyReading:
    """What an instrument reads back of its safe state."""

    safe: bool
    read_back: str


@runtime_checkable
class Instrument(Protocol):
    """Anything with a line, or an operator, at its other end."""

    place: Place

    def identify(self) -> Identity:
        """Ask who is there."""
        ...

    def close(self) -> None:
        """Give the line back; never raises for a line that is already gone."""
        ...


@runtime_checkable
class MadeSafe(Protocol):
    """An instrument that can harm, and how it is brought to rest."""

    def make_safe(self, deadline_s: float) -> None:
        """Bring the instrument to rest before run time `deadline_s`."""
        ...

    def read_safety(self) -> SafetyReading:
        """Read back whether it is at rest; nothing is assumed from what was commanded."""
        ...


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
class SampledSource(Instrument, Protocol):
    """A source of samples that number or stamp themselves."""

    source: str
    """The name of its raw files."""

    columns: Mapping[str, str]
    """Column name to unit and meaning, for whoever opens the raw file.

    The text begins with the unit. A running number of equal intervals says how far they are apart,
    as in `1, number of the sample, every 0.1 s`: exports make its time axis of that.
    """

    def drain(self) -> Block:
        """Return all rows that came since the last call, possibly none."""
        ...


@runtime_checkable
class Gaussmeter(SampledSource, Protocol):
    """A three-axis field meter; columns `instrument_time_s`, `x_T`, `y_T`, `z_T`."""

    averaging_s: float
    timestamp: str
    """Which instant of the averaging its time stamp means: interval-start, -middle, -end."""

    def start(self, largest_field_mT: float) -> None:
        """Choose the range, begin to buffer readings, and forget older ones."""
        ...


@runtime_checkable
class GyroAcquisition(SampledSource, Protocol):
    """A pulse counter of laser gyros; columns `sequence`, `counts`, `temperature_degC`."""

    def start(self, sample_interval_s: float, channel: int) -> None:
        """Begin to sample `channel` every `sample_interval_s`."""
        ...

    def stop(self) -> None:
        """End the sampling."""
        ...


@runtime_checkable
class Multimeter(Instrument, Protocol):
    """A voltmeter that takes a burst of readings on its own trigger; column `voltage_V`.

    A reading beyond the range is kept as the instrument says it (±9.9e37 V), with `overload` 1.
    """

    source: str
    columns: Mapping[str, str]

    def configure(self, largest_V: float, nplc: float) -> float:
        """Choose range and integration time in power-line cycles; return the range in V."""
        ...

    def start(self, readings: int) -> None:
        """Begin a burst of readings; returns at once."""
        ...

    def fetch(self) -> Block | None:
        """Return the burst that was started, None while it is being taken."""
        ...


@runtime_checkable
class Thermometer(Instrument, Protocol):
    """A thermometer at the device under test; columns `resistance_ohm`, `temperature_degC`."""

    source: str
    columns: Mapping[str, str]

    def start(self, readings: int) -> None:
        """Begin a burst of readings; returns at once."""
        ...

    def fetch(self) -> Block | None:
        """Return the burst that was started, None while it is being taken."""
        ...


@runtime_checkable
class RotaryStage(Instrument, MadeSafe, Protocol):
    """A single-axis table that goes to angles against its own encoder."""

    def programme_limits(self) -> None:
        """Write the bench file's rate and angle limits into the instrument itself."""
        ...

    def is_homed(self) -> bool:
        """Whether the encoder's zero has been found since the stage was switched on."""
        ...

    def home(self) -> None:
        """Begin to look for the encoder's zero; `is_moving` tells when it is found."""
        ...

    def move_to(self, angle_deg: float) -> None:
        """Begin to turn to an absolute angle; returns at once."""
        ...

    def is_moving(self) -> bool:
        """Whether the stage still turns; raises InstrumentError for a fault of the axis."""
        ...

    def angle_deg(self) -> float:
        """Return the encoder's angle in deg."""
        ...


@runtime_checkable
class SignalGenerator(Instrument, MadeSafe, Protocol):
    """Two channels, 1 and 2, each a voltage at a coil: held, or for one step after a trigger."""

    def programme_limits(self) -> None:
        """Write the bench file's voltage limits into the instrument and check its load setting."""
        ...

    def hold(self, channel: int, voltage_V: float) -> None:
        """Put a steady voltage on a channel, at once, output on."""
        ...

    def prepare_step(self, channel: int, voltage_V: float, duration_s: float) -> None:
        """Arm a step from what the channel holds by `voltage_V`, and back after `duration_s`.

        It begins at the external trigger that starts all armed channels of the bench together.
        """
        ...

    def disarm(self, channel: int) -> None:
        """Take an armed step back; the channel holds what it held."""
        ...

    def switch_off(self, channel: int) -> None:
        """Switch a channel's output off."""
        ...


@runtime_checkable
class Digitizer(Instrument, MadeSafe, Protocol):
    """A recorder of one signal about a trigger that it gives itself; columns `time_s`, `voltage_V`.

    `time_s` is zero at the trigger. At rest its trigger output is off.
    """

    source: str
    columns: Mapping[str, str]

    def prepare(self, sample_rate_Hz: float, duration_s: float, full_scale_V: float) -> float:
        """Choose decimation and range, clear the last record; return the sample rate in Hz."""
        ...

    def fire(self) -> None:
        """Give the trigger: time zero of the record, and of what is wired to the output."""
        ...

    def fetch(self) -> Block | None:
        """Return the record that was fired, None while it is being taken."""
        ...

    def release(self) -> None:
        """Take the trigger output back to rest."""
        ...


@runtime_checkable
class PumpLaser(Instrument, MadeSafe, Protocol):
    """The shutter of the pump light: closed is safe."""

    def open_shutter(self) -> None:
        """Let the light through, and prove it."""
        ...

    def close_shutter(self) -> None:
        """Block the light, and prove it."""
        ...

    def follow_trigger(self) -> None:
        """Let the light through until the bench's trigger, and again when the trigger goes off."""
        ...

    def is_open(self) -> bool:
        """Whether the light passes."""
        ...


@runtime_checkable
class InterlockChain(Instrument, Protocol):
    """The hard-wired chain of emergency stops, doors and limit switches, as it can be read."""

    def is_closed(self) -> bool:
        """Whether the chain is closed, so that the bench may be energised."""
        ...


@runtime_checkable
class DutPower(Instrument, Protocol):
    """The supply of the device under test."""

    def switch_on(self) -> None:
        """Switch the device on."""
        ...

    def switch_off(self) -> None:
        """Switch the device off."""
        ...
