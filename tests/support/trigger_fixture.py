"""A small world with a trigger, a detector and pump light."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim_instruments.world import base as world
from sim_instruments.world.base import TriggerLine

Signal = Callable[[np.ndarray], np.ndarray]


class Room(world.Room):
    """A detector whose signal begins with the last trigger, and a lamp."""

    def __init__(self, signal: Signal) -> None:
        super().__init__()
        self.trigger = TriggerLine()
        self.edges: list[tuple[float, str]] = []
        self.light: list[tuple[float, bool]] = []
        self._signal = signal
        self.trigger.listen(
            lambda time_s: self.edges.append((time_s, "rise")),
            lambda time_s: self.edges.append((time_s, "fall")),
        )

    def detector_V(self, times_s: np.ndarray) -> np.ndarray:
        assert (np.diff(times_s) > 0).all()
        risen_s = np.array([-np.inf, *(time_s for time_s, kind in self.edges if kind == "rise")])
        since_s = times_s - risen_s[np.searchsorted(risen_s, times_s, side="right") - 1]
        return self._signal(np.where(np.isinf(since_s), -1.0, since_s))

    def pump(self, time_s: float, on: bool) -> None:
        self.light.append((time_s, on))
