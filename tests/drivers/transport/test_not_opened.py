"""A line that cannot be opened: one sentence that says why, and what to do."""

from __future__ import annotations

import errno
import os
import pty
from collections.abc import Iterator

import pytest
import serial

from drivers.transport.ports import why_not_opened
from station import registry
from station.clock import RealClock
from station.errors import InstrumentError
from station.instruments.addresses import why_unknown
from station.instruments.opening import InstrumentPlace


@pytest.fixture
def port() -> Iterator[str]:
    """Yield the name of a pseudo-terminal, as a serial port."""
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def opened(driver: str, address: str, **settings: str) -> str:
    """Return what the driver says of an address that cannot be opened."""
    with pytest.raises(InstrumentError) as raised:
        registry.load(registry.DRIVERS, driver)(
            InstrumentPlace("multimeter", address, RealClock(), settings)
        )
    return str(raised.value)


def test_a_serial_port_that_is_missing() -> None:
    said = opened("thorlabs-sc10", "/dev/ttyUSB97")
    assert "this computer has no serial port /dev/ttyUSB97" in said
    assert "`station scan`" in said


def test_a_serial_port_in_use(port: str) -> None:
    with serial.serial_for_url(port, exclusive=True):
        said = opened("thorlabs-sc10", port)
    assert f"another program uses the serial port {port}" in said
    assert f"`fuser -v {port}`" in said


def test_a_serial_port_without_permission(port: str) -> None:
    found = why_not_opened(port, PermissionError(errno.EACCES, "Permission denied"))
    assert found is not None
    assert f"this user may not use the serial port {port}" in found[0]
    assert found[1].startswith("have an administrator run `usermod -aG ")


def test_a_group_that_is_not_known_is_the_usual_one() -> None:
    found = why_not_opened("/dev/none", PermissionError(errno.EACCES, "Permission denied"))
    assert found is not None
    assert "usermod -aG dialout USER" in found[1]


@pytest.mark.parametrize(
    ("address", "library", "why", "do_now"),
    [
        ("GPIB0::22::INSTR", "@py", "has no GPIB", "linux-gpib"),
        ("USB0::0x2A8D::0x0101::MY1::INSTR", "@py", "has no USB", "pyusb"),
        ("GPIB0::22::INSTR", "/nowhere/libvisa.so", "cannot be loaded", "install the maker's VISA"),
        ("GPIB0::22::INSTR", "@nowhere", "cannot be loaded", "install the maker's VISA"),
    ],
)
def test_a_visa_library_or_a_part_of_it_that_is_missing(
    address: str, library: str, why: str, do_now: str
) -> None:
    said = opened("keysight-34465a", address, visa_library=library)
    assert why in said
    assert do_now in said


def test_a_refused_connection_is_nobody_who_answers() -> None:
    refused = ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
    assert why_not_opened("socket://127.0.0.1:9", refused) is None
    assert why_not_opened("TCPIP::127.0.0.1::9::SOCKET", refused) is None


@pytest.mark.parametrize(
    "address",
    [
        "GPIB0::31::INSTR",
        "GPIB0::x::INSTR",
        "GPIB0::INSTR",
        "GPIB0::22::INSTRR",
        "USB0::0x2A8D::MY1::INSTR",
        "USB0::0x2A8D::0x0101::MY1::INST",
        "ASRL::INSTR",
        "ASRL/dev/ttyUSB0::INSR",
    ],
)
def test_a_malformed_resource_name_is_refused(address: str) -> None:
    why = why_unknown(address)
    assert why is not None and "is no whole VISA resource name; write it as" in why


@pytest.mark.parametrize(
    "address",
    [
        "GPIB0::22::INSTR",
        "gpib::5",
        "GPIB1::22::3::INSTR",
        "ASRL3::INSTR",
        "ASRLCOM3::INSTR",
        "ASRL/dev/ttyS0::INSTR",
        "USB0::0x2A8D::0x0101::MY1::INSTR",
        "USB::1234::5678::A22::0::INSTR",
    ],
)
def test_a_whole_resource_name_is_taken(address: str) -> None:
    assert why_unknown(address) is None
