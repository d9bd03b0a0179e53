"""What is said before a run begins, and what is noticed of the computer while it goes on."""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import PLAN, station, with_addresses
from small_disk import small_disk
from tiers import quick

from station.clock import RealClock, VirtualClock, system_clock_synchronised
from station.control.questions import Operator
from station.files.lookup import BENCHES, find
from station.procedure import Prompt
from station.record.folder import RunFolder, RunRecord
from station.runner.preflight import (
    SystemClockWatch,
    fault_of_output,
    warned_of_clock,
    watch_system_clock,
)
from station.runner.progress import how_long

NAME = "rlg-magnetic-sensitivity"
ANSWERS = "mount: done\nconnect-cables: done\ndut-power-on: done\ndut-power-off: done\n"


def sim_text() -> str:
    return find(BENCHES, "sim").read_text(encoding="utf-8")


@pytest.fixture
def taken_port() -> Iterator[int]:
    """A port of the loopback interface that somebody else listens on."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


def with_port(port: int, folder: Path) -> None:
    text = sim_text().replace("      coil: y\n", f"      coil: y\n      port: {port}\n")
    (folder / "bench.yaml").write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    "command",
    quick(
        [
            "sim bench.yaml",
            f"run {NAME} --bench bench.yaml --non-interactive",
            "identify bench.yaml",
        ],
        "sim bench.yaml",
    ),
)
def test_a_port_that_is_taken_is_one_sentence_naming_instrument_and_port(
    command: str, taken_port: int, tmp_path: Path
) -> None:
    with_port(taken_port, tmp_path)
    done = station(tmp_path, *command.split())
    assert done.returncode == 3
    assert f"coil_supply.y cannot be served on port {taken_port} of 127.0.0.1" in done.stderr
    assert "take `simulator.port` out of bench.yaml" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "runs").exists()


def test_a_port_that_two_instruments_want_is_a_fault_of_the_bench_file(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    text = sim_text()
    for axis in "xy":
        text = text.replace(f"      coil: {axis}\n", f"      coil: {axis}\n      port: {port}\n")
    (tmp_path / "bench.yaml").write_text(text, encoding="utf-8")
    done = station(tmp_path, "sim", "bench.yaml")
    assert done.returncode == 2
    assert f"coil_supply.y.simulator.port: coil_supply.x has port {port} already" in done.stderr


def test_a_port_that_cannot_be_one_is_a_fault_of_the_bench_file(tmp_path: Path) -> None:
    with_port(70000, tmp_path)
    done = station(tmp_path, "sim", "bench.yaml")
    assert done.returncode == 2
    assert "a port number goes up to 65535, got 70000" in done.stderr


@pytest.mark.parametrize(
    "command", quick(["sim bench.yaml", f"run {NAME} --bench bench.yaml"], "sim bench.yaml")
)
def test_a_simulated_bench_described_wrongly_is_told_with_its_file(
    command: str, tmp_path: Path
) -> None:
    text = sim_text().replace("    channel: 1\n", "    chanel: 1\n")
    (tmp_path / "bench.yaml").write_text(text, encoding="utf-8")
    done = station(tmp_path, *command.split())
    assert done.returncode == 2
    assert "bench.yaml: " in done.stderr
    assert "'channel' is missing" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_disk_too_small_for_the_plan_is_said_before_the_run_begins(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk") as disk:
        done = station(tmp_path, "run", NAME, "--non-interactive", "--output", str(disk))
        assert list(disk.iterdir()) == []
    assert done.returncode == 3
    assert f"the disk of {disk} is too small for this plan: it needs about" in done.stderr
    assert "choose another disk with --output" in done.stderr


def test_an_output_that_is_no_folder_is_said_before_the_run_begins(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    done = station(tmp_path, "run", NAME, "--non-interactive", "--output", "file/below/it")
    assert done.returncode == 3
    assert "file is no folder, so no run can be recorded in file/below/it" in done.stderr
    assert "choose another place with --output" in done.stderr


@pytest.mark.skipif(
    sys.platform == "win32" or os.geteuid() == 0, reason="whoever runs this may write anywhere"
)
def test_an_output_that_nobody_may_write_is_said(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    fault = fault_of_output(tmp_path / "runs")
    assert fault is not None
    assert f"nothing can be written in {tmp_path}" in fault


def test_an_output_that_is_not_there_yet_is_no_fault(tmp_path: Path) -> None:
    assert fault_of_output(tmp_path / "a" / "b") is None


def test_the_system_says_whether_its_clock_is_synchronised_or_that_it_does_not_know() -> None:
    assert system_clock_synchronised() in ({True, False, None} if on_linux() else {None})


def on_linux() -> bool:
    return sys.platform == "linux"


@pytest.mark.parametrize(
    ("expected_s", "real", "synchronised", "warned"),
    [
        (7200.0, True, False, True),
        (7200.0, True, True, False),
        (7200.0, True, None, False),
        (600.0, True, False, False),
        (7200.0, False, False, False),
    ],
)
def test_an_unsynchronised_clock_is_warned_of_before_a_long_run_on_real_instruments(
    expected_s: float, real: bool, synchronised: bool | None, warned: bool
) -> None:
    told = list(warned_of_clock(expected_s, real=real, synchronised=synchronised))
    assert [one.kind for one in told] == ["system-clock-unsynchronised"] * warned


def test_a_long_run_on_a_real_bench_goes_on_with_the_warning_in_its_log(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN.replace("100 s", "7200 s"), encoding="utf-8")
    real = sim_text().split("\nsimulation:")[0]
    for driver, address in {
        "kepco-bop-36-12": "TCPIP::127.0.0.{number}::9::SOCKET",
        "lakeshore-f71": "TCPIP::127.0.1.{number}::9::SOCKET",
        "can-pulse-board": "socketcand://127.0.0.1:9/can0",
    }.items():
        real = with_addresses(real, driver, address)
    (tmp_path / "real.yaml").write_text(real, encoding="utf-8")
    (tmp_path / "answers.yaml").write_text(ANSWERS, encoding="utf-8")
    arguments = "run plan.yaml --bench real.yaml --answers answers.yaml --non-interactive"
    done = station(tmp_path, *arguments.split())
    assert done.returncode == 3
    assert "- gaussmeter: " in done.stderr  # it went on and looked for the instruments
    unsynchronised = system_clock_synchronised() is False
    assert ("WARNING: nothing keeps this computer's clock right" in done.stderr) == unsynchronised
    (folder,) = (tmp_path / "runs").iterdir()
    events = [event.kind for event in RunFolder(folder).events]
    assert ("system-clock-unsynchronised" in events) == unsynchronised
    facts = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert facts["system_clock_synchronised"] == system_clock_synchronised()


def test_a_jump_of_the_system_clock_is_found_once_with_its_size() -> None:
    watch = SystemClockWatch(unix_s=1.7e9, boot_s=100.0)
    assert watch.jump_s(1.7e9 + 600.0, 700.0) is None
    assert watch.jump_s(1.7e9 + 1200.0 - 3600.0, 1300.0) == pytest.approx(-3600.0)
    assert watch.jump_s(1.7e9 + 1800.0 - 3600.0, 1900.0) is None


def test_the_system_clock_is_watched_at_the_end_of_each_unit_of_real_time(tmp_path: Path) -> None:
    clock = RealClock()
    record = RunRecord(tmp_path, "procedure", "SN-1", clock)
    watch_system_clock(record, clock)
    assert record.after_unit
    record.finish_unit("IA")
    record.close()
    assert [event.kind for event in RunFolder(record.path).events] == ["unit-finished"]


def test_a_jump_of_the_system_clock_is_an_event_after_its_unit(tmp_path: Path) -> None:
    clock = RealClock()
    record = RunRecord(tmp_path, "procedure", "SN-1", clock)
    times = iter([(1.7e9, 0.0), (1.7e9 + 60.0, 60.0), (1.7e9 + 3720.0, 120.0)])
    watch_system_clock(record, clock, lambda: next(times))
    record.finish_unit("IA")
    record.finish_unit("NA")
    record.close()
    events = [(event.kind, event.details) for event in RunFolder(record.path).events]
    assert [kind for kind, _ in events] == ["unit-finished", "unit-finished", "system-clock-jumped"]
    assert events[-1][1] == {"by_s": 3600.0}


def test_the_system_clock_is_not_watched_on_virtual_time(tmp_path: Path) -> None:
    clock = VirtualClock()
    record = RunRecord(tmp_path, "procedure", "SN-1", clock)
    watch_system_clock(record, clock)
    assert not record.after_unit
    record.close()


def test_the_first_lines_of_a_run_say_how_long_the_operator_waits() -> None:
    assert how_long(2520.0, VirtualClock()) == (
        "bench time about 42 min 00 s (virtual: waiting is skipped)"
    )
    assert how_long(2520.0, RealClock()) == "about 42 min 00 s"
    assert how_long(2520.0, RealClock(speed=42.0)) == (
        "bench time about 42 min 00 s, 42 times as fast: about 1 min 00 s"
    )


def test_the_simulated_world_does_what_an_answers_file_calls_done() -> None:
    operator = Operator(
        RealClock(), {"mount": "done"}, interactive=False, act=lambda act: f"{act} was done"
    )
    answer = operator.ask(Prompt("mount", "Mount the device."))
    assert (answer.text, answer.by) == ("mount was done", "simulated world")
