"""Time for everything that waits or stamps; the only package that asks the operating system."""

from station.clock.base import (
    Attendant,
    Clock,
    ClockError,
    ClockStopped,
    FarEnd,
    ParticipantThread,
    Wire,
)
from station.clock.pulse import Pulse, Quiet
from station.clock.real import (
    RealClock,
    boot_seconds,
    local_time,
    system_clock_synchronised,
    utc_now,
    utc_today,
)
from station.clock.virtual import VirtualClock

__all__ = [
    "Attendant",
    "Clock",
    "ClockError",
    "ClockStopped",
    "FarEnd",
    "ParticipantThread",
    "Pulse",
    "Quiet",
    "RealClock",
    "VirtualClock",
    "Wire",
    "boot_seconds",
    "local_time",
    "system_clock_synchronised",
    "utc_now",
    "utc_today",
]
