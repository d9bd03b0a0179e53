"""The second instruments of the laser-gyro bench over their real lines, and a run with all three.

What every driver owes is tested by the conformance tests (`test_conformance.py`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from navigator_fixture import bitwise_crc
from plan_runs import run_of, shipped_bench, shipped_plan

from drivers.generic.serial_pulse_board import OUTPUT, frame
from drivers.kepco.bop import KepcoBop
from drivers.kepco.bop_1kw import KepcoBop1kW
from sim_instruments.wire.frames import crc32
from station import registry
from station.cli.validating import read_plan_for
from station.conformance.fixture import Fixture, fixture_of
from station.errors import InstrumentError
from station.files.faults import FaultList
from station.instruments.bench import read_bench
from station.method.work import POLL_S
from station.record.folder import RunFolder

PROCEDURE = "rlg-magnetic-sensitivity"


@contextmanager
def stood(
    folder: Path, name: str, *faults: dict[str, Any], **gyro: str
) -> Iterator[tuple[Fixture, Any]]:
    """Put an instrument of the alternate bench on the stand, with faults and another gyro."""
    data = shipped_bench("sim-alternate")
    data["simulation"]["faults"] = [{"instrument": name, **one} for one in faults]
    data["simulation"]["gyro"] |= gyro
    path = folder / "bench.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    with fixture_of(read_bench(path, registry.names(registry.DRIVERS)), name, PROCEDURE) as fixture:
        yield fixture, fixture.open()


def recorded(fixture: Fixture, source: Any, seconds: float) -> dict[str, np.ndarray]:
    """Return the columns of a source that is drained as an acquisition does."""
    until_s, blocks = fixture.clock.now() + seconds, []
    while fixture.clock.now() < until_s:
        fixture.clock.sleep(POLL_S)
        blocks.append(source.drain().columns)
    return {name: np.concatenate([one[name] for one in blocks]) for name in source.columns}


def test_the_probe_is_turned_once_and_only_its_axis_has_readings(tmp_path: Path) -> None:
    with stood(tmp_path, "gaussmeter") as (fixture, meter):
        meter.turn_to("y")
        meter.turn_to("y")
        assert fixture.asked == ["turn-probe-y"]
        meter.start(1.5)
        rows = recorded(fixture, meter, 5.0)
        assert np.isfinite(rows["y_T"]).all()
        assert np.isnan(rows["x_T"]).all() and np.isnan(rows["z_T"]).all()
        assert rows["y_T"] * 1e3 == pytest.approx(-0.004, abs=0.01)  # the ambient field


def test_the_gaussmeter_is_left_alone_for_30_ms_after_each_line(tmp_path: Path) -> None:
    with stood(tmp_path, "gaussmeter") as (fixture, meter):
        meter.start(1.5)
        meter.drain()
        times_s = [time_s for time_s, direction, _ in fixture.heard if direction in "<>"]
        sent_s = [time_s for time_s, direction, _ in fixture.heard if direction == ">"]
        assert len(sent_s) > 8
        for one_s in sent_s[1:]:
            assert one_s - max(time_s for time_s in times_s if time_s < one_s) > 0.0299


def test_an_answer_of_before_is_told_and_so_is_a_turned_knob(tmp_path: Path) -> None:
    fault = {"fault": "previous-reply", "command": "RDGFIELD", "nth": 3}
    with stood(tmp_path, "gaussmeter", fault) as (_, meter):
        meter.start(1.5)
        meter.drain()
        meter.drain()
        with pytest.raises(InstrumentError, match=r"read the field: (UNIT|RDGMODE)\? answers"):
            meter.drain()


def test_a_reading_beyond_the_range_is_marked(tmp_path: Path) -> None:
    with stood(tmp_path, "gaussmeter", {"fault": "overload", "at": "2 s"}) as (fixture, meter):
        meter.start(1.5)
        rows = recorded(fixture, meter, 5.0)
        assert rows["state"].tolist() == [0.0, 1.0, 1.0, 1.0, 1.0]
        assert meter.read_quantity("field") == np.inf


def test_a_supply_of_the_1_kw_family_is_told_from_a_card() -> None:
    large, small = "KEPCO,BOP 72-14MG,K2304411,2.24", "KEPCO,BIT 802E 36-12,H148201,1.15-1.80"
    found = re.match(KepcoBop1kW.recognises, large)
    assert found is not None and found["serial"] == "K2304411"
    assert re.match(KepcoBop1kW.recognises, small) is None
    assert re.match(KepcoBop.recognises, large) is None


def test_a_sine_left_at_any_moment_ends_without_a_step(tmp_path: Path) -> None:
    """The list is left near a zero, whatever FIX does there; what remains is ramped."""
    with stood(tmp_path, "coil_supply.x") as (fixture, supply):
        for wait_s in (0.4, 3.1):
            supply.programme_limits()
            assert supply.load_sine(0.1, 5.0) == 0.1
            supply.start_sine()
            fixture.clock.sleep(wait_s)
            supply.stop()
            assert supply.read_safety().safe
        coil = fixture.simulation.simulation_report()["coils"]["x"]
        assert coil["largest_current_A"] > 1.0
        assert coil["largest_slew_A_per_s"] * coil["time_constant_s"] < 0.25


def test_a_frequency_that_the_generator_cannot_do_is_refused(tmp_path: Path) -> None:
    with stood(tmp_path, "coil_supply.x") as (_, supply):
        supply.programme_limits()
        with pytest.raises(InstrumentError, match=r"in one segment it makes 0\.01 Hz to 1\.8 Hz"):
            supply.load_sine(2.0, 1.0)
        assert supply.read_safety().safe


def test_the_checksum_covers_bytes_that_are_not_sent() -> None:
    for payload in (b"", b"\x00", bytes(range(20))):
        data = bytes((OUTPUT,)) + payload
        assert frame(OUTPUT, payload)[-4:] == crc32(data).to_bytes(4, "big")
        assert crc32(data) == bitwise_crc(data)


def test_counts_go_on_beyond_their_24_bits_and_say_how_long_they_were_on_their_way(
    tmp_path: Path,
) -> None:
    with stood(tmp_path, "gyro_acquisition", pulse_weight="0.00001 arcsec") as (fixture, board):
        board.start(0.1, 1)
        rows = recorded(fixture, board, 60.0)
        steps = np.diff(rows["counts"].astype(np.int64))
        assert abs(int(rows["counts"][-1])) > 2**24
        assert np.abs(steps - np.median(steps)).max() < 0.4 * abs(np.median(steps))
        assert rows["latency_s"] == pytest.approx(1.5e-3, abs=2e-6)


@pytest.mark.parametrize("seconds", [3, 40])
def test_a_silent_board_leaves_a_gap_in_the_sequence(seconds: int, tmp_path: Path) -> None:
    """Also one that is longer than a round of the counter of 8 bits."""
    fault = {"fault": "silent", "at": "10 s", "for": f"{seconds} s"}
    with stood(tmp_path, "gyro_acquisition", fault) as (fixture, board):
        board.start(0.1, 1)
        steps = np.diff(recorded(fixture, board, 60.0)["sequence"].astype(int))
        assert sorted(set(steps.tolist())) == [1, 10 * seconds + 1]


def test_a_gyro_that_goes_dark_is_told_by_its_samples(tmp_path: Path) -> None:
    with stood(tmp_path, "gyro_acquisition", {"fault": "dark", "at": "5 s"}) as (fixture, board):
        board.start(0.1, 1)
        with pytest.raises(InstrumentError, match="record channel 1: the board sees no lit gyro"):
            recorded(fixture, board, 10.0)


def test_the_same_plan_runs_on_both_benches_and_recovers_the_truth(tmp_path: Path) -> None:
    plan, bench = shipped_plan(PROCEDURE), shipped_bench("sim-alternate")
    plan["parameters"] |= {
        "duration": "200 s",
        "warm_up": {"slope_limit": "10 deg/h^2", "window": "1 min", "at_most": "5 min"},
    }
    outcome = run_of(tmp_path, plan, bench)
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    truth = bench["simulation"]["gyro"]["magnetic_sensitivity"]
    for result in outcome.document.to_data()["results"]:
        true = float(truth[result["axis"]].split()[0])
        assert abs(result["value"] - true) < 3 * result["standard_uncertainty"]
        (unseen,) = [one for one in result["budget"] if "does not see" in one["description"]]
        assert 0.0 < unseen["contribution"] < 0.1 * result["standard_uncertainty"]
        seen = [axis for axis, part in result["coil_field"].items() if part is not None]
        assert seen == [result["axis"]]
    asked = [one.details["id"] for one in RunFolder(outcome.folder).events_of("prompt")]
    assert [one for one in asked if "probe" in one] == [f"turn-probe-{axis}" for axis in "xyz"]


@pytest.mark.parametrize(
    ("forget", "setting", "said"),
    [
        (False, "parameters.excitation=simultaneous", "measures one axis at a time"),
        (True, "parameters.settle=20 s", "must state the uncertainty of the angle"),
    ],
)
def test_what_a_probe_of_one_axis_cannot_do_is_refused(
    forget: bool, setting: str, said: str, tmp_path: Path
) -> None:
    data = shipped_bench("sim-alternate")
    if forget:
        del data["instruments"]["gaussmeter"]["calibration"]["uncertainty"][-1]
    path = tmp_path / "bench.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    bench = read_bench(path, registry.names(registry.DRIVERS))
    with pytest.raises(FaultList, match=said):
        read_plan_for(PROCEDURE, bench, (setting,))
