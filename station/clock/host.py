"""The computer's own clocks, for folder names, locks and heartbeats; never for raw data."""

from __future__ import annotations

import time
from datetime import UTC, date, datetime


def utc_now() -> datetime:
    """Return the time of day in UTC, as the computer believes it."""
    return datetime.now(UTC)


def utc_today() -> date:
    """Return today's date in UTC."""
    return utc_now().date()


def boot_seconds() -> float:
    """Return seconds that never run backwards, for intervals of real time."""
    return time.monotonic()
