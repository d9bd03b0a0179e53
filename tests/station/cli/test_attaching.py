"""A run that outlives its terminal, and terminals that come and go."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from threading import Thread

import pytest
from command_line import PLAN, begun, station, station_command
from served_bench import served_bench
from terminal import OnTerminal, hears_hang_up

from station.cli.attaching import LogTimes
from station.clock import RealClock, local_time
from station.control.channel import Incoming
from station.control.questions import PromptQueue
from station.control.status import read_status
from station.errors import EXIT_ABORTED, EXIT_DONE, EXIT_WRONG_INPUT, Aborted
from station.files.locks import FileLock
from station.method.prompts import Prompt
from station.record.events import Event as LogEvent
from station.record.events import EventLog, LogTail
from station.record.layout import EVENTS, LOCK, RUN

WITHIN_S = 60.0
MOUNT = Prompt("mount", "Mount the gyro.")


@contextmanager
def detached_run(folder: Path) -> Iterator[Path]:
    """A run that waits at its first prompt, as on a real bench, with no terminal."""
    (folder / "plan.yaml").write_text(PLAN, encoding="utf-8")
    started = station(folder, "run", "plan.yaml", "--rehearse", "--detach", CI="")
    assert started.returncode == 0, started.stderr
    (run,) = (folder / "runs").iterdir()
    assert f"station attach {run}" in started.stdout
    try:
        yield run
    finally:
        if read_status(run).running:
            station(folder, "abort", str(run))


def answers(run: Path) -> list[tuple[str, str]]:
    events = LogTail(run).new_events()
    return [(one.details["id"], one.details["by"]) for one in events if one.kind == "prompt"]


def test_whoever_attaches_answers_and_whoever_leaves_ends_nothing(tmp_path: Path) -> None:
    with detached_run(tmp_path) as run:
        first = OnTerminal(tmp_path, "attach", run)
        first.wait_for("[mount]")
        first.process.send_signal(signal.SIGHUP)  # its window is closed
        first.ended()
        assert read_status(run).running
        second = OnTerminal(tmp_path, "attach", "SN-1")
        second.wait_for("[mount]")
        second.type("perhaps\n")
        second.wait_for("'perhaps' is no answer here")
        second.type("yes\n")
        second.wait_for("[connect-cables]")
        assert answers(run) == [("mount", "operator")]
        second.type("no\n")
        assert second.ended() == 4
        second.wait_for("ended the run at the prompt connect-cables")
        status = read_status(run)
        assert not status.running
        assert status.bench_safe


def test_the_serial_number_of_an_earlier_run_means_the_one_that_is_active(tmp_path: Path) -> None:
    with detached_run(tmp_path) as run:
        earlier = tmp_path / "runs" / "20250101T000000Z-rlg-magnetic-sensitivity-SN-1"
        earlier.mkdir()
        (earlier / EVENTS).touch()
        seen = station(tmp_path, "status", "SN-1", "--json")
        assert json.loads(seen.stdout)["run"] == f"runs/{run.name}", seen.stderr
        aborted = station(tmp_path, "abort", "SN-1")
        assert aborted.returncode == 0, aborted.stderr
        assert not read_status(run).running


@pytest.mark.campaign
def test_keys_from_before_a_prompt_was_read_answer_nothing(tmp_path: Path) -> None:
    with detached_run(tmp_path) as run:
        terminal = OnTerminal(tmp_path, "attach", run)
        terminal.type("\n")
        terminal.wait_for(">> Mount the gyro")
        terminal.type("\n")  # too soon to have been read
        terminal.wait_for("[mount]")
        terminal.type("perhaps\n")
        terminal.wait_for("'perhaps' is no answer here")
        assert answers(run) == []
        terminal.type("d\n")
        assert terminal.ended() == 0
        terminal.wait_for("the run goes on; to attach again")
        assert read_status(run).running


@pytest.mark.campaign
def test_ctrl_c_in_an_attached_terminal_ends_the_run_safely(tmp_path: Path) -> None:
    with detached_run(tmp_path) as run:
        terminal = OnTerminal(tmp_path, "attach", run)
        terminal.wait_for("[mount]")
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.ended() == 4
        terminal.wait_for(f"station resume {run}")
        status = read_status(run)
        assert (status.running, status.bench_safe) == (False, True)


def test_a_detached_run_goes_to_its_end_and_attach_shows_its_results(tmp_path: Path) -> None:
    # Long enough that it still goes on when another process has come up on a busy computer.
    longer = PLAN.replace("duration: 100 s", "duration: 1500 s")
    (tmp_path / "plan.yaml").write_text(longer, encoding="utf-8")
    started = station(tmp_path, "run", "plan.yaml", "--detach", "--non-interactive", "--json")
    assert started.returncode == 0, started.stderr
    (run,) = (tmp_path / "runs").iterdir()
    assert Path(json.loads(started.stdout)["run"]).samefile(run)
    seen = station(tmp_path, "attach", str(run))
    assert seen.returncode == 0, seen.stderr
    assert "magnetic_sensitivity IA" in seen.stdout
    assert "S9  Switch the coils and the gyro off" in seen.stderr
    again = station(tmp_path, "attach", str(run))
    assert again.returncode == 0
    assert "magnetic_sensitivity IA" in again.stdout


def test_attach_says_that_a_killed_run_is_gone_and_its_bench_is_not_verified(
    tmp_path: Path,
) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    started = station(tmp_path, "run", "plan.yaml", "--rehearse", "--detach", CI="")
    (run,) = (tmp_path / "runs").iterdir()
    process = re.search(r"in process (\d+)", started.stdout)
    assert process is not None
    os.kill(int(process.group(1)), signal.SIGKILL)
    until_s = time.monotonic() + WITHIN_S
    while read_status(run).running and time.monotonic() < until_s:
        time.sleep(0.02)
    seen = station(tmp_path, "attach", str(run))
    assert seen.returncode == 3
    assert f"`station resume {run}` resumes it" in seen.stderr
    assert "NOT VERIFIED: go to the bench" in seen.stderr


def test_attach_gives_each_past_step_the_time_at_which_it_began(tmp_path: Path) -> None:
    began = local_time() - timedelta(hours=2)
    begins = [began, began + timedelta(hours=1)]
    again = [{"resumed_utc": begins[1].isoformat()}]
    facts = {"started_utc": begins[0].isoformat(), "resumed": again}
    (tmp_path / RUN).write_text(json.dumps(facts), encoding="utf-8")
    log, lock = EventLog(tmp_path / EVENTS), FileLock(tmp_path / LOCK)
    steps = [{"step": number, "title": "T", "expected_s": 9e4} for number in ("S1", "S2")]
    for time_s, kind, details in (
        (500.0, "run-started", {"speed": 10.0, "steps": steps}),
        (6500.0, "step-started", {"step": "S1", "title": "T"}),  # 600 s later
        (7000.0, "resumed", {}),
        (7600.0, "step-started", {"step": "S2", "title": "T"}),  # 60 s later
    ):
        log.append(time_s, kind, details, durable=False)
    log.close()
    process = begun(tmp_path, "attach", tmp_path)
    assert process.stderr is not None
    shown: list[str] = []
    while not any("  S2  " in line for line in shown):
        shown.append(process.stderr.readline())
    lock.release()
    process.communicate(timeout=WITHIN_S)
    times = {line.split()[-2]: line.split("  ")[0] for line in shown if line.endswith("  T\n")}
    expected = (begins[0] + timedelta(seconds=600), begins[1] + timedelta(seconds=60))
    for number, moment in zip(("S1", "S2"), expected, strict=True):
        assert times[number].endswith(f"{moment:%H:%M:%S}"), shown


def test_attach_to_a_run_that_was_paused_says_how_much_of_its_work_is_done(tmp_path: Path) -> None:
    (tmp_path / RUN).write_text("{}", encoding="utf-8")
    log, lock = EventLog(tmp_path / EVENTS), FileLock(tmp_path / LOCK)
    steps = [{"step": number, "title": "T", "expected_s": 100.0} for number in ("S1", "S2")]
    for time_s, kind, details in (
        (500.0, "run-started", {"speed": 1.0, "steps": steps, "units_expected": {"a": 1, "b": 1}}),
        (500.0, "step-started", {"step": "S1", "title": "T"}),
        (600.0, "unit-finished", {"unit": "a"}),
        (600.0, "paused", {"devices": {}}),
        (4200.0, "went-on", {}),
        (4200.0, "step-finished", {"step": "S1"}),
        (4200.0, "step-started", {"step": "S2", "title": "T"}),
        (4250.0, "unit-finished", {"unit": "b"}),
    ):
        log.append(time_s, kind, details, durable=False)
    log.close()
    process = begun(tmp_path, "attach", tmp_path)
    assert process.stderr is not None
    shown: list[str] = []
    while not any(line.endswith("  b\n") for line in shown):
        shown.append(process.stderr.readline())
    lock.release()
    process.communicate(timeout=WITHIN_S)
    assert re.findall(r"(\S+) %  bench time left", "".join(shown)) == ["50", "75"]


def test_on_virtual_time_the_bench_time_of_a_step_is_given(tmp_path: Path) -> None:
    times = LogTimes(tmp_path)
    assert times.of(LogEvent(50.0, "run-started", {"speed": None})) == "+ 0 s"
    assert times.of(LogEvent(3650.0, "step-started", {})) == "+ 1 h 00 min"


def test_what_keeps_a_detached_run_from_beginning_is_shown(tmp_path: Path) -> None:
    refused = station(tmp_path, "run", "no-such-plan", "--detach", "--non-interactive")
    assert refused.returncode == 2
    assert "no-such-plan" in refused.stderr
    assert not (tmp_path / "runs").exists()


def asked(desk: PromptQueue, prompt_id: str, text: str) -> str:
    incoming = Incoming("answer", {"id": prompt_id, "text": text})
    desk.take(incoming)
    return str(incoming.final["outcome"])


def test_a_prompt_that_nobody_answers_ends_the_run() -> None:
    with pytest.raises(Aborted, match="no answer came to the prompt mount"):
        PromptQueue(RealClock(), within_s=0.2).ask(MOUNT)


def test_an_answer_counts_once_and_for_the_prompt_that_waits() -> None:
    desk, said = PromptQueue(RealClock(), within_s=30.0), list[str]()

    def ask() -> None:
        try:
            desk.ask(MOUNT)
        except Aborted as ended:
            said.append(str(ended))

    waiting = Thread(target=ask)
    waiting.start()
    while asked(desk, "mount", "maybe") != "no-answer":
        time.sleep(0.01)
    assert asked(desk, "connect-cables", "yes") == "refused"
    assert asked(desk, "mount", "n") == "taken"
    waiting.join(WITHIN_S)
    assert said == ["the answer `n` ended the run at the prompt mount"]
    assert asked(desk, "mount", "yes") == "refused"


def test_without_a_terminal_attach_names_the_prompt_and_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with detached_run(tmp_path) as run:
        watching = subprocess.Popen(
            station_command("attach", run),
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert watching.stderr is not None
        assert any("[mount]" in line for line in watching.stderr)
        assert read_status(run).running
        station(tmp_path, "abort", str(run))
        watching.communicate(timeout=WITHIN_S)
        assert watching.returncode == 4


@pytest.mark.campaign
def test_a_run_at_a_terminal_outlives_it(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    terminal = OnTerminal(tmp_path, "run", "plan.yaml", "--rehearse")
    terminal.wait_for("[mount]")
    (run,) = (tmp_path / "runs").iterdir()
    try:
        terminal.wait_for(f"station attach {run}")
        terminal.process.send_signal(signal.SIGHUP)  # its window is closed
        terminal.ended()
        assert read_status(run).running
        again = OnTerminal(tmp_path, "attach", "SN-1")
        again.wait_for("[mount]")
        again.process.send_signal(signal.SIGINT)
        assert again.ended() == EXIT_ABORTED
    finally:
        if read_status(run).running:
            station(tmp_path, "abort", str(run))
    assert read_status(run).bench_safe


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_end_the_run_at_its_terminal(tmp_path: Path, how: int) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    terminal = OnTerminal(tmp_path, "run", "plan.yaml", "--rehearse")
    terminal.wait_for("[mount]")
    terminal.process.send_signal(how)
    assert terminal.ended() == EXIT_ABORTED
    (run,) = (tmp_path / "runs").iterdir()
    assert f"station resume {run}" in terminal.shown
    status = read_status(run)
    assert (status.running, status.bench_safe) == (False, True)


def test_a_plan_with_a_fault_is_refused_at_a_terminal_as_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN.replace("1 mT", "1 furlong"), encoding="utf-8")
    terminal = OnTerminal(tmp_path, "run", "plan.yaml", "--rehearse")
    assert terminal.ended() == EXIT_WRONG_INPUT
    terminal.wait_for("plan.yaml:6:14: parameters.amplitude")


@pytest.mark.campaign
def test_a_run_goes_on_when_its_terminal_closes_and_nobody_is_asked(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    with served_bench(tmp_path, speed=20.0) as (at, _):
        options = ("--served", at, "--non-interactive", "--output", tmp_path / "runs")
        process = subprocess.Popen(
            station_command("run", tmp_path / "plan.yaml", *options),
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=hears_hang_up,
        )
        until_s = time.monotonic() + WITHIN_S
        while not any((tmp_path / "runs").glob("*/raw/*.mcap")):
            assert time.monotonic() < until_s
            time.sleep(0.02)
        process.send_signal(signal.SIGHUP)
        assert process.wait(WITHIN_S) == EXIT_DONE
    (run,) = (tmp_path / "runs").iterdir()
    assert "terminal-closed" in [one.kind for one in LogTail(run).new_events()]
