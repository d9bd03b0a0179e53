"""The commands of what turns a device under test and of what heats it: table axes, chambers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

from station.errors import InputError
from station.method.set_points import Bounds, Command, Result, SetPoint, Station, Where

if TYPE_CHECKING:
    from station.instruments.bench import Bench


@dataclass(frozen=True)
class AxisCommand(Command[Result]):
    """A command of a table's axis `outer`, `middle` or `inner`, numbered by the bench file.

    `number` is the axis of a table that only turns, for which the bench file names none.
    """

    axis: str
    text: str
    number: int | None = None

    def words(self, bench: Bench) -> str:
        """Return the words given."""
        return self.text

    def axis_number(self, bench: Bench) -> int:
        """Return the number that the controller gives the axis; InputError where nothing does."""
        from station.roles.turntable import table_axes

        axes = table_axes(bench.instruments[self.instrument].settings)
        number: int | None = self.number if axes is None else getattr(axes, self.axis)
        if number is None:
            raise InputError(
                f"{self.instrument}: the bench file does not name its {self.axis} axis"
            )
        return number

    @classmethod
    def declare(cls, step: str, commands: Sequence[Self], bench: Bench) -> Iterator[SetPoint]:
        """Yield successive commands once that have the same words and the same bounds."""
        yield from dict.fromkeys(command.set_point(step, bench) for command in commands)


@dataclass(frozen=True)
class AxisTo(AxisCommand[None]):
    """An axis of a table to an angle of its encoder; `come_to_rest` waits for it."""

    angle_deg: float = 0.0

    def bounds(self, bench: Bench) -> Bounds:
        """Return the angle."""
        return {"angle_deg": self.angle_deg}

    def apply(self, station: Station, prepared: None) -> None:
        """Begin to turn to the angle."""
        from station.roles import Turntable

        number = self.axis_number(station.bench)
        station.role(self.instrument, Turntable).move_to(number, self.angle_deg)


@dataclass(frozen=True)
class AxisAtRate(AxisCommand[None]):
    """An axis of a table at a signed rate; stopping it needs no declaration."""

    rate_deg_per_s: float = 0.0

    def bounds(self, bench: Bench) -> Bounds:
        """Return the rate in magnitude."""
        return {"rate_deg_per_s": abs(self.rate_deg_per_s)}

    def apply(self, station: Station, prepared: None) -> None:
        """Begin to turn at the rate."""
        from station.roles import Turntable

        number = self.axis_number(station.bench)
        station.role(self.instrument, Turntable).turn(number, self.rate_deg_per_s)


@dataclass(frozen=True)
class AxisBy(AxisCommand[float]):
    """An axis of a table by an angle from where it stands when the command is prepared.

    `bound_deg` is the place that it reaches, counted from where the axis stands before the first of
    several. Preparing and applying return the angle at which it stood.
    """

    angle_deg: float = 0.0
    bound_deg: float = 0.0

    @property
    def assumed(self) -> float:
        """That it stands at zero."""
        return 0.0

    def bounds(self, bench: Bench) -> Bounds:
        """Return the place that is reached."""
        return {"angle_deg": self.bound_deg}

    def prepare(self, station: Station) -> float:
        """Read where the axis stands."""
        from station.roles import Turntable

        number = self.axis_number(station.bench)
        return station.role(self.instrument, Turntable).angle_deg(number)

    def apply(self, station: Station, prepared: float | None) -> float:
        """Begin to turn to the angle from there."""
        from station.roles import Turntable

        began_deg = self.prepare(station) if prepared is None else prepared
        number = self.axis_number(station.bench)
        station.role(self.instrument, Turntable).move_to(number, began_deg + self.angle_deg)
        return began_deg


@dataclass(frozen=True)
class ChamberOn(Command[None]):
    """A thermal chamber begins to control, with the present temperature as set-point."""

    def words(self, bench: Bench) -> str:
        """Return that it is on."""
        return "on"

    def apply(self, station: Station, prepared: None) -> None:
        """Switch it on."""
        from station.roles import ThermalChamber

        station.role(self.instrument, ThermalChamber).switch_on()


@dataclass(frozen=True)
class TemperatureTo(Command[None]):
    """The air of a thermal chamber to a temperature as fast as the chamber can."""

    temperature_degC: float
    text: str

    def words(self, bench: Bench) -> str:
        """Return the words given."""
        return self.text

    def bounds(self, bench: Bench) -> Bounds:
        """Return the temperature."""
        return {"temperature_degC": self.temperature_degC}

    def apply(self, station: Station, prepared: None) -> None:
        """Begin to go there."""
        from station.roles import ThermalChamber

        station.role(self.instrument, ThermalChamber).set_temperature(self.temperature_degC)


@dataclass(frozen=True)
class TemperatureRamp(Command[None]):
    """A slow ramp of a thermal chamber to a temperature; `rate_decided_by` decides how slow."""

    temperature_degC: float
    rate_degC_per_h: float
    rate_decided_by: Where | None = None

    def words(self, bench: Bench) -> str:
        """Return where it goes, and how fast."""
        return f"ramp to {self.temperature_degC:g} degC at {self.rate_degC_per_h:g} degC/h"

    def bounds(self, bench: Bench) -> Bounds:
        """Return temperature and slope."""
        return {
            "temperature_degC": self.temperature_degC,
            "temperature_slew_degC_per_min": self.rate_degC_per_h / 60.0,
        }

    def apply(self, station: Station, prepared: None) -> None:
        """Begin the ramp."""
        from station.roles import ThermalChamber

        chamber = station.role(self.instrument, ThermalChamber)
        chamber.ramp_to(self.temperature_degC, self.rate_degC_per_h / 60.0)

    @classmethod
    def declare(cls, step: str, commands: Sequence[Self], bench: Bench) -> Iterator[SetPoint]:
        """Yield temperature and slope apart: different keys of the plan decide them."""
        for command in commands:
            whole, slope = (
                command.set_point(step, bench),
                command.rate_decided_by or command.decided_by,
            )
            end, rate = (
                f"ramp to {command.temperature_degC:g} degC",
                f"ramp at {command.rate_degC_per_h:g}",
            )
            yield replace(whole, text=end, temperature_slew_degC_per_min=None)
            yield replace(whole, text=f"{rate} degC/h", temperature_degC=None, decided_by=slope)
