"""The nine-axis sensors' messages on the wire, read by their descriptions alone."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import pytest
import yaml
from conformance_runs import conformance
from imu_fixture import FIELD_NT, FORCE_G, KINDS, NAME, bench_of, imu
from navigator_fixture import RawLine, bitwise_crc

from drivers.transport.can_line import CanLine
from drivers.transport.can_messages import message_file
from drivers.transport.serial_stream import crc32_mpeg2

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


@pytest.mark.parametrize("kind", KINDS)
def test_our_drivers_conform_in_the_sensors_own_world(kind: str, tmp_path: Path) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(yaml.safe_dump(bench_of(kind)), encoding="utf-8")
    driver = "kvh-1775" if kind == "kvh" else "can-imu"
    done = conformance(tmp_path, driver, str(bench), "--station-procedure", NINE_AXIS)
    assert done.returncode == 0, done.stdout
    assert "test_sampled_source" in done.stdout and NAME in bench.read_text(encoding="utf-8")
