"""Roles of a vapour cell: its coils, its signal, its pump light."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Protocol, runtime_checkable

from pydantic import Field

from station.fields import Unit
from station.roles.base import Block, DriverSettings, Instrument, MadeSafe

CoilConstant = Annotated[
    float | None, Unit("nT/V"), Field(gt=0, description="field at the cell for one volt")
]


class CellCoilSettings(DriverSettings):
    """What a volt of a signal generator makes at the coils of a vapour cell, whatever its model."""

    constant_x_nT_per_V: CoilConstant = None
    constant_y_nT_per_V: CoilConstant = None
    constant_z_nT_per_V: CoilConstant = None
    gradient_at_1_V_nT_per_cm: Annotated[float | None, Unit("nT/cm")] = Field(
        None, gt=0, description="gradient at the cell for one volt"
    )


class LightSettings(DriverSettings):
    """What a bench file says of the pump light, whatever shuts it off."""

    trigger_to_dark_s: Annotated[float | None, Unit("s")] = Field(
        None, ge=0, description="from the trigger's edge until no light passes; by a photodiode"
    )


@runtime_checkable
class SignalGenerator(Instrument, MadeSafe, Protocol):
    """Two channels, 1 and 2, each a voltage at a coil: held, or for one step after a trigger."""

    def programme_limits(self) -> None:
        """Write the bench file's voltage limits into the instrument and check its load setting."""
        ...

    def hold(self, channel: int, voltage_V: float) -> None:
        """Put a steady voltage on a channel, at once, output on."""
        ...

    def prepare_step(
        self, channel: int, voltage_V: float, duration_s: float, delay_s: float = 0.0
    ) -> None:
        """Arm a step from what the channel holds by `voltage_V`, and back after `duration_s`.

        It begins `delay_s` after the external trigger that starts all armed channels of the bench
        together.
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

    @classmethod
    def why_no_record(
        cls,
        settings: Mapping[str, Any],
        sample_rate_Hz: float,
        duration_s: float,
        full_scale_V: float,
    ) -> str | None:
        """Return why it cannot take a record with these bench settings, None where it can."""
        ...

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
