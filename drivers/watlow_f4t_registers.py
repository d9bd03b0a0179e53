"""The registers of a Watlow F4T: numbers in two of them, and who answers."""

from __future__ import annotations

import struct

from drivers.roles import Identity, Place
from drivers.transport.modbus_line import UNITS, ModbusLine
from drivers.transport.patient_registers import PatientRegisters, RegisterLine
from drivers.transport.retry import Repeatable
from drivers.transport.serial_port import Framing
from station.errors import InstrumentError

FRAMING = Framing(baud_rate=9600)
LOW_FIRST, HIGH_FIRST = "low-first", "high-first"
HARDWARE, RELEASE, BUILD, SERIAL = 0, 4, 8, 12
HARDWARE_OF_F4T = 124
FIRST_IO, PER_MODULE, PER_IO, MOST = 33718, 240, 40, 6
OFF, ON = 62, 63
REPEATABLE = Repeatable(r"(read|write) \d+")
"""A register that is read or written twice holds the same afterwards."""


class F4TRegisters:
    """One controller's line, and the settings `unit` and `word_order` of the bench file."""

    def __init__(self, place: Place) -> None:
        self._place = place
        settings = place.settings
        try:
            unit = int(settings.get("unit", 1))
            order = str(settings.get("word_order", LOW_FIRST))
            if unit not in UNITS or order not in (LOW_FIRST, HIGH_FIRST):
                raise ValueError(f"unit {unit}, word_order {order}")
        except (TypeError, ValueError) as error:
            raise self.wrong_settings(
                error, f"write unit as 1 to 247, and word_order as {LOW_FIRST} or {HIGH_FIRST}"
            ) from error
        self._low_first = order == LOW_FIRST
        self.line = ModbusLine(place, unit, FRAMING, REPEATABLE, ((HARDWARE, 2), (SERIAL, 2)))
        self.surely = PatientRegisters(self.line, REPEATABLE)

    def wrong_settings(self, error: Exception, do_now: str) -> InstrumentError:
        """Return the error of settings that are none."""
        return InstrumentError(
            self._place.name, "read the bench file", f"its settings are wrong ({error})", do_now
        )

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


def io_register(name: object) -> int:
    """Return the register of an input or output by `module.number`, as `2.1`; ValueError else."""
    module, _, number = str(name).partition(".")
    if not (module.isdecimal() and number.isdecimal()):
        raise ValueError(f"{name!r} is no module and number")
    if not (1 <= int(module) <= MOST and 1 <= int(number) <= MOST):
        raise ValueError(f"{name!r} is beyond module {MOST} or number {MOST}")
    return FIRST_IO + PER_MODULE * (int(module) - 1) + PER_IO * (int(number) - 1)
