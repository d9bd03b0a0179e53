"""When to leave the running list of a Kepco BOP: near a zero of its sine, whatever is read back.

A card that leaves its list goes at once to the fixed set-point, which is zero. At full current this
would cut the coil off, so the list is left where it carries no more than one step of a ramp. A
read-back that stands still while a list runs tells nothing: then the zeros are reckoned from the
time at which the list was started.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from station.clock import Clock

LOOK_S = 0.01
LOOKS = 6
"""A sine near its zero changes by several times its read-back's noise in as many looks."""


@dataclass(frozen=True)
class Sine:
    """A list that was started by this driver: when, and half of its period."""

    began_s: float
    half_period_s: float

    def next_zero_s(self, time_s: float) -> float:
        """Return the first zero of the current at or after a run time."""
        halves = math.ceil((time_s - self.began_s) / self.half_period_s - 1e-9)
        return self.began_s + halves * self.half_period_s


def wait_for_zero(
    clock: Clock,
    read_A: Callable[[], float],
    near_zero_A: float,
    until_s: float,
    sine: Sine | None,
    in_step: Callable[[], bool],
) -> bool:
    """Return near a zero of a running list's current; False when the read-back stood still.

    `in_step` proves that a reading near zero is the current, and no answer to another question.
    At `until_s` the list is to be left in any case.
    """
    seen: list[float] = []
    while clock.now() < until_s:
        seen = [*seen[1 - LOOKS :], read_A()]
        if abs(seen[-1]) <= near_zero_A:
            if len(set(seen)) > 1:
                if in_step():
                    return True
                seen = []
                continue
            if len(seen) == LOOKS:
                break
        clock.sleep(LOOK_S)
    stood_still = len(seen) == LOOKS and len(set(seen)) == 1
    if stood_still and sine is not None:
        clock.sleep_until(max(clock.now(), sine.next_zero_s(clock.now())))
    return not stood_still
