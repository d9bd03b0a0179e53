"""What a chamber maker's program writes into a Watlow F4T: profiles, its clock, events."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from watlow_fixture import RawModbus, controller

FIRST, PER_STEP = 19094, 170
INSTANT, RAMP_TIME, RAMP_RATE, SOAK, JUMP, END = 1927, 1928, 81, 87, 116, 27
HOLD, OFF, ON, USER, NO_CHANGE = 47, 62, 63, 100, 1557
RUNNING, PAUSED, NOT_STARTED, COMPLETE, TERMINATED = 149, 146, 251, 252, 253
REFUSED = b"\x03"


class Program:
    """What ChamberConnectLibrary writes, register by register."""

    def __init__(self, line: RawModbus) -> None:
        self.line, self.clock = line, line._clock

    def put(self, address: int, *words: int) -> bytes:
        body = struct.pack(f">{len(words)}H", *words)
        return self.line.pdu(struct.pack(">BHHB", 16, address, len(words), len(body)) + body)

    def word(self, address: int) -> int:
        return self.line.words(address, 1)[0]

    def add(self, number: int, name: str, *steps: dict[str, float]) -> None:
        self.put(18888, number)
        self.put(18890, 1375)
        self.put(18606, *name.ljust(20, "\0").encode())
        for k, step in enumerate(steps):
            at = FIRST + PER_STEP * k
            assert self.put(at, int(step["type"]))[:1] == b"\x10"
            for offset, key in ((2, "hours"), (4, "minutes"), (6, "seconds"), (8, "jump_to")):
                if key in step:
                    self.put(at + offset, int(step[key]))
            if "jumps" in step:
                self.put(at + 10, int(step["jumps"]))
            if "rate" in step:
                self.line.put_number(at + 12, step["rate"])
            if "target" in step:
                self.line.put_number(at + 20, step["target"])
            if "end" in step:
                self.put(at + 76, int(step["end"]))
            if "event1" in step:
                self.put(at + 52, int(step["event1"]))

    def start(self, number: int, step: int = 1) -> bytes:
        self.put(16558, number)
        self.put(16560, step)
        return self.put(16562, 1782)

    def where(self) -> tuple[int, int, int]:
        return self.word(16568), self.word(16588), self.word(16590)


@contextmanager
def program() -> Iterator[tuple[Program, RawModbus]]:
    with controller("f4t") as fixture, fixture.line() as line:
        yield Program(line), line


def soak(hours: int = 0, minutes: int = 0, **more: float) -> dict[str, float]:
    return {"type": SOAK, "hours": hours, "minutes": minutes, **more}


def test_a_profile_is_read_as_it_was_written() -> None:
    with program() as (maker, line):
        maker.add(3, "WARM UP", {"type": INSTANT, "target": 40.0}, soak(1, 30), {"type": END})
        assert maker.word(18920) == 3
        assert bytes(line.words(16886 + 80, 20)).rstrip(b"\0") == b"WARM UP"
        assert bytes(line.words(18606, 20)).rstrip(b"\0") == b"WARM UP"
        assert line.number(FIRST + 20) == 40.0
        assert line.words(FIRST + PER_STEP + 2, 6)[::2] == (1, 30, 0)
        assert [maker.word(FIRST + PER_STEP * k) for k in range(4)] == [INSTANT, SOAK, END, 61]
        maker.put(18890, 1772)
        assert maker.word(18920) == 0


def test_steps_follow_one_another_at_their_times_though_nobody_looks() -> None:
    with program() as (maker, line):
        clock = maker.clock
        ramp = {"type": RAMP_TIME, "minutes": 10, "target": 60.0}
        maker.add(
            1,
            "A",
            {"type": INSTANT, "target": 20.0, "minutes": 5, "event1": ON},
            ramp,
            soak(minutes=20),
            {"type": RAMP_RATE, "rate": 2.0, "target": 20.0},
            {"type": END, "end": HOLD, "event1": OFF},
        )
        assert maker.where() == (NOT_STARTED, 0, 0)
        maker.start(1)
        assert maker.where() == (RUNNING, 1, 1) and maker.word(2814) == 10
        assert maker.word(16594) == ON and maker.word(33718 + 240 + 80) == ON
        clock.sleep(60.0)
        assert line.words(16622, 5)[::2] == (0, 4, 0)
        assert line.words(16570, 3)[::2] == (54, 0)
        clock.sleep(540.0)
        assert maker.where() == (RUNNING, 1, 2)
        assert line.number(2810) == pytest.approx(40.0, abs=0.1)
        clock.sleep(600.0)
        assert maker.where() == (RUNNING, 1, 3) and line.number(2810) == 60.0
        clock.sleep(1500.0)
        assert maker.where() == (RUNNING, 1, 4)
        assert line.number(2810) == pytest.approx(40.0, abs=0.2)
        clock.sleep(3600.0)
        assert maker.where() == (COMPLETE, 0, 0)
        assert line.number(2810) == line.number(2782) == 20.0
        assert maker.word(16594) == OFF


def test_the_loops_own_set_point_comes_back_after_the_profile() -> None:
    with program() as (maker, line):
        line.put_number(2782, 23.0)
        maker.add(1, "A", {"type": INSTANT, "target": 50.0}, soak(1), {"type": END, "end": USER})
        maker.start(1)
        assert (line.number(2782), line.number(2810)) == (23.0, 50.0)
        line.put_number(2782, 25.0)
        assert (line.number(2782), line.number(2810)) == (25.0, 50.0)
        maker.clock.sleep(3601.0)
        assert maker.word(16568) == COMPLETE and line.number(2810) == 25.0
        maker.start(1)
        maker.put(16566, 148)
        assert maker.where() == (TERMINATED, 0, 0) and line.number(2810) == 25.0
        assert maker.word(2814) == 10


def test_an_end_may_switch_the_loop_off() -> None:
    with program() as (maker, _):
        maker.add(1, "A", soak(minutes=1), {"type": END, "end": OFF})
        maker.start(1)
        assert maker.word(2814) == 10
        maker.clock.sleep(61.0)
        assert maker.word(2814) == OFF


def test_a_pause_stands_still_and_a_resume_goes_on() -> None:
    with program() as (maker, line):
        clock = maker.clock
        line.put_number(2782, 20.0)
        maker.add(1, "A", {"type": RAMP_TIME, "minutes": 10, "target": 60.0}, soak(1))
        maker.start(1)
        clock.sleep(300.0)
        assert maker.put(16564, 147) == b"\x90" + REFUSED
        maker.put(16566, 146)
        assert maker.where() == (PAUSED, 1, 1)
        clock.sleep(3600.0)
        assert line.number(2810) == pytest.approx(40.0, abs=0.1)
        assert line.words(16622, 5)[::2][1] in (4, 5)
        maker.put(16564, 147)
        clock.sleep(150.0)
        assert line.number(2810) == pytest.approx(50.0, abs=0.2)
        clock.sleep(160.0)
        assert maker.where() == (RUNNING, 1, 2)


def test_a_jump_repeats_so_many_times() -> None:
    with program() as (maker, _):
        maker.add(1, "A", soak(minutes=1), {"type": JUMP, "jump_to": 1, "jumps": 2}, {"type": END})
        maker.start(1)
        maker.clock.sleep(170.0)
        assert maker.where() == (RUNNING, 1, 1)
        maker.clock.sleep(15.0)
        assert maker.word(16568) == COMPLETE


def test_what_is_out_of_its_turn_is_refused_and_changes_nothing() -> None:
    with program() as (maker, _):
        assert maker.start(7) == b"\x90" + REFUSED, "it has no steps"
        assert maker.put(16566, 146) == b"\x90" + REFUSED, "nothing runs"
        assert maker.put(16566, 148)[:1] == b"\x10", "the driver terminates whatever is there"
        assert maker.put(16558, 41) == b"\x90" + REFUSED
        maker.add(1, "A", soak(1))
        assert maker.start(1, 2) == b"\x90" + REFUSED, "it has one step"
        assert maker.put(FIRST + 5 * PER_STEP, SOAK) == b"\x90" + REFUSED, "there is a gap"
        assert maker.put(FIRST, 1542) == b"\x90" + REFUSED, "no step that waits"
        assert maker.put(FIRST + 44, ON) == b"\x90" + REFUSED, "no guaranteed soak"
        assert maker.line.put_number(FIRST + 20, 181.0) == b"\x90" + REFUSED, "beyond its limits"
        maker.start(1)
        assert maker.start(1) == b"\x90" + REFUSED, "it runs"
        assert maker.put(FIRST + 2, 2) == b"\x90" + REFUSED, "it runs"
        assert maker.where() == (RUNNING, 1, 1) and maker.word(FIRST + 2) == 1


def test_the_clock_is_set_and_goes_on() -> None:
    with program() as (maker, line):
        for address, value in ((14664, 13), (14666, 5), (14668, 7), (14670, 6), (14672, 15)):
            assert maker.put(address, value)[:1] == b"\x10"
        assert maker.put(14674, 2027)[:1] == b"\x10"
        maker.clock.sleep(10.0)
        assert line.words(14664, 12)[::2] == (13, 5, 17, 6, 15, 2027)
        assert maker.put(14664, 24) == b"\x90" + REFUSED
        assert line.words(16536, 1) == (1540,) and line.words(6730, 1) == (15,)
