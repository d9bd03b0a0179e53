"""How long something takes in bench time, and between which bounds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Duration:
    """Bench time in s that something is expected to take, and between which bounds it does."""

    expected_s: float = 0.0
    shortest_s: float = 0.0
    longest_s: float = 0.0

    def __add__(self, other: Duration) -> Duration:
        """Return what one after the other takes."""
        return Duration(
            self.expected_s + other.expected_s,
            self.shortest_s + other.shortest_s,
            self.longest_s + other.longest_s,
        )

    @property
    def is_certain(self) -> bool:
        """Whether it takes what is expected, whatever data and instruments say."""
        return self.longest_s - self.shortest_s < 1e-6

    def to_data(self) -> dict[str, float]:
        """Return it as plain data."""
        return {name: round(value, 6) for name, value in vars(self).items()}


NO_TIME = Duration()


def exactly(seconds: float) -> Duration:
    """Return how long something takes that nothing makes shorter or longer."""
    return Duration(seconds, seconds, seconds)


def on_the_way(expected_s: float) -> Duration:
    """Return how long an instrument takes to where it is sent: nothing at all, or twice as long."""
    return Duration(expected_s, 0.0, 2.0 * expected_s)
