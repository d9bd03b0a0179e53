"""What a person types at a prompt decides; in doubt nothing is energised, and nothing is lost."""

from __future__ import annotations

import io
import os
import pty
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Timer

import pytest
from rlg_runs import short_run

from drivers.generic.operator_power import OperatorPower
from station.cli.running import report_outcome, run_plan
from station.clock import RealClock
from station.control import questions as asking
from station.control.questions import READS_WITHIN_S, Operator
from station.errors import (
    EXIT_ABORTED,
    EXIT_INTERLOCK,
    Aborted,
    InputError,
    UnansweredPrompt,
)
from station.instruments.opening import InstrumentPlace
from station.procedure import Prompt
from station.record.folder import RunFolder
from station.runner import execute as executing
from station.runner.outcome import Outcome
from station.runner.resuming import ResumeRequest, resume

MOUNT = Prompt("mount", "Mount the gyro.")


def operator() -> Operator:
    return Operator(RealClock(), {}, interactive=True, act=None)


@pytest.mark.parametrize("typed", ["\n", "done\n", " Done \n", "y\n", "YES\n"])
def test_enter_or_done_goes_on(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    assert operator().ask(MOUNT).text == "done"


@pytest.mark.parametrize("typed", ["no, the probe is missing\n", "not yet\n", "abrot\n", "\x1b\n"])
def test_anything_else_is_asked_again(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{typed}abort\n"))
    with pytest.raises(Aborted, match="ended the run at the prompt mount"):
        operator().ask(MOUNT)


@pytest.mark.parametrize("typed", ["no", "n", "q", "quit", "abort!", "No."])
def test_a_no_ends_the_run(typed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{typed}\n\n"))
    with pytest.raises(Aborted, match=f"the answer `{typed}` ended the run at the prompt mount"):
        operator().ask(MOUNT)


@pytest.mark.parametrize("given", ["no", "quit", "abort"])
def test_a_no_in_the_answers_file_ends_the_run(given: str) -> None:
    asked = Operator(RealClock(), {"mount": given}, interactive=False, act=None)
    asked.check([MOUNT])
    with pytest.raises(Aborted, match="the answers file ended the run at the prompt mount"):
        asked.ask(MOUNT)


@pytest.mark.parametrize("given", ["", "maybe", "no, the probe is missing"])
def test_an_answers_file_without_an_answer_is_refused_beforehand(given: str) -> None:
    asked = Operator(RealClock(), {"mount": given}, interactive=False, act=None)
    with pytest.raises(InputError, match="nothing was energised"):
        asked.check([MOUNT])


def test_what_is_asked_because_of_data_and_nobody_answers_does_not_say_what_a_check_says() -> None:
    asked = Operator(RealClock(), {}, interactive=False, act=None)
    with pytest.raises(UnansweredPrompt, match="the prompt mount needs a person") as caught:
        asked.ask(MOUNT)
    assert "nothing was energised" not in str(caught.value)


def rehearsed(answers: dict[str, str], *, interactive: bool, acts: list[str]) -> Operator:
    def act(prompt_id: str) -> str:
        acts.append(prompt_id)
        return "the simulated world did it"

    return Operator(RealClock(), answers, interactive=interactive, act=act, rehearse=True)


def test_a_rehearsal_asks_what_a_real_bench_asks_and_then_the_world_acts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    acts: list[str] = []
    monkeypatch.setattr(sys, "stdin", io.StringIO("\nno\n"))
    asked = rehearsed({}, interactive=True, acts=acts)
    assert asked.ask(MOUNT).by == "operator"
    assert acts == ["mount"]
    with pytest.raises(Aborted, match="ended the run at the prompt mount"):
        asked.ask(MOUNT)
    assert acts == ["mount"], "a no mounts nothing"


def test_a_rehearsal_without_a_person_needs_answers() -> None:
    acts: list[str] = []
    with pytest.raises(UnansweredPrompt, match="no operator can be asked"):
        rehearsed({}, interactive=False, acts=acts).check([MOUNT])
    answered = rehearsed({"mount": "done"}, interactive=False, acts=acts)
    answered.check([MOUNT])
    assert answered.ask(MOUNT).by == "answers file"
    assert acts == ["mount"]


def test_a_rehearsal_on_a_real_bench_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bench.yaml").write_text(
        "bench: 1\nname: real\nsafe_state: [{role: dut_power, within: 5 s}]\n"
        "instruments:\n  dut_power: {driver: operator-power}\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="is for a simulated bench"):
        run_plan(
            "rlg-magnetic-sensitivity",
            str(tmp_path / "bench.yaml"),
            non_interactive=True,
            answers=None,
            served=None,
            output=tmp_path,
            as_json=False,
            rehearse=True,
        )


def test_keys_that_were_pressed_before_a_prompt_are_no_answer_to_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master, terminal = pty.openpty()
    with os.fdopen(terminal, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        os.write(master, b"\n\ndone\n")
        Timer(READS_WITHIN_S / 2, os.write, (master, b"done\n")).start()
        Timer(3 * READS_WITHIN_S, os.write, (master, b"abort\n")).start()
        with pytest.raises(Aborted):
            operator().ask(MOUNT)
    os.close(master)


def test_keys_that_are_no_letters_do_not_reach_the_terminal_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("\x1b[A\n\n"))
    operator().ask(MOUNT)
    assert "\x1b" not in (said := capsys.readouterr().err)
    assert "is no answer here" in said


def test_a_terminal_that_is_gone_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("not yet\n"))
    with pytest.raises(Aborted):
        operator().ask(MOUNT)


OFF = "dut-power-off"
ONE_AXIS = {"parameters/axes": ["IA"], "parameters/duration": "100 s"}


class SwitchedByHand(Operator):
    """The simulated world does every act but one: a person switches the device off."""

    def would_wait(self, prompt: Prompt) -> bool:
        return prompt.id == OFF


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Outcome]:
    """A run whose last request nobody has answered yet."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(executing, "Operator", SwitchedByHand)
        yield short_run(tmp_path_factory.mktemp("run"), plan=ONE_AXIS)[0]


def test_no_hazard_and_no_result_waits_for_a_person_who_may_be_asleep(run: Outcome) -> None:
    folder = RunFolder(run.folder)
    kinds = [(one.kind, one.details.get("id", one.details.get("step"))) for one in folder.events]
    order = [("prompt-left", OFF), ("step-finished", "S9"), ("safe-state", None)]
    assert [kinds.index(one) for one in order] == sorted(kinds.index(one) for one in order)
    assert all(one.verified for one in run.safe)
    assert folder.events_of("run-ended").__next__().details["complete"]
    assert (run.folder / "results.json").is_file()
    assert not folder.damage.altered
    assert not folder.damage.no_manifest
    # As after a kill at the last prompt: it is finished, and nothing of it is measured again.
    with pytest.raises(InputError, match="is finished"):
        resume(ResumeRequest(run.folder, quiet=True))


@pytest.mark.parametrize("answer", ["done\n", "abort\n", "", "SIGINT", "SIGTERM"])
def test_no_answer_to_the_last_prompt_changes_exit_code_or_results(
    answer: str,
    run: Outcome,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = {path: path.read_bytes() for path in run.folder.rglob("*") if path.is_file()}
    monkeypatch.setattr(asking, "READS_WITHIN_S", 0.0)
    master, terminal = pty.openpty()
    with os.fdopen(terminal, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin if answer else io.StringIO())
        if answer.startswith("SIG"):
            Timer(0.3, os.kill, (os.getpid(), getattr(signal, answer))).start()
        else:
            Timer(0.3, os.write, (master, answer.encode())).start()
        monkeypatch.setattr(run, "ask_at_the_end", lambda: last(run))
        assert report_outcome(run, "rlg-magnetic-sensitivity", as_json=True) == 0
        time.sleep(0.4 if not answer else 0.0)
    os.close(master)
    shown = capsys.readouterr()
    assert '"verdict": "pass"' in shown.out
    assert f"[{OFF}]" in shown.err
    assert ("not confirmed" in shown.err) == (answer != "done\n")
    assert before == {path: path.read_bytes() for path in run.folder.rglob("*") if path.is_file()}


def last(run: Outcome) -> None:
    """Put what the run left, as at a terminal."""
    left = RunFolder(run.folder).events_of("prompt-left")
    asked = operator()
    asked.left += (Prompt(e.details["id"], e.details["text"]) for e in left)
    asked.ask_what_is_left()


def test_a_run_that_died_before_its_results_is_evaluated_and_names_what_was_left(
    run: Outcome, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / run.folder.name
    shutil.copytree(run.folder, folder)
    shutil.rmtree(folder / "revisions")
    for name in ("results.json", "manifest.json"):
        (folder / name).unlink()
    outcome = resume(ResumeRequest(folder, quiet=True, report=False))
    assert outcome.exit_code == 0
    assert (folder / "results.json").read_bytes() == (run.folder / "results.json").read_bytes()
    outcome.ask_at_the_end()
    assert f"not confirmed: {OFF}" in capsys.readouterr().err


def test_what_the_answers_file_or_the_world_answers_is_not_left_for_the_end() -> None:
    off = Prompt(OFF, "Switch the device under test off.")
    for given, act, waits in (
        ({OFF: "done"}, None, False),
        ({OFF: "abort"}, None, True),
        ({}, lambda prompt: prompt, False),
        ({}, None, True),
    ):
        asked = Operator(RealClock(), given, interactive=False, act=act)
        assert asked.ask_later(off, of="step") == waits, given


def test_the_hand_at_the_switch_is_asked_at_the_end_for_the_device_off_alone() -> None:
    asked: list[tuple[str, bool]] = []

    def asker(prompt_id: str, text: str, at_the_end: bool) -> str:
        asked.append((prompt_id, at_the_end))
        return "done"

    power = OperatorPower(InstrumentPlace("dut_power", "", RealClock(), asker=asker))
    power.switch_on()
    power.switch_off()
    assert asked == [("dut-power-on", False), (OFF, True)]


def test_a_run_that_did_not_finish_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a run"
    report_outcome(Outcome(folder, EXIT_ABORTED, error="ended by the operator"), "x", as_json=False)
    said = capsys.readouterr().err
    assert f"to go on where it stopped: station resume '{folder}'\n" in said
    report_outcome(Outcome(folder, EXIT_INTERLOCK, error="a door opened"), "x", as_json=False)
    assert "; first `station acknowledge` the bench" in capsys.readouterr().err
