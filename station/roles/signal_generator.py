"""A signal generator: voltages at the coils of a vapour cell."""

from __future__ import annotations

from typing import Annotated, Protocol, runtime_checkable

from pydantic import Field

from station.fields import Unit
from station.roles.base import DriverSettings, Instrument, MadeSafe
from station.roles.role import OUTPUT, Limit, Role, SafeState

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
        self,
        channel: int,
        voltage_V: float,
        duration_s: float,
        delay_s: float = 0.0,
        cycles: int = 1,
    ) -> None:
        """Arm a step from what the channel holds by `voltage_V`, and back after `duration_s`.

        It begins `delay_s` after the external trigger that starts all armed channels of the bench
        together. With several `cycles` it is a square wave: each cycle is the step for `duration_s`
        and what the channel holds for as long.
        """
        ...

    def disarm(self, channel: int) -> None:
        """Take an armed step back; the channel holds what it held."""
        ...

    def switch_off(self, channel: int) -> None:
        """Switch a channel's output off."""
        ...


SIGNAL_GENERATOR = Role(
    "signal_generator",
    SignalGenerator,
    members=("xy", "z_gradient"),
    settings=CellCoilSettings,
    limits={"voltage": Limit("V", "largest voltage of a channel", needed=True)},
    quantities={"output": OUTPUT},
    safe_state=SafeState("both outputs off", "the output state of both channels", rank=40),
)
