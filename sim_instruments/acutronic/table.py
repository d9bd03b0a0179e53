"""A table under an ACUTROL3000: what its axes can, may and shall do, and what its encoders read."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_instruments.truth import SimulationError, Truth


@dataclass(frozen=True)
class Table:
    """What the axes of a table have in common; truth of the bench file.

    `maximum_rate`, `maximum_acceleration`; `rate_error` of the controller's clock; `rate_noise` of
    a reading; `encoder_noise` (rms) and `resolution`; `tracking_delay`, how late the axis follows
    its profile; `settling`, how long after its end a profile counts as complete.
    """

    largest_rate: float
    largest_acceleration: float
    rate_error: float
    rate_noise: float
    encoder_noise_deg: float
    resolution_deg: float
    delay_s: float
    settling_s: float

    @classmethod
    def read(cls, truth: Truth) -> Table:
        """Read the truth; SimulationError where something is missing or impossible."""
        table = cls(
            truth.quantity("maximum_rate", "deg/s"),
            truth.quantity("maximum_acceleration", "deg/s^2"),
            truth.quantity("rate_error", "1"),
            truth.quantity("rate_noise", "deg/s"),
            truth.quantity("encoder_noise", "deg"),
            truth.quantity("resolution", "deg"),
            truth.quantity("tracking_delay", "s"),
            truth.quantity("settling", "s"),
        )
        positive = (table.largest_rate, table.largest_acceleration, table.resolution_deg)
        if min(positive) <= 0 or min(table.delay_s, table.settling_s) < 0:
            raise SimulationError(f"{truth.where}: rates, resolution and times must be positive")
        return table


@dataclass
class ModeLimits:
    """What a mode may use of an axis."""

    rate: float
    acceleration: float
    jerk: float


@dataclass
class Demands:
    """What was demanded of each mode, whether or not the axis is in it."""

    position: float = 0.0
    rate: float = 0.0
    acceleration: float = 0.0


@dataclass
class Encoder:
    """Offset, one sine a turn, and the range of an axis that does not turn for ever.

    Truth: `encoder_offset`, `encoder_sine`, `encoder_phase`; `angle_at_start`, where the axis truly
    stands when the world has none; `unreferenced: true` for an encoder that reads zero there until
    its zero is found; `low` and `high` for an axis with end stops.
    """

    offset_deg: float
    sine_deg: float
    phase_rad: float
    start_deg: float
    referenced: bool
    low_deg: float
    high_deg: float
    lost_deg: float = 0.0

    @classmethod
    def read(cls, truth: Truth) -> Encoder:
        """Read the truth of one axis."""
        ends = "low" in truth or "high" in truth
        return cls(
            truth.quantity("encoder_offset", "deg"),
            truth.quantity("encoder_sine", "deg"),
            math.radians(truth.quantity("encoder_phase", "deg")),
            truth.quantity("angle_at_start", "deg"),
            not truth.switch("unreferenced"),
            truth.quantity("low", "deg") if ends else -math.inf,
            truth.quantity("high", "deg") if ends else math.inf,
        )

    @property
    def continuous(self) -> bool:
        """Whether the axis turns for ever."""
        return math.isinf(self.low_deg)

    def reads(self, true_deg: float) -> float:
        """Return what the encoder reads at a true angle, turns counted."""
        sine = self.sine_deg * math.sin(math.radians(true_deg) + self.phase_rad)
        return true_deg + self.offset_deg + sine - self.lost_deg

    def true_at(self, reading_deg: float) -> float:
        """Return the true angle at which the encoder reads an angle."""
        near_deg = reading_deg - self.offset_deg + self.lost_deg
        return near_deg - self.sine_deg * math.sin(math.radians(near_deg) + self.phase_rad)
