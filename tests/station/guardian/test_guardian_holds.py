"""A bench stays guarded: guardians that are lost, outages, disks that hang, two deaths at once.

What is safe is asked of the simulated world, in another process.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from campaign_helpers import short_plan, station
from campaigns.standstill.runs import memory_of
from command_line import begun
from guardian_helpers import ROOT, World, is_alive, start_run, until, world
from user_space_disk import UserSpaceDisk, disk_or_skip

from station.clock import RealClock
from station.control.status import read_status
from station.files.lookup import find
from station.files.yaml.document import yaml_text
from station.guardian.messages import GuardianLine
from station.guardian.notes import guardian_at_work
from station.guardian.supervisor import Guardian
from station.record.folder import RunFolder
from station.recorded import left_unverified, read_plan_and_bench
from station.runner.evaluation import flags_of_guardians

if sys.platform != "linux":
    pytest.skip("SIGKILL, SIGSTOP and /proc; not verified elsewhere", allow_module_level=True)

DOUBLE_DEATH_S = 60.0
WHY_LOST = {signal.SIGKILL: "has ended", signal.SIGSTOP: "did not respond for 5 s"}
STARTS_S = 20.0
LESS_BYTES = 12_000_000


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with world(tmp_path_factory.mktemp("world")) as served:
        yield served


@pytest.mark.campaign
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_run_and_first_guardian_gone_together_leave_a_safe_bench(
    bench: World, tmp_path: Path, end: signal.Signals
) -> None:
    run = start_run(bench, tmp_path)
    first, second = run.guardians
    os.kill(first, end)
    run.end_by(signal.SIGKILL)
    until(lambda: bench.at_rest("x"), DOUBLE_DEATH_S)
    until(lambda: not is_alive(second))
    assert not is_alive(first)
    assert run.safe_states()[-1] == {"coil_supply.x": True}
    assert "the first guardian of the run does not act" in run.guardian_log()[0]["message"]


@pytest.mark.campaign
def test_run_and_both_guardians_that_stand_still_are_outlived_by_a_second_that_goes_on(
    bench: World, tmp_path: Path
) -> None:
    run = start_run(bench, tmp_path)
    guardians = run.guardians
    for process in (*guardians, run.process.pid):
        os.kill(process, signal.SIGSTOP)
    time.sleep(0.5)
    os.kill(guardians[1], signal.SIGCONT)
    until(lambda: bench.at_rest("x"), DOUBLE_DEATH_S)
    until(lambda: not is_alive(guardians[1]))  # it looks once more, and keeps the supply till then


@pytest.mark.campaign
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("rank", [0, 1])
def test_a_guardian_that_is_lost_is_replaced_and_the_new_one_acts(
    bench: World, tmp_path: Path, rank: int, end: signal.Signals
) -> None:
    run = start_run(bench, tmp_path)
    before = run.guardians
    os.kill(before[rank], end)
    until(lambda: run.events("guardian-lost"))
    until(lambda: run.events("guardian-replaced"), STARTS_S)
    after = run.guardians
    assert [one["message"] for one in run.events("guardian-lost")] == [WHY_LOST[end]]
    assert after[rank] != before[rank]
    assert after[1 - rank] == before[1 - rank]
    folder = RunFolder(run.folder)
    (flag,) = flags_of_guardians(folder)
    assert flag.code == "guardian-lost"
    assert f"the {('first', 'second')[rank]} guardian" in flag.message
    os.kill(after[1 - rank], signal.SIGKILL)
    run.end_by(signal.SIGKILL)
    until(lambda: bench.at_rest("x"), DOUBLE_DEATH_S)
    until(lambda: not is_alive(after[rank]))


@pytest.mark.campaign
def test_an_outage_is_waited_for_and_the_bench_belongs_to_the_guardian_meanwhile(
    bench: World, tmp_path: Path
) -> None:
    run = start_run(bench, tmp_path)
    first, _ = run.guardians
    bench.inject(instrument="coil_supply.x", fault="port-gone", **{"for": "22 s"})
    run.end_by(signal.SIGKILL)
    said = run.wait_for_guardian()
    assert "NOT VERIFIED as safe; go to the bench" in said
    assert f"`station abort {run.folder}` ends it" in said
    status = json.loads(station("status", run.folder, "--json").stdout)
    assert status["bench_safe"] is False
    assert f"(process {first}) goes on trying to make coil_supply.x safe" in status["message"]
    refused = station("resume", run.folder, "--non-interactive")
    assert refused.returncode == 2
    assert f"(process {first}) goes on trying" in refused.stderr
    plan = short_plan(tmp_path, axes=["IA"])
    parts = ("--served", bench.head, "--non-interactive", "--output", tmp_path / "new")
    another = station("run", plan, *parts)
    assert another.returncode == 3
    assert f"(process {first}) goes on trying to make coil_supply.x safe" in another.stderr
    until(lambda: not is_alive(first))
    assert bench.at_rest("x")
    assert run.safe_states()[-1] == {"coil_supply.x": True}
    assert guardian_at_work(run.folder) is None
    assert "goes on trying" not in station("status", run.folder).stdout


@pytest.mark.campaign
def test_a_person_ends_a_guardian_that_goes_on_trying(bench: World, tmp_path: Path) -> None:
    run = start_run(bench, tmp_path, "coil_supply.y")
    guardians = run.guardians
    bench.inject(instrument="coil_supply.y", fault="port-gone", **{"for": "1 h"})
    run.end_by(signal.SIGKILL)
    run.wait_for_guardian()
    aborted = station("abort", run.folder)
    assert aborted.returncode == 3
    assert "NOT VERIFIED: coil_supply.y could not be proven safe" in aborted.stderr
    until(lambda: not any(map(is_alive, guardians)))
    assert [one["event"] for one in run.guardian_log()][-2:] == ["left", "bench-read"]
    folder = RunFolder(run.folder)
    left = left_unverified(folder, read_plan_and_bench(folder)[1])
    assert "Connection refused" in left["coil_supply.y"]
    message = read_status(run.folder).message
    assert "could not verify as safe, and was ended by a person: coil_supply.y sent" in message
    assert message in aborted.stdout


@pytest.mark.campaign
def test_guardians_that_have_no_room_for_a_thread_make_the_bench_safe_all_the_same(
    bench: World, tmp_path: Path
) -> None:
    run = start_run(bench, tmp_path)
    for pid in run.guardians:
        # What a guardian has kept for itself and given back is not enough for a thread's stack.
        most = memory_of(pid) - LESS_BYTES
        subprocess.run(["prlimit", f"--pid={pid}", f"--as={most}:"], check=True)
    run.end_by(signal.SIGKILL)
    until(lambda: bench.at_rest("x"), DOUBLE_DEATH_S)
    assert "coil_supply.x output off" in run.wait_for_guardian()
    assert run.safe_states()[-1] == {"coil_supply.x": True}


@pytest.mark.campaign
def test_a_guardian_that_stands_still_keeps_no_instrument_of_a_run_that_is_over(
    bench: World, tmp_path: Path
) -> None:
    run = start_run(bench, tmp_path)
    _, second = run.guardians
    os.kill(second, signal.SIGSTOP)
    run.end_by(signal.SIGKILL)
    assert "coil_supply.x output off" in run.wait_for_guardian()
    until(lambda: not is_alive(second), DOUBLE_DEATH_S)
    with_it = start_run(bench, tmp_path / "next")
    with_it.end_by(signal.SIGKILL)
    with_it.wait_for_guardian()


@pytest.mark.campaign
def test_a_run_that_cannot_verify_hands_over_and_the_guardian_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))  # an interlock may trip
    plan = short_plan(tmp_path, axes=["IA"])
    with world(tmp_path, 5.0) as bench:
        parts = ("--served", bench.head, "--non-interactive", "--output", tmp_path / "runs")
        run = begun(None, "run", plan, *parts)
        until(lambda: bench.report()["outputs"]["coil_supply.x"])
        bench.inject(instrument="coil_supply.x", fault="port-gone", **{"for": "100 s"})
        _, said = run.communicate(timeout=90)
        assert run.returncode == 3
        assert "goes on trying and keeps the instruments until they are safe" in said
        (folder,) = (tmp_path / "runs").iterdir()
        assert guardian_at_work(folder) is not None
        until(lambda: guardian_at_work(folder) is None)
        assert bench.at_rest()
        status = json.loads(station("status", folder, "--json").stdout)
        assert status["bench_safe"] is True
        assert "the guardian made the bench safe" in status["message"]


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[UserSpaceDisk]:
    with disk_or_skip(tmp_path) as made:
        yield made


@pytest.mark.campaign
def test_a_run_that_cannot_die_keeps_nobody_from_its_instruments(
    bench: World, disk: UserSpaceDisk
) -> None:
    run = start_run(bench, disk.place / "runs", "coil_supply.z")
    first, _ = run.guardians
    disk.freeze()
    time.sleep(0.5)
    run.end_by(signal.SIGKILL)
    until(lambda: bench.at_rest("z"), DOUBLE_DEATH_S)
    assert is_alive(run.process.pid), "the disk holds it"
    disk.thaw()
    run.wait_for_guardian()
    until(lambda: not is_alive(first))
    assert run.safe_states()[-1] == {"coil_supply.z": True}


def test_beats_that_nobody_reads_never_hold_up_who_sends_them() -> None:
    own, its = socket.socketpair()
    channel = GuardianLine(own)
    began = time.monotonic()
    taken = [channel.send({"say": "beat"}) for _ in range(20_000)]
    assert time.monotonic() - began < 5.0
    assert taken[0]
    assert not taken[-1]
    its.close()


@pytest.mark.campaign
def test_guardians_that_stand_still_do_not_hold_up_the_end_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "bench.resolved.yaml").write_text(bench_text(), encoding="utf-8")
    guardian = Guardian(tmp_path, None, {}, RealClock(), on_lost=lambda said: None)
    guardian.watch(["coil_supply.x"])
    pids = guardian.pids
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    began = time.monotonic()
    guardian.dismiss()
    assert time.monotonic() - began < 9.0
    assert not any(map(is_alive, pids))


def bench_text() -> str:
    from station import registry
    from station.instruments.bench import read_bench

    shipped = read_bench(find("benches", "sim"), registry.names(registry.DRIVERS))
    return yaml_text(shipped.to_yaml_data())


AUDITED = """
import json, sys
from pathlib import Path
from station.guardian.messages import Instructions
from station.guardian.notes import OperatorOutput
from station.guardian.watching import Peer
from station.guardian.make_safe import MakeSafe
from station.guardian.watching import SafingOrder

class Gone:
    def has_ended(self): return True

bench_guard = MakeSafe(Instructions(**json.loads(sys.argv[1])), OperatorOutput(2), Peer())
opened, ready = [], set(sys.modules)

def look(event, arguments):
    if event in ("open", "os.listdir", "os.scandir") and not isinstance(arguments[0], int):
        opened.append(str(arguments[0]))

sys.addaudithook(look)
code = bench_guard.make_safe(SafingOrder("It died.", ["coil_supply.x"]), Gone())
print(json.dumps({"code": code, "opened": opened, "loaded": sorted(set(sys.modules) - ready)}))
"""


def test_a_guardian_that_acts_loads_nothing_and_reads_no_file_but_locks_and_its_log(
    bench: World, tmp_path: Path
) -> None:
    head = json.loads(bench.head.read_text(encoding="utf-8").splitlines()[0])
    (tmp_path / "bench.resolved.yaml").write_text(bench_text(), encoding="utf-8")
    (tmp_path / "events.jsonl").write_bytes(b"")
    instructions = {
        "folder": str(tmp_path),
        "bench": str(tmp_path / "bench.resolved.yaml"),
        "instruments": ["coil_supply.x"],
        "addresses": {name: one["address"] for name, one in head["instruments"].items()},
        "runner_pid": 0,
        "speed": head["clock"]["speed"],
        "epoch_unix": head["clock"]["epoch_unix"],
        "world": "audited",
    }
    done = subprocess.run(
        [sys.executable, "-c", AUDITED, json.dumps(instructions)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
        cwd=ROOT,
    )
    told = json.loads(done.stdout)
    assert told["code"] == 0, done.stderr
    assert not told["loaded"]
    others = [
        path
        for path in told["opened"]
        if not path.startswith((str(tmp_path), "/run/lock", "/tmp/inertial", "/dev/null", "/etc/"))
    ]
    assert not others
