"""A nine-axis sensor as a run uses it: a KVH 1775 and a sensor on CAN, over their real lines."""

from __future__ import annotations

import numpy as np
import pytest
from fixture import recorded
from imu_fixture import FIELD_NT, FORCE_G, KINDS, LATENCY_S, STRETCH, Spindle, imu

from drivers.transport.serial_stream import Numbering
from station.errors import InputError, InstrumentError
from station.roles import Imu, SensorStatus

both = pytest.mark.parametrize("kind", KINDS)
FINEST = {"kvh": 1e-6, "can": 2.0**-15}


@both
def test_it_is_the_role_that_procedures_ask_for(kind: str) -> None:
    with imu(kind) as (_, driver):
        assert isinstance(driver, Imu)
        assert driver.identify().serial == "0"
        assert driver.status() == SensorStatus(())


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
        with pytest.raises(InputError, match="does not read 'field'"):
            driver.read_quantity("field")
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
