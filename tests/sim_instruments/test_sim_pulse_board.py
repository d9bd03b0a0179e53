"""The simulated pulse board on the CAN bus, decoded by the message file, and the gyro behind it."""

from __future__ import annotations

import socket
from typing import Any

import can
import numpy as np
import pytest
from sim_bench import Frames, Line, bench_with, counts, decoder, served

from sim_instruments.bench import SimulatedBench
from station.clock import Clock, RealClock, VirtualClock

START, STOP, IDENTIFY, STATUS = 1, 2, 3, 4
COUNTS_1, COUNTS_2, BOARD_STATUS, BOARD_IDENTITY = 0x121, 0x122, 0x110, 0x111


def test_the_message_file_describes_all_messages(bench: SimulatedBench) -> None:
    names = {message.name for message in decoder(bench).messages}
    assert names == {
        "BOARD_COMMAND",
        "BOARD_ACK",
        "BOARD_STATUS",
        "BOARD_IDENTITY",
        "GYRO_COUNTS_1",
        "GYRO_COUNTS_2",
        "GYRO_COUNTS_3",
    }
    assert all(message.comment for message in decoder(bench).messages)


def test_it_identifies_itself(bench: SimulatedBench, board: Frames) -> None:
    assert board.command(IDENTIFY) == 0
    identity = decoder(bench).decode_message(BOARD_IDENTITY, board.of(BOARD_IDENTITY)[0])
    assert identity["serial_number"] == 1042
    assert (identity["firmware_major"], identity["channel_count"]) == (1, 3)


def test_an_acknowledgement_echoes_the_request(bench: SimulatedBench, board: Frames) -> None:
    board.command(START, 1, 100.0, ticket=4711)
    acknowledgement = decoder(bench).decode_message("BOARD_ACK", board.of(0x101)[0])
    assert str(acknowledgement["command"]) == "start" and str(acknowledgement["result"]) == "ok"
    assert acknowledgement["request_id"] == 4711
    assert acknowledgement["sample_interval"] == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("mask", "interval_ms", "result"), [(1, 0.9, 2), (1, 10000.1, 2), (0, 100.0, 3), (8, 100.0, 3)]
)
def test_a_start_outside_the_limits_is_refused(
    board: Frames, clock: Clock, mask: int, interval_ms: float, result: int
) -> None:
    assert board.command(START, mask, interval_ms) == result
    clock.sleep(2.0)
    assert not board.of(COUNTS_1)
    assert board.of(BOARD_STATUS)[-1][5] & 1


def test_unknown_and_short_commands_are_refused(board: Frames, clock: Clock) -> None:
    assert board.command(99) == 1
    board.send(0x100, b"\x01\x01")
    clock.sleep(0.01)
    assert board.of(0x101)[-1][1] == 5


def test_a_running_board_must_be_stopped_before_it_is_started(board: Frames) -> None:
    assert board.command(START, 1, 100.0) == 0
    assert board.command(START, 1, 100.0) == 4
    assert board.command(STOP) == 0
    assert board.command(STOP) == 0
    assert board.command(START, 1, 50.0) == 0


def test_frames_come_at_the_end_of_each_interval_numbered_from_one(
    bench: SimulatedBench, board: Frames, clock: Clock
) -> None:
    board.command(START, 1, 100.0)
    clock.sleep(20.0)
    times = np.array([time_s for number, time_s, _ in board.received if number == COUNTS_1])
    np.testing.assert_array_equal(counts(board, bench)[:, 0], np.arange(1, times.size + 1))
    np.testing.assert_allclose(np.diff(times), 0.1, atol=3e-6)
    assert times[-1] - times[0] == pytest.approx((times.size - 1) * 0.1 * (1 - 8e-6), abs=5e-6)
    assert times.size in (199, 200)


def test_short_intervals_come_in_batches_and_none_is_missing(
    bench: SimulatedBench, board: Frames, clock: Clock
) -> None:
    board.command(START, 1, 1.0)
    clock.sleep(70.0)
    sequence = counts(board, bench)[:, 0].astype(int)
    assert sequence.size >= 69_900
    np.testing.assert_array_equal(sequence, np.arange(1, sequence.size + 1) % 65536)


def test_no_frames_come_after_a_stop_and_a_start_begins_at_zero(
    bench: SimulatedBench, board: Frames, clock: Clock
) -> None:
    bench.act("dut-power-on")
    board.command(START, 1, 100.0)
    clock.sleep(60.0)
    board.command(STOP)
    seen = len(board.of(COUNTS_1))
    clock.sleep(5.0)
    assert len(board.of(COUNTS_1)) == seen
    board.command(START, 1, 100.0)
    clock.sleep(0.35)
    again = counts(board, bench)[seen:]
    assert again[0, 0] == 1 and abs(again[0, 1]) < 20 < abs(counts(board, bench)[seen - 1, 1])


def test_a_channel_without_a_gyro_counts_nothing(
    bench: SimulatedBench, board: Frames, clock: Clock
) -> None:
    bench.act("dut-power-on")
    board.command(START, 3, 100.0)
    clock.sleep(10.0)
    assert len(board.of(COUNTS_2)) == len(board.of(COUNTS_1))
    last = decoder(bench).decode_message(COUNTS_2, board.of(COUNTS_2)[-1])
    assert last["counts"] == 0 and last["temperature"] == pytest.approx(-327.68)


def test_the_status_tells_of_the_gyro_and_the_acquisition(
    bench: SimulatedBench, board: Frames, clock: Clock
) -> None:
    def status() -> Any:
        return decoder(bench).decode_message(BOARD_STATUS, board.of(BOARD_STATUS)[-1])

    board.command(STATUS)
    assert str(status()["running"]) == "stopped" and status()["laser_on"] == 0
    bench.act("dut-power-on")
    board.command(START, 1, 100.0)
    clock.sleep(10.0)
    board.command(STATUS)
    assert str(status()["running"]) == "running" and status()["laser_on"] == 1
    assert status()["gyro_present"] == 1 and status()["channel_mask"] == 1
    assert status()["sample_counter"] == len(board.of(COUNTS_1))
    assert len(board.of(BOARD_STATUS)) == pytest.approx(12, abs=1)


def everything_received(seed: int) -> list[tuple[int, float, bytes]]:
    clock = VirtualClock()
    with served(clock, bench_with(seed=seed)) as bench, Frames(bench, clock) as board:
        bench.act("dut-power-on")
        board.command(START, 1, 50.0)
        with Line(bench, "coil_supply.y", clock) as supply:
            supply.ask("FUNC:MODE CURR;:VOLT 30;:OUTP ON;*OPC?")
            for step in range(20):
                supply.ask(f"CURR {step / 10};*OPC?")
                clock.sleep(0.7)
        board.command(STOP)
        return board.received


def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not() -> None:
    first, second, other = everything_received(3), everything_received(3), everything_received(4)
    assert first == second
    assert first != other


def test_looking_ahead_changes_no_sample(clock: Clock) -> None:
    """A change that changes nothing (the same current again) must leave all samples alone."""

    def acquire(disturbed: bool) -> list[bytes]:
        clock = VirtualClock()
        with served(clock) as bench, Frames(bench, clock) as board:
            bench.act("dut-power-on")
            board.command(START, 1, 100.0)
            for _ in range(30):
                clock.sleep(1.03)
                if disturbed:
                    bench._world.version += 1
            return board.of(COUNTS_1)

    assert acquire(False) == acquire(True)


def test_python_can_reads_it_in_real_time() -> None:
    with served(RealClock()) as simulation:
        entry = simulation.instruments["gyro_acquisition"]
        database = decoder(simulation)
        with can.Bus(
            interface="socketcand",
            host=entry["host"],
            port=entry["port"],
            channel=entry["channel"],
        ) as bus:
            start = database.encode_message(
                "BOARD_COMMAND",
                {"command": 1, "channel_mask": 1, "sample_interval": 20.0, "request_id": 5},
            )
            bus.send(can.Message(arbitration_id=0x100, data=start, is_extended_id=False))
            seen = []
            while "GYRO_COUNTS_1" not in seen:
                message = bus.recv(3.0)
                assert message is not None
                seen.append(database.get_message_by_frame_id(message.arbitration_id).name)
            assert "BOARD_ACK" in seen


def test_the_wrong_channel_is_refused(bench: SimulatedBench) -> None:
    entry = bench.instruments["gyro_acquisition"]
    with socket.create_connection((entry["host"], entry["port"]), 2.0) as client:
        assert client.recv(256) == b"< hi >"
        client.sendall(b"< open can7 >")
        assert client.recv(256).startswith(b"< error")


def test_two_clients_both_get_the_frames() -> None:
    clock = RealClock()
    with served(clock) as simulation, Frames(simulation, clock) as first:
        with Frames(simulation, clock) as second:
            first.command(START, 1, 20.0)
            clock.sleep(0.5)
            assert second.of(COUNTS_1) and second.of(0x101)
        assert first.of(COUNTS_1)
