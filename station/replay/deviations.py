"""What a replay finds: where drivers do another thing than the transcript has."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from station.instruments.trace import readable

MAX_SHOWN = 20
LONGEST = 60
BEFORE = 20
"""Bytes that are shown before the first that differs."""
NOTHING = "nothing"


@dataclass(frozen=True)
class Deviation:
    """One difference: the instrument, run time in s, what the transcript has, what was sent."""

    instrument: str
    time_s: float
    expected: str
    sent: str
    line: int | None = None
    """The line of the transcript, None where it holds none for this."""

    @property
    def sentence(self) -> str:
        """The difference in one line."""
        where = f" (line {self.line})" if self.line else ""
        return (
            f"{self.instrument} at {self.time_s:.6f} s{where}: "
            f"expected {self.expected}, sent {self.sent}"
        )


@dataclass
class Deviations:
    """All differences of a replay; after `ended_s` nothing counts, for the transcript is over."""

    differences: list[Deviation] = field(default_factory=list)
    altered: list[str] = field(default_factory=list)
    """Transcripts that are not as they were recorded, in words."""
    exchanges: int = 0
    ended_s: float | None = None

    def add(
        self,
        instrument: str,
        time_s: float,
        expected: bytes | None,
        sent: bytes | None,
        line: int = 0,
    ) -> None:
        """Note a difference."""
        if self.ended_s is None or time_s < self.ended_s:
            words = shown(expected, sent), shown(sent, expected)
            self.differences.append(Deviation(instrument, time_s, *words, line or None))

    @property
    def none(self) -> bool:
        """Whether everything was as the transcript has it."""
        return not self.differences and not self.altered

    def lines(self) -> list[str]:
        """Return what a person is shown: the first differences, and how many there are."""
        lines = [
            *self.altered,
            *(deviation.sentence for deviation in self.differences[:MAX_SHOWN]),
        ]
        left_out = len(self.differences) - MAX_SHOWN
        if left_out > 0:
            lines.append(f"and {left_out} more; --json lists all of them")
        count = len(self.differences)
        what = "no deviation" if not count else f"{count} deviation{'s' * (count > 1)}"
        return [*lines, f"{self.exchanges} messages sent, {what}"]

    def to_data(self) -> dict[str, Any]:
        """Return all of it as plain data."""
        return {
            "messages": self.exchanges,
            "count": len(self.differences),
            "deviations": [asdict(deviation) for deviation in self.differences],
            "altered": self.altered,
        }


def shown(data: bytes | None, other: bytes | None) -> str:
    """Return bytes as readable text, of long ones the part where they begin to differ."""
    if data is None:
        return NOTHING
    pairs = enumerate(zip(data, other or b"", strict=False))
    alike = next((n for n, (mine, its) in pairs if mine != its), 0)
    first = max(alike - BEFORE, 0) if len(data) > LONGEST else 0
    part = data[first : first + LONGEST]
    more = "…" if first + LONGEST < len(data) else ""
    return f"'{'…' * (first > 0)}{readable(part)}{more}'"
