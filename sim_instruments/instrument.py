"""What a simulated instrument is given, and what the bench asks of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sim_instruments.faults.instrument import InstrumentFaults
from sim_instruments.truth import Truth
from sim_instruments.world.base import World
from station.clock import Clock


@dataclass(frozen=True)
class Setting:
    """One instrument of the bench file, with the world it stands in."""

    name: str
    serial: str
    truth: Truth
    world: World
    clock: Clock
    rng: np.random.Generator
    port: int
    faults: InstrumentFaults


class SimulatedInstrument(Protocol):
    """An instrument that listens on its port from its construction until it is closed.

    Its class may name, as `lasting_faults`, the states of `sim_instruments.faults.lasting` that
    it can be in, and may have `energised() -> bool` where it can harm.
    """

    def __init__(self, setting: Setting) -> None:
        """Begin to serve."""

    def describe(self) -> dict[str, Any]:
        """Return model, protocol, address, host and port, as `station sim` prints them."""

    def close(self) -> None:
        """Stop serving."""
