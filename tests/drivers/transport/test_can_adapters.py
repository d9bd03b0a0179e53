"""CAN adapters of python-can: a driver on a virtual bus, SLCAN on a pseudo-terminal, addresses."""

from __future__ import annotations

import os
import sys
import threading
import tty
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import can
import pytest

from drivers.generic.can_pulse_board import CanPulseBoard
from drivers.transport.can_adapter import StampedTime
from drivers.transport.can_line import CanLine
from station.clock import RealClock
from station.errors import InstrumentError
from station.instruments.addresses import forms_of, why_unknown
from station.instruments.can_adapters import can_interfaces
from station.instruments.opening import InstrumentPlace
from station.roles.can_addresses import can_address


@contextmanager
def board_on(channel: str) -> Iterator[None]:
    """A pulse board that answers `identify` on a virtual bus."""
    closing = threading.Event()
    with can.Bus(interface="virtual", channel=channel) as bus:

        def answer() -> None:
            while not closing.is_set():
                message = bus.recv(0.02)
                if message is None or message.arbitration_id != 0x100:
                    continue
                command, ticket = message.data[0], bytes(message.data[6:8])
                acknowledgement = bytes([command, 0]) + ticket + bytes(4)
                identity = (1042).to_bytes(4, "little") + bytes([1, 2, 3, 3])
                for name, data in ((0x101, acknowledgement), (0x111, identity)):
                    bus.send(can.Message(arbitration_id=name, data=data, is_extended_id=False))

        thread = threading.Thread(target=answer)
        thread.start()
        try:
            yield
        finally:
            closing.set()
            thread.join()


def test_a_driver_speaks_to_its_board_on_a_virtual_bus() -> None:
    notes: list[tuple[str, dict[str, Any]]] = []

    def note(what: str, details: Mapping[str, Any]) -> None:
        notes.append((what, dict(details)))

    place = InstrumentPlace("gyro_acquisition", "can://virtual/room-3", RealClock(), noter=note)
    with board_on("room-3"):
        board = CanPulseBoard(place)
        try:
            assert board.identify().serial == "1042"
        finally:
            board.close()
    assert notes == [("can-time-stamps", {"of": "computer", "interface": "virtual"})]


class SlcanAdapter:
    """The far end of an SLCAN adapter's serial port: what it is sent, what it says."""

    def __init__(self) -> None:
        self.end, self._port = os.openpty()
        tty.setraw(self._port)
        tty.setraw(self.end)
        self.name = os.ttyname(self._port)
        self.heard = b""

    def read_until(self, wanted: bytes) -> None:
        while wanted not in self.heard:
            self.heard += os.read(self.end, 100)

    def close(self) -> None:
        os.close(self.end)
        os.close(self._port)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_frames_go_over_an_slcan_adapter_on_a_serial_port() -> None:
    adapter = SlcanAdapter()
    clock = RealClock()
    try:
        address = f"can://slcan/{adapter.name}?bitrate=250000&sleep_after_open=0"
        line = CanLine(InstrumentPlace("board", address, clock), {0x111: "SAMPLE"})
        try:
            line.send(0x100, b"\x01\x02")
            adapter.read_until(b"t10020102\r")
            os.write(adapter.end, b"t11130A0B0C\rt222101\r")
            (frame,) = line.wait_for(0x111, clock.now() + 5.0)
            assert (frame.identifier, frame.data) == (0x111, b"\x0a\x0b\x0c")
        finally:
            line.close()
        assert b"S5\r" in adapter.heard and b"O\r" in adapter.heard
    finally:
        adapter.close()


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("can://pcn/PCAN_USBBUS1", "with one of socketcan, pcan, kvaser"),
        ("can://pcan", "write can://pcan/CHANNEL"),
        ("can://pcan/0", "as channel of pcan is wrong"),
        ("can://pcan/PCAN_USBBUS1?bitrate=300000", "write one of 5000, 10000"),
        ("can://slcan//dev/ttyACM0?bitrate=800000", "write one of 10000, 20000"),
        ("can://slcan/ttyACM0", "as channel of slcan is wrong"),
        ("can://socketcan/can0?bitrate=500000", "has no setting 'bitrate'; it knows none"),
        ("can://kvaser/one", "as channel of kvaser is wrong"),
        ("can://kvaser/0?bitrate=2000000", "as bitrate of kvaser is wrong"),
        ("can://vector/0?app=x", "no setting 'app'; it knows bitrate"),
        ("can://ixxat/0?bitrate=1&bitrate=2", "twice"),
        ("can://ixxat/0?bitrate", "no list of settings"),
        ("can://udp_multicast/192.0.2.1", "is no multicast group"),
        ("can://socketcand/can0", "socketcand://host:port/channel"),
    ],
)
def test_a_wrong_can_address_is_refused_with_what_to_write(address: str, says: str) -> None:
    found = why_unknown(address)
    assert found is not None and says in found
    with pytest.raises(InstrumentError, match="in the bench file"):
        CanLine(InstrumentPlace("board", address, RealClock()), {})


@pytest.mark.parametrize(
    ("address", "settings", "stamps"),
    [
        ("can://socketcan/can0", {"channel": "can0"}, "kernel"),
        (
            "can://pcan/PCAN_USBBUS1?bitrate=250000",
            {"channel": "PCAN_USBBUS1", "bitrate": 250_000},
            "adapter",
        ),
        ("can://kvaser/1", {"channel": 1, "bitrate": 500_000}, "adapter"),
        (
            "can://vector/0?app_name=bench&serial=7",
            {"channel": 0, "bitrate": 500_000, "app_name": "bench", "serial": 7},
            "adapter",
        ),
        (
            "can://ixxat/0?unique_hardware_id=HW1",
            {"channel": 0, "bitrate": 500_000, "unique_hardware_id": "HW1"},
            "adapter",
        ),
        ("can://slcan/COM5", {"channel": "COM5", "tty_baudrate": 115_200}, "computer"),
        (
            "can://udp_multicast/ff15::1?port=5000",
            {"channel": "ff15::1", "port": 5000, "hop_limit": 1},
            "kernel",
        ),
    ],
)
def test_a_can_address_gives_the_settings_of_its_interface(
    address: str, settings: dict[str, Any], stamps: str
) -> None:
    assert why_unknown(address) is None
    read = can_address(address)
    assert (read.settings, read.stamps) == (settings, stamps)


def test_settings_of_an_adapter_make_no_other_bus() -> None:
    assert forms_of("can://kvaser/0?bitrate=250000") == forms_of("can://kvaser/0")
    assert forms_of("can://kvaser/0") != forms_of("can://kvaser/1")


def test_an_adapter_that_is_not_there_is_named() -> None:
    with pytest.raises(InstrumentError, match=r"nothing answers there .slcan: .*check the adapter"):
        CanLine(InstrumentPlace("board", "can://slcan//nowhere/ttyACM9", RealClock()), {})


def test_a_stamped_frame_came_before_it_was_taken() -> None:
    stamped = StampedTime()
    assert stamped.run_time(1000.0, 5.0) == pytest.approx(5.0)
    assert stamped.run_time(1001.0, 6.3) == pytest.approx(6.0)
    for k in range(10):  # the adapter's clock was set back by 100 s
        late = stamped.run_time(902.0 + k, 7.0 + k)
    assert late == pytest.approx(16.0)


def test_an_interface_that_hangs_or_crashes_costs_its_own_lines_only() -> None:
    detect = (
        "import os, sys, time\n"
        "if sys.argv[1] == 'pcan': time.sleep(60)\n"
        "if sys.argv[1] == 'kvaser': os.abort()\n"
        "print('[\"can0\"]')\n"
    )
    (pcan, hangs), (kvaser, fails), good = can_interfaces(
        ("pcan", "kvaser", "socketcan"), detect=detect, within_s=0.7
    )
    assert pcan == "can://pcan/CHANNEL" and "no answer in 0.7 s" in hangs
    assert kvaser == "can://kvaser/CHANNEL" and "fails" in fails
    assert good == ("can://socketcan/can0", "CAN interface socketcan")
