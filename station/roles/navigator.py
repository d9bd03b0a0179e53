"""An inertial navigation system under test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from station.roles.base import SampledSource
from station.roles.role import TEMPERATURE, Limit, Role


@dataclass(frozen=True)
class NavigatorStatus:
    """What a navigator says of itself.

    `aligning_for_s` is None unless an alignment is under way; `faults` are words, none when all is
    well.
    """

    aligned: bool
    aligning_for_s: float | None
    faults: tuple[str, ...]


@runtime_checkable
class Navigator(SampledSource, Protocol):
    """A navigator that outputs attitude and the temperatures of its gyros, all axes body axes.

    Columns `counter` (16 bits, one more with every output, from 1 after a start), `heading_deg`
    (0 to 360), `pitch_deg`, `roll_deg`, `temperature_x_degC`, `temperature_y_degC`,
    `temperature_z_degC`, `status` (bit 0: aligned, bit 1: aligning). Before it is aligned its
    angles mean nothing. An output that is lost on the line leaves a gap in `counter`.
    """

    def start(self, rate_Hz: float) -> None:
        """Begin to output, 1 Hz to 10 Hz, with the counter from 1; what came before is forgotten.

        Raises InstrumentError when the navigator is switched off.
        """
        ...

    def stop(self) -> None:
        """End the output."""
        ...

    def align(self, latitude_deg: float) -> None:
        """Begin to find attitude and heading at rest, at a latitude; returns at once."""
        ...

    def status(self) -> NavigatorStatus:
        """Ask whether it is aligned, and what is wrong with it."""
        ...


NAVIGATOR = Role(
    "navigator",
    Navigator,
    limits={"rate": Limit("deg/s", "largest rate")},
    quantities={"temperature": TEMPERATURE},
    start_samples=lambda source: source.start(rate_Hz=10.0),
    reads_device=True,
)
