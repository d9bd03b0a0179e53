"""The command line as its users run it: what it prints, where, and its exit codes."""

from __future__ import annotations

import json
import os
import pty
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from bad_input_files import here
from command_line import PLAN, begun, station, station_command, with_addresses
from places import SIM


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """One run by the command line: its folder, the document it printed, its messages."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(folder, "run", "plan.yaml", "--json", "--output", "here", CI="true")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    return folder / document["run"], document, done.stderr


def test_run_prints_one_json_document_and_the_rest_on_standard_error(
    finished: tuple[Path, dict[str, Any], str],
) -> None:
    folder, document, messages = finished
    assert document["schema"] == 1
    assert document["procedure"] == "rlg-magnetic-sensitivity"
    assert document["verdict"] == "pass"
    (result,) = document["results"]
    assert result["name"] == "magnetic_sensitivity"
    assert result["axis"] == "IA"
    assert result["unit"] == "deg/h/mT"
    assert result["limit"] == {"max_abs": 0.2}
    assert result["expanded_uncertainty"] > 0
    assert document["as_published"][0]["method"] == "dft-peak"
    assert {"simulated"} <= {flag["code"] for flag in document["flags"]}
    assert "S9" in messages
    assert folder.parent.name == "here"
    assert folder.name.endswith("Z-rlg-magnetic-sensitivity-SN-1")


def test_serial_number_and_operator_of_the_command_line_are_in_the_record(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    who = ("--serial", "42", "--operator", "O'Neill")
    looked = station(tmp_path, "run", "plan.yaml", "--dry-run", *who, "--json")
    assert json.loads(looked.stdout)["dut"]["serial"] == "42", looked.stderr
    done = station(tmp_path, "run", "plan.yaml", *who, "--set", "title=trial", CI="true")
    assert done.returncode == 0, done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    assert run.name.endswith("-rlg-magnetic-sensitivity-42")
    plan = yaml.safe_load((run / "plan.resolved.yaml").read_text(encoding="utf-8"))
    assert (plan["dut"]["serial"], plan["operator"]) == ("42", "O'Neill")
    assert "dut.serial='42'" in json.loads((run / "run.json").read_text(encoding="utf-8"))["set"]
    refused = station(tmp_path, "run", "plan.yaml", "--serial", "a/b", CI="true")
    assert refused.returncode == 2
    assert "dut.serial" in refused.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="file names of bytes")
@pytest.mark.parametrize("verb", [["run", "plan.yaml"], ["analyse", "."], ["history"]])
def test_an_output_that_is_no_utf_8_is_refused_in_a_sentence(
    tmp_path: Path, verb: list[str]
) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(tmp_path, *verb, "--output", os.fsdecode(b"out\xff"), "--json", CI="true")
    assert done.returncode == 2
    assert "out\\xff is no UTF-8; name another folder" in json.loads(done.stdout)["error"]
    assert [path.name for path in tmp_path.iterdir()] == ["plan.yaml"]


def test_no_colour_codes_leave_the_program(finished: tuple[Path, dict[str, Any], str]) -> None:
    assert "\x1b" not in finished[2]


def test_the_report_of_a_run_needs_nothing_beside_it(
    finished: tuple[Path, dict[str, Any], str],
) -> None:
    page = (finished[0] / "report.html").read_text(encoding="utf-8")
    assert "SN-1" in page
    assert "simulated" in page.lower()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    assert "<script" not in page


def test_report_is_made_again_in_the_exports_folder(
    finished: tuple[Path, dict[str, Any], str],
) -> None:
    folder = finished[0]
    done = station(folder.parent, "report", str(folder))
    assert done.returncode == 0, done.stderr
    again = (folder / "exports" / "report.html").read_text(encoding="utf-8")
    assert again == (folder / "report.html").read_text(encoding="utf-8")


def test_analyse_adds_a_revision_and_compares(finished: tuple[Path, dict[str, Any], str]) -> None:
    folder = finished[0]
    stored = (folder / "results.json").read_bytes()
    done = station(folder.parent, "analyze", str(folder), "--json", "--compare")
    assert done.returncode == 0, done.stderr
    assert "largest difference from the stored results: 0 standard uncertainties" in done.stderr
    assert json.loads(done.stdout) == json.loads(stored)
    assert (folder / "results.json").read_bytes() == stored
    assert (folder / "revisions" / "001" / "results.json").read_bytes() == stored


def test_every_fault_of_a_plan_is_reported_at_once_with_line_and_column(tmp_path: Path) -> None:
    text = (
        PLAN.replace("frequency: 0.1 Hz", "frequency: 0.5 Hz")
        .replace("amplitude: 1 mT", "amplitude: 1 mt")
        .replace("pulse_weight", "pulse_wieght")
        .replace("max_abs: 0.2 deg/h/mT", "max_abs: 0.2")
        .replace("serial: SN-1", "serail: SN-1")
    )
    (tmp_path / "plan.yaml").write_text(text, encoding="utf-8")
    done = station(tmp_path, "validate", "plan.yaml")
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    places = [line.split(" ")[0] for line in lines]
    assert "plan.yaml:3:22:" in places  # unknown key serail
    assert "plan.yaml:5:14:" in places  # frequency outside the published range
    assert "plan.yaml:6:14:" in places  # mt
    assert "plan.yaml:10:3:" in places  # pulse_wieght
    assert "plan.yaml:13:35:" in places  # a bare number
    assert "did you mean 'pulse_weight'" in done.stderr
    assert "0.05 Hz to 0.2 Hz" in done.stderr
    assert all(line.count("plan.yaml") == 1 for line in lines)


def test_run_refuses_a_faulty_plan_before_anything_happens(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN.replace("1 mT", "5 mT"), encoding="utf-8")
    done = station(tmp_path, "run", "plan.yaml", "--non-interactive")
    assert done.returncode == 2
    assert "plan.yaml:6:14: parameters.amplitude" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_a_plan_beyond_the_benchs_limits_names_the_limit(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN.replace("1 mT", "2 mT"), encoding="utf-8")
    bench = SIM.read_text(encoding="utf-8")
    (tmp_path / "weak.yaml").write_text(
        bench.replace("8 A", "5 A").replace("above: 8.2 A", "above: 5.2 A"), encoding="utf-8"
    )
    done = station(tmp_path, "validate", "plan.yaml", "--bench", "weak.yaml")
    assert done.returncode == 2
    assert "needs 6.67 A from coil_supply.x, the bench allows 5 A" in done.stderr


def test_a_prompt_nobody_can_answer_names_the_entry_to_give(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    bench = SIM.read_text(encoding="utf-8")
    real = bench.split("\nsimulation:")[0]
    (tmp_path / "real.yaml").write_text(real, encoding="utf-8")
    done = station(tmp_path, "run", "plan.yaml", "--bench", "real.yaml", CI="true")
    assert done.returncode == 2
    for prompt in ("mount: done", "connect-cables: done", "dut-power-on: done"):
        assert prompt in done.stderr
    assert "--answers" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_absent_instruments_are_all_named_at_once(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    bench = SIM.read_text(encoding="utf-8")
    real = bench.split("\nsimulation:")[0]
    for driver, address in {
        "kepco-bop-36-12": "TCPIP::127.0.0.{number}::9::SOCKET",
        "lakeshore-f71": "TCPIP::127.0.1.{number}::9::SOCKET",
        "can-pulse-board": "socketcand://127.0.0.1:9/can0",
    }.items():
        real = with_addresses(real, driver, address)
    (tmp_path / "real.yaml").write_text(real, encoding="utf-8")
    answers = "mount: done\nconnect-cables: done\ndut-power-on: done\ndut-power-off: done\n"
    (tmp_path / "answers.yaml").write_text(answers, encoding="utf-8")
    done = station(
        tmp_path, "run", "plan.yaml", "--bench", "real.yaml", "--answers", "answers.yaml", CI="true"
    )
    assert done.returncode == 3
    for name in ("coil_supply.x", "gaussmeter", "gyro_acquisition"):
        assert f"- {name}: " in done.stderr
    assert done.stderr.count("Connection refused") == 3
    assert "Traceback" not in done.stderr


def test_interrupting_a_run_leaves_a_safe_bench_and_exit_code_4(tmp_path: Path) -> None:
    text = PLAN.replace("duration: 100 s", "duration: 40 h").replace("10 deg/h^2", "50 deg/h^2")
    (tmp_path / "plan.yaml").write_text(text, encoding="utf-8")
    process = begun(tmp_path, "run", "plan.yaml", "--non-interactive", "--json")
    assert process.stderr is not None
    for line in process.stderr:
        if "samples" in line:
            break
    process.send_signal(signal.SIGINT)
    printed, messages = process.communicate(timeout=60)
    assert process.returncode == 4, messages
    assert "the bench is safe" in messages
    document = json.loads(printed)
    assert document["verdict"] == "none"
    assert all(one["verified"] for one in document["safe_state"])


def test_identify_compares_serial_numbers(tmp_path: Path) -> None:
    done = station(tmp_path, "identify", "sim", "--json")
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    assert {row["instrument"] for row in rows} >= {"coil_supply.x", "gaussmeter"}
    bench = SIM.read_text(encoding="utf-8")
    wrong = bench.replace("      coil: x\n", "      serial: H0\n      coil: x\n")
    (tmp_path / "wrong.yaml").write_text(wrong, encoding="utf-8")
    done = station(tmp_path, "identify", "wrong.yaml")
    assert done.returncode == 3
    assert "serial number H0 answers" in done.stdout


def test_list_names_what_there_is(tmp_path: Path) -> None:
    done = station(tmp_path, "list", "--json")
    listed = json.loads(done.stdout)
    assert "rlg-magnetic-sensitivity" in [row["name"] for row in listed["procedures"]]
    assert "rlg-magnetic-sensitivity" in [row["name"] for row in listed["plans"]]
    assert "sim" in [row["name"] for row in listed["benches"]]
    assert "kepco-bop-36-12" in [row["name"] for row in listed["drivers"]]
    assert listed["runs"] == []


def test_wrong_usage_is_exit_code_2(tmp_path: Path) -> None:
    assert station(tmp_path, "run").returncode == 2
    assert station(tmp_path, "levitate").returncode == 2
    done = station(tmp_path, "run", "rlg-magnetic-sensitivty")
    assert done.returncode == 2
    assert "did you mean" in done.stderr
    for arguments in (("run", "--json"), ("status", "--bogus", "--json"), ("levitate", "--json")):
        assert json.loads(station(tmp_path, *arguments).stdout)["exit_code"] == 2


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("list certificates --search A", "--search and --page are of the runs"),
        ("list certificates --page 2", "leave them out with certificates"),
        ("list plans --store here", "--store is of runs and certificates"),
        ("history --acknowledge A --reason mended --html a.html", "--acknowledge lists and draws"),
        ("history --acknowledge A --reason mended --dut SN-1", "--acknowledge lists and draws"),
        ("history --acknowledge A --reason mended --rebuild", "--acknowledge lists and draws"),
        ("report {run} --paper letter", "--paper is of a PDF: give --format pdf"),
    ],
)
def test_an_option_that_would_be_ignored_is_refused(
    line: str, said: str, finished: tuple[Path, dict[str, Any], str], tmp_path: Path
) -> None:
    done = station(tmp_path, *line.format(run=finished[0]).split())
    assert done.returncode == 2
    assert said in " ".join(done.stderr.split())


def test_a_cmc_of_no_result_is_refused_with_the_nearest_name(tmp_path: Path) -> None:
    bench = yaml.safe_load(SIM.read_text(encoding="utf-8"))
    bench["laboratory"] = {"name": "L", "address": "A", "cmc": {"magnetic_sensitivty": "1 nT"}}
    (tmp_path / "bench.yaml").write_text(yaml.safe_dump(bench), encoding="utf-8")
    for lang, meant in (("en", "did you mean 'magnetic_sensitivity'"), ("zh", "您是否指 ")):
        arguments = ("validate", "rlg-magnetic-sensitivity", "--bench", "bench.yaml")
        done = station(tmp_path, *arguments, "--lang", lang)
        assert done.returncode == 2
        assert "laboratory.cmc.magnetic_sensitivty" in done.stderr and meant in done.stderr


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("stauts", "Error: No such command 'stauts'.\nDid you mean 'status'?\n"),
        ("frobnicate", "Error: No such command 'frobnicate'.\nthere are run, attach, pause, "),
        ("run x --non-interactve", "option: --non-interactve\nDid you mean --non-interactive?\n"),
        ("new pln x", "for 'kind': Did you mean 'plan'?\n'pln' is not one of 'procedure', "),
        ("list nix", "Error: Invalid value for 'kind': 'nix' is not one of 'procedures', "),
        ("run x y", "Error: Got unexpected extra arguments (y)\n"),
        ("run rlg-magnetic-sensitivity --served no.json", "the path no.json does not exist\n"),
    ],
)
def test_what_was_meant_comes_first_then_what_there_is(
    line: str, said: str, tmp_path: Path
) -> None:
    done = here(line.split(), tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr


def test_sim_serves_instruments_to_any_client_until_interrupted(tmp_path: Path) -> None:
    process = begun(tmp_path, "sim", "sim", "--speed", "50")
    assert process.stdout is not None
    head = json.loads(process.stdout.readline())
    assert head["clock"]["speed"] == 50.0
    assert head["clock"]["epoch_unix"] > 1.6e9
    supply, board = head["instruments"]["coil_supply.x"], head["instruments"]["gyro_acquisition"]
    assert supply["protocol"] == "scpi"
    assert supply["address"] == f"TCPIP::{supply['host']}::{supply['port']}::SOCKET"
    assert board["protocol"] == "socketcand"
    assert Path(board["dbc"]).is_file()
    with socket.create_connection((supply["host"], supply["port"]), 5) as client:
        client.sendall(b"*IDN?\n")
        assert client.recv(4096).startswith(b"KEPCO")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    assert process.returncode == 0


def test_sim_ends_with_whoever_started_it(tmp_path: Path) -> None:
    process = begun(tmp_path, "sim", "sim", "--until-stdin-closes")
    assert process.stdout is not None and process.stdin is not None
    process.stdout.readline()
    process.stdin.write("report\n")
    process.stdin.flush()
    assert process.poll() is None
    process.stdin.close()
    assert process.wait(20) == 0


@pytest.mark.campaign
def test_a_run_on_a_bench_served_by_another_process_finds_the_same_sensitivity(
    tmp_path: Path,
) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    with (tmp_path / "served.json").open("w", encoding="utf-8") as first_line:
        process = begun(
            tmp_path, "sim", "sim", "--speed", "40", "--until-stdin-closes", stdout=first_line
        )
    assert process.stderr is not None
    assert "serving" in process.stderr.readline()
    try:
        done = station(tmp_path, "run", "plan.yaml", "--served", "served.json", "--json", CI="true")
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=20)
    assert done.returncode == 0, done.stderr
    (result,) = json.loads(done.stdout)["results"]
    assert abs(result["value"] - 0.045) < 3 * result["standard_uncertainty"]


IN_THE_BACKGROUND = """\
import fcntl, os, signal, subprocess, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
signal.signal(signal.SIGTTOU, signal.SIG_IGN)
child = subprocess.Popen(sys.argv[1:], process_group=0)
for line in sys.stdin:
    os.tcsetpgrp(0, child.pid)
    break
sys.exit(child.wait())
"""
FAULT = "{instrument: gaussmeter, fault: frozen}\n"


def test_faults_typed_to_sim_on_a_terminal_are_injected() -> None:
    """First in the background of the terminal, where it must not be stopped, then in front."""
    keyboard, terminal = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", IN_THE_BACKGROUND, *station_command("sim")],
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        start_new_session=True,
    )
    os.close(terminal)
    assert process.stdout is not None and process.stderr is not None
    try:
        assert "gaussmeter" in json.loads(process.stdout.readline())["instruments"]
        assert process.stderr.readline().startswith("serving")
        os.write(keyboard, b"to the front\n")
        os.write(keyboard, FAULT.encode())
        assert process.stderr.readline().startswith("gaussmeter: frozen injected at ")
        os.write(keyboard, b"report\n")
        assert json.loads(process.stderr.readline())["faults"][0]["fault"] == "frozen"
        os.write(keyboard, b"\x03")
        assert process.wait(20) == 0
        assert process.stdout.read() == ""
        assert process.stderr.read() == ""
    finally:
        os.close(keyboard)  # what is left hangs up
        process.kill()
        process.wait(20)
