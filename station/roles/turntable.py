"""A turntable of up to three axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from pydantic import Field, ValidationInfo, field_validator

from station.roles.base import DriverSettings, Instrument, MadeSafe
from station.roles.role import CONTACT_STATES, Quantity, Role, SafeState
from station.roles.rotary_stage import ROTARY_STAGE


class TableSettings(DriverSettings):
    """Which axis of a table is which, whatever its model."""

    outer_axis: int | None = Field(
        None, ge=1, le=3, description="number of the axis that carries the others"
    )
    middle_axis: int | None = Field(None, ge=1, le=3, description="number of the axis between")
    inner_axis: int | None = Field(
        None, ge=1, le=3, description="number of the axis that carries the device"
    )

    @field_validator("outer_axis", "middle_axis", "inner_axis")
    @classmethod
    def is_there_once(cls, number: int | None, info: ValidationInfo) -> int | None:
        """Refuse one number for two axes: one of them would turn in the other's place.

        Beside a driver's own settings an axis that the table lacks is refused, too.
        """
        if number is None:
            return None
        need_axis(number, info.data.get("axes"))
        before = [name for name in TableSettings.model_fields if info.data.get(name) == number]
        if before:
            raise ValueError(f"is the number of {before[0]}, too; each axis has its own")
        return number


def need_axis(number: int, axes: int | None) -> None:
    """Raise ValueError for an axis beyond those of a table; None for one that says not how many."""
    if axes is not None and number > axes:
        raise ValueError(
            f"there is no axis {number}, as settings.axes is {axes}; write a smaller number here, "
            f"or settings.axes: {number}"
        )


@dataclass(frozen=True)
class TableAxes:
    """Numbers of a three-axis table's axes: the outer is vertical and carries the middle one."""

    outer: int
    middle: int
    inner: int


def table_axes(settings: Mapping[str, Any]) -> TableAxes | None:
    """Return which axis is which by a table's settings; None for a table that only turns."""
    numbers = [settings.get(key) for key in TableSettings.model_fields]
    whole = [number for number in numbers if isinstance(number, int)]
    return TableAxes(*whole) if len(whole) == len(numbers) else None


def unnamed_axes(instance: str, settings: Mapping[str, Any]) -> Iterator[str]:
    """Yield what a bench file has to say before a table's angles mean anything, axis by axis."""
    for key in TableSettings.model_fields:
        if not isinstance(settings.get(key), int):
            name = key.removesuffix("_axis")
            yield (
                f"the bench file does not say which axis of {instance} is the {name} one; write "
                f"instruments.{instance}.settings.{key}, such as 1"
            )


@runtime_checkable
class Turntable(Instrument, MadeSafe, Protocol):
    """A table of up to three axes, numbered from 1, each with its own encoder.

    Angles are the encoder's, in deg, and go on beyond a turn where the axis is continuous: after
    three turns at a positive rate an axis reads 1080 deg more than before.
    """

    def programme_limits(self) -> None:
        """Write the bench file's rate, acceleration and angle limits into the controller."""
        ...

    def is_homed(self, axis: int) -> bool:
        """Whether the encoder's zero is known."""
        ...

    def home(self, axis: int) -> None:
        """Close the axis' servo and begin to look for the encoder's zero."""
        ...

    def move_to(self, axis: int, angle_deg: float) -> None:
        """Begin to go to an angle, by way of every angle between; returns at once."""
        ...

    def turn(self, axis: int, rate_deg_per_s: float) -> None:
        """Begin to turn at a rate until commanded otherwise; returns at once."""
        ...

    def stop(self, axis: int) -> None:
        """Begin to come to rest within the acceleration limit; returns at once."""
        ...

    def is_moving(self, axis: int) -> bool:
        """Whether the axis has not settled at its angle or rest; raises for a fault of the axis."""
        ...

    def is_at_rate(self, axis: int) -> bool:
        """Whether the axis has settled at the commanded rate; raises for a fault of the axis."""
        ...

    def angle_deg(self, axis: int) -> float:
        """Return the encoder's angle, counted through every turn."""
        ...

    def rate_deg_per_s(self, axis: int) -> float:
        """Return the measured rate."""
        ...


TURNTABLE = Role(
    "turntable",
    Turntable,
    settings=TableSettings,
    limits=ROTARY_STAGE.limits,
    quantities={
        **ROTARY_STAGE.quantities,
        "chain": Quantity(states=CONTACT_STATES, while_on=True),
    },
    safe_state=SafeState(
        "every axis decelerated to rest within its acceleration limit",
        "the measured rate of every axis",
        rank=10,
    ),
)
