"""Watlow controllers as other programs use them: whole frames, blocks of registers."""

from __future__ import annotations

import struct

from sim_bench import Line
from watlow_fixture import NAME, Fixture, controller


def crc(data: bytes) -> bytes:
    """Return the check of a Modbus RTU frame."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return struct.pack("<H", value)


class RawRtu(Line):
    """A raw client of Modbus RTU."""

    def __init__(self, fixture: Fixture) -> None:
        super().__init__(fixture, NAME, fixture.clock)  # type: ignore[arg-type]

    def pdu(self, request: bytes) -> bytes:
        """Send a request in a frame and return the answer out of its frame."""
        frame = b"\x01" + request
        answer = self.raw_ask(frame + crc(frame))
        assert answer[:1] == b"\x01" and crc(answer[:-2]) == answer[-2:]
        return answer[1:-2]

    def words(self, address: int, count: int) -> tuple[int, ...]:
        """Read registers."""
        answer = self.pdu(struct.pack(">BHH", 3, address, count))
        assert answer[:2] == bytes([3, 2 * count]), answer.hex()
        return struct.unpack(f">{count}H", answer[2:])


def test_an_f4_of_a_chamber_shows_its_clock_and_the_names_of_its_profiles() -> None:
    with controller("f4") as fixture, RawRtu(fixture) as line:
        fixture.clock.sleep(3723.0)
        assert line.words(1916, 6) == (1, 2, 3, 1, 1, 2026)
        request = struct.pack(">BHH", 6, 1917, 30)
        assert line.pdu(request) == request and line.words(1916, 3) == (1, 30, 3)
        assert line.pdu(struct.pack(">BHH", 6, 1919, 13)) == b"\x86\x03"
        assert line.words(3500 + 10 * 39, 10) == (32,) * 10
        assert line.words(200, 1) == (0,)
        assert line.pdu(struct.pack(">BHH", 3, 3900, 10)) == b"\x83\x02"


def test_an_f4p_has_a_slidewire_there_and_no_profiles() -> None:
    with controller("f4", map="f4p") as fixture, RawRtu(fixture) as line:
        assert line.words(1916, 6) == (0,) * 6 and line.words(200, 1) == (1,)
        assert line.pdu(struct.pack(">BHH", 6, 1217, 1)) == b"\x86\x02"


def test_the_level_at_which_an_input_is_active_changes_no_wire() -> None:
    with controller("f4", door_input=1) as fixture, RawRtu(fixture) as line:
        assert line.words(1061, 1) == (1,) and line.words(201, 1) == (1,)
        request = struct.pack(">BHH", 6, 1061, 0)
        assert line.pdu(request) == request
        assert line.words(1061, 1) == (0,) and line.words(201, 1) == (1,)
        assert line.pdu(struct.pack(">BHH", 6, 1061, 2)) == b"\x86\x03"


def test_an_f4t_shows_its_clock_in_every_second_register_and_keeps_a_manual_power() -> None:
    with controller("f4t") as fixture, fixture.line() as line:
        fixture.clock.sleep(59.0)
        assert line.words(14664, 12)[::2] == (0, 0, 59, 1, 1, 2026)
        assert line.put_number(2784, -12.5)[:1] == b"\x10"
        assert line.number(2784) == -12.5 and line.number(2808) == 0.0
        assert line.put_number(2784, 101.0) == b"\x90\x03"
