"""The lines' part: healthy benches pass, figures of answers, kept errors, a pulled cable."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from campaigns.planted.commissioning import TRIES, faulty, named
from commissioning_parts import whole_plan_of
from plan_runs import run_of, shipped_bench
from short_forms import read_bench_at

from procedures.commissioning.completing import block_of
from procedures.commissioning.lines import PART, Answers, Kept, LineDataset, analyse
from sim_instruments.wire.scpi_device import ScpiDevice
from station.record.folder import RunFolder
from station.runner.evaluation import evaluate_run


def answers(*, lost: int = 0, others: int = 0, latency_s: float = 0.01) -> Answers:
    """Return fifty answers, the first of them lost, the next of somebody else."""
    answered, same = np.ones(50, bool), np.ones(50, bool)
    answered[:lost] = False
    same[: lost + others] = False
    return Answers(np.where(answered, latency_s, np.nan), answered, same)


@pytest.mark.parametrize("bench", ["sim", "sim-alternate"])
def test_a_healthy_bench_raises_no_alarm(tmp_path: Path, bench: str) -> None:
    outcome = run_of(tmp_path / "run", whole_plan_of("lines", bench), shipped_bench(bench))
    assert named(outcome) == set()
    assert outcome.document is not None
    (untried,) = [one for one in outcome.document.flags if one.code == "not-tried"]
    assert "L2, no line was disconnected by hand" in untried.message
    assert outcome.exit_code == 0
    assert outcome.document is not None
    asked = {one["axis"] for one in outcome.document.to_data()["results"]}
    assert {"coil_supply.x", "gaussmeter", "turntable", "thermal_chamber"} <= asked
    if bench == "sim":  # a person is its device's supply
        assert {"signal_generator.xy", "pump_laser"} <= asked
        assert "dut_power" not in asked
    else:
        assert "dut_power" in asked


def test_on_a_real_bench_every_cable_is_pulled_unless_the_plan_says_otherwise(
    tmp_path: Path,
) -> None:
    bench = shipped_bench()
    (tmp_path / "sim.yaml").write_text(yaml.safe_dump(bench), encoding="utf-8")
    assert len(list(PART.fits(read_bench_at(tmp_path / "sim.yaml")))) == 1
    del bench["simulation"]
    for number, entry in enumerate(bench["instruments"].values()):
        entry.pop("simulator", None)
        entry["address"] = f"tcp://127.0.0.1:{number + 1}"
    (tmp_path / "real.yaml").write_text(yaml.safe_dump(bench), encoding="utf-8")
    asked, pulled = PART.fits(read_bench_at(tmp_path / "real.yaml"))
    assert pulled == asked.replace("instruments", "disconnected")


def test_an_instrument_that_is_pulled_and_plugged_in_answers_again(tmp_path: Path) -> None:
    plan = whole_plan_of("lines")
    plan["parameters"]["lines"] = {"instruments": ["gaussmeter"], "disconnected": ["multimeter"]}
    bench = shipped_bench()
    # Asked when it is opened, before the cable is pulled, and then on a line that is gone.
    faulty(bench, "multimeter", fault="dropped-connection", nth=3, count=2 * TRIES)
    outcome = run_of(tmp_path / "run", plan, bench)
    assert named(outcome) == set()
    folder = RunFolder(outcome.folder)
    answered = folder.rows("lines", "return of multimeter")["answered"]
    assert answered[-1] and not answered[0]
    assert '"reconnect"' in (outcome.folder / "events.jsonl").read_text(encoding="utf-8")


def test_one_that_stays_away_fails_the_bench_though_no_limit_of_a_figure_does(
    tmp_path: Path,
) -> None:
    plan, bench = whole_plan_of("lines"), shipped_bench()
    plan["parameters"]["lines"] = {"instruments": ["multimeter"], "disconnected": ["multimeter"]}
    faulty(bench, "multimeter", fault="no-reply", nth=54, count=200)
    outcome = run_of(tmp_path / "run", plan, bench)
    assert named(outcome) == {("line-does-not-return", "multimeter")}
    assert outcome.exit_code == 1


def test_one_that_stays_away_or_answers_as_another_is_named() -> None:
    gone = analyse(LineDataset({}, {"multimeter": answers(lost=50)}, {}))
    assert [(one.code, one.axis) for one in gone.flags] == [("line-does-not-return", "multimeter")]
    back = analyse(LineDataset({}, {"multimeter": answers(lost=3)}, {}))
    assert back.flags == ()
    swapped = analyse(LineDataset({"gaussmeter": answers(others=4)}, {}, {}))
    assert [(one.code, one.axis) for one in swapped.flags] == [
        ("line-identity-changes", "gaussmeter")
    ]


def test_latency_is_that_of_the_answers_that_came() -> None:
    found = analyse(LineDataset({"gaussmeter": answers(lost=2, latency_s=0.02)}, {}, {}))
    values = {one.name: one.value for one in found.estimates}
    assert values["line_latency"] == pytest.approx(20.0)
    assert values["line_latency_p99"] == pytest.approx(20.0)
    assert values["line_jitter"] == pytest.approx(0.0)
    assert values["line_errors"] == 2.0


def test_jitter_is_the_standard_deviation_of_the_latencies() -> None:
    spread_s = np.where(np.arange(50) % 2 == 0, 0.01, 0.03)
    every = np.ones(50, bool)
    found = analyse(LineDataset({"gaussmeter": Answers(spread_s, every, every)}, {}, {}))
    (one,) = (one for one in found.estimates if one.name == "line_jitter")
    assert one.value == pytest.approx(10.0, rel=0.02)
    assert one.standard_uncertainty == pytest.approx(one.value / np.sqrt(98.0))
    silent = analyse(LineDataset({"gaussmeter": answers(lost=49)}, {}, {}))
    assert [one.value for one in silent.estimates if one.name == "line_jitter"] == [None]


def test_errors_that_are_kept_are_named_by_when_they_came() -> None:
    old, new = Kept(('-113,"Undefined header"',), ()), Kept((), ("3, OVERRUN", "3, OVERRUN"))
    found = analyse(
        LineDataset({}, {}, {"multimeter": old, "rotary_stage": new, "gaussmeter": Kept((), ())})
    )
    assert [(one.code, one.axis) for one in found.flags] == [
        ("error-queue-not-empty", "multimeter"),
        ("error-while-asked", "rotary_stage"),
    ]
    assert '-113,"Undefined header"' in found.flags[0].message
    assert [one.value for one in found.estimates] == [1.0, 2.0, 0.0]


def test_an_error_from_before_the_run_is_named_and_taken_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make = ScpiDevice.__init__

    def used_before(device: ScpiDevice, *given: Any) -> None:
        make(device, *given)
        device.errors.push(-113)

    monkeypatch.setattr(ScpiDevice, "__init__", used_before)
    plan = whole_plan_of("lines")
    plan["parameters"]["lines"] = {"instruments": ["multimeter"], "queries": 20}
    for name in ("line_latency_p99", "line_errors"):
        plan["limits"].pop(name)
    outcome = run_of(tmp_path / "run", plan, shipped_bench())
    assert named(outcome) == {("error-queue-not-empty", "multimeter")}
    assert outcome.exit_code == 1
    kept = RunFolder(outcome.folder).finished_units()["line of multimeter"]
    assert "-113" in kept["errors_before"][0] and kept["errors_since"] == []


def test_an_answer_near_its_deadline_names_the_deadline_to_write(tmp_path: Path) -> None:
    plan, bench = whole_plan_of("lines"), shipped_bench()
    faulty(bench, "multimeter", fault="late", delay="0.42 s", nth=9)
    outcome = run_of(tmp_path / "run", plan, bench)
    assert outcome.document is not None
    (flag,) = (flag for flag in outcome.document.flags if flag.code == "line-slow")
    assert flag.axis == "multimeter"
    assert "near its deadline of 0.5 s" in flag.message
    assert "write `deadline: 0.9 s` at it in the bench file" in flag.message
    longest = {
        result["axis"]: result["value"]
        for result in outcome.document.to_data()["results"]
        if result["name"] == "longest_answer"
    }
    assert longest["multimeter"] == pytest.approx(420.0, abs=5.0)


def test_what_no_document_confirms_is_tried_and_noted(tmp_path: Path) -> None:
    bench = shipped_bench()
    refused = {"instrument": "coil_supply.y", "command": "STAT:OPER:COND?", "fault": "no-reply"}
    bench["simulation"]["faults"] = [{**refused, "nth": 1, "count": 9}]
    outcome = run_of(tmp_path / "run", whole_plan_of("lines"), bench)
    assert named(outcome) == set()
    text = (outcome.folder / "commissioned.json").read_text(encoding="utf-8")
    tried = {(of["instrument"], of["command"]): of for of in json.loads(text)["tried"]}
    assert tried["rotary_stage", "1ID?"]["answer"] == "URS100BPP, SNB2K0417"
    assert tried["rotary_stage", "1ID?"]["confirmed"]
    assert tried["coil_supply.x", "STAT:OPER:COND?"]["confirmed"]
    silent = tried["coil_supply.y", "STAT:OPER:COND?"]
    assert not silent["confirmed"]
    assert "coil_supply.y" in silent["answer"]
    assert not [command for _, command in tried if not command.endswith(("?", "? 1"))]
    _, findings = evaluate_run(RunFolder(outcome.folder))
    assert "  tried:" in block_of(findings.detail.commissioned)
