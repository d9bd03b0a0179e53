"""A run goes on after every kind of end, and only where it would measure the same."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
import yaml
from campaign_helpers import only_run, shipped, short_plan
from campaigns.kills import raw_hashes, results_of, what_is_wrong
from command_line import begun, station, station_command
from guardian_helpers import until, world
from limited_files import limited

from station import registry
from station.cli.analysing import analyse_run
from station.cli.running import resume_run
from station.clock import RealClock
from station.control.channel import ask
from station.errors import InputError, NotAcknowledged, StationError
from station.files.plan import read_plan
from station.instruments.bench import Bench, read_bench
from station.procedure import Procedures
from station.record.events import REVISED
from station.record.folder import RunFolder, RunRecord
from station.record.layout import EVENTS, RUN
from station.record.verification import verify
from station.runner.evaluation import units_in_words
from station.runner.execute import SERVED_SINCE, Request, conclude, execute
from station.runner.outcome import Outcome
from station.runner.resuming import ResumeRequest, resume, silent_since
from station.safety.acknowledgement import acknowledge

DURING_NA = "300 s"


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_plan(tmp_path_factory.mktemp("plan"), axes=["IA", "NA"])


def bench_at(folder: Path, *faults: dict[str, Any], **changes: Any) -> Bench:
    """Return the simulated bench with faults, or with other values of an instrument."""
    data = shipped("benches", "sim")
    if faults:
        data["simulation"]["faults"] = list(faults)
    for name, change in changes.items():
        data["instruments"][name] |= change
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bench.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    return read_bench(folder / "bench.yaml", registry.names(registry.DRIVERS))


def run_on(bench: Bench, plan: Path, parent: Path) -> Outcome:
    read = read_plan(plan, Procedures())
    return execute(Request(read, bench, parent, quiet=True, report=False))


def go_on(folder: Path, bench: Bench | None = None) -> Outcome:
    return resume(ResumeRequest(folder, bench, quiet=True, report=False))


@pytest.fixture(scope="module")
def reference(plan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same run, undisturbed."""
    parent = tmp_path_factory.mktemp("reference")
    outcome = run_on(bench_at(parent), plan, parent / "runs")
    assert outcome.exit_code == 0, outcome.error
    return outcome.folder


@pytest.fixture(scope="module")
def lost_gaussmeter(plan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose gaussmeter went away while its second axis was recorded."""
    parent = tmp_path_factory.mktemp("fault")
    fault = {"instrument": "gaussmeter", "fault": "port-gone", "at": DURING_NA}
    outcome = run_on(bench_at(parent, fault), plan, parent / "runs")
    assert outcome.exit_code == 3
    assert list(RunFolder(outcome.folder).finished_units()) == ["warm-up", "IA"]
    return outcome.folder


@pytest.fixture
def interrupted(lost_gaussmeter: Path, tmp_path: Path) -> Path:
    """A copy of that run, to do with as one likes."""
    return Path(shutil.copytree(lost_gaussmeter, tmp_path / "run"))


def judged(folder: Path, reference: Path, go: Callable[[], Outcome]) -> Outcome:
    raw, finished = raw_hashes(folder), list(RunFolder(folder).finished_units())
    outcome = go()
    assert outcome.exit_code == 0, outcome.error
    assert not list(what_is_wrong(folder, raw, finished, reference))
    return outcome


def in_the_second_axis(parent: Path, act: Callable[[Path], object]) -> Thread:
    """Do something from another thread as soon as the second axis is being recorded."""

    def wait_and_act() -> None:
        begun = re.compile(rb'"event": ?"unit-started".*"unit": ?"NA"')
        while not any(begun.search(log.read_bytes()) for log in parent.glob("[!.]*/events.jsonl")):
            RealClock().sleep(0.002)
        act(next(parent.glob("[!.]*")))

    thread = Thread(target=wait_and_act, daemon=True)
    thread.start()
    return thread


def test_after_an_instruments_fault(interrupted: Path, reference: Path, tmp_path: Path) -> None:
    mended = bench_at(tmp_path)
    judged(interrupted, reference, lambda: go_on(interrupted, mended))
    segments = {
        name: one["segment"] for name, one in RunFolder(interrupted).finished_units().items()
    }
    assert segments == {"warm-up": 1, "IA": 0, "NA": 1}


def resumed_flag(document: dict[str, Any]) -> dict[str, Any]:
    (flag,) = (flag for flag in document["flags"] if flag["code"] == "resumed")
    return dict(flag)


def test_a_computer_whose_clock_was_set_back_is_flagged(interrupted: Path, tmp_path: Path) -> None:
    ahead_s = time.time() + 3600.0
    os.utime(interrupted / EVENTS, (ahead_s, ahead_s))
    outcome = go_on(interrupted, bench_at(tmp_path))
    assert outcome.document is not None
    flag = resumed_flag(outcome.document.to_data())
    assert 3500.0 < flag["backwards_s"] <= 3600.0
    assert "time runs backwards there" in flag["message"]
    assert "was resumed an unknown time later" in flag["message"]


def test_a_resume_on_the_same_clock_is_no_step_backwards(interrupted: Path, tmp_path: Path) -> None:
    outcome = go_on(interrupted, bench_at(tmp_path))
    assert outcome.document is not None
    assert "backwards_s" not in resumed_flag(outcome.document.to_data())


@pytest.mark.campaign
def test_a_bench_that_is_served_anew_has_a_younger_clock_and_is_flagged(tmp_path: Path) -> None:
    plan_file = short_plan(tmp_path / "plan", axes=["IA"])
    options = ("--non-interactive", "--json", "--served")
    with world(tmp_path, 60.0) as served:
        command = ("run", str(plan_file), *options, str(served.head))
        process = begun(tmp_path, *command)
        until(lambda: only_run(tmp_path / "runs") is not None)
        run = only_run(tmp_path / "runs")
        assert run is not None
        until(lambda: "step-started" in (run / EVENTS).read_text(encoding="utf-8"))
        station(tmp_path, "abort", str(run))
        process.communicate()
    with world(tmp_path, 20.0) as served:
        done = station(tmp_path, "resume", str(run), *options, str(served.head))
    assert done.returncode == 0, done.stderr
    assert "WARNING: The clock stands" in done.stderr
    assert resumed_flag(json.loads(done.stdout))["backwards_s"] > 1.0


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to itself there")
def test_after_ctrl_c(plan: Path, reference: Path, tmp_path: Path) -> None:
    bench, parent = bench_at(tmp_path), tmp_path / "runs"
    thread = in_the_second_axis(parent, lambda _: os.kill(os.getpid(), signal.SIGINT))
    outcome = run_on(bench, plan, parent)
    thread.join()
    assert outcome.exit_code == 4, outcome.error
    judged(outcome.folder, reference, lambda: go_on(outcome.folder))


def test_after_an_abort_from_another_terminal(plan: Path, reference: Path, tmp_path: Path) -> None:
    bench, parent = bench_at(tmp_path), tmp_path / "runs"
    thread = in_the_second_axis(parent, lambda folder: ask(folder, "abort"))
    outcome = run_on(bench, plan, parent)
    thread.join()
    assert outcome.exit_code == 4, outcome.error
    judged(outcome.folder, reference, lambda: go_on(outcome.folder))


def test_after_an_interlock_and_its_acknowledgement(
    plan: Path, reference: Path, tmp_path: Path
) -> None:
    opened = {"instrument": "interlock_chain", "fault": "chain-open", "at": DURING_NA}
    bench = bench_at(tmp_path, {**opened, "for": "5 s"})
    outcome = run_on(bench, plan, tmp_path / "runs")
    assert outcome.exit_code == 5
    closed = bench_at(tmp_path)
    with pytest.raises(NotAcknowledged, match="station acknowledge"):
        go_on(outcome.folder, closed)
    acknowledge(bench.path)
    judged(outcome.folder, reference, lambda: go_on(outcome.folder, closed))


@pytest.mark.campaign
@pytest.mark.skipif(sys.platform == "win32", reason="no file-size limit to set there")
def test_after_a_full_disk(plan: Path, reference: Path, tmp_path: Path) -> None:
    done = limited(110_000, plan, tmp_path / "runs")
    assert done.returncode == 3, done.stderr
    folder = Path(json.loads(done.stdout)["run"])
    judged(folder, reference, lambda: go_on(folder))


def test_an_analysis_in_between_is_recorded_and_changes_nothing(
    interrupted: Path, reference: Path, tmp_path: Path
) -> None:
    before = RunFolder(interrupted)
    log = interrupted / EVENTS
    os.utime(log, (100.0, log.stat().st_mtime - 100.0))
    silent_s = silent_since(before)
    analyse_run(interrupted, None, compare=False)
    assert verify(interrupted).changed == ()
    after = RunFolder(interrupted)
    assert after.events[-1].kind == REVISED
    assert after.events[-1].time_s == before.events[-1].time_s
    assert silent_since(after) == pytest.approx(silent_s, abs=60.0)
    bench = bench_at(tmp_path)
    judged(interrupted, reference, lambda: go_on(interrupted, bench))
    assert verify(interrupted).changed == ()
    shutil.rmtree(interrupted / "revisions" / "001")
    assert "001 is missing" in " ".join(verify(interrupted).changed)


@pytest.mark.campaign
def test_a_second_time_after_a_second_fault(
    interrupted: Path, reference: Path, tmp_path: Path
) -> None:
    stopped_s = RunFolder(interrupted).events[-1].time_s
    again = {"instrument": "gaussmeter", "fault": "port-gone", "at": f"{stopped_s + 100} s"}
    worse = bench_at(tmp_path / "worse", again)
    outcome = go_on(interrupted, worse)
    assert outcome.exit_code == 3
    assert list(RunFolder(interrupted).finished_units()) == ["warm-up", "IA"]
    mended = bench_at(tmp_path / "mended")
    last = judged(interrupted, reference, lambda: go_on(interrupted, mended))
    assert last.document is not None
    assert [flag.code for flag in last.document.flags].count("resumed") == 2
    assert RunFolder(interrupted).finished_units()["NA"]["segment"] == 2


@pytest.mark.campaign
def test_a_kill_while_it_goes_on_costs_nothing_that_was_finished(
    interrupted: Path, reference: Path, tmp_path: Path
) -> None:
    bench = bench_at(tmp_path)
    raw, finished = raw_hashes(interrupted), list(RunFolder(interrupted).finished_units())
    process = subprocess.Popen(
        station_command("resume", interrupted, "--bench", bench.path, "--non-interactive"),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    second = interrupted / "raw" / "gyro_acquisition-001.mcap"
    while process.poll() is None and not (second.is_file() and second.stat().st_size > 20_000):
        RealClock().sleep(0.002)
    process.kill()
    process.wait()
    assert not (interrupted / "results.json").is_file()
    outcome = go_on(interrupted, bench)
    assert outcome.exit_code == 0, outcome.error
    assert not list(what_is_wrong(interrupted, raw, finished, reference))


def test_a_finished_run_is_refused(reference: Path) -> None:
    with pytest.raises(InputError, match="is finished"):
        go_on(reference)


@pytest.mark.campaign
def test_a_run_that_a_process_is_at_work_on_is_refused(
    plan: Path, interrupted: Path, tmp_path: Path
) -> None:
    said: list[str] = []

    def resume_it_meanwhile(folder: Path) -> None:
        try:
            as_typed(folder)
        except InputError as error:
            said.append(str(error))

    parent = tmp_path / "runs"
    thread = in_the_second_axis(parent, resume_it_meanwhile)
    outcome = run_on(bench_at(tmp_path), plan, parent)
    thread.join()
    assert outcome.exit_code == 0, outcome.error
    assert ["is being run and is not paused" in one for one in said] == [True]
    # One that listens to nobody, here nobody at all, is refused as well.
    record = RunRecord.go_on(interrupted, RealClock())
    with pytest.raises(StationError, match="a process is at work on it"):
        as_typed(interrupted)
    record.close()
    record.seal()


def as_typed(folder: Path) -> int:
    """Do what `station resume FOLDER --non-interactive` does."""
    return resume_run(
        folder,
        None,
        served=None,
        answers=None,
        non_interactive=True,
        trace=False,
        as_json=False,
    )


def test_a_run_goes_on_in_the_world_that_it_began_in(interrupted: Path) -> None:
    """Served or not: the other way would be another simulated world, or another bench."""
    served = {"clock": {"speed": 1.0, "epoch_unix": 1e9}, "instruments": {}}
    before = raw_hashes(interrupted)
    with pytest.raises(InputError, match=rf"type `station resume {interrupted}`, without --served"):
        resume(ResumeRequest(interrupted, quiet=True, report=False, served=served))
    facts = json.loads((interrupted / RUN).read_text(encoding="utf-8"))
    assert facts[SERVED_SINCE] is None
    text = json.dumps({**facts, SERVED_SINCE: 1e9})
    (interrupted / "manifest.json").unlink()
    (interrupted / RUN).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"type `station resume {interrupted} --served FILE`"):
        go_on(interrupted)
    assert raw_hashes(interrupted) == before


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("plan.resolved.yaml", "amplitude: 1 mT", "amplitude: 0.9 mT"),
        ("bench.resolved.yaml", "serial: LSA2B7X", "serial: LSA2B7Y"),
    ],
)
def test_an_altered_plan_or_bench_is_refused(
    name: str, old: str, new: str, interrupted: Path
) -> None:
    text = (interrupted / name).read_text(encoding="utf-8")
    assert old in text
    (interrupted / name).write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=r"was changed since the run began"):
        go_on(interrupted)


def test_another_instrument_in_the_bench_file_is_refused(interrupted: Path, tmp_path: Path) -> None:
    other = bench_at(tmp_path, gaussmeter={"serial": "ANOTHER"})
    with pytest.raises(InputError, match="gaussmeter: another serial"):
        go_on(interrupted, other)


def test_another_instrument_that_answers_energises_nothing(
    interrupted: Path, tmp_path: Path
) -> None:
    data = shipped("benches", "sim")["instruments"]["coil_supply.y"]["simulator"]
    exchanged = bench_at(tmp_path, **{"coil_supply.y": {"simulator": {**data, "serial": "H999"}}})
    outcome = go_on(interrupted, exchanged)
    assert outcome.exit_code == 3
    assert outcome.error is not None
    assert "serial number H999 answers" in outcome.error
    assert "nothing was energised" in outcome.error
    mended = bench_at(tmp_path / "mended")
    assert go_on(interrupted, mended).exit_code == 0


def test_other_software_is_flagged(interrupted: Path, tmp_path: Path) -> None:
    facts = json.loads((interrupted / "run.json").read_text(encoding="utf-8"))
    facts["station"] = "0.0.1"
    (interrupted / "run.json").write_text(json.dumps(facts), encoding="utf-8")
    (interrupted / "manifest.json").unlink()
    mended = bench_at(tmp_path)
    outcome = go_on(interrupted, mended)
    assert outcome.exit_code == 0, outcome.error
    flags = {flag["code"]: flag for flag in results_of(interrupted)["flags"]}
    assert "station 0.0.1 →" in flags["software-changed"]["message"]


def test_a_run_that_was_only_not_evaluated_is_evaluated(reference: Path, tmp_path: Path) -> None:
    copy = Path(
        shutil.copytree(
            reference,
            tmp_path / "run",
            ignore=shutil.ignore_patterns("results.json", "revisions", "manifest.json"),
        )
    )
    raw = raw_hashes(copy)
    assert go_on(copy).exit_code == 0
    assert raw_hashes(copy) == raw
    assert results_of(copy)["results"] == results_of(reference)["results"]
    assert (copy / "manifest.json").is_file()


def test_a_run_that_died_before_its_manifest_is_sealed(reference: Path, tmp_path: Path) -> None:
    folder = tmp_path / reference.name
    shutil.copytree(reference, folder)
    (folder / "manifest.json").unlink()
    before = (folder / "results.json").read_bytes()
    outcome = resume(ResumeRequest(folder, quiet=True, report=False))
    assert outcome.exit_code == 0
    assert (folder / "manifest.json").is_file()
    assert (folder / "results.json").read_bytes() == before
    with pytest.raises(InputError, match="is finished"):
        resume(ResumeRequest(folder, quiet=True, report=False))


def test_a_run_whose_evaluation_failed_is_evaluated_by_resume(
    reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(reference, folder)
    (folder / "results.json").unlink()
    *before, _ = (folder / EVENTS).read_bytes().splitlines(keepends=True)
    (folder / EVENTS).write_bytes(b"".join(before))  # no revision was written
    shutil.rmtree(folder / "revisions")
    with monkeypatch.context() as lacking:

        def no_memory(*_: object, **__: object) -> None:
            raise MemoryError

        lacking.setattr("station.runner.execute.conclude_run", no_memory)
        failed = Outcome(folder, exit_code=0)
        conclude(RunRecord.go_on(folder, RealClock()), failed, report=False)
        assert failed.exit_code == 3
        assert "evaluation failed: this computer has no memory left" in str(failed.error)
    outcome = go_on(folder)
    assert outcome.exit_code == 0, outcome.error
    assert results_of(folder) == results_of(reference)


@pytest.mark.parametrize(
    ("units", "words"),
    [
        ([], "nothing"),
        (["warm-up", "IA"], "warm-up, IA"),
        ([f"ramp {n}" for n in range(60)], "60 units of work, the last ramp 59"),
    ],
)
def test_many_finished_units_are_counted_not_listed(units: list[str], words: str) -> None:
    assert units_in_words(units) == words
