"""The trace: every byte on the wire with its run time, and a run that is not changed by it."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import pytest
from campaign_helpers import file_hashes, short_plan

from drivers.transport.text_line import VisaLine
from station import registry
from station.clock import VirtualClock
from station.conformance.faulty_server import FaultyServer
from station.errors import InstrumentTimeout
from station.files.lookup import BENCHES, find
from station.files.plan import read_plan
from station.instruments.bench import read_bench
from station.instruments.opening import InstrumentPlace
from station.instruments.trace import ADDRESS, Trace, readable
from station.procedure import Procedures
from station.runner.execute import Request, execute
from station.runner.outcome import Outcome

LINE = re.compile(r" *(?P<time_s>\d+\.\d{6}) (?P<direction>[-><!]) (?P<text>.*)")
SPOKEN = ("coil_supply.x", "gaussmeter", "gyro_acquisition", "interlock_chain")


def traced_run(folder: Path, *, trace: bool) -> Outcome:
    plan = read_plan(short_plan(folder, axes=["IA"]), Procedures())
    bench = read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))
    outcome = execute(Request(plan, bench, folder / "runs", quiet=True, report=False, trace=trace))
    assert outcome.exit_code == 0, outcome.error
    return outcome


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return traced_run(tmp_path_factory.mktemp("traced"), trace=True).folder


def lines_of(path: Path) -> list[dict[str, Any]]:
    lines = [one for one in path.read_text(encoding="utf-8").splitlines() if one[0] != "#"]
    matches = [LINE.fullmatch(line) for line in lines]
    assert all(matches), "a line that is no message"
    return [{**match.groupdict(), "at": float(match["time_s"])} for match in matches if match]


def test_each_instrument_with_a_line_has_a_file_of_messages_in_order(folder: Path) -> None:
    names = sorted(path.stem for path in (folder / "trace").glob("*.txt"))
    assert set(SPOKEN) < set(names), "those outside the plan are read, too"
    for name in SPOKEN:
        lines = lines_of(folder / "trace" / f"{name}.txt")
        times = [line["at"] for line in lines]
        assert times == sorted(times)
        assert lines[0]["text"] == "opened"
        assert lines[-1]["text"] == "closed"
        assert {"<", ">"} <= {line["direction"] for line in lines}


def test_what_was_said_can_be_read_with_its_line_ends(folder: Path) -> None:
    supply = lines_of(folder / "trace" / "coil_supply.x.txt")
    assert (supply[1]["direction"], supply[1]["text"]) == (">", r"*IDN?\n")
    assert (supply[2]["direction"], supply[2]["text"][:6]) == ("<", "KEPCO,")
    assert any(line["text"].startswith("LIST:CURR 0.0000,") for line in supply)
    assert any(line["text"].startswith("OUTP OFF;") for line in supply)
    gaussmeter = lines_of(folder / "trace" / "gaussmeter.txt")
    assert gaussmeter[2]["text"].endswith(r"\r\n")


def test_can_frames_bear_the_names_of_the_message_file(folder: Path) -> None:
    board = lines_of(folder / "trace" / "gyro_acquisition.txt")
    texts = [line["text"] for line in board]
    assert texts[1:4] == [
        "100#03000A0000000100 BOARD_COMMAND",
        "101#0300010000000000 BOARD_ACK",
        "111#1204000001020103 BOARD_IDENTITY",
    ]
    samples = sum(text.endswith(" GYRO_COUNTS_1") for text in texts)
    events = (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()
    assert samples >= 1000
    assert not any("trace" in json.loads(line)["event"] for line in events)


def test_the_manifest_covers_the_trace(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["files"]
    for name in SPOKEN:
        data = (folder / "trace" / f"{name}.txt").read_bytes()
        assert manifest[f"trace/{name}.txt"] == hashlib.sha256(data).hexdigest()


def without_address(path: Path) -> list[str]:
    """The lines but for the address: a simulated instrument gets its port from the system."""
    lines = path.read_text(encoding="utf-8").splitlines()
    assert sum(one.startswith(ADDRESS) for one in lines) == 1
    return [one for one in lines if not one.startswith(ADDRESS)]


def test_the_same_plan_twice_gives_the_same_trace(folder: Path, tmp_path: Path) -> None:
    again = traced_run(tmp_path, trace=True).folder
    for name in SPOKEN:
        file = f"trace/{name}.txt"
        assert without_address(again / file) == without_address(folder / file)


def test_a_run_without_a_trace_is_the_same_run(folder: Path, tmp_path: Path) -> None:
    plain = traced_run(tmp_path, trace=False).folder
    assert not (plain / "trace").exists()
    assert file_hashes(plain, "results.json") == file_hashes(folder, "results.json")


def test_silence_and_a_line_that_was_opened_again_stand_in_the_trace(tmp_path: Path) -> None:
    clock = VirtualClock()
    trace = Trace(tmp_path, clock)
    answers = iter([b"12", b"", b"34\n"])
    with clock.participant("test"), FaultyServer(clock, lambda data: next(answers)) as server:
        address = f"TCPIP::127.0.0.1::{server.port}::SOCKET"
        line = VisaLine(InstrumentPlace("gaussmeter", address, clock, trace=trace.of("gaussmeter")))
        for _ in range(2):
            with pytest.raises(InstrumentTimeout):
                line.query("FIELD?")
        assert line.query("FIELD?") == "34"
        line.close()
    clock.stop()
    trace.close()
    told = lines_of(tmp_path / "trace" / "gaussmeter.txt")
    assert [(line["direction"], line["text"].split(":")[0]) for line in told] == [
        ("-", "opened"),
        (">", r"FIELD?\n"),
        ("<", "12"),
        ("!", "sent 'FIELD?'"),
        ("-", "reopened"),
        (">", r"FIELD?\n"),
        ("!", "sent 'FIELD?'"),
        ("-", "reopened"),
        (">", r"FIELD?\n"),
        ("<", r"34\n"),
        ("-", "closed"),
    ]
    assert "only '12' came, without the end of an answer, within 0.5 s" in told[3]["text"]
    assert told[6]["at"] == 0.5
    assert "no answer came within 0.5 s" in told[6]["text"]


def test_every_byte_can_be_told_from_every_other() -> None:
    texts = [readable(bytes([code])) for code in range(256)]
    assert len(set(texts)) == 256
    assert all(text.isascii() and text.isprintable() for text in texts)
    assert readable(b'0,"ok"\r\n\x00\xff\\') == r'0,"ok"\r\n\x00\xff\\'
    assert readable(bytes(range(256))).encode().decode("unicode_escape").encode("latin-1") == bytes(
        range(256)
    )


def test_a_trace_that_cannot_be_written_is_said_once_and_stops_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "trace").write_text("in the way", encoding="utf-8")
    trace = Trace(tmp_path, VirtualClock())
    tell = trace.of("gaussmeter")
    for _ in range(3):
        tell(">", b"*IDN?\n")
    trace.close()
    assert capsys.readouterr().err.count("the trace ends here") == 1
