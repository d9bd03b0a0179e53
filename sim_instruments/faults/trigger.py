"""When a fault strikes: from a time on, at a message, for a while, so many times."""

from __future__ import annotations

import math
from collections.abc import Callable

Matcher = Callable[[str], bool]


def any_message(message: str) -> bool:
    """Match every message."""
    return True


def text_within(text: str) -> Matcher:
    """Match messages that contain `text`, upper and lower case alike."""
    wanted = text.strip().upper()
    return lambda message: wanted in message.upper()


def frame_named(identifier: int) -> Matcher:
    """Match frames of one CAN identifier, which are named by it as `0x121` is by `121`."""
    wanted = frame_name(identifier)
    return lambda message: message == wanted


def frame_name(identifier: int) -> str:
    """Return how a CAN frame is named as a message."""
    return f"{identifier:03X}"


class Trigger:
    """Decide which messages a fault meets.

    Those that `matches`, from `at_s` on, the first `nth` - 1 of them left out, at most `count`.
    With `for_s` none later than that after `at_s`, or after the first one met when `opens` says
    that the time begins with it.
    """

    def __init__(
        self,
        matches: Matcher,
        at_s: float,
        for_s: float = math.inf,
        nth: int = 1,
        count: float = math.inf,
        *,
        opens: bool = False,
    ) -> None:
        self.at_s = at_s
        self.for_s = for_s
        self.met = 0
        self.first_s: float | None = None
        self.last_s: float | None = None
        self._matches = matches
        self._left_out = nth - 1
        self._count = count
        self._until_s = math.inf if opens else at_s + for_s

    def spent(self, time_s: float) -> bool:
        """Return whether no message can be met any more."""
        return self.met >= self._count or time_s >= self._until_s

    def meets(self, time_s: float, message: str) -> bool:
        """Return whether the fault strikes this message, and count it."""
        if time_s < self.at_s or self.spent(time_s) or not self._matches(message):
            return False
        if self._left_out:
            self._left_out -= 1
            return False
        self.strike(time_s)
        return True

    def strike(self, time_s: float) -> None:
        """Count that the fault struck."""
        if self.first_s is None:
            self.first_s = time_s
            self._until_s = min(self._until_s, time_s + self.for_s)
        self.last_s = time_s
        self.met += 1
