"""However a run ends: the bench is at rest, what was not verified is named, the folder opens."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from command_line import PLAN, begun
from rlg_runs import short_run

from station.cli import main
from station.cli.analysing import analyse_run
from station.clock import utc_today
from station.errors import InterlockTripped
from station.record.folder import RunFolder, RunRecord
from station.record.layout import Presence
from station.recorded import read_plan_and_bench
from station.runner import evaluation
from station.runner.evaluation import flags_of_run
from station.runner.execute import export
from station.runner.outcome import NO_MEMORY, in_one_sentence

ONE_AXIS = {"parameters/axes": ["IA"], "parameters/duration": "100 s"}


def test_a_safe_state_that_cannot_be_verified_is_named_and_is_exit_code_3(tmp_path: Path) -> None:
    # No supply reads back a current this small: rest cannot be proven.
    limit = "instruments/coil_supply.x/limits/zero_current"
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS, bench={limit: "1e-9 A"})
    assert outcome.exit_code == 3
    used = [(one.instrument, one.verified) for one in outcome.safe if one.used]
    assert used == [("coil_supply.x", False)]
    folder = RunFolder(outcome.folder)
    (safe,) = folder.events_of("safe-state")
    assert safe.details["outcomes"][0]["instrument"] == "coil_supply.x"
    document = analyse_run(outcome.folder, None, compare=False)
    assert "safe-state-unverified" in {flag.code for flag in document.flags}
    assert document.verdict == "inconclusive"


def test_a_supply_in_compliance_shows_in_the_measured_field(tmp_path: Path) -> None:
    outcome, truth = short_run(
        tmp_path,
        plan={"parameters/axes": ["NA"], "parameters/amplitude": "2 mT"},
        bench={"instruments/coil_supply.y/limits/voltage": "1 V"},
    )
    assert outcome.document is not None
    flags = {flag.code: flag for flag in outcome.document.flags}
    assert flags["field-differs-from-commanded"].details["relative_difference"] < -0.5
    (result,) = outcome.document.results
    assert result.combined is not None
    error = result.estimate.value - truth["NA"]
    assert abs(error) < 3 * result.combined.standard_uncertainty


@pytest.mark.campaign
def test_a_run_that_ended_early_is_analysed_as_far_as_it_went(tmp_path: Path) -> None:
    text = PLAN.replace("axes: [IA]", "axes: [IA, LA]").replace("100 s", "2000 s")
    (tmp_path / "plan.yaml").write_text(text, encoding="utf-8")
    process = begun(tmp_path, "run", "plan.yaml", "--non-interactive")
    assert process.stderr is not None
    for line in process.stderr:
        if "IA: as published" in line:
            break
    process.send_signal(signal.SIGTERM)
    _, messages = process.communicate(timeout=60)
    assert process.returncode == 4, messages
    (folder,) = (tmp_path / "runs").iterdir()
    document = analyse_run(folder, None, compare=False)
    values = {result.estimate.axis: result.estimate.value for result in document.results}
    assert values["IA"] is not None
    assert values["LA"] is None
    missing = [flag for flag in document.flags if flag.code == "not-identifiable"]
    assert [(flag.axis, "was not measured" in flag.message) for flag in missing] == [("LA", True)]


def test_an_overdue_calibration_is_flagged(tmp_path: Path) -> None:
    due = "instruments/gaussmeter/calibration/due"
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS, bench={due: "2026-02-01"})
    assert outcome.document is not None
    flags = {flag.code: flag for flag in outcome.document.flags}
    assert "gaussmeter was due on 2026-02-01" in flags["calibration-overdue"].message


def test_a_calibration_that_became_overdue_while_the_run_stood_is_flagged(tmp_path: Path) -> None:
    due = str(utc_today() + timedelta(days=30))
    outcome, _ = short_run(
        tmp_path, plan=ONE_AXIS, bench={"instruments/gaussmeter/calibration/due": due}
    )
    folder = RunFolder(outcome.folder)
    bench = read_plan_and_bench(folder)[1]
    assert "calibration-overdue" not in {flag.code for flag in flags_of_run(folder, bench)}
    last, days = folder.events[-1], 86400.0 * 40
    folder.events = (*folder.events, replace(last, time_s=last.time_s + days))
    assert "calibration-overdue" in {flag.code for flag in flags_of_run(folder, bench)}


def test_a_bench_whose_instruments_have_simulators_is_called_simulated(tmp_path: Path) -> None:
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS)
    folder = RunFolder(outcome.folder)
    bench = read_plan_and_bench(folder)[1]
    real = replace(bench, file=bench.file.model_copy(update={"simulation": None}))
    assert real.simulation is None
    assert "simulated" in {flag.code for flag in flags_of_run(folder, real)}


@pytest.mark.campaign
def test_a_terminal_that_is_gone_ends_no_run(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    process = begun(tmp_path, "run", "plan.yaml", "--non-interactive", stdout=subprocess.DEVNULL)
    assert process.stderr is not None
    process.stderr.readline()
    process.stderr.close()
    process.wait(timeout=60)
    (folder,) = (tmp_path / "runs").iterdir()
    assert (folder / "results.json").is_file()
    assert (folder / "manifest.json").is_file()


def test_a_run_without_memory_says_so_in_one_sentence() -> None:
    assert in_one_sentence(MemoryError()).startswith("this computer has no memory left")
    unloaded = ImportError("a.so: failed to map segment from shared object")
    assert in_one_sentence(unloaded) == in_one_sentence(MemoryError())
    assert in_one_sentence(KeyError("x")) == "a fault of the program: 'x' is missing"


@pytest.mark.parametrize(
    "error",
    [
        SystemError("<built-in function len> returned NULL without setting an exception"),
        SystemError("error return without exception set"),
        RuntimeError("can't start new thread"),
        OSError("Unable to synchronously create dataset (memory allocation failed)"),
        RuntimeError("Allocation error : not enough memory"),
    ],
    ids=str,
)
def test_a_c_library_without_memory_is_no_fault_of_the_program(error: Exception) -> None:
    assert in_one_sentence(error) == in_one_sentence(MemoryError())


def test_what_comes_of_a_lack_of_memory_is_no_fault_of_the_program() -> None:
    come_of_it = SystemError("<class 'Event'> returned a result with an exception set")
    come_of_it.__cause__ = MemoryError()
    assert in_one_sentence(come_of_it) == in_one_sentence(MemoryError())
    ours = InterlockTripped("a", "it is warm", 0.0)
    ours.__context__ = MemoryError()
    assert in_one_sentence(ours) == str(ours)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to itself there")
def test_ctrl_c_at_the_end_of_the_last_step_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted = RunRecord.event

    def note(record: RunRecord, kind: str, **details: Any) -> None:
        noted(record, kind, **details)
        if kind == "step-finished" and details["step"] == "S9":
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(RunRecord, "event", note)
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS)
    assert (outcome.exit_code, outcome.error) == (4, "the run was ended by Ctrl-C")
    assert outcome.document is None


def test_a_step_that_leaves_the_program_is_not_recorded_as_a_complete_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted = RunRecord.event
    records: list[RunRecord] = []

    def note(record: RunRecord, kind: str, **details: Any) -> None:
        noted(record, kind, **details)
        if kind == "step-finished":
            records.append(record)
            raise SystemExit(0)

    monkeypatch.setattr(RunRecord, "event", note)
    with pytest.raises(SystemExit):
        short_run(tmp_path, plan=ONE_AXIS)
    (ended,) = RunFolder(records[0].path).events_of("run-ended")
    assert ended.details["complete"] is False


def test_a_folder_that_cannot_be_sealed_keeps_back_no_word_of_the_bench(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_memory(record: RunRecord) -> None:
        raise MemoryError

    monkeypatch.setattr(RunRecord, "seal", without_memory)
    outcome, _ = short_run(tmp_path, plan=ONE_AXIS)
    assert outcome.exit_code == 3
    assert outcome.error == f"not everything was recorded: {in_one_sentence(MemoryError())}"
    assert outcome.safe and not outcome.unsafe


def test_a_run_that_cannot_load_what_exports_it_is_finished_without_an_export(
    one_axis_run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "station.record.export.hdf5", None)
    export(SimpleNamespace(path=one_axis_run))  # type: ignore[arg-type]
    assert capsys.readouterr().err.startswith("not exported: ")


LATE = """
import os, signal, sys
class Late:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
late = Late()
sys.argv = ["station", "validate", "no-such-plan"]
from station.cli import main
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to itself there")
def test_ctrl_c_while_the_interpreter_ends_changes_no_exit_code() -> None:
    done = subprocess.run([sys.executable, "-c", LATE], capture_output=True, check=False)
    assert done.returncode == 2, done.stderr


def test_a_file_that_is_gone_with_its_run_folder_is_not_a_fault_of_the_program(
    tmp_path: Path,
) -> None:
    presence, lost = Presence(tmp_path), FileNotFoundError(2, "No such file or directory")
    assert presence.cause_of(lost) is lost
    tmp_path.rename(tmp_path.with_name("elsewhere"))
    assert "removed, moved or unmounted" in str(presence.cause_of(lost))
    assert isinstance(presence.cause_of(ValueError()), ValueError)


def test_an_evaluation_without_room_for_its_libraries_neither_hangs_nor_looks_like_a_verdict(
    one_axis_run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(evaluation, "LIBRARIES_BYTES", 1 << 62)
    monkeypatch.delitem(sys.modules, "scipy.linalg", raising=False)
    monkeypatch.setattr(sys, "argv", ["station", "analyse", str(one_axis_run)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 3
    assert capsys.readouterr().err == f"{NO_MEMORY}\n"
