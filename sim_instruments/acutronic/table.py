"""A table under an ACUTROL3000: what its axes can, may and shall do."""

from __future__ import annotations

from dataclasses import dataclass

from sim_instruments.truth import SimulationError, Truth

TRIP_ABOVE = 1.2
"""The largest velocity trip, in the axis' largest rate."""


class TableData:
    """What the axes of a table have in common; truth of the bench file.

    `maximum_rate`, `maximum_acceleration`; `rate_error` of the controller's clock; `rate_noise` of
    a reading; `encoder_noise` (rms) and `resolution`; `tracking_delay`, how late the axis follows
    its profile; `settling`, how long after its end a profile counts as complete; `tracking_bit`,
    in which a tracking fault is reported: 2, or 12 before build 1848.
    """

    def __init__(self, truth: Truth) -> None:
        self.largest_rate = truth.positive("maximum_rate", "deg/s")
        self.largest_acceleration = truth.positive("maximum_acceleration", "deg/s^2")
        self.rate_error = truth.quantity("rate_error", "1")
        self.rate_noise = truth.quantity("rate_noise", "deg/s")
        self.encoder_noise_deg = truth.quantity("encoder_noise", "deg")
        self.resolution_deg = truth.positive("resolution", "deg")
        self.delay_s = truth.quantity("tracking_delay", "s")
        self.settling_s = truth.quantity("settling", "s")
        self.tracking_error = 1 << truth.integer("tracking_bit", 2, 2)
        if min(self.delay_s, self.settling_s) < 0:
            raise SimulationError(f"{truth.where}: times must not be negative")


@dataclass
class ModeLimits:
    """What a mode may use of an axis."""

    rate: float
    acceleration: float
    jerk: float
    velocity_trip: float
    low_deg: float
    high_deg: float


@dataclass
class Demands:
    """What was demanded of each mode, whether or not the axis is in it."""

    position: float = 0.0
    rate: float = 0.0
    acceleration: float = 0.0
    change_deg: float = 0.0
    oscillator: tuple[float, ...] = (0.0, 0.0, 0.0)
    slews: tuple[str | float, ...] = ("Disable", 0.0, 0.0, "Position", "Linear")
    """Of the oscillator: whether its values slew, how fast amplitude and frequency do, of what
    quantity the amplitude is, and how it slews."""

    def vector(self) -> tuple[float, ...]:
        """Return the demands of position and rate."""
        return self.position, self.rate
