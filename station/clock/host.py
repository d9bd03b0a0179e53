"""The computer's own clocks, for folder names, locks and heartbeats; never for raw data."""

from __future__ import annotations

import ctypes
import sys
import time
from datetime import UTC, date, datetime

TIME_ERROR = 5
"""What adjtimex(2) answers while nothing keeps the system clock right."""
TIMEX_BYTES = 1024
"""More than the kernel's struct timex; all zeros, it asks and sets nothing."""


def utc_now() -> datetime:
    """Return the time of day in UTC, as the computer believes it."""
    return datetime.now(UTC)


def utc_today() -> date:
    """Return today's date in UTC."""
    return utc_now().date()


def boot_seconds() -> float:
    """Return seconds that never run backwards, for intervals of real time."""
    return time.monotonic()


def system_clock_synchronised() -> bool | None:
    """Return whether something, such as NTP, keeps the computer's time of day right.

    None where the system does not say: asked of the kernel on Linux only.
    """
    if sys.platform != "linux":
        return None
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != TIME_ERROR
