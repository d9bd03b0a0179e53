"""The same plan gives the same bytes, and whoever hangs is named before anybody gives up."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from campaign_helpers import (
    STREAM_PERIODS_S,
    file_hashes,
    four_streams,
    raw_content,
    whole_events,
)

from station.clock import ClockError, ClockStopped, VirtualClock
from station.clock import virtual as watchdog_module


@pytest.fixture(scope="module")
def repetitions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    parent = tmp_path_factory.mktemp("streams")
    return [four_streams(parent / str(number), duration_s=30.0) for number in range(3)]


def test_four_streams_and_two_watchers_leave_the_same_bytes_every_time(
    repetitions: list[Path],
) -> None:
    assert len({tuple(file_hashes(folder).items()) for folder in repetitions}) == 1


def test_no_stream_loses_a_sample_while_others_ask_the_instruments(repetitions: list[Path]) -> None:
    for name, period_s in STREAM_PERIODS_S.items():
        content = raw_content(repetitions[0] / "raw" / f"{name}-000.mcap")
        sequence = [number for rows in content.rows["all"] for number in rows["sequence"].tolist()]
        assert not content.cut
        assert sequence == list(range(sequence[0], sequence[0] + len(sequence)))
        assert len(sequence) == pytest.approx(30.0 / period_s, abs=2.0 / period_s)


def test_the_watchers_kept_their_periods(repetitions: list[Path]) -> None:
    events = whole_events(repetitions[0])
    for kind, period_s in {"current": 0.2, "gaussmeter": 0.3}.items():
        times = [event["t_s"] for event in events if event["event"] == kind]
        steps = [later - earlier for earlier, later in pairwise(times)]
        assert len(times) > 50
        assert min(steps) == pytest.approx(period_s)
        assert max(steps) < 2 * period_s


def test_another_seed_gives_other_bytes(repetitions: list[Path], tmp_path: Path) -> None:
    other = file_hashes(four_streams(tmp_path, seed=2, duration_s=5.0))
    assert other["gyro.a-000.mcap"] != file_hashes(repetitions[0])["gyro.a-000.mcap"]


def test_a_deadlock_is_told_within_ten_seconds() -> None:
    last_look_s = watchdog_module.HANGS_AFTER_S + 2 * watchdog_module.LOOKS_EVERY_S
    assert last_look_s + watchdog_module.ENDS_AFTER_S < 10


def test_a_deadlock_names_who_holds_what(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog_module, "HANGS_AFTER_S", 0.6)
    monkeypatch.setattr(watchdog_module, "LOOKS_EVERY_S", 0.1)
    clock = VirtualClock()
    supply, gaussmeter = clock.lock("the supply"), clock.lock("the gaussmeter")

    def interlocks() -> None:
        with gaussmeter:
            clock.sleep(1.0)
            with supply:
                pass

    with clock.participant("run"), pytest.raises(ClockError) as caught:
        thread = clock.start("interlocks", interlocks)
        with supply:
            clock.sleep(2.0)
            with gaussmeter:
                pass
    assert "run is waiting for the gaussmeter, which interlocks holds" in str(caught.value)
    assert "interlocks is waiting for the supply, which run holds" in str(caught.value)
    with pytest.raises(ClockError, match="time stands still"):
        thread.join(5.0)


def test_a_stopped_thread_leaves_the_queue_of_a_lock() -> None:
    clock = VirtualClock()
    line = clock.lock("the line")

    def waits() -> None:
        clock.sleep(1.0)
        with line:
            raise AssertionError("it was stopped before its turn came")

    with clock.participant("run"):
        with line:
            threads = [clock.start(name, waits) for name in ("first", "second")]
            clock.sleep(2.0)
            clock.stop()
            for thread in threads:
                thread.join(5.0)
        with line:
            pass
    assert not any(thread.alive for thread in threads)


STUCK = """
import ctypes, sys, threading
from station.clock import ClockError, VirtualClock
from station.clock import virtual as watchdog
from station.control.signals import AbortSignals

watchdog.HANGS_AFTER_S, watchdog.LOOKS_EVERY_S, watchdog.ENDS_AFTER_S = 0.6, 0.1, 0.5

def lock_of_the_system():
    lock = threading.Lock()
    lock.acquire()
    lock.acquire()

def read_that_nothing_answers():
    import socket
    first, second = socket.socketpair()
    first.recv(1)

def lock_of_a_library():
    mutex = ctypes.create_string_buffer(256)
    library = ctypes.CDLL(None)
    library.pthread_mutex_lock(mutex)
    library.pthread_mutex_lock(mutex)

clock = VirtualClock()
safe = False
with clock.participant("run"), AbortSignals(clock) as signals:
    try:
        clock.start("interlocks", lambda: clock.sleep(100.0))
        clock.sleep(1.0)
        {where}()
    except ClockError as error:
        safe = True
    signals.hold()
print("made safe" if safe else "not told")
sys.exit(3)
"""


def stuck_in(where: str) -> subprocess.CompletedProcess[str]:
    code = STUCK.replace("{where}", where)
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, encoding="utf-8", timeout=60
    )


@pytest.mark.skipif(sys.platform == "win32", reason="no signal reaches a stuck thread there")
@pytest.mark.parametrize("where", ["lock_of_the_system", "read_that_nothing_answers"])
def test_a_main_thread_stuck_in_the_system_is_woken_and_told(where: str) -> None:
    done = stuck_in(where)
    assert done.returncode == 3
    assert "time stands still" in done.stderr
    assert "run is stuck" in done.stderr
    assert f"in {where}" in done.stderr
    assert "interlocks is sleeping until 100 s" in done.stderr
    assert done.stdout.strip() == "made safe"


@pytest.mark.skipif(sys.platform == "win32", reason="it needs a library that Windows lacks")
def test_a_main_thread_that_nothing_wakes_ends_with_its_process() -> None:
    done = stuck_in("lock_of_a_library")
    assert done.returncode == 3
    assert "time stands still" in done.stderr
    assert "the process ends" in done.stderr
    assert done.stdout == ""


def test_a_stopped_clock_ends_a_thread_that_waits_for_an_answer() -> None:
    clock = VirtualClock()
    wire = clock.wire("nobody")
    ended: list[str] = []

    def asks() -> None:
        try:
            wire.wait(100.0)
        except ClockStopped:
            ended.append("stopped")
            raise

    with clock.participant("run"):
        thread = clock.start("asks", asks)
        clock.sleep(1.0)
        clock.stop()
        thread.join(5.0)
    assert ended == ["stopped"]
