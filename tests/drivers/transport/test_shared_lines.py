"""The bench of second models, and instruments there that have no line of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from campaigns.truths import fog_curve_ppm
from fog_runs import short_run
from interlock_helpers import CHAIN, bench_from, bench_with, watched
from plan_runs import run_of, shipped_bench, shipped_plan

from drivers.generic.interlock_chain import SharedInterlockChain
from station.clock import RealClock
from station.errors import InstrumentError
from station.files.faults import FaultList
from station.instruments.opening import InstrumentPlace, with_shared
from station.record.folder import RunFolder

ALTERNATE = shipped_bench("sim-alternate")
NARROW: dict[str, Any] = {
    "temperature_range": ["22 degC", "26 degC"],
    "reference_temperature": "25 degC",
    "axes": ["z"],
    "initial_order": 1,
    "bench_name": "sim-alternate",
}


def alternate(**changed: Any) -> str:
    """Return the bench of second models with instruments changed, as text."""
    instruments = {**ALTERNATE["instruments"], **changed}
    return yaml.safe_dump({**ALTERNATE, "instruments": instruments}, sort_keys=False)


@pytest.mark.campaign
def test_second_models_recover_the_true_scale_factor(tmp_path: Path) -> None:
    outcome, truth = short_run(tmp_path, 4, **NARROW)
    assert outcome.exit_code == 0, outcome.error
    assert outcome.document is not None
    (found,) = (
        one for one in outcome.document.results if one.estimate.name == "scale_factor_error"
    )
    assert found.combined is not None
    error_ppm = found.estimate.value - fog_curve_ppm(truth, "z", 25.0)
    assert abs(error_ppm) < found.combined.expanded_uncertainty
    opened = RunFolder(outcome.folder).events_of("identified")
    used = {"thermal_chamber", "thermometer", "turntable", "navigator", "dut_power", CHAIN}
    assert {one.details["instrument"] for one in opened} == used


@pytest.mark.campaign
def test_the_same_plan_runs_on_both_benches_and_recovers_the_truth(tmp_path: Path) -> None:
    plan, bench = shipped_plan("rlg-magnetic-sensitivity"), shipped_bench("sim-alternate")
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
    ("instrument", "kind", "said"),
    [
        ("turntable", "emergency-stop", "turntable motor 1, turntable motor 2, turntable motor 3"),
        ("thermal_chamber", "door-open", "thermal_chamber door"),
        ("thermal_chamber", "chamber-alarm", "thermal_chamber alarm 1 is on"),
    ],
)
def test_a_contact_of_table_or_chamber_trips_and_is_named(
    tmp_path: Path, instrument: str, kind: str, said: str
) -> None:
    struck = {"instrument": instrument, "fault": kind, "at": "60 s"}
    outcome, _ = short_run(tmp_path, 4, struck, **NARROW)
    assert outcome.exit_code == 5
    assert f"interlock_chain chain is open (open: {said})" in (outcome.error or "")
    assert not outcome.unsafe


def test_a_run_that_fails_of_an_emergency_stop_is_told_as_the_trip_that_it_is(
    tmp_path: Path,
) -> None:
    """The command that meets the broken interlock comes before the next look at the chain."""
    struck = {"instrument": "turntable", "fault": "emergency-stop", "command": "3RMO"}
    outcome, _ = short_run(tmp_path, 4, struck, **NARROW, soak="1 s")
    assert outcome.exit_code == 5
    assert "interlock_chain chain is open (open: turntable motor 1" in (outcome.error or "")
    failed = RunFolder(outcome.folder).events_of("failed")
    assert [one.details["exit_code"] for one in failed] == [3, 5]


def test_the_first_choice_bench_watches_the_tables_own_interlock(tmp_path: Path) -> None:
    struck = {"instrument": "turntable", "fault": "emergency-stop", "at": "0 s"}
    outcome, _ = short_run(tmp_path, 4, struck)
    assert outcome.exit_code == 5
    assert "table-interlock tripped" in (outcome.error or "")
    assert "turntable chain is open" in (outcome.error or "")


def test_after_a_fault_contacts_are_asked_anew() -> None:
    opens = {"instrument": CHAIN, "fault": "chain-open", "at": "0.6 s"}
    with watched(bench_with(faults=[opens])) as fixture:
        fixture.monitor.check_once()
        fixture.monitor.look_at_chains()
        assert fixture.monitor.trip is None
        fixture.clock.sleep_until(0.7)
        fixture.monitor.look_at_chains()
        assert "chain is open" in str(fixture.monitor.trip)


def test_what_is_shared_is_opened_before_who_shares_it() -> None:
    bench = bench_from(alternate())
    assert with_shared(bench, [CHAIN]) == ["thermal_chamber", "turntable", CHAIN]
    assert with_shared(bench, ["navigator"]) == ["navigator"]


@pytest.mark.parametrize(
    ("shares", "said"),
    [
        (["turntabel"], "no other instrument 'turntabel'; did you mean 'turntable'"),
        (["dut_power"], "no other instrument 'dut_power'"),
        (["interlock_chain"], "'interlock_chain' has no line of its own"),
    ],
)
def test_a_bench_that_shares_a_line_that_is_none_is_refused(shares: list[str], said: str) -> None:
    power = {"driver": "watlow-output-power", "shares": shares}
    with pytest.raises(FaultList, match=said):
        bench_from(alternate(dut_power=power))


def test_a_chain_of_what_sees_no_contact_is_refused() -> None:
    with pytest.raises(InstrumentError, match="navigator sees no contact of the chain"):
        SharedInterlockChain(
            InstrumentPlace(CHAIN, "", RealClock(), shared={"navigator": object()})  # type: ignore[dict-item]
        )
    with pytest.raises(InstrumentError, match="it shares no line"):
        SharedInterlockChain(InstrumentPlace(CHAIN, "", RealClock()))
