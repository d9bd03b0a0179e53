"""A run that stands still leaves a safe bench: frozen disk, stopped terminal, no memory left.

What is safe is asked of the simulated world, in another process; what stands still is made to by
the operating system.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from campaign_helpers import only_run, station
from guardian_helpers import GuardedRun, World, until, world
from still_helpers import (
    SLEW_AND_ZERO_S,
    SPEED,
    at_rest_after_s,
    begun_run,
    events_of,
    is_driven,
    stopped_terminal,
    stopped_thread,
)
from user_space_disk import UserSpaceDisk, disk_or_skip

from station.guardian.watching import SILENT_FOR_S
from station.runner.watchers import MAX_SILENCE_S, OBEYS_WITHIN_S

if sys.platform != "linux":
    pytest.skip("FUSE, prlimit and /proc; not verified elsewhere", allow_module_level=True)

pytestmark = pytest.mark.campaign
ENDED = ["failed", "safe-state", "run-ended"]
SAFE = "the bench is safe, read back from every instrument that can harm: coil_supply.x output off"
BUSY_S = 30.0
"""What a machine with other work may take on top of what is promised."""


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    # A trip on a busy machine is remembered for this test alone.
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with world(tmp_path, SPEED) as served:
        yield served


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[UserSpaceDisk]:
    with disk_or_skip(tmp_path) as made:
        yield made


def test_a_disk_that_stands_still_leaves_a_safe_bench(
    bench: World, tmp_path: Path, disk: UserSpaceDisk
) -> None:
    with begun_run(bench, tmp_path, disk.place / "runs") as process:
        disk.freeze()
        until(lambda: disk.holds(process.pid))
        taken_s = at_rest_after_s(bench, MAX_SILENCE_S + SLEW_AND_ZERO_S + BUSY_S)
        print(f"frozen disk to a bench at rest: {taken_s:.1f} s")
        time.sleep(2.0)
        assert bench.at_rest(), "nothing goes on with the run"
        disk.thaw()
        process.wait(60)
    assert process.returncode in (3, -signal.SIGKILL)
    assert bench.at_rest()
    made_safe = [one for one in events_of(disk.place / "runs") if one["event"] == "safe-state"]
    assert all(one["verified"] for one in made_safe[-1]["outcomes"])


def test_a_wish_to_end_is_obeyed_on_a_disk_that_stands_still(
    bench: World, tmp_path: Path, disk: UserSpaceDisk
) -> None:
    with begun_run(bench, tmp_path, disk.place / "runs") as process:
        disk.freeze()
        until(lambda: disk.holds(process.pid))
        process.send_signal(signal.SIGINT)
        taken_s = at_rest_after_s(bench, OBEYS_WITHIN_S + SLEW_AND_ZERO_S + BUSY_S)
        print(f"Ctrl-C on a frozen disk to a bench at rest: {taken_s:.1f} s")
        disk.thaw()
        process.wait(60)
    assert process.returncode in (4, -signal.SIGKILL)


def test_an_abort_on_a_disk_that_stands_still_says_what_was_read_back(
    bench: World, tmp_path: Path, disk: UserSpaceDisk
) -> None:
    with begun_run(bench, tmp_path, disk.place / "runs") as process:
        folder = only_run(disk.place / "runs")
        assert folder is not None
        disk.freeze()
        until(lambda: disk.holds(process.pid))
        began_s = time.monotonic()
        aborted = station("abort", folder, "--timeout", "60")
        print(f"abort on a frozen disk: {time.monotonic() - began_s:.1f} s")
        assert bench.at_rest()
        assert aborted.returncode == 3, aborted
        assert "the request was received" in aborted.stderr
        assert "does not end" in aborted.stdout
        assert "coil_supply.x       output off" in aborted.stdout
        disk.thaw()
        process.wait(60)


def test_steps_that_never_return_are_taken_over(bench: World, tmp_path: Path) -> None:
    """The thread of the steps alone is stopped, in whatever it does just then."""
    with begun_run(bench, tmp_path, tmp_path / "runs") as process:
        try:
            with stopped_thread(process.pid):
                within_s = MAX_SILENCE_S + SILENT_FOR_S + SLEW_AND_ZERO_S + BUSY_S
                taken_s = at_rest_after_s(bench, within_s)
                print(f"stopped steps to a bench at rest: {taken_s:.1f} s")
                _, said = process.communicate(timeout=60)
        except OSError as error:
            pytest.skip(f"no thread can be stopped here: {error}")
    assert process.returncode == -signal.SIGKILL
    assert (
        "the bench is safe, read back from every instrument that can harm: coil_supply.x output off"
        in said
    )
    *_, last, read = events_of(tmp_path / "runs")
    assert (last["event"], read["event"]) == ("safe-state", "bench-read")
    assert all(one["verified"] for one in last["outcomes"])


def test_a_terminal_whose_output_is_stopped_holds_nothing_up(bench: World, tmp_path: Path) -> None:
    with (
        stopped_terminal() as terminal,
        begun_run(bench, tmp_path, tmp_path / "runs", stderr=terminal, stdin=terminal) as process,
    ):
        folder = only_run(tmp_path / "runs")
        assert folder is not None
        raw = folder / "raw"
        sizes = set()
        for _ in range(8):
            sizes.add(sum(one.stat().st_size for one in raw.iterdir()))
            time.sleep(0.5)
        assert len(sizes) > 2, "the run has stopped recording"
        assert is_driven(bench)
        process.send_signal(signal.SIGINT)
        at_rest_after_s(bench, 1.0 + SLEW_AND_ZERO_S + BUSY_S)
        process.wait(30)
    assert process.returncode == 4
    assert [one["event"] for one in events_of(tmp_path / "runs")][-1] == "run-ended"


@pytest.mark.parametrize("room", [0, 300_000])
def test_a_run_without_memory_leaves_a_safe_bench(bench: World, tmp_path: Path, room: int) -> None:
    with begun_run(bench, tmp_path, tmp_path / "runs") as process:
        status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
        kib = next(line for line in status.splitlines() if line.startswith("VmSize")).split()[1]
        size = int(kib) * 1024 + room
        resource.prlimit(process.pid, resource.RLIMIT_AS, (size, size))
        # It may have all the memory that it needs, and goes on: then it can be ended.
        time.sleep(5.0)
        process.send_signal(signal.SIGINT)
        at_rest_after_s(bench, 60.0)
        process.communicate(timeout=60)
    # 5 where it was the watching of the interlocks that had none.
    assert process.returncode in (3, 4, 5, -signal.SIGKILL)
    last = [one for one in events_of(tmp_path / "runs") if one["event"] == "safe-state"][-1]
    assert all(one["verified"] for one in last["outcomes"])


@pytest.mark.parametrize("how", ["removed", "moved", "replaced"])
def test_a_folder_that_is_gone_ends_the_run_at_once(bench: World, tmp_path: Path, how: str) -> None:
    runs, elsewhere = tmp_path / "runs", tmp_path / "elsewhere"
    with begun_run(bench, tmp_path, runs) as process:
        folder = only_run(runs)
        assert folder is not None
        folder.rename(elsewhere)
        if how == "removed":
            shutil.rmtree(elsewhere)
        elif how == "replaced":
            folder.mkdir()
        taken_s = at_rest_after_s(bench, 2.0 + SLEW_AND_ZERO_S + BUSY_S)
        print(f"a folder {how} to a bench at rest: {taken_s:.1f} s")
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3
    assert said.count("was removed, moved or unmounted while the run went on") == 1
    assert "the bench is safe, read back from every instrument" in said
    assert "Traceback" not in said
    assert [one.name for one in runs.rglob("*")] == ([folder.name] if how == "replaced" else [])
    if how != "removed":
        log = (elsewhere / "events.jsonl").read_text(encoding="utf-8").splitlines()
        kinds = [json.loads(line)["event"] for line in log]
        # An instrument that is opened to be made safe has its form and its settings noted then.
        noted = ("instrument-variant", "instrument-settings", "answer-time")
        assert [kind for kind in kinds if kind not in noted][-3:] == ENDED


def test_a_disk_that_is_unmounted_ends_the_run_at_once(
    bench: World, tmp_path: Path, disk: UserSpaceDisk
) -> None:
    with begun_run(bench, tmp_path, disk.place / "runs") as process:
        disk.detach()
        at_rest_after_s(bench, 2.0 + SLEW_AND_ZERO_S + BUSY_S)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3
    assert "was removed, moved or unmounted while the run went on" in said
    assert not list(disk.place.iterdir())


def test_nohup_is_respected(bench: World, tmp_path: Path) -> None:
    def nohup() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    with begun_run(bench, tmp_path, tmp_path / "runs", preexec_fn=nohup) as process:
        process.send_signal(signal.SIGHUP)
        time.sleep(3.0)
        assert process.poll() is None
        assert not bench.at_rest()
        process.send_signal(signal.SIGTERM)
        at_rest_after_s(bench, 1.0 + SLEW_AND_ZERO_S + BUSY_S)
        process.communicate(timeout=60)
    assert process.returncode == 4


def test_a_closed_terminal_keeps_no_run_from_going_on(bench: World, tmp_path: Path) -> None:
    def close_all() -> None:
        for handle in range(3):
            os.close(handle)

    with begun_run(
        bench, tmp_path, tmp_path / "runs", preexec_fn=close_all, stderr=None, stdout=None
    ) as process:
        time.sleep(3.0)
        assert process.poll() is None
        assert not bench.at_rest()
        process.send_signal(signal.SIGTERM)
        process.wait(60)
    assert bench.at_rest()
    assert process.returncode == 4
    kinds = [one["event"] for one in events_of(tmp_path / "runs")]
    assert [kind for kind in kinds if kind != "answer-time"][-3:] == ENDED


def test_time_that_run_and_guardians_missed_together_is_flagged(
    bench: World, tmp_path: Path
) -> None:
    with begun_run(bench, tmp_path, tmp_path / "runs") as process:
        stopped = [*GuardedRun(process, tmp_path).guardians, process.pid]
        assert len(stopped) == 3
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(8.0)
        for pid in stopped:
            os.kill(pid, signal.SIGCONT)
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 4
    assert "this run did not run for 8 s, and nobody watched the bench" in said
    (missed,) = [one for one in events_of(tmp_path / "runs") if one["event"] == "time-missed"]
    assert 7.0 < missed["seconds"] < 12.0
