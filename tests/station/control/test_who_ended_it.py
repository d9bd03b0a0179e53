"""Whoever ends a run reads what ended it, in a sentence, in the terminal and on the panel."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest
from command_line import PLAN, station
from for_people import need_sentences
from guardian_helpers import world
from panel_server import panel
from terminal import CODE, OnTerminal
from tiers import quick

from station.clock import RealClock
from station.control.questions import READS_WITHIN_S
from station.control.run_reader import RunReader
from station.record.folder import RunRecord
from station.safety.acknowledgement import user_name

OWN, SAME = "a process of its own", "the command's process"
USER = f"(user {user_name()})"
ENDINGS = {
    "n": "the answer `n` ended the run at the prompt mount",
    "q": "the answer `q` ended the run at the prompt mount",
    "Ctrl-C": "the run was ended by Ctrl-C",
    "SIGTERM": "the run was ended by a request of the system to end (SIGTERM)",
    "abort": f"the run was ended by `station abort` {USER}",
    "panel": "the run was ended by the panel's abort (operator at 127.0.0.1)",
}
UNKNOWN = "is unknown"


def end(folder: Path, run: Path, terminal: OnTerminal, ending: str) -> None:
    """Do what ends a run that waits at its first prompt."""
    match ending:
        case "Ctrl-C":
            terminal.process.send_signal(signal.SIGINT)
        case "SIGTERM":
            terminal.process.send_signal(signal.SIGTERM)
        case "abort":
            station(folder, "abort", str(run))
        case "panel":
            with panel(run.parent) as served:
                assert served.post(f"/api/run/{run.name}/abort", {})[0] == 200
        case key:
            terminal.type(f"{key}\n")


@pytest.mark.parametrize("process", quick([OWN, SAME], OWN))
@pytest.mark.parametrize("ending", quick(ENDINGS, "n", "panel"))
def test_a_run_that_a_person_ends_says_by_what(tmp_path: Path, ending: str, process: str) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    options = [] if process == OWN else ["--json"]
    terminal = OnTerminal(tmp_path, "run", "plan.yaml", "--rehearse", *options, columns=300)
    terminal.wait_for("[mount]")
    RealClock().sleep(2 * READS_WITHIN_S)
    (run,) = (tmp_path / "runs").iterdir()
    end(tmp_path, run, terminal, ending)
    assert terminal.ended() == 4
    need_sentences(CODE.sub("", terminal.shown), "the terminal")
    assert ENDINGS[ending] in terminal.shown
    assert "answered by somebody else" not in terminal.shown
    on_panel_says(run, ENDINGS[ending])


def on_panel_says(run: Path, sentence: str) -> None:
    """Hold that the panel says how a run ended, and nothing else of it."""
    reader = RunReader(run)
    reader.read()
    state = reader.state()
    assert sentence in state["message"]
    assert UNKNOWN not in json.dumps(state)
    need_sentences(json.dumps(state), "the panel")


@pytest.mark.campaign
@pytest.mark.parametrize("detail", [[], ["--non-interactive"]], ids=[OWN, SAME])
def test_a_run_that_an_interlock_ends_says_which(tmp_path: Path, detail: list[str]) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    with world(tmp_path, 20.0) as served:
        served.report()
        terminal = OnTerminal(
            tmp_path, "run", "plan.yaml", "--served", served.head, *detail, columns=300
        )
        terminal.wait_for("filling the window")
        served.inject(instrument="interlock_chain", fault="chain-open", contact="door")
        assert terminal.ended() == 5
    station(tmp_path, "acknowledge", "sim")
    (run,) = (tmp_path / "runs").iterdir()
    need_sentences(CODE.sub("", terminal.shown), "the terminal")
    assert "the interlock chain tripped at" in terminal.shown
    on_panel_says(run, "the interlock chain tripped at")


def test_a_log_that_ends_early_without_a_reason_says_so(tmp_path: Path) -> None:
    record = RunRecord(tmp_path, "some-procedure", "SN-1", RealClock())
    record.event("run-started", procedure="some-procedure", steps=[], units=[])
    record.note("run-ended", complete=False)  # the disk was full when the reason was noted
    record.close()
    reader = RunReader(record.path)
    reader.read()
    assert "why it ended is unknown" in reader.state()["message"]
