"""A KVH 1775 as its interface control document has it: modes, settings that stay, what is refused.

Strangers are raw clients on the line; the driver meets units that somebody else has set up.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

import pytest
from fixture import Fixture, recorded, standing
from imu_fixture import FORCE_G, TRUTH, Spindle, imu
from navigator_fixture import RawLine

from drivers.transport.serial_stream import ends_with_its_crc
from sim_instruments.kvh.imu_1775 import Kvh1775 as SimulatedKvh
from sim_instruments.truth import SimulationError
from station.errors import InstrumentTimeout

Say = Callable[[bytes], bytes]


@contextmanager
def stranger(**truth: object) -> Iterator[Say]:
    """Speak to a unit as a client of its own; a line gives what comes within a tenth of a second.

    The built-in test of the power-up is over.
    """
    with imu("kvh", **truth) as (fixture, driver):
        driver.close()
        line = RawLine(fixture)

        def say(data: bytes) -> bytes:
            line.write(data)
            return line.received

        say(b"=config,1\n")
        try:
            yield say
        finally:
            line.close()


def test_a_bad_line_is_answered_in_configuration_mode_alone() -> None:
    with stranger() as say:
        assert say(b"?hello\r") == b"INVALID,?HELLO\r\n"
        assert say(b"=dr,33\r\n").startswith(b"ERROR")
        assert say(b"=dr\n").startswith(b"USAGE")
        assert say(b"=axes,1,2\n").startswith(b"ERROR")
        assert say(b"?config\n") == b"CONFIG,1\r\n"
        assert say(b"?bit\n").startswith(b"INVALID")
        say(b"=msync,ext\n")
        assert say(b"=config,0\n?hello\n?dr\n?config\n") == b""


def test_it_says_what_it_is_in_five_lines() -> None:
    with stranger() as say:
        lines = say(b"?ws\n").decode().splitlines()
        assert lines[0] == "1775 IMU" and len(lines) == 5
        assert [line.split(" Rev")[0] for line in lines[1:]] == [
            "ICB DSP",
            "ICB FPGA",
            "GCB DSP",
            "GCB FPGA",
        ]


def test_settings_are_those_of_the_maker_until_somebody_changes_them() -> None:
    with stranger() as say:
        for name, value in (
            ("OUTPUTFMT", "A"),
            ("ROTFMT", "DELTA"),
            ("ROTUNITS", "RAD"),
            ("DR", "1000"),
            ("TEMPUNITS", "C"),
            ("LINFMT", "ACCEL"),
            ("FILTEN", "1"),
            ("FILTTYPE,A", "CHEBY"),
            ("MSYNC", "IMU"),
            ("BAUD", "921600"),
        ):
            assert say(f"?{name}\n".encode()) == f"{name},{value}\r\n".encode()
        assert say(b"?axes\n").startswith(b"AXES,+1.000000E+00,+0.000000E+00,")
        for rate in (1, 5, 25, 3600, 5000):
            assert say(f"=DR,{rate}\n".encode()) == f"DR,{rate}\r\n".encode()
        say(b"=msync,ext\n")
        assert say(b"=msync,imu\n?filttype,g\n") == b"MSYNC,IMU\r\nFILTTYPE,G,AVE\r\n"
        assert say(b"=rstcfg\n") == b"RSTCFG\r\n"
        assert say(b"?dr\n") == b"DR,1000\r\n"


def test_a_restart_begins_with_the_built_in_test_and_keeps_the_settings() -> None:
    with stranger() as say:
        say(b"=dr,10\n")
        data = say(b"=restart\n")
        assert data[:4] == bytes.fromhex("FE8100AA") and data[10] == sum(data[:10]) % 256
        say(b"=config,1\n")
        assert say(b"?dr\n") == b"DR,10\r\n"


def test_the_built_in_test_comes_after_data() -> None:
    with stranger() as say:
        say(b"=dr,100\n")
        data = say(b"=config,0\n") + say(b"?bit\n") + say(b"?bit,2\n") + say(b"")
        assert data.count(bytes.fromhex("FE8100AA")) == 1
        begin = data.index(bytes.fromhex("FE8100AA"))
        assert begin and begin % 36 == 0 and data[begin - 36 :][:4] == bytes.fromhex("FE81FF55")
        long = data[data.index(bytes.fromhex("FE8100AB")) :][:13]
        assert long[12] == sum(long[:12]) % 256


def test_frames_of_format_a_have_angles_in_radians_and_whole_degrees() -> None:
    with stranger() as say:
        say(b"=dr,50\n=axes,0,1,0,1,0,0,0,0,-1\n=linfmt,delta\n=tempunits,f\n")
        data = say(b"=config,0\n") + say(b"")
        gyro = struct.unpack_from(">3f", data, 4)
        assert gyro == pytest.approx([-6.981e-4, 3.49e-4, -1.0472e-3], rel=1e-3)
        force = struct.unpack_from(">3f", data, 16)
        axes = (FORCE_G[1], FORCE_G[0], -FORCE_G[2])
        assert force == pytest.approx([one * 9.80665 / 50 for one in axes])
        assert data[28] == 0x77 and struct.unpack_from(">h", data, 30) == (68,)


@contextmanager
def stranger_of_a_spindle() -> Iterator[tuple[Fixture, Spindle, RawLine]]:
    """Be on the line of a unit that is switched off, and say nothing."""
    spindle = Spindle()
    spindle.dut_powered = False
    with standing("imu", SimulatedKvh, TRUTH, spindle) as fixture:
        line = RawLine(fixture)
        try:
            yield fixture, spindle, line
        finally:
            line.close()


def test_a_unit_that_is_switched_on_streams_unasked_its_built_in_test_first() -> None:
    with stranger_of_a_spindle() as (fixture, spindle, line):
        fixture.clock.sleep(5.0)
        assert line.received == b""
        spindle.dut_powered = True
        fixture.clock.sleep(1.5)
        assert line.received.startswith(bytes.fromhex("FE8100AA"))
        assert line.received[11:15] == bytes.fromhex("FE81FF55")


def test_an_echo_counts_or_takes_a_number_and_is_forgotten() -> None:
    with stranger() as say:
        assert say(b"=echo\n?echo\n") == b"ECHO,1\r\nECHO,2\r\n"
        assert say(b"=ECHO,7\n=echo\n") == b"ECHO,7\r\nECHO,8\r\n"
        assert say(b"=echo,reset\n") == b"ECHO,0\r\n"
        assert say(b"=echo,x\n").startswith(b"ERROR")
        say(b"=echo,7\n=restart\n=config,1\n")
        assert say(b"?echo\n") == b"ECHO,1\r\n"


def test_it_answers_its_temperature_in_the_units_that_are_set_and_lists_its_commands() -> None:
    with stranger() as say:
        assert say(b"?temp\n").startswith(b"TEMP,20.")
        say(b"=tempunits,f_100\n")
        assert say(b"?temp\n").startswith(b"TEMP,68")
        assert b"?AXES\r\n" in say(b"=help\n")


def test_the_factory_settings_leave_the_baud_rate() -> None:
    with stranger() as say:
        assert say(b"=baud,4147200\n=rstcfg\n?baud\n").endswith(b"BAUD,4147200\r\n")


def test_frames_of_format_b_have_a_time_stamp() -> None:
    with stranger() as say:
        say(b"=dr,50\n=outputfmt,b\n")
        data = say(b"=config,0\n") + say(b"")
        frames = [data[k : k + 40] for k in range(0, len(data) - 39, 40)]
        assert len(frames) > 2
        assert all(frame[:4] == bytes.fromhex("FE81FF56") for frame in frames)
        stamps = [struct.unpack_from(">I", frame, 28)[0] for frame in frames]
        assert [after - before for before, after in pairwise(stamps)] == [20000] * (len(stamps) - 1)
        assert frames[0][32] == 0x77 and struct.unpack_from(">h", frames[0], 34) == (20,)
        assert all(ends_with_its_crc(frame) for frame in frames)


def test_no_unit_is_made_with_a_setting_that_it_does_not_have() -> None:
    with (
        pytest.raises(SimulationError, match=r"settings\.DR: it has no such value"),
        imu("kvh", settings={"DR": "33"}),
    ):
        pass


def test_a_driver_opens_a_unit_that_streams_in_any_format() -> None:
    for left in ("A", "B", "C"):
        with imu("kvh", settings={"OUTPUTFMT": left}) as (fixture, driver):
            fixture.clock.sleep(3.0)
            assert len(fixture.heard) > 5
            assert driver.identify().model == "1775"
            assert not any(direction == "!" for direction, _ in fixture.heard)


LEFT = [
    {},
    {"OUTPUTFMT": "B", "ROTFMT": "RESET", "TEMPUNITS": "F_100", "DR": "5000"},
    {"MSYNC": "EXT", "LINFMT": "DELTA", "LINUNITS": "FEET", "FILTEN": "0"},
    {"AXES": "0,1,0,1,0,0,0,0,-1", "ROTUNITS": "DEG", "FILTTYPE,G": "BUTTER"},
]


@pytest.mark.parametrize("left", LEFT)
def test_a_unit_outputs_in_the_roles_units_and_is_left_as_it_was(left: dict[str, str]) -> None:
    with imu("kvh", settings=left) as (fixture, driver):
        before = dict(fixture.simulator._settings)
        driver.start(10.0)
        columns = recorded(fixture, driver, 4.0).columns
        assert columns["counter"][:3].tolist() == [1, 2, 3]
        assert columns["gyro_y_deg_per_s"] == pytest.approx(-2.0, abs=0.01)
        assert columns["accelerometer_x_g"] == pytest.approx(FORCE_G[0])
        assert driver.read_quantity("temperature") == pytest.approx(20.0, abs=0.1)
        driver.stop()
        driver.kept.put_back()
        after = dict(fixture.simulator._settings)
        assert after == before


def test_the_built_in_test_is_asked_of_a_unit_that_is_quiet() -> None:
    with imu("kvh") as (fixture, driver):
        driver.start(10.0)
        fixture.clock.sleep(3.0)
        driver.stop()
        assert driver.status().faults == ()
        rows = driver.drain()
        assert rows.columns["counter"].tolist() == list(range(1, len(rows) + 1))
        assert 25 < len(rows) < 32
        fixture.clock.sleep(3.0)
        assert not len(driver.drain())


def test_a_unit_that_does_not_stream_after_its_configuration_is_noticed() -> None:
    fault = {"fault": "silent", "at": "0 s"}
    with imu("kvh", fault) as (_, driver), pytest.raises(InstrumentTimeout, match="no output came"):
        driver.start(10.0)


def test_a_built_in_test_that_is_not_answered_is_no_good_one() -> None:
    fault = {"fault": "lost-frame", "command": "command ?bit"}
    states = "no built-in test came within 0.5 s"
    with imu("kvh", fault) as (fixture, driver):
        fixture.clock.sleep(2.0)  # that of the power-up is over
        with pytest.raises(InstrumentTimeout, match=states):
            driver.status()
