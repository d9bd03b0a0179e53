"""What a simulated instrument is given, and what the bench asks of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from sim_instruments.faults.instrument import InstrumentFaults
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.wire.tcp import HOST, TcpServer
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

    def serial_number(self, whose: str) -> int:
        """Return the serial number of what tells it in 32 bits; SimulationError where it cannot."""
        if not self.serial.isdigit() or int(self.serial) >= 2**32:
            raise SimulationError(
                f"{self.truth.where}: {whose} serial number is a number below 2^32, "
                f"got '{self.serial}'"
            )
        return int(self.serial)


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


class Electronics(Protocol):
    """What makes an instrument's outputs, in threads of its own."""

    def close(self) -> None:
        """End the outputs for good."""


class ServedInstrument:
    """What every instrument does alike: say where it is served, and end.

    Its class says which it is; `resource` is the form of the address that a driver of it takes.
    """

    model: ClassVar[str]
    protocol: ClassVar[str]
    resource: ClassVar[str]
    _server: TcpServer
    _electronics: Electronics | None = None

    def describe(self) -> dict[str, Any]:
        """Return what `station sim` prints about this instrument."""
        port = self._server.port
        return {
            "model": self.model,
            "protocol": self.protocol,
            "address": self.resource.format(host=HOST, port=port),
            "host": HOST,
            "port": port,
        }

    def close(self) -> None:
        """Stop serving."""
        if self._electronics is not None:
            self._electronics.close()
        self._server.close()
