"""What a Red Pitaya's operating system can do, and which decimation and range a record needs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

CONVERTER_HZ = 125e6
SLOTS = 16384
"""Values in the board's buffer."""

HALF = SLOTS // 2
"""Values after the trigger at a delay of 0."""

CLASSIC = (1, 8, 64, 1024, 8192, 65536)
POWERS = tuple(2**power for power in range(17))
LARGEST_DECIMATION = 65536
FULL_SCALES_V = {"LV": 1.0, "HV": 20.0}
LATEST = "2.05"


@dataclass(frozen=True)
class System:
    """The operating system of a board, by its version, such as (2, 5, 37)."""

    version: tuple[int, ...]

    @property
    def decimation_command(self) -> str:
        """The header of the decimation, which has a query, too."""
        return "ACQ:DEC:F" if self.version >= (2, 0, 30) else "ACQ:DEC"

    @property
    def data_query(self) -> str:
        """What follows the channel in a query for values from a place in the buffer on."""
        return "DATA:START:N?" if self.version >= (2,) else "DATA:STA:N?"

    @property
    def tells_full(self) -> bool:
        """Whether `ACQ:TRIG:FILL?` is known."""
        return self.version >= (2, 0, 15)

    @property
    def first_after_trigger(self) -> int:
        """How many values after the kept pointer the one lies that was taken at the trigger."""
        return 0 if self.version >= (2, 5) else 1

    def decimation(self, sample_rate_Hz: float) -> int | None:
        """Return the largest decimation that samples at least that fast; None where none does."""
        largest = math.floor(CONVERTER_HZ / sample_rate_Hz * (1 + 1e-12))
        if self.version >= (2, 0, 30) and largest >= 16:
            return min(largest, LARGEST_DECIMATION)
        known = POWERS if self.version >= (1, 4) else CLASSIC
        return max((one for one in known if one <= largest), default=None)


@dataclass(frozen=True)
class Window:
    """A record: how many values before the trigger, and how many from it on."""

    before: int
    after: int

    @classmethod
    def of(cls, sample_rate_Hz: float, duration_s: float) -> Window:
        """Return the window that holds `duration_s`, and a fiftieth of it before the trigger."""
        after = math.ceil(duration_s * sample_rate_Hz) + 1
        return cls(max(8, math.ceil(after / 50)), after)

    @property
    def delay(self) -> int:
        """What the trigger delay is set to: two values more, so that none is missing at the end."""
        return self.after + 2 - HALF

    @property
    def length(self) -> int:
        """The number of values."""
        return self.before + self.after

    @property
    def fits(self) -> bool:
        """Whether the buffer holds it."""
        return self.length + 2 <= SLOTS


@dataclass(frozen=True)
class Settings:
    """A bench file's settings of a board."""

    system: System
    channel: int
    jumper: str

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Settings:
        """Return the settings; raises ValueError with what is wrong."""
        text = str(settings.get("os_version", LATEST))
        parts = text.replace("-", ".").split(".")
        if not all(part.isdecimal() for part in parts):
            raise ValueError(f"os_version is {text!r}")
        channel, jumper = settings.get("channel", 1), str(settings.get("jumper", "LV")).upper()
        if channel not in (1, 2) or jumper not in FULL_SCALES_V:
            raise ValueError(f"channel is {channel!r}, jumper is {jumper!r}")
        return cls(System(tuple(int(part) for part in parts)), int(channel), jumper)
