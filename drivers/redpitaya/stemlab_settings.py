"""What a Red Pitaya's operating system can do, and which decimation and range a record needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from drivers.transport.text_line import VisaSettings

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
        return max((factor for factor in known if factor <= largest), default=None)


class CannotRecord(Exception):
    """A record that the board cannot take: why, and what to do now."""

    def __init__(self, why: str, do_now: str) -> None:
        super().__init__(why)
        self.why, self.do_now = why, do_now


@dataclass(frozen=True)
class Record:
    """A record: its decimation, and how many values lie before the trigger and from it on."""

    decimation: int
    before: int
    after: int

    @classmethod
    def of(cls, decimation: int, duration_s: float) -> Record:
        """Return the record that holds `duration_s`, and a fiftieth of it before the trigger."""
        after = math.ceil(duration_s * CONVERTER_HZ / decimation) + 1
        return cls(decimation, max(8, math.ceil(after / 50)), after)

    @property
    def rate_Hz(self) -> float:
        """The sample rate."""
        return CONVERTER_HZ / self.decimation

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


def system_version(text: str) -> str:
    """Return the version of an operating system; raise ValueError for what is none."""
    if not all(part.isdecimal() for part in text.replace("-", ".").split(".")):
        raise ValueError(f"'{text}' is no version such as 2.05-37")
    return text


class BoardSettings(VisaSettings):
    """What the bench file says of a board."""

    os_version: Annotated[str, AfterValidator(system_version)] = Field(
        LATEST, description="of the board's system; it decides which decimations there are"
    )
    channel: int = Field(1, ge=1, le=2, description="the input that is recorded")
    jumper: Literal["LV", "HV"] = Field(
        "LV", description="where those of the input are set: LV, ±1 V, or HV, ±20 V"
    )

    @property
    def system(self) -> System:
        """What the board's system can do."""
        return System(tuple(map(int, self.os_version.replace("-", ".").split("."))))

    @property
    def full_scale_V(self) -> float:
        """Where the range ends."""
        return FULL_SCALES_V[self.jumper]

    def record(self, sample_rate_Hz: float, duration_s: float, full_scale_V: float) -> Record:
        """Return the record with the nearest rate at or above the wanted; raises CannotRecord."""
        wishes = (sample_rate_Hz, duration_s, full_scale_V)
        if not all(math.isfinite(wish) and wish > 0 for wish in wishes):
            raise CannotRecord("these must be positive", "correct the plan")
        if full_scale_V > self.full_scale_V:
            higher = "move the input's jumpers to HV and write settings.jumper: HV"
            raise CannotRecord(
                f"its range ends at {self.full_scale_V:g} V",
                higher if self.jumper == "LV" else "put a divider before its input",
            )
        decimation = self.system.decimation(sample_rate_Hz)
        if decimation is None:
            raise CannotRecord("it samples at 125 MHz at most", "lower the plan's sample rate")
        record = Record.of(decimation, duration_s)
        if not record.fits:
            holds_s = 0.975 * SLOTS / record.rate_Hz
            raise CannotRecord(
                f"at {record.rate_Hz:g} Hz its {SLOTS} values hold {holds_s:.3g} s",
                "shorten the record, or lower the sample rate",
            )
        return record
