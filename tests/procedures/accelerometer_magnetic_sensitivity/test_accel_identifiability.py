"""What each plan determines of the thirteen coefficients: one test for each kind of plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from accelerometer_records import SIX_FIELDS_T, TRUTH, axes_g, output_V, points

from procedures.accelerometer_magnetic_sensitivity import UNITS as UNITS_OF_RESULTS
from procedures.accelerometer_magnetic_sensitivity.from_import import nominal_angles
from procedures.accelerometer_magnetic_sensitivity.model import (
    COEFFICIENTS,
    UNITS,
    accelerations,
    accelerations_by_angle,
    describe,
    judge,
    model_columns,
    model_columns_by_angle,
)
from procedures.accelerometer_magnetic_sensitivity.outlook import expected_uncertainty
from station.files.lookup import PLANS as PLANS_SHIPPED
from station.files.lookup import find
from station.files.plan import read_plan
from station.findings import combination_text
from station.procedure import Procedures, procedure_of
from station.runner.preflight import warned_of_limits

PLANS = {
    "level: the axis of rotation is vertical": (
        (("level",), 24, SIX_FIELDS_T),
        3,
        "K0 Ki Kii Kiii Kio Kip Koo Kpp Km Kim Kom Kpm",
        ("K0 + Kpp", "Km + Kpm", "Kmm"),
    ),
    "one plane, seven angles, three fields": (
        (("io",), 7, (0.0, 0.025, 0.05)),
        9,
        "K0 Kii Kip Koo Kpp Kpm",
        ("K0 + Koo", "Kii − Koo"),
    ),
    "one plane, 24 angles, six fields": (
        (("io",), 24, SIX_FIELDS_T),
        9,
        "K0 Kii Kip Koo Kpp Kpm",
        ("K0 + Koo", "Kii − Koo"),
    ),
    "one plane, four angles": (
        (("io",), 4, SIX_FIELDS_T),
        7,
        "K0 Ki Kii Kiii Kio Kip Koo Kpp Kpm",
        ("Ki + Kiii",),
    ),
    "one plane, five angles": (
        (("io",), 5, SIX_FIELDS_T),
        8,
        "K0 Ki Kii Kiii Kio Kip Koo Kpp Kpm",
        ("Ki − 1.5 Kio", "Kiii + 2 Kio"),
    ),
    "one plane, six angles": (
        (("io",), 6, SIX_FIELDS_T),
        8,
        "K0 Ki Kii Kiii Kip Koo Kpp Kpm",
        ("Ki + 0.75 Kiii",),
    ),
    "one plane, fields zero and B only": (
        (("io",), 24, (0.0, 0.05)),
        8,
        "K0 Kii Kip Koo Kpp Km Kmm Kpm",
        ("Km + 0.05 Kmm",),
    ),
    "two planes": (
        (("io", "ip"), 24, SIX_FIELDS_T),
        12,
        "K0 Kii Koo Kpp",
        ("K0 + Kpp", "Kii − Kpp", "Koo − Kpp"),
    ),
    "three planes": (
        (("io", "ip", "op"), 24, SIX_FIELDS_T),
        12,
        "K0 Kii Koo Kpp",
        ("K0 + Kpp", "Kii − Kpp", "Koo − Kpp"),
    ),
}
Plan = tuple[Sequence[str], int, Sequence[float]]


@pytest.mark.parametrize("name", list(PLANS))
def test_the_plan_has_the_rank_and_the_list_of_the_table(name: str) -> None:
    plan, rank, not_alone, combinations = PLANS[name]
    found = judge(*points(*plan))
    assert found.rank == rank
    assert list(found.not_alone) == not_alone.split()
    texts = [combination_text(terms) for terms in found.terms.values()]
    assert set(combinations) <= set(texts)


@pytest.mark.parametrize("name", list(PLANS))
def test_the_combinations_are_what_a_fit_of_the_kept_columns_finds(name: str) -> None:
    plane, angle_deg, field_T = points(*PLANS[name][0])
    found = judge(plane, angle_deg, field_T)
    theta = np.radians(angle_deg)
    output = output_V(*axes_g(plane, theta), field_T)
    columns = model_columns(accelerations(plane, theta), field_T)
    places = [COEFFICIENTS.index(kept) for kept in found.kept]
    fitted = np.linalg.lstsq(columns[:, places], output, rcond=None)[0]
    for value, terms in zip(fitted, found.terms.values(), strict=True):
        true = sum(share * TRUTH[name] for name, share in terms.items())
        assert value == pytest.approx(true, rel=1e-8, abs=1e-12)


@pytest.mark.parametrize("name", list(PLANS))
def test_words_say_what_is_not_known(name: str) -> None:
    plan, rank, _, combinations = PLANS[name]
    said = " ".join(describe(judge(*points(*plan))))
    assert said.startswith(f"{rank} of the thirteen")
    assert all(text in said for text in combinations if len(text) > 4)


def test_no_static_plan_tells_all_thirteen() -> None:
    plane, angle_deg, field_T = points(("io", "ip", "op", "level"), 24, SIX_FIELDS_T)
    found = judge(plane, angle_deg, field_T)
    assert found.rank == 12
    assert set(found.not_alone) == {"K0", "Kii", "Koo", "Kpp"}


def test_the_shape_and_not_the_size_of_the_field_decides() -> None:
    weak = judge(*points(("io", "ip"), 9, (-1e-6, 0.0, 1e-6)))
    assert weak.rank == 12
    none = judge(*points(("io", "ip"), 9, (0.0,)))
    assert set(none.not_alone) >= {"Km", "Kmm", "Kim", "Kom", "Kpm"}


def test_local_gravity_is_in_the_combinations() -> None:
    plane, angle_deg, field_T = points(("io",), 12, SIX_FIELDS_T)
    terms = judge(plane, angle_deg, field_T, 0.999).terms["K0"]
    assert terms["Koo"] == pytest.approx(0.999**2, abs=1e-9)


def test_an_encoder_that_stops_beside_its_mark_makes_nothing_identifiable() -> None:
    generator = np.random.default_rng(0)
    plane, angle_deg, field_T = points(("io",), 4, SIX_FIELDS_T)
    read = angle_deg + 0.001 * generator.standard_normal(len(angle_deg))
    assert judge(plane, read, field_T).rank > 7
    assert judge(plane, nominal_angles(read), field_T).rank == 7


def test_angles_are_found_whatever_even_division_the_plan_has() -> None:
    generator = np.random.default_rng(1)
    for count in (4, 7, 9, 24, 36, 72, 360):
        angle_deg = 360.0 * np.arange(count) / count
        read = angle_deg + 0.002 * generator.uniform(-1, 1, count)
        assert nominal_angles(read) == pytest.approx(angle_deg, abs=1e-9)
    jumped = 30.0 * np.arange(12) + 12.0 * (np.arange(12) == 5)
    assert np.flatnonzero(np.isnan(nominal_angles(jumped))).tolist() == [5]
    odd = np.array([0.0, 17.31, 101.77, 205.123])
    assert nominal_angles(odd) == pytest.approx(odd)


def test_expected_uncertainties_are_those_of_the_table_of_the_method() -> None:
    plane, angle_deg, field_T = points(("io", "ip", "op"), 24, SIX_FIELDS_T)
    u = expected_uncertainty(plane, angle_deg, field_T, 3e-6).standard_uncertainty["Km"]
    assert u == pytest.approx(30e-6, rel=0.1)
    few = expected_uncertainty(*points(("io",), 3, (0.0,)), 3e-6)
    assert set(few.standard_uncertainty.values()) == {None}


def test_the_efficient_design_needs_far_fewer_readings_for_the_same_km() -> None:
    published = expected_uncertainty(*points(("io", "ip"), 9, SIX_FIELDS_T), 3e-6)
    efficient = expected_uncertainty(*points(("io", "ip"), 9, (-0.05, 0.0, 0.05)), 3e-6)
    one, other = published.standard_uncertainty["Km"], efficient.standard_uncertainty["Km"]
    assert one is not None and other is not None
    # Readings for equal u: the squared ratio, and half as many fields.
    assert 2.0 * (one / other) ** 2 == pytest.approx(73, rel=0.05)


@pytest.mark.parametrize(
    ("planes", "angles", "shows"),
    [
        (("io",), 6, False),
        (("io",), 8, False),
        (("io",), 9, True),
        (("io", "ip"), 7, True),
        (("level",), 4, True),
    ],
)
def test_a_plan_is_known_to_hide_an_encoder_that_is_off_at_one_angle(
    planes: tuple[str, ...], angles: int, shows: bool
) -> None:
    assert expected_uncertainty(*points(planes, angles), 3e-6).angle_shows is shows


def test_derivatives_by_the_angle_are_derivatives() -> None:
    plane, angle_deg, field_T = points(("io", "ip", "op", "level"), 7, SIX_FIELDS_T)
    theta, step = np.radians(angle_deg), 1e-6
    high, low = (model_columns(accelerations(plane, theta + s), field_T) for s in (step, -step))
    change = accelerations_by_angle(plane, theta)
    slope = model_columns_by_angle(accelerations(plane, theta), change, field_T)
    assert slope == pytest.approx((high - low) / (2 * step), abs=1e-8)


def test_a_limit_on_what_the_plan_does_not_determine_alone_is_told_before_it_runs() -> None:
    limits = [f"limits.{name}.max=1 {UNITS[name]}" for name in ("K0", "Kpp")]
    plan = read_plan(
        find(PLANS_SHIPPED, "accelerometer-magnetic-sensitivity"), Procedures(), limits
    )
    told = [one.sentence for one in warned_of_limits(plan, procedure_of(plan.procedure))]
    assert [one.partition(": limits.")[2] for one in told] == [
        "K0: this plan determines only K0 + Kpp; the limit is held against that",
        "Kpp: this plan does not determine Kpp alone, only K0 + Kpp, Kii − Kpp and Koo − Kpp; its "
        "verdict will be inconclusive (exit code 6)",
    ]


def test_units_of_results_are_those_of_the_model() -> None:
    assert UNITS_OF_RESULTS == UNITS
    assert tuple(UNITS_OF_RESULTS) == COEFFICIENTS
