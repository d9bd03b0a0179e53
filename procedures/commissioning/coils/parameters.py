"""The parameters of the coils' part, and the records that they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

COILS = ("x", "y", "z")
"""A coil bears the name of the probe's axis along which it must make its field."""
RESULTS = {
    name: ResultKind(COILS, unit)
    for name, unit in (
        ("coil_constant_ratio", "1"),
        ("cross_axis", "1"),
        ("field_after_off", "mT"),
        ("ambient_field", "mT"),
        ("ambient_noise", "mT"),
    )
}
"""What is reported of each axis, with its unit."""


class Ambient(StrictModel):
    """The ambient field along the bench's axes, from a map of the field and a compass."""

    x_mT: Annotated[float, Unit("mT")]
    y_mT: Annotated[float, Unit("mT")]
    z_mT: Annotated[float, Unit("mT")]
    standard_uncertainty_mT: Annotated[float, Unit("mT"), Field(gt=0)]

    @property
    def field_mT(self) -> tuple[float, ...]:
        """The components, in the order of `COILS`."""
        return (self.x_mT, self.y_mT, self.z_mT)


@dataclass(frozen=True)
class CoilRecord:
    """A unit of work: a coil at a field of either sense, or off, seen along a direction."""

    along: str
    coil: str
    state: str
    field_mT: float

    @property
    def unit(self) -> str:
        """The name of the unit of work."""
        return f"coil {self.coil} {self.state} along {self.along}"


class CoilParameters(StrictModel):
    """What the engineer chooses. A probe of one axis needs `turn_probe`: a person turns it."""

    field_mT: Annotated[float, Unit("mT"), Field(gt=0, le=1.0)] = 0.2
    record_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 5.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0.5, le=60)] = 1.0
    turn_probe: bool = False
    ambient: Ambient | None = None

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions in which the probe stands, one after the other."""
        return COILS if self.turn_probe else ("all",)

    def coil_records(self, along: str) -> tuple[CoilRecord, ...]:
        """Return the records of every coil, seen along a direction."""
        states = {"plus": self.field_mT, "minus": -self.field_mT, "off": 0.0}
        return tuple(CoilRecord(along, coil, *state) for coil in COILS for state in states.items())


def ambient_unit(along: str) -> str:
    """Return the name of the unit of work that records the ambient field along a direction."""
    return f"ambient along {along}"
