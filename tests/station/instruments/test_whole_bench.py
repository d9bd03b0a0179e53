"""Safe means the whole bench: what a plan does not use is read, named, and never touched."""

from __future__ import annotations

import codecs
import json
import re
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from command_line import PLAN, begun, station
from guardian_helpers import World, until, world
from run_heads import head_of

from station import registry
from station.cli.controlling import say_how_it_ended
from station.clock import RealClock, VirtualClock
from station.control.status import read_state, read_status
from station.files.lookup import BENCHES, find
from station.guardian.make_safe import summary
from station.instruments.bench import read_bench
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.trace import Trace
from station.instruments.whole_bench import BenchReading, LeftOut, UnusedInstruments, bystanders_of
from station.runner.session import BenchSession
from station.safety.safe_state import SafeOutcome

USED, OTHER = "coil_supply.x", "coil_supply.z"
SPEED = 40.0
RUN = ("run", "plan.yaml", "--bench", "sim", "--served", "served.json", "--non-interactive")


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    with world(tmp_path, SPEED) as one:
        yield one


def drive_by_hand(folder: Path, instrument: str, current_A: float) -> None:
    """Let a current flow as somebody at the supply, or another program, would."""
    place = head_of(folder)["instruments"][instrument]
    with socket.create_connection((place["host"], place["port"]), 5.0) as line:
        told = ("FUNC:MODE CURR", "VOLT 30", "CURR:MODE FIX;:CURR 0", "OUTP ON")
        for message in (*told, f"CURR {current_A:.4f}", "CURR?"):
            line.sendall(message.encode() + b"\n")
        assert float(line.makefile().readline()) == pytest.approx(current_A, abs=0.001)


def still_driven(served: World) -> bool:
    state = served.report()
    return bool(state["outputs"][OTHER]) and abs(state["coils"]["z"]["current_A"] - 5.0) < 0.05


def events_of(folder: Path, kind: str) -> list[dict[str, Any]]:
    (run,) = (folder / "runs").iterdir()
    lines = (run / "events.jsonl").read_text(encoding="utf-8").splitlines()
    return [one for one in map(json.loads, lines) if one["event"] == kind]


def test_an_energised_source_outside_the_plan_refuses_the_start_and_is_left_alone(
    tmp_path: Path, served: World
) -> None:
    drive_by_hand(tmp_path, OTHER, 5.0)
    done = station(tmp_path, *RUN)
    assert done.returncode == 3, done.stderr
    assert "the run did not finish: the bench is not at rest" in done.stderr
    assert f"- {OTHER}, which this plan does not use: output on, " in done.stderr
    assert "switch off by hand, or by the run that uses it" in done.stderr
    assert f"NOT VERIFIED: {OTHER}, which this run did not use" in done.stderr
    assert "the bench is safe" not in done.stderr
    assert still_driven(served)
    assert served.report()["coils"]["x"]["largest_current_A"] == 0.0
    assert not events_of(tmp_path, "step-started")
    (before,) = events_of(tmp_path, "bench-read")
    by_name = {one["instrument"]: one for one in before["outcomes"] + before["outside"]}
    assert by_name[USED]["verified"]
    assert "used" not in by_name[USED]
    assert by_name[OTHER]["used"] is by_name[OTHER]["verified"] is False


@pytest.mark.campaign
def test_a_source_that_is_energised_during_the_run_is_not_verified_and_left_alone(
    tmp_path: Path, served: World
) -> None:
    run = begun(tmp_path, *RUN)
    until(lambda: served.report()["outputs"][USED])
    drive_by_hand(tmp_path, OTHER, 5.0)
    _, said = run.communicate(timeout=90)
    assert run.returncode == 3, said
    assert f"NOT VERIFIED: {OTHER}, which this run did not use, is not at rest (output on" in said
    assert "the bench is safe" not in said
    assert still_driven(served)
    assert served.at_rest("x")
    (run_folder,) = (tmp_path / "runs").iterdir()
    results = json.loads((run_folder / "results.json").read_text(encoding="utf-8"))
    assert results["verdict"] == "inconclusive"
    flagged = [one for one in results["flags"] if one["code"] == "safe-state-unverified"]
    assert [one["instrument"] for one in flagged] == [OTHER]


@pytest.mark.campaign
def test_a_resumed_run_reads_the_whole_bench_too(tmp_path: Path, served: World) -> None:
    run = begun(tmp_path, *RUN)
    until(lambda: served.report()["outputs"][USED])
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 4, said
    assert "the bench is safe, read back from every instrument that can harm (at " in said
    drive_by_hand(tmp_path, OTHER, 5.0)
    (run_folder,) = (tmp_path / "runs").iterdir()
    again = ("--bench", "sim", "--served", "served.json", "--non-interactive", "--answers", "a")
    (tmp_path / "a").write_text("resume: done\n", encoding="utf-8")
    done = station(tmp_path, "resume", str(run_folder), *again)
    assert done.returncode == 3, done.stderr
    assert f"- {OTHER}, which this plan does not use: output on" in done.stderr
    assert still_driven(served)


@contextmanager
def held_by_another(folder: Path, instrument: str) -> Iterator[None]:
    """Hold an instrument's lock as another run does."""
    head = head_of(folder)
    address = head["instruments"][instrument]["address"]
    world = f"served since {head['clock']['epoch_unix']}"
    locks = InstrumentLocks("the run of somebody else", world)
    locks.take(instrument, address)
    try:
        yield
    finally:
        locks.release()


@pytest.mark.campaign
def test_what_another_run_holds_or_does_not_answer_is_left_out_and_named(
    tmp_path: Path, served: World, capsys: pytest.CaptureFixture[str]
) -> None:
    head = head_of(tmp_path)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        gone = f"TCPIP::127.0.0.1::{nobody.getsockname()[1]}::SOCKET"
        head["instruments"][OTHER]["address"] = gone
        (tmp_path / "served.json").write_text(json.dumps(head) + "\n", encoding="utf-8")
        with held_by_another(tmp_path, "turntable"):
            done = station(tmp_path, *RUN)
    assert done.returncode == 0, done.stderr
    assert (
        f"\nNOT KNOWN to be safe: {OTHER} (does not answer) and turntable (in use by the run of "
        "somebody else); every other instrument that can harm was read back as safe (at "
    ) in done.stderr
    assert "the bench is safe" not in done.stderr
    for kind in ("bench-read", "safe-state"):
        (event,) = events_of(tmp_path, kind)
        assert [one["instrument"] for one in event["left_out"]] == [OTHER, "turntable"]
    (run_folder,) = (tmp_path / "runs").iterdir()
    left_out = read_status(run_folder).left_out
    assert [one["instrument"] for one in left_out] == [OTHER, "turntable"]
    results = json.loads((run_folder / "results.json").read_text(encoding="utf-8"))
    assert results["verdict"] == "pass"
    (flag,) = [one for one in results["flags"] if one["code"] == "not-read-back"]
    assert flag["instruments"] == [OTHER, "turntable"]
    told = station(tmp_path, "status", str(run_folder))
    assert f" NOT KNOWN to be safe: {OTHER} (does not answer) and turntable (in use" in told.stdout
    assert say_how_it_ended(run_folder, "", read_state(run_folder).safe_state(), as_json=False) == 0
    assert f"NOT KNOWN to be safe: {OTHER} (does not answer) and turn" in capsys.readouterr().out


def test_the_guardian_too_names_first_what_is_not_known_to_be_safe() -> None:
    made = [SafeOutcome(USED, True, "output off", 0.1)]
    assert summary(made).startswith("the bench is safe, read back from every instrument that can")
    unread = BenchReading(left_out=[LeftOut(OTHER, "does not answer", "")])
    assert summary(made, unread) == (
        f"NOT KNOWN to be safe: {OTHER} (does not answer); every other instrument that can harm "
        f"was read back as safe: {USED} output off"
    )


def test_silent_addresses_are_asked_at_once_and_the_whole_is_bounded() -> None:
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    names = bystanders_of(bench, [])
    kinds = dict.fromkeys(("rotary_stage", "pump_laser", "turntable"), "socket://127.0.0.1:{}")
    kinds["thermal_chamber"] = "modbus-tcp://127.0.0.1:{}"
    with ExitStack() as silent:  # they take lines and never answer
        place = {}
        for name in names:
            server = silent.enter_context(socket.create_server(("127.0.0.1", 0)))
            address = kinds.get(name, "TCPIP::127.0.0.1::{}::SOCKET")
            place[name] = address.format(server.getsockname()[1])
        clock = RealClock()
        unused = UnusedInstruments(bench, place, clock, "a test")
        unused.read([], only=names[:1])
        one_took_s = clock.now()
        reading = unused.read([])
        took_s = clock.now() - one_took_s
    assert [one.instrument for one in reading.left_out] == names
    assert {one.why for one in reading.left_out} == {"does not answer"}
    assert not reading.outside
    assert took_s < len(names) / 2 * one_took_s


def only_asks(sent: str) -> bool:
    """Whether what went over a wire is a question: a query, or the reading of registers."""
    if "?" in sent or re.fullmatch(r"\d?(PPO|PVE)\\r", sent):  # angle and rate of a table
        return True
    data = codecs.escape_decode(sent.encode())[0]
    return data[7:8] == b"\x03" or data[1:2] == b"\x03"


@pytest.mark.parametrize("name", ["sim", "sim-alternate"])
def test_reading_an_instrument_commands_nothing(tmp_path: Path, name: str) -> None:
    bench = read_bench(find(BENCHES, name), registry.names(registry.DRIVERS))
    with BenchSession(bench, "rlg-magnetic-sensitivity") as session:
        assert isinstance(session.clock, VirtualClock)
        trace = Trace(tmp_path, session.clock)
        with session.clock.participant("run"):
            others = UnusedInstruments(
                bench, session.addresses, session.clock, "a test", trace=trace
            )
            reading = others.read([])
        trace.close()
    names = bystanders_of(bench, [])
    assert [one.instrument for one in reading.outside] == names
    assert all(one.verified and not one.used for one in reading.outside)
    assert not reading.left_out
    for one in names:
        text = (tmp_path / "trace" / f"{one}.txt").read_text(encoding="utf-8")
        lines = [line for line in text.splitlines() if not line.startswith("#")]
        sent = [line.split(" > ", 1)[1] for line in lines if " > " in line]
        assert sent
        assert all(map(only_asks, sent)), (one, sent)
