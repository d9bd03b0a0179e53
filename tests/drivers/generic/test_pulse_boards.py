"""The pulse boards on CAN and on a serial line."""

from __future__ import annotations

import numpy as np
import pytest
from fixture import taken
from navigator_fixture import bitwise_crc
from variants import variant

from drivers.generic.can_pulse_board import CanPulseBoard
from drivers.generic.serial_pulse_board import OUTPUT, frame
from sim_instruments.wire.frames import crc32
from station.clock import VirtualClock
from station.conformance.faulty_server import FaultyServer
from station.errors import InstrumentError
from station.instruments.opening import InstrumentPlace

BOARD = ("gyro_acquisition", "rlg-magnetic-sensitivity", "sim-alternate")


def on_the_bus(identifier: int, data: bytes) -> bytes:
    return f"< frame {identifier:03X} 0.000000 {data.hex()} >".encode()


def acknowledgement(command: int, result: int, request: int) -> bytes:
    return on_the_bus(0x101, bytes([command, result, request & 255, request >> 8, 0, 0, 0, 0]))


ODD_ANSWERS = {
    "short frame": (on_the_bus(0x101, b"\x03"), "101#03 is none of its messages"),
    "refused": (acknowledgement(3, 2, 1), "refused with bad_interval"),
    "unknown refusal": (acknowledgement(3, 77, 1), "refused with 77"),
    "identity missing": (acknowledgement(3, 0, 1), "no identity came"),
    "another's answer": (acknowledgement(3, 0, 9), "no acknowledgement came"),
    "other traffic": (on_the_bus(0x555, b"\x01") * 50, "no acknowledgement came"),
}


@pytest.mark.parametrize("kind", ODD_ANSWERS)
def test_a_board_on_can_that_answers_oddly_is_reported(kind: str, clock: VirtualClock) -> None:
    answer, states = ODD_ANSWERS[kind]
    with clock.participant("test"), FaultyServer(clock, lambda _: answer, can=True) as server:
        address = f"socketcand://127.0.0.1:{server.port}/can0"
        board = CanPulseBoard(InstrumentPlace("gyro_acquisition", address, clock))
        with pytest.raises(InstrumentError, match=states):
            board.identify()
        board.close()
    clock.stop()


def test_the_checksum_covers_bytes_that_are_not_sent() -> None:
    for payload in (b"", b"\x00", bytes(range(20))):
        data = bytes((OUTPUT,)) + payload
        assert frame(OUTPUT, payload)[-4:] == crc32(data).to_bytes(4, "big")
        assert crc32(data) == bitwise_crc(data)


def test_counts_go_on_beyond_their_24_bits_and_say_how_long_they_were_on_their_way() -> None:
    fine = {"gyro": {"pulse_weight": "0.00001 arcsec"}}
    with variant(*BOARD, world=fine) as here:
        board = here.driver()
        board.start(0.1, 1)
        rows = taken(here.fixture, board, 60.0)
        steps = np.diff(rows["counts"].astype(np.int64))
        assert abs(int(rows["counts"][-1])) > 2**24
        assert np.abs(steps - np.median(steps)).max() < 0.4 * abs(np.median(steps))
        assert rows["latency_s"] == pytest.approx(1.5e-3, abs=2e-6)


def test_a_gyro_that_goes_dark_is_told_by_its_samples() -> None:
    with variant(*BOARD, {"fault": "dark", "at": "5 s"}) as here:
        board = here.driver()
        board.start(0.1, 1)
        with pytest.raises(InstrumentError, match="record channel 1: the board sees no lit gyro"):
            taken(here.fixture, board, 10.0)
