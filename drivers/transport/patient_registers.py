"""Registers that are read and written again where one lost answer must not decide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from drivers.transport.retry import Repeatable, repeated


class RegisterLine(Protocol):
    """A device's registers, as `ModbusLine` reaches them."""

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return registers from an address on."""
        ...

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write registers from an address on."""
        ...


class PatientRegisters:
    """A line on which everything repeatable, named as `read 2820`, is tried three times."""

    def __init__(self, line: RegisterLine, repeatable: Repeatable) -> None:
        self._line = line
        self._repeatable = repeatable

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return registers from an address on."""
        message = f"read {address}"
        return repeated(self._repeatable, message, lambda: self._line.read(address, count))

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write registers from an address on."""
        message = f"write {address}"
        repeated(self._repeatable, message, lambda: self._line.write(address, values))
