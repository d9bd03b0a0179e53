"""Nine-axis sensors as a run uses them, a KVH 1775 and one on CAN, over their real lines."""

from __future__ import annotations

import struct
from itertools import pairwise

import numpy as np
import pytest
from fixture import recorded
from imu_fixture import FIELD_NT, FORCE_G, KINDS, LATENCY_S, STRETCH, Spindle, imu
from navigator_fixture import RawLine, bitwise_crc

from drivers.transport.can_line import CanLine
from drivers.transport.can_messages import message_file
from drivers.transport.serial_stream import Numbering, crc32_mpeg2
from station.errors import InputError, InstrumentError
from station.roles import SensorStatus

both = pytest.mark.parametrize("kind", KINDS)
FINEST = {"kvh": 1e-6, "can": 2.0**-15}


@both
@pytest.mark.parametrize("rate_Hz", [10.0, 100.0])
def test_every_output_comes_in_the_roles_units_and_at_its_time(kind: str, rate_Hz: float) -> None:
    with imu(kind) as (fixture, driver):
        driver.start(rate_Hz)
        block = recorded(fixture, driver, 20.0)
        counter = block.columns["counter"].astype(float)
        assert counter.tolist() == list(range(1, len(counter) + 1))
        assert len(counter) == pytest.approx(20.0 * rate_Hz, abs=0.11 * rate_Hz)
        interval_s = STRETCH / rate_Hz
        assert f"every {1 / rate_Hz:.9g} s" in driver.columns["counter"]
        # The last output of a batch comes when it is made; the others wait for it.
        begin_s = block.arrival_time_s - LATENCY_S - counter * interval_s
        start_s = begin_s.min()
        assert np.ptp(begin_s) < 0.1
        middle_s = start_s + (counter - 0.5) * interval_s
        for axis, rate in zip("xyz", (1.0, -2.0, 3.0), strict=True):
            gyro = block.columns[f"gyro_{axis}_deg_per_s"]
            assert np.abs(gyro - rate - 0.001 * middle_s).max() < FINEST[kind] + 1e-6
        for k, axis in enumerate("xyz"):
            force = block.columns[f"accelerometer_{axis}_g"]
            assert force == pytest.approx(np.full(len(counter), FORCE_G[k]))
            field = block.columns[f"magnetometer_{axis}_nT"]
            assert np.isfinite(field).sum() == pytest.approx(len(counter) / 4, abs=1)
            assert field[np.isfinite(field)] == pytest.approx(FIELD_NT[k], rel=1e-6)
        warm = block.columns["temperature_degC"]
        read = np.isfinite(warm)
        assert np.abs(warm[read] - 20.0 - 0.01 * middle_s[read]).max() < 0.0051
        assert (
            driver.read_quantity("temperature") == fixture.newest("temperature") == warm[read][-1]
        )
        assert not block.columns["status"].any()


@both
def test_a_rate_beyond_the_range_is_cut_off_and_called_not_valid(kind: str) -> None:
    room = Spindle()
    room.turn(10.0, -500.0, 399.9985)
    with imu(kind, room=room) as (fixture, driver):
        driver.start(10.0)
        columns = recorded(fixture, driver, 4.0).columns
        assert columns["gyro_y_deg_per_s"] == pytest.approx(-400.0)
        status = columns["status"]
        assert (status[:5] == 0b010).all() and (status[-5:] == 0b110).all()


@both
def test_what_changes_on_the_bench_is_felt_in_the_next_output(kind: str) -> None:
    with imu(kind) as (fixture, driver):
        driver.start(10.0)
        fixture.clock.sleep(5.0)
        fixture.room.turn(50.0, 0.0, 0.0)
        gyro = recorded(fixture, driver, 5.0).columns["gyro_x_deg_per_s"]
        turned = gyro > 25.0
        assert not turned[:48].any() and turned[51:].all()


@both
def test_after_a_stop_nothing_comes_and_a_start_counts_from_one(kind: str) -> None:
    with imu(kind) as (fixture, driver):
        for rate_Hz in (10.0, 50.0):
            driver.start(rate_Hz)
            fixture.clock.sleep(3.0)
            driver.stop()
            assert driver.drain().columns["counter"][:2].tolist() == [1, 2]
            fixture.clock.sleep(3.0)
            assert not len(driver.drain())
            assert driver.read_quantity("temperature") is None


@both
def test_what_it_cannot_do_is_refused_before_anything_is_sent(kind: str) -> None:
    with imu(kind) as (fixture, driver):
        for rate_Hz in (0.0, 33.33, 5000.0):
            with pytest.raises(InputError, match="sample_rate"):
                driver.start(rate_Hz)
        assert not fixture.sent()


def test_a_sensor_that_is_off_says_so_on_can_and_nothing_on_its_own_line() -> None:
    room = Spindle()
    room.dut_powered = False
    with imu("can", room=room) as (_, driver):
        assert driver.status() == SensorStatus(("switched off",))
        with pytest.raises(InstrumentError, match="unit_off; switch the device under test on"):
            driver.start(10.0)
    with (
        imu("kvh", room=room) as (_, driver),
        pytest.raises(InstrumentError, match=r"no answer came within 0.5 s; check that the device"),
    ):
        driver.identify()


def test_a_kvh_that_outputs_tells_its_identity_without_a_gap() -> None:
    with imu("kvh") as (fixture, driver):
        assert driver.identify().firmware.startswith("ICB DSP Rev B Version: 104; ICB FPGA")
        driver.start(10.0)
        fixture.clock.sleep(5.0)
        assert driver.identify().serial == "0"
        counter = recorded(fixture, driver, 5.0).columns["counter"]
        assert (np.diff(counter.astype(int)) == 1).all()


def numbers_of(
    sent: list[int], arrival_s: np.ndarray, first: int = 100, block: int = 50
) -> list[int]:
    counting = Numbering(0.1, 128)
    found: list[int] = []
    for k in range(0, len(sent), block):
        sequence = np.array([(first + n) % 128 for n in sent[k : k + block]], dtype=np.uint8)
        numbers, new = counting.numbers(sequence, arrival_s[k : k + block])
        found += numbers[new].tolist()
    return found


@pytest.mark.parametrize("lost", [0, 1, 64, 127, 129, 200, 384, 1000])
@pytest.mark.parametrize("block", [1, 7, 1000])
def test_seven_bits_number_every_frame_whatever_is_lost(lost: int, block: int) -> None:
    """Arrivals are up to 2 s late by chance, and the sensor's clock is 0.1 % slow."""
    rng = np.random.default_rng(1)
    sent = [*range(1, 301), *range(301 + lost, 601 + lost)]
    arrival_s = np.maximum.accumulate(0.1001 * np.array(sent) + rng.exponential(0.2, len(sent)))
    found = numbers_of(sent, arrival_s, block=block)
    assert found[:300] == sent[:300]
    # After a loss of almost a round the first frames cannot be told from late ones.
    assert found[-250:] == sent[-250:]
    assert set(found) <= set(sent)


def test_frames_that_come_twice_or_late_are_left_out() -> None:
    sent = [1, 2, 3, 3, 4, 6, 7, 5, 8, 9]
    arrival_s = 0.1 * np.array([1, 2, 3, 3, 4, 6, 7, 7, 8, 9.0])
    assert numbers_of(sent, arrival_s) == [1, 2, 3, 4, 6, 7, 8, 9]


# What goes wrong on its line, or with itself.


@both
def test_a_silence_is_told_to_whoever_watches_the_temperature(kind: str) -> None:
    with imu(kind, {"fault": "silent", "at": "10 s"}) as (fixture, driver):
        driver.start(10.0)
        for _ in range(8):  # the temperature comes with every fourth output
            recorded(fixture, driver, 1.05)
        assert driver.read_quantity("temperature") is not None
        recorded(fixture, driver, 10.0)
        with pytest.raises(InstrumentError, match="no output came for"):
            driver.read_quantity("temperature")


def test_an_output_that_comes_late_is_left_out() -> None:
    entry = {"fault": "late", "command": "output", "nth": 50, "count": 1, "delay": "1.05 s"}
    with imu("kvh", entry) as (fixture, driver):
        driver.start(10.0)
        counter = recorded(fixture, driver, 20.0).columns["counter"].astype(int)
        assert sorted(set(np.diff(counter).tolist())) == [1, 2]


@both
def test_an_overloaded_gyro_is_at_its_range_and_not_valid(kind: str) -> None:
    with imu(kind, {"fault": "overload", "at": "5 s", "for": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        columns = recorded(fixture, driver, 15.0).columns
        bad = columns["status"] == 1
        assert bad.sum() == pytest.approx(50, abs=1)
        assert columns["gyro_x_deg_per_s"][bad] == pytest.approx(400.0)
        assert not columns["status"][~bad].any()


@both
def test_a_gyro_that_failed_its_test_is_told(kind: str) -> None:
    with imu(kind, {"fault": "gyro-fails", "at": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        assert recorded(fixture, driver, 10.0).columns["status"][-1] == 1
        (fault, *_) = driver.status().faults
        assert "gyro" in fault or "built-in test, byte 1, bit 0" in fault


@both
def test_a_frozen_sensor_repeats_its_last_values(kind: str) -> None:
    with imu(kind, {"fault": "frozen", "at": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        columns = recorded(fixture, driver, 10.0).columns
        assert np.ptp(columns["gyro_x_deg_per_s"][:45]) > 0.003
        assert np.ptp(columns["gyro_x_deg_per_s"][-45:]) == 0.0
        assert (np.diff(columns["counter"].astype(int)) == 1).all()


@both
def test_an_overheated_sensor_reads_warmer(kind: str) -> None:
    with imu(kind, {"fault": "overheating", "at": "5 s", "rise": "60 K"}) as (fixture, driver):
        driver.start(10.0)
        recorded(fixture, driver, 10.0)
        assert driver.read_quantity("temperature") == pytest.approx(80.1, abs=0.1)


# Byte by byte, read by their descriptions alone.


NINE_AXIS = "nine-axis-calibration"


def test_the_checksum_is_that_of_mpeg_2() -> None:
    assert crc32_mpeg2(b"123456789") == 0x0376E6E7  # the catalogue's check value
    for data in (b"abcd", bytes(range(256))):
        assert crc32_mpeg2(data) == bitwise_crc(data)


def test_a_kvh_streams_from_power_up_as_its_clients_expect() -> None:
    with imu("kvh") as (fixture, driver):
        driver.close()
        line = RawLine(fixture)
        try:
            line.write(b"=config,1\n=outputfmt,c\n=rotfmt,rate\n=rotunits,deg\n=dr,10\n")
            assert line.received[:4] == bytes.fromhex("FE8100AA")  # of the power-up, unasked
            answers = b"CONFIG,1\r\nOUTPUTFMT,C\r\nROTFMT,RATE\r\nROTUNITS,DEG\r\nDR,10\r\n"
            assert line.received[11:] == answers
            line.write(b"=config,0\n")
            fixture.clock.sleep(0.95)
            data = line.received  # CONFIG,0 is never answered
        finally:
            line.close()
        assert len(data) == 10 * 38
        frames = [data[k : k + 38] for k in range(0, len(data), 38)]
        further = {0: 20.0, 1: FIELD_NT[0] * 1e-5, 2: FIELD_NT[1] * 1e-5, 3: FIELD_NT[2] * 1e-5}
        sequences = []
        for frame in frames:
            assert frame[:4] == bytes.fromhex("FE81FF57")
            *values, status, sequence, crc = struct.unpack(">7fBBI", frame[4:])
            # 34 bytes: the padding of STIM300's checksum must not be added.
            assert crc == crc32_mpeg2(frame[:34])
            assert values[:3] == pytest.approx([1.0, -2.0, 3.0], abs=0.01)
            assert values[3:6] == pytest.approx(list(FORCE_G))
            assert values[6] == pytest.approx(further[sequence % 4], abs=0.02)
            assert status == 0x77
            sequences.append(sequence)
        assert [(b - a) % 128 for a, b in pairwise(sequences)] == [1] * 9


def test_the_message_file_and_the_sensor_agree_on_can() -> None:
    messages = message_file("nine_axis")
    with imu("can") as (fixture, driver):
        driver.close()
        names = {one.frame_id: one.name for one in messages.messages}
        line = CanLine(fixture.place(), names)
        try:
            command = messages.get_message_by_name("IMU_COMMAND")
            data = command.encode({"command": "start", "request_id": 7, "rate": 10.0})
            line.send(command.frame_id, data)
            fixture.clock.sleep(1.05)
            frames = line.take(*names)
        finally:
            line.close()
    ack, *rest = frames
    told = messages.decode_message(ack.identifier, ack.data)
    assert (told["result"], told["request_id"], told["rate"]) == ("ok", 7, 10.0)
    order = ["IMU_GYRO_XY", "IMU_GYRO_Z_ACC_X", "IMU_ACC_YZ", "IMU_FURTHER"]
    assert [names[one.identifier] for one in rest] == order * 10
    outputs = [messages.decode_message(one.identifier, one.data) for one in rest]
    assert [one["counter"] for one in outputs] == [k // 4 + 1 for k in range(40)]
    assert outputs[0]["gyro_y"] == pytest.approx(-2.0, abs=1e-3)
    assert outputs[1]["accelerometer_x"] == FORCE_G[0]
    assert outputs[2]["accelerometer_z"] == FORCE_G[2]
    assert outputs[3]["magnetometer_x"] == FIELD_NT[0]
    assert outputs[11]["magnetometer_z"] == FIELD_NT[2]
    assert outputs[15]["temperature"] == pytest.approx(20.0, abs=0.01)
