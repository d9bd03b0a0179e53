"""The registers of a Watlow F4T: numbers in two of them, and who answers."""

from __future__ import annotations

import struct
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from drivers.transport.modbus_line import ModbusLine, ModbusSettings, RegisterLine
from drivers.transport.retry import Repeatable
from station.errors import InstrumentError
from station.roles import Identity, Place

LOW_FIRST = "low-first"
HARDWARE, RELEASE, BUILD, SERIAL = 0, 4, 8, 12
HARDWARE_OF_F4T = 124
FIRST_IO, PER_MODULE, PER_IO, MOST = 33718, 240, 40, 6
OFF, ON = 62, 63
REPEATABLE = Repeatable(r"(read|write) \d+")
"""A register that is read or written twice holds the same afterwards."""


def io_register(name: str) -> int:
    """Return the register of an input or output by `module.number`, as `2.1`; ValueError else."""
    module, _, number = name.partition(".")
    if not (module.isdecimal() and number.isdecimal()):
        raise ValueError(f"{name!r} is no module and number such as '2.2'")
    if not (1 <= int(module) <= MOST and 1 <= int(number) <= MOST):
        raise ValueError(f"{name!r} is beyond module {MOST} or number {MOST}")
    return FIRST_IO + PER_MODULE * (int(module) - 1) + PER_IO * (int(number) - 1)


def io_name(name: str) -> str:
    """Return the name of an input or output; ValueError for one that no controller has."""
    io_register(name)
    return name


IoName = Annotated[str, AfterValidator(io_name)]
"""Module and number of an input or output, as `2.1`."""


class F4TSettings(ModbusSettings):
    """What the bench file says of a controller, whatever it is used for."""

    word_order: Literal["low-first", "high-first"] = Field(
        "low-first", description="of the two words of a number; proven by the identity"
    )


class F4TRegisters:
    """One controller's line, and the order of the two words of a number."""

    def __init__(self, place: Place, settings: F4TSettings) -> None:
        self._place = place
        self._low_first = settings.word_order == LOW_FIRST
        self.line = ModbusLine(place, settings, REPEATABLE, ((HARDWARE, 2), (SERIAL, 2)))

    def identify(self) -> Identity:
        """Read who is there; the hardware's number proves the model and the order of words."""
        hardware = self.whole(HARDWARE)
        if hardware != HARDWARE_OF_F4T:
            swapped = (hardware & 0xFFFF) << 16 | hardware >> 16 & 0xFFFF
            raise InstrumentError(
                self._place.name,
                "read the number of its hardware",
                f"{hardware} came back where an F4T has {HARDWARE_OF_F4T}",
                "correct settings.word_order in the bench file, or the order in the controller"
                if swapped == HARDWARE_OF_F4T
                else "check that the address in the bench file is this controller's",
            )
        release, build = self.whole(RELEASE), self.whole(BUILD)
        return Identity("Watlow", "F4T", str(self.whole(SERIAL)), f"{release}.{build}")

    def whole(self, address: int) -> int:
        """Return a signed whole number of two registers."""
        (value,) = struct.unpack(">i", self._bytes(self.line.read(address, 2)))
        return int(value)

    def number(self, address: int, line: RegisterLine | None = None) -> float:
        """Return a number of two registers; it may be no finite one."""
        (value,) = struct.unpack(">f", self._bytes((line or self.line).read(address, 2)))
        return float(value)

    def write_number(self, address: int, value: float) -> None:
        """Write a number into two registers and read it back; InstrumentError for another."""
        high, low = struct.unpack(">HH", struct.pack(">f", value))
        self.line.write(address, (low, high) if self._low_first else (high, low))
        found = self.number(address)
        if not abs(found - value) <= 1e-6 * abs(value) + 1e-6:
            raise self.another(f"write {value:g} to register {address}", f"{found:g}")

    def write_word(self, address: int, value: int) -> None:
        """Write one register and read it back; InstrumentError for another value."""
        self.line.write(address, [value])
        (found,) = self.line.read(address)
        if found != value:
            raise self.another(f"write {value} to register {address}", str(found))

    def another(self, attempted: str, found: str) -> InstrumentError:
        """Return the error of a value that reads back as another one."""
        return InstrumentError(
            self._place.name,
            attempted,
            f"{found} reads back",
            "see that nobody works at the controller's panel, then run again",
        )

    def _bytes(self, words: list[int]) -> bytes:
        first, second = words
        return struct.pack(">HH", *((second, first) if self._low_first else (first, second)))
