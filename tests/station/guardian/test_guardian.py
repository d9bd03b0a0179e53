"""A run that is killed or stands still leaves a safe bench: its guardian sees to that.

What is safe is asked of the simulated world, in another process. The long form, with the
distribution of the times, is `benchmarks/guardian.py`.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from campaign_helpers import station, whole_events
from guardian_helpers import GuardedRun, World, start_run, until, world

from station import registry
from station.clock import RealClock, VirtualClock
from station.control.status import read_status
from station.files.lookup import BENCHES, find
from station.files.yaml.document import yaml_text
from station.guardian.notes import guardian_at_work
from station.guardian.supervisor import Guardian, GuardianFailed
from station.guardian.watching import SILENT_FOR_S
from station.instruments.bench import read_bench
from station.record.events import REVISED, Event, guardian_events
from station.record.folder import RunFolder
from station.record.later import record_later
from station.record.layout import GUARDIAN_LOG, MANIFEST, write_manifest
from station.record.run_state import RunState
from station.recorded import left_unverified, read_plan_and_bench
from station.safety.acknowledgement import unacknowledged

if sys.platform != "linux":
    pytest.skip("SIGKILL, SIGSTOP and /proc; not verified elsewhere", allow_module_level=True)

COILS = ("coil_supply.x", "coil_supply.y")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with world(tmp_path_factory.mktemp("world")) as served:
        yield served


@pytest.fixture(scope="module", autouse=True)
def standing_still(
    bench: World, tmp_path_factory: pytest.TempPathFactory
) -> tuple[GuardedRun, float]:
    """A run on a coil of its own that is stopped at once: what it shows takes 5 s to come."""
    run = start_run(bench, tmp_path_factory.mktemp("still"), "coil_supply.z")
    return run, run.end_by(signal.SIGSTOP)


def verified_after_s(run: GuardedRun, bench: World, killed_s: float) -> float:
    """Return the real time from the end of a run to the verified safe state, from the log."""
    last = run.made_safe()
    assert last["event"] == "safe-state"
    assert all(one["verified"] for one in last["outcomes"]), last
    return (last["t_s"] - bench.bench_s(killed_s)) / bench.speed


@dataclass(frozen=True)
class Killed:
    """A run that was killed while its coil carried a large current, and what was said then."""

    run: GuardedRun
    after_s: float
    said: str
    at_rest: bool


@pytest.fixture(scope="module")
def killed(bench: World, tmp_path_factory: pytest.TempPathFactory) -> Killed:
    run = start_run(bench, tmp_path_factory.mktemp("killed"))
    until(lambda: abs(bench.report()["coils"]["x"]["current_A"]) > 4.0)
    killed_s = run.end_by(signal.SIGKILL)
    said = run.wait_for_guardian()
    return Killed(run, verified_after_s(run, bench, killed_s), said, bench.at_rest("x"))


def test_a_killed_run_leaves_its_coil_at_zero_and_its_output_off(killed: Killed) -> None:
    assert killed.at_rest
    assert killed.run.safe_states() == [{"coil_supply.x": True}], "at the first attempt"
    assert "read back" in killed.said  # another run of these tests may have an instrument
    assert "coil_supply.x output off" in killed.said


def test_a_supply_that_lies_to_the_guardian_is_contradicted_by_the_field(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
    with world(tmp_path_factory.mktemp("lies")) as served:
        run = start_run(served, tmp_path_factory.mktemp("run"), "coil_supply.x", "gaussmeter")
        until(lambda: abs(served.report()["coils"]["x"]["current_A"]) > 4.0)
        time.sleep(3.0)  # the witness has seen it
        served.inject(instrument="coil_supply.x", fault="lies")
        run.end_by(signal.SIGKILL)
        said = run.wait_for_guardian()  # it ends: whoever put a magnet there needs no guardian
        assert not served.at_rest("x")
    assert "NOT VERIFIED as safe" in said
    assert "coil_supply.x: it reads back output off" in said
    assert "gaussmeter sees that" in said
    (doubted,) = [one for one in run.made_safe()["outcomes"] if not one["verified"]]
    assert (doubted["instrument"], doubted["doubted"]) == ("coil_supply.x", True)
    assert unacknowledged(find(BENCHES, "sim")) is not None


@pytest.mark.campaign
def test_a_supply_that_comes_on_again_and_again_is_named_and_left_when_a_person_asks(
    tmp_path: Path,
) -> None:
    with world(tmp_path, speed=5.0) as served:
        run = start_run(served, tmp_path / "runs", "coil_supply.x")
        served.inject(instrument="coil_supply.x", fault="comes-back", after="2 s", times=100000)
        run.end_by(signal.SIGKILL)

        def goes_on() -> bool:
            at_work = guardian_at_work(run.folder)
            return at_work is not None and at_work.waits_for == ("coil_supply.x",)

        until(goes_on)
        ended = station("abort", run.folder)
        said = run.wait_for_guardian()
        assert not served.at_rest("x")
    assert ended.returncode == 3
    assert "NOT VERIFIED: coil_supply.x" in ended.stderr
    assert "NOT VERIFIED as safe" in said
    status = read_status(run.folder)
    assert status.bench_safe is False
    assert "could not verify as safe, and was ended by a person" in status.message


@pytest.mark.campaign
def test_one_supply_out_of_reach_hides_no_other_that_lies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with world(tmp_path) as served:
        coils = ("coil_supply.x", "coil_supply.y", "gaussmeter")
        run = start_run(served, tmp_path / "runs", *coils)
        until(lambda: abs(served.report()["coils"]["x"]["current_A"]) > 4.0)
        time.sleep(3.0)  # the witness has seen it
        served.inject(instrument="coil_supply.x", fault="lies")
        served.inject(instrument="coil_supply.y", fault="port-gone")
        run.end_by(signal.SIGKILL)

        def doubted() -> list[str]:
            log = run.folder / "guardian.jsonl"
            events = run.guardian_log() if log.is_file() else []
            outcomes = [one for event in events for one in event.get("outcomes", ())]
            return [one["instrument"] for one in outcomes if one.get("doubted")]

        until(doubted)
        assert set(doubted()) == {"coil_supply.x"}
        station("abort", run.folder)
        said = run.wait_for_guardian()
    assert "coil_supply.x: it reads back output off" in said
    assert "coil_supply.y: " in said


def test_status_and_analysis_learn_what_the_guardian_did(killed: Killed) -> None:
    status = read_status(killed.run.folder)
    assert (status.state, status.bench_safe) == ("interrupted", True)
    assert "the guardian made the bench safe" in status.message
    folder = RunFolder(killed.run.folder)
    assert not left_unverified(folder, read_plan_and_bench(folder)[1])


def test_what_the_guardian_did_stays_the_last_word_when_the_run_is_analysed(
    killed: Killed, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(killed.run.folder, tmp_path / "run"))
    record_later(folder, REVISED, {"revision": "001"})
    assert "the guardian made the bench safe" in read_status(folder).message
    assert not (folder / MANIFEST).exists()


def test_the_guardian_writes_a_chained_log_that_a_manifest_covers(
    killed: Killed, tmp_path: Path
) -> None:
    folder = shutil.copytree(killed.run.folder, tmp_path / "run")
    gone, made_safe, read = guardian_events(folder)
    assert (gone.kind, made_safe.kind, read.kind) == ("runner-gone", "safe-state", "bench-read")
    assert made_safe.details["after_events"] == len(whole_events(folder))
    write_manifest(folder)
    manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    assert GUARDIAN_LOG in manifest["files"]


@pytest.mark.campaign
def test_what_ends_a_terminal_does_not_end_the_guardian(bench: World, tmp_path: Path) -> None:
    run = start_run(bench, tmp_path, *COILS)
    for guardian in run.guardians:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1):
            os.kill(guardian, number)
        assert os.getsid(guardian) != os.getsid(run.process.pid)
    run.end_by(signal.SIGKILL)
    run.wait_for_guardian()
    assert bench.at_rest("xy")
    names = [one["instrument"] for one in run.made_safe()["outcomes"]]
    assert names == list(COILS), "what cannot harm is left alone"


@pytest.mark.campaign
def test_a_supply_that_is_gone_for_a_while_keeps_no_other_from_being_made_safe(
    bench: World, tmp_path: Path
) -> None:
    run = start_run(bench, tmp_path, *COILS)
    bench.inject(instrument="coil_supply.x", fault="port-gone", **{"for": "0.6 s"})
    run.end_by(signal.SIGKILL)
    run.wait_for_guardian()
    states = [event["outcomes"] for event in run.guardian_log() if event["event"] == "safe-state"]
    assert [one["verified"] for one in states[0]] == [False, True]
    assert [one["verified"] for one in states[-1]] == [True, True]
    assert bench.at_rest()


@pytest.fixture
def folder(bench: World, tmp_path: Path) -> Path:
    """A run folder's resolved bench."""
    shipped = read_bench(find("benches", "sim"), registry.names(registry.DRIVERS))
    text = yaml_text(shipped.to_yaml_data())
    (tmp_path / "bench.resolved.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_a_dismissed_guardian_ends_and_leaves_no_word(folder: Path) -> None:
    guardian = Guardian(folder, None, {}, RealClock(), wait=False)
    guardian.wait_ready()
    guardian.watch(["coil_supply.x"])
    guardian.dismiss()
    guardian.dismiss()
    assert not (folder / GUARDIAN_LOG).exists()


def test_a_guardian_that_cannot_read_its_bench_says_so_before_anything_is_energised(
    tmp_path: Path,
) -> None:
    with pytest.raises(GuardianFailed, match=r"cannot do its work: .*bench\.resolved\.yaml"):
        Guardian(tmp_path, None, {}, RealClock())


def test_a_world_in_the_same_process_has_no_guardian(tmp_path: Path) -> None:
    with pytest.raises(GuardianFailed, match="ends with it"):
        Guardian(tmp_path, None, {}, VirtualClock())


def outcome(verified: bool, read_back: str = "") -> dict[str, object]:
    return {"instrument": "coil_supply.x", "verified": verified, "read_back": read_back}


def of_run(*kinds: str, safe: bool = True) -> list[Event]:
    return [
        Event(0.0, kind, {"outcomes": [outcome(safe)]} if kind == "safe-state" else {})
        for kind in kinds
    ]


def of_guardian(after_events: int, *, safe: bool) -> Event:
    return Event(0.0, "safe-state", {"after_events": after_events, "outcomes": [outcome(safe)]})


def test_the_guardians_word_counts_until_instruments_are_opened_again() -> None:
    killed = of_run("run-started", "identified")
    word = of_guardian(2, safe=False)
    assert RunState(killed, [word]).safe_state() == [outcome(False)]
    resumed = [*killed, *of_run("resumed")]
    assert RunState(resumed, [word]).safe_state() == [outcome(False)]
    opened = [*resumed, *of_run("identified")]
    assert RunState(opened, [word]).safe_state() is None
    ended = [*opened, *of_run("safe-state")]
    assert RunState(ended, [word]).safe_state() == [outcome(True)]


def test_a_resumed_run_that_opened_nothing_changes_nothing_about_the_bench() -> None:
    resumed = of_run("identified", "resumed")
    nothing = Event(0.0, "safe-state", {"outcomes": []})
    word = of_guardian(1, safe=False)
    assert RunState([*resumed, nothing], [word]).safe_state() == [outcome(False)]
    assert RunState([nothing], []).safe_state() == []


def test_a_guardian_that_acts_after_the_runs_own_safe_state_has_the_last_word() -> None:
    own = of_run("identified", "safe-state")
    assert RunState(own, [of_guardian(2, safe=False)]).safe_state() == [outcome(False)]


def test_a_run_that_stands_still_is_ended_and_its_bench_made_safe(
    bench: World, standing_still: tuple[GuardedRun, float], killed: Killed
) -> None:
    run, stopped_s = standing_still
    said = run.wait_for_guardian()
    assert run.process.returncode == -signal.SIGKILL
    assert bench.at_rest("z")
    # One that is dead is not waited for; one that stands still may yet go on.
    assert killed.after_s < verified_after_s(run, bench, stopped_s) >= SILENT_FOR_S
    assert run.safe_states() == [{"coil_supply.z": True}]
    assert "did not respond for 5 s" in said
