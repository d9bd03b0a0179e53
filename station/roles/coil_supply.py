"""A coil supply: a bipolar current source with a coil at its output."""

from __future__ import annotations

from typing import Annotated, Protocol, runtime_checkable

from pydantic import AfterValidator, Field

from station.fields import Unit
from station.roles.base import DriverSettings, Instrument, MadeSafe
from station.roles.role import OUTPUT, TEMPERATURE, Limit, Quantity, Role, SafeState


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
    """A bipolar current source with a coil at its output.

    At `coil_supply.dc` it also holds steady currents: there it needs `switch_on()` and
    `ramp_to(current_A)` beside these verbs (`DirectCurrentSupply`).
    """

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
class ProvesItself(DirectCurrentSupply, Protocol):
    """A supply that shows, at small currents, that its own limit acts and that off is off."""

    def current_beyond_limit_A(self, limit_A: float, asked_A: float) -> float:
        """Return the current in A that flows where more is asked for than a limit of its own.

        The output is off before and after, and the limit is again that of the bench.
        """
        ...

    def cut_off(self) -> None:
        """Switch the output off at once, without a ramp, at a current of at most 1 A."""
        ...


COIL_SUPPLY = Role(
    "coil_supply",
    CoilSupply,
    members=("x", "y", "z", "dc"),
    settings=CoilSettings,
    limits={
        "current": Limit(
            "A", "largest current; written into a supply before it is used", needed=True
        ),
        "voltage": Limit(
            "V", "largest voltage; written into a supply before it is used", needed=True
        ),
        "slew": Limit(
            "A/s", "fastest change of current when a coil is brought to zero", needed=True
        ),
        "zero_current": Limit("A", "largest measured current that counts as zero", needed=True),
        "rms_current": Limit("A", "largest effective current for as long as a plan likes"),
        "heating": Limit("W", "power that a coil may turn into heat for as long as a plan likes"),
        "field": Limit("mT", "largest field amplitude a plan may ask for"),
    },
    quantities={
        "current": Quantity("A", period_s=0.2, magnitude=True, while_on=True, limit="current"),
        # It is watched for the coil's resistance, which changes slowly; the supply itself keeps
        # its voltage below the limit.
        "voltage": Quantity("V", period_s=2.0, magnitude=True, while_on=True),
        "temperature": TEMPERATURE,
        "output": OUTPUT,
    },
    safe_state=SafeState(
        "current ramped to zero within the slew limit, then the output off",
        "output off, no list running, measured current below zero_current",
        rank=20,
    ),
)
"""`coil_supply.x`, `.y`, `.z` are the coils about a device; `.dc` is a `DirectCurrentSupply`."""
