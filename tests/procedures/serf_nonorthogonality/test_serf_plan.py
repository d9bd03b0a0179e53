"""Plans for coil angles: what is refused before anything is switched on, and what is promised."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from station import registry
from station.files.faults import FaultList
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import Plan, plan_of
from station.files.yaml.reading import read_yaml_text
from station.instruments.bench import Bench, read_bench
from station.procedure import Procedures
from station.runner.static_limits import problems_of_plan

NAME = "serf-nonorthogonality"
SHIPPED = yaml.safe_load(find(PLANS, NAME).read_text(encoding="utf-8"))


def plan(**parameters: Any) -> Plan:
    data = SHIPPED | {"parameters": SHIPPED["parameters"] | parameters}
    data["parameters"] = {k: v for k, v in data["parameters"].items() if v is not None}
    text = yaml.safe_dump(data)
    return plan_of(read_yaml_text(text, Path("plan.yaml")), Procedures())


@pytest.fixture(scope="module")
def bench() -> Bench:
    return read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))


def tones(**others: Any) -> dict[str, Any]:
    return {"method": "modulation", **others}


def problems(one: Plan, bench: Bench) -> str:
    procedure = Procedures()[NAME]
    return "\n".join(problem.what for problem in problems_of_plan(procedure, one.parameters, bench))


def test_the_shipped_plan_has_no_fault(bench: Bench) -> None:
    assert problems(plan(), bench) == ""


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"probe_axis": "z"}, "another axis than pump_axis"),
        ({"single_axis": "y"}, "use coil x"),
        ({"single_axis": "z"}, "the pump light"),
        ({"nuclear_spin": 1.0}, "1.5 (K"),
        ({"field": "50 Hz"}, "field"),
        ({"nulling": "modulate"}, "must be 'precession' or 'modulation'"),
        ({"nulling": {"method": "modulation", "tone": "9 nT"}}, "at most 5 nT"),
        ({"fields": {"x": "50 nT", "y": "50 nT", "z": "50 nT"}}, "either field or fields"),
        ({"field": None, "exchange_rate": None}, "relaxation_rate and exchange_rate"),
    ],
)
def test_a_fault_names_what_would_do(parameters: dict[str, Any], said: str) -> None:
    with pytest.raises(FaultList) as caught:
        plan(**parameters)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"sample_rate": "1 kHz"}, "less than four times the fastest precession"),
        ({"field": "500 nT", "sample_rate": "50 kHz"}, "25 V is more than the 9 V"),
        ({"field": "170 nT", "sample_rate": "50 kHz", "relaxation_rate": "120 Hz"}, "broadens"),
        ({"relaxation_rate": "2000 Hz"}, "fewer than one; take about"),
        ({"nulling": tones(frequency="10 Hz")}, "lies 0 Hz from the mains"),
        ({"nulling": tones(cycles=100)}, "its 16384 values hold"),
        ({"nulling": tones(frequency="90 Hz", cycles=200), "sample_rate": "3 kHz"}, "75 Hz would"),
    ],
)
def test_what_the_bench_or_the_cell_cannot_do_is_said(
    bench: Bench, parameters: dict[str, Any], said: str
) -> None:
    assert said in problems(plan(**parameters), bench)


def test_a_bench_that_does_not_know_its_coils_is_named(tmp_path: Path) -> None:
    text = find(BENCHES, "sim").read_text(encoding="utf-8")
    (tmp_path / "bench.yaml").write_text(
        text.replace(" constant_x: 20 nT/V,", ""), encoding="utf-8"
    )
    blind = read_bench(tmp_path / "bench.yaml", registry.names(registry.DRIVERS))
    assert "settings.constant_x of signal_generator.xy" in problems(plan(), blind)


def test_nulling_by_modulation_is_a_word_or_a_mapping_and_is_promised(bench: Bench) -> None:
    assert plan().parameters.nulling.method == "precession"
    alone = plan(nulling="modulation")
    assert alone.parameters.nulling == plan(nulling=tones()).parameters.nulling
    assert problems(alone, bench) == ""
    said = " ".join(Procedures()[NAME].outlook(alone.parameters))
    assert "tones of 0.4 nT at 8 Hz on each coil in turn" in said


def test_the_field_is_chosen_where_the_angles_are_told_best() -> None:
    parameters = plan(field=None).parameters
    assert parameters.best_field_nT == pytest.approx(59.0, abs=0.5)
    assert set(parameters.field_levels_nT.values()) == {parameters.best_field_nT}


def test_the_outlook_says_how_well_and_what_is_taken_for_granted() -> None:
    procedure = Procedures()[NAME]
    reversal = " ".join(procedure.outlook(plan().parameters))
    assert "xy 23 arcsec, xz 23 arcsec, yz 32 arcsec" in reversal
    published = " ".join(procedure.outlook(plan(shots="as_published").parameters))
    assert "4 shots" in published
    assert "taken for zero" in published
