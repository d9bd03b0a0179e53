"""The commands of what turns a device under test and of what heats it: table axes, chambers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from station.errors import InputError
from station.method.set_points import Bounds, Command, SetPoint, Station

if TYPE_CHECKING:
    from station.instruments.bench import Bench


@dataclass(frozen=True)
class AxisCommand(Command[None]):
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
        yield from dict.fromkeys(one.set_point(step, bench) for one in commands)


@dataclass(frozen=True)
class AxisTo(AxisCommand):
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
class AxisAtRate(AxisCommand):
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
