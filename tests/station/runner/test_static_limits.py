"""Every limit of a bench is held against what a plan commands, before anything is energised."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import pytest
from interlock_helpers import bench_from

from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import Bench
from station.method.dry_run import Forecast
from station.method.set_points import SetPoint
from station.procedure import Problem, Procedures, procedure_of
from station.runner.static_limits import beyond_limits, problems_of_plan

BENCH = """\
bench: 1
name: small
safe_state: []
instruments:
  coil_supply.x:
    driver: kepco-bop-36-12
    settings: {{coil_constant: 0.5 mT/A, {resistance}}}
    limits: {{current: 8 A, voltage: 9 V, slew: 2 A/s, zero_current: 20 mA, {more}}}
  turntable:
    driver: none
    limits: {{rate: 100 deg/s, acceleration: 50 deg/s^2, angle_low: -10 deg, angle_high: 370 deg}}
  thermal_chamber:
    driver: none
    limits: {{temperature_low: -45 degC, temperature_high: 70 degC, temperature_slew: 2 degC/min}}
"""


def bench(resistance: str = "coil_resistance: 2 ohm", more: str = "field: 3 mT") -> Bench:
    text = BENCH.format(resistance=resistance, more=more)
    return bench_from(text.replace("driver: none", "driver: operator-power"))


def coil(**given: Any) -> SetPoint:
    return SetPoint("S1", "coil_supply.x", "a sine", **given)


def table(**given: Any) -> SetPoint:
    return SetPoint("S2", "turntable", "turn", **given)


def chamber(**given: Any) -> SetPoint:
    return SetPoint("S3", "thermal_chamber", "soak", **given)


def said(*points: SetPoint, on: Bench | None = None) -> list[str]:
    return [one.what for one in beyond_limits(Forecast(points), on or bench())]


WITHIN = [
    coil(field_mT=2.0, current_A=4.0, rms_current_A=3.0),
    coil(current_A=-4.5),
    table(rate_deg_per_s=-100.0, acceleration_deg_per_s2=50.0, angle_deg=370.0),
    table(angle_deg=-10.0),
    chamber(temperature_degC=-45.0, temperature_slew_degC_per_min=-2.0),
    chamber(temperature_degC=70.0),
    SetPoint("S4", "gaussmeter", "range for 10 mT", field_mT=10.0),
    SetPoint("S4", "coil_supply.x", "0 A, output off"),
]
BEYOND = [
    (
        coil(current_A=-8.5, field_mT=4.25),
        [
            "4.25 mT is more than the 3 mT that the bench allows for coil_supply.x",
            "4.25 mT needs 8.5 A from coil_supply.x, the bench allows 8 A",
            "4.25 mT needs 17 V at coil_supply.x's coil, the bench allows 9 V",
        ],
    ),
    (
        table(rate_deg_per_s=-120.0),
        ["turn: 120 deg/s is more than the 100 deg/s that the bench allows for turntable"],
    ),
    (
        table(acceleration_deg_per_s2=51.0),
        ["turn: 51 deg/s^2 is more than the 50 deg/s^2 that the bench allows for turntable"],
    ),
    (
        table(angle_deg=371.0),
        ["turn: 371 deg is more than the 370 deg that the bench allows for turntable"],
    ),
    (
        table(angle_deg=-11.0),
        ["turn: -11 deg is less than the -10 deg that the bench allows for turntable"],
    ),
    (
        chamber(temperature_degC=71.0),
        ["soak: 71 degC is more than the 70 degC that the bench allows for thermal_chamber"],
    ),
    (
        chamber(temperature_degC=-46.0),
        ["soak: -46 degC is less than the -45 degC that the bench allows for thermal_chamber"],
    ),
    (
        chamber(temperature_slew_degC_per_min=-3.0),
        ["soak: 3 degC/min is more than the 2 degC/min that the bench allows for thermal_chamber"],
    ),
]


def test_what_is_within_its_limits_is_no_problem() -> None:
    assert said(*WITHIN) == []


@pytest.mark.parametrize(("point", "sentences"), BEYOND)
def test_what_is_beyond_a_limit_is_told_with_what_is_allowed(
    point: SetPoint, sentences: list[str]
) -> None:
    assert said(*WITHIN, point) == sentences


def test_of_many_set_points_beyond_a_limit_the_worst_is_told_once() -> None:
    points = [table(rate_deg_per_s=rate) for rate in (110.0, 140.0, 90.0, 120.0)]
    (sentence,) = said(*points)
    assert "140 deg/s" in sentence


@pytest.mark.parametrize(
    ("point", "watts"),
    [
        (coil(current_A=4.0), 32.0),
        (coil(current_A=4.0, rms_current_A=3.0), 18.0),
        (coil(current_A=4.0, duty=0.25), 8.0),
        (coil(current_A=4.0, rms_current_A=3.0, duty=0.5), 9.0),
    ],
)
def test_a_coil_heats_by_its_effective_current_and_duty(point: SetPoint, watts: float) -> None:
    assert said(point, on=bench(more=f"heating: {watts + 0.1} W")) == []
    (sentence,) = said(point, on=bench(more=f"heating: {watts - 0.1} W"))
    assert f"a sine heats coil_supply.x's coil with {watts:g} W, the bench allows" in sentence


def test_an_effective_current_has_a_limit_of_its_own() -> None:
    (sentence,) = said(coil(current_A=4.0, rms_current_A=3.0), on=bench(more="rms_current: 2.5 A"))
    assert (
        "needs an effective current of 3 A from coil_supply.x, the bench allows 2.5 A" in sentence
    )


def test_heating_that_nobody_can_compute_is_a_problem_where_it_has_a_limit() -> None:
    unknown = bench(resistance="note: none", more="heating: 10 W")
    (sentence,) = said(coil(current_A=1.0), on=unknown)
    assert "give settings.coil_resistance in the bench file" in sentence
    assert said(SetPoint("S1", "coil_supply.x", "0 A, output off"), on=unknown) == []
    assert said(coil(current_A=4.0), on=bench(resistance="note: none")) == []


def test_a_problem_stands_at_the_key_of_the_plan_that_decides() -> None:
    rates = ("parameters", "rates")
    points = (coil(current_A=8.5), table(rate_deg_per_s=120.0, decided_by=rates))
    found = {one.where for one in beyond_limits(Forecast(points), bench())}
    assert found == {("parameters",), ("parameters", "rates")}


def test_every_procedure_is_checked_alike_and_nothing_is_told_twice() -> None:
    procedure = procedure_of("rlg-magnetic-sensitivity")
    plan = read_plan(find(PLANS, procedure.name), Procedures())
    shipped = bench_from(find(BENCHES, "sim").read_text(encoding="utf-8"))
    assert list(problems_of_plan(procedure, plan.parameters, shipped)) == []

    def says_it_too(parameters: Any, on: Bench) -> Iterator[Problem]:
        what = f"the bench {on.name!r} has no gaussmeter, which this plan needs"
        yield Problem(("procedure",), what)
        yield Problem(("procedure",), "something of its own")

    found = list(
        problems_of_plan(
            dataclasses.replace(procedure, check=says_it_too), plan.parameters, bench()
        )
    )
    sentences = [one.what for one in found]
    assert len(sentences) == len(set(sentences))
    assert "the bench 'small' has no gaussmeter, which this plan needs" in sentences
    assert "something of its own" in sentences


def test_what_is_no_number_hides_nothing_that_is_beyond_a_limit() -> None:
    assert "nan A" in said(coil(current_A=math.nan), coil(current_A=100.0))[0]
    assert "nan deg" in said(table(angle_deg=math.nan), table(angle_deg=0.0))[0]
