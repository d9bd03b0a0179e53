"""Faults planted in accelerometer data end in a flag that names their cause, or in u."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accelerometer_records import codes, estimate, off_in_u, record
from sabotage import judged
from sabotage_accelerometer import FAULTS

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset

FIVE_T = (-0.04, -0.02, 0.0, 0.02, 0.04)
QUICK = (
    "gain step 100 ppm; efficient",
    "voltmeter lags 3 %; one plane",
    "gaussmeter gain steps 2 %; three planes, 12 angles",
    "mains, aliased, 40 uV; three planes, 12 angles",
    "voltmeter frozen; one plane",
    "output clipped at 0.45 V; three planes, 12 angles",
    "output in steps of 1 mV; one plane",
    "angle in rad; three planes, 12 angles",
    "angle in gon; one plane",
    "angle of the other sense in a plane; efficient",
    "angle 90 deg off; one plane",
    "plane io called op; one plane",
    "a copied block; efficient",
    "cubic in the field, 3 %; three planes, 12 angles",
    "sensitivity gone from a row on; three planes, 12 angles",
    "scale warms up by 100 ppm; three planes, 12 angles",
    "noise ten times as large in a plane; three planes, 12 angles",
    "field and its command reversed in a plane; efficient",
    "output of the other sign from a row on; one plane",
    "output a mean of two rows; efficient",
    "encoder stands still; efficient",
    "coil warms the device, 4 rows; efficient",
)


@pytest.mark.parametrize("name", QUICK)
def test_a_planted_fault_is_named(name: str) -> None:
    (fault,) = [one for one in FAULTS if one.name == name]
    found = judged(fault, 7)
    assert found["named"], found


def there_and_back(seed: int) -> tuple[AccelerometerDataset, np.ndarray]:
    """Return a record whose fields go up and down at each angle, and +1 where they came up."""
    one = record(seed, ("io", "ip"), 12, (*FIVE_T, *FIVE_T[-2::-1]))
    steps = np.sign(np.diff(one.field_commanded_T, prepend=-1.0))
    return one, steps


@pytest.mark.parametrize("width_V", [10e-6, -30e-6, 200e-6])
def test_hysteresis_of_the_device_is_flagged_by_its_cause(width_V: float) -> None:
    for seed in range(1):
        one, up = there_and_back(seed)
        loop = 1.0 - 0.5 * (one.field_commanded_T / 0.04) ** 2
        for course in (0.5 * width_V * up, 0.5 * width_V * up * loop):
            analysis = analyse(replace(one, output_V=one.output_V + course))
            assert "hysteresis" in codes(analysis) and "misfit" not in codes(analysis)
            assert max(off_in_u(analysis).values()) < 4.5


@pytest.mark.parametrize(("name", "seed"), [("cubic in the field, 3 %", 6), ("remanence", 0)])
def test_hysteresis_and_a_shape_over_the_field_are_named_where_neither_is_sure(
    name: str, seed: int
) -> None:
    kind = "three planes, 12 angles"
    fault = next(one for one in FAULTS if one.name.startswith(name) and one.name.endswith(kind))
    assert judged(fault, seed)["flags"] == ["hysteresis", "misfit", "not-identifiable"]


def test_hysteresis_of_the_core_is_in_the_measured_field_and_costs_nothing() -> None:
    one, up = there_and_back(3)
    k = 0.0135 + 2 * 0.12 * one.field_T
    there_T = 2e-4 * up
    analysis = analyse(
        replace(one, field_T=one.field_T + there_T, output_V=one.output_V + k * there_T)
    )
    assert max(off_in_u(analysis).values()) < 4.5


def test_clean_records_have_no_hysteresis() -> None:
    for seed in range(12):
        assert codes(analyse(there_and_back(seed)[0])) <= {"not-identifiable", "not-significant"}


@pytest.mark.parametrize("field_gain", [0.99, 1.003])
def test_terms_are_those_of_the_measured_field(field_gain: float) -> None:
    for seed in range(2):
        one = record(seed, ("io", "ip"), 24, (0.0, 0.05), noise_V=1e-6, field_gain=field_gain)
        analysis = analyse(one)
        km = estimate(analysis, "Km")
        assert km.extra["terms"]["Kmm"] == pytest.approx(0.05 * field_gain, rel=1e-4)
        assert off_in_u(analysis)["Km"] < 4.0
        moved = [f for f in analysis.flags if f.code == "field-differs-from-commanded"]
        assert ["Km"] in [flag.details.get("coefficients") for flag in moved]
        wanting = next(f for f in analysis.flags if f.code == "not-identifiable")
        assert wanting.details["coefficients"] == ["K0", "Kii", "Koo", "Kpp", "Km", "Kmm"]


def test_terms_stay_those_of_the_plan_where_the_field_was_as_commanded() -> None:
    analysis = analyse(record(0, ("io", "ip"), 24, (0.0, 0.05), noise_V=1e-6))
    assert estimate(analysis, "Km").extra["terms"] == {"Km": 1.0, "Kmm": 0.05}
    assert "field-differs-from-commanded" not in codes(analysis)


@pytest.mark.parametrize("size_V", [20e-6, -60e-6, 200e-6])
def test_an_output_step_of_about_100_uV_is_flagged(size_V: float) -> None:
    for seed, row in ((0, 12), (1, 29)):
        one = record(seed)
        output_V = one.output_V + size_V * (np.arange(54) >= row)
        assert "output-step" in codes(analyse(replace(one, output_V=output_V)))


@pytest.mark.parametrize("rise_K", [0.3, 1.0, 3.0])
def test_a_thermometer_that_stands_still_or_measures_the_room(rise_K: float) -> None:
    true = 25.0 + rise_K * np.linspace(0.0, 1.0, 54)
    one = record(4, temperature_degC=true, K0_per_K=30e-6, Ki_per_K=100e-6)
    still = analyse(replace(one, temperature_degC=np.where(np.arange(54) < 20, true, true[20])))
    assert "frozen" in codes(still)
    room = 23.0 + 0.02 * np.random.default_rng(5).standard_normal(54)
    elsewhere = analyse(replace(one, temperature_degC=room))
    assert "drift-removed" in codes(elsewhere)
    for analysis in (still, elsewhere):
        assert max(off_in_u(analysis).values()) < 4.5


@pytest.mark.parametrize("offset_arcsec", [36.0, -1800.0])
def test_the_zero_of_the_encoder_is_no_fault_in_three_planes(offset_arcsec: float) -> None:
    one = record(
        0,
        ("io", "ip", "op"),
        12,
        FIVE_T,
        offset_arcsec=offset_arcsec,
        misalignment=(3e-4, -2e-4),
    )
    analysis = analyse(one)
    assert codes(analysis) == {"not-identifiable"}
    assert max(off_in_u(analysis).values()) < 4.0


def test_coarse_readings_are_neither_copies_nor_frozen() -> None:
    for seed in range(4):
        one = record(seed, ("io", "ip", "op"), 12, FIVE_T, noise_V=1e-6)
        output_V, field_T = np.round(one.output_V, 5), np.round(one.field_T, 5)
        found = codes(analyse(replace(one, output_V=output_V, field_T=field_T)))
        assert "coarse-output" in found
        assert not found & {"repeated-rows", "frozen"}


def test_a_coarse_thermometer_that_follows_is_not_frozen() -> None:
    true = 23.0 + 0.3 * np.linspace(0.0, 1.0, 180)
    one = record(
        2,
        ("io", "ip", "op"),
        12,
        FIVE_T,
        temperature_degC=true,
        K0_per_K=30e-6,
        Ki_per_K=100e-6,
    )
    assert "frozen" not in codes(analyse(replace(one, temperature_degC=np.round(true, 1))))


@pytest.mark.parametrize(
    "name, statement, said",
    [
        ("field_T field_commanded_T", "field_T", "has the other sign in plane io"),
        ("output_V", "output_V", "has the other sign from row 20 "),
        ("theta_deg theta_commanded_deg", "theta_deg", "has the other sign from row 20 "),
        ("", "output_V", "holds about 40 % of the row before"),
    ],
)
def test_a_sign_that_changes_and_outputs_that_run_together_are_named(
    name: str, statement: str, said: str
) -> None:
    one = record(1)
    where = one.plane == "io" if "plane" in said else np.arange(len(one)) >= 20
    changes = {each: np.where(where, -1.0, 1.0) * getattr(one, each) for each in name.split()}
    last_V = np.append(one.output_V[0], one.output_V[:-1])
    changes = changes or {"output_V": 0.6 * one.output_V + 0.4 * last_V}
    analysis = analyse(replace(one, **changes))
    (flag,) = (one for one in analysis.flags if one.code == "contradicts-statement")
    assert flag.details["statement"] == statement and said in flag.message
    assert all(estimate.value is None for estimate in analysis.estimates)


def test_an_encoder_that_stands_still_is_left_out_and_a_long_stay_is_not() -> None:
    one = record(2, ("io", "ip"), 12, FIVE_T)
    rows = np.arange(len(one))
    held = (rows >= 30) & (rows < 52)
    angle_deg = np.where(held, one.theta_deg[30], one.theta_deg)
    analysis = analyse(replace(one, theta_deg=angle_deg, theta_commanded_deg=angle_deg))
    assert "frozen" in codes(analysis)
    assert max(off_in_u(analysis).values()) < 4.0
    # At one angle, many times measured, the output moves with the field alone.
    at = np.concatenate((rows, np.tile(rows[30:35], 6)))
    stay = {
        name: getattr(one, name)[np.sort(at)]
        for name in ("plane", "theta_deg", "theta_commanded_deg", "field_T", "field_commanded_T")
    }
    drawn = np.random.default_rng(0).standard_normal(len(at)) * 3e-6
    output_V = one.output_V[np.sort(at)] + drawn
    long = replace(one, **stay, output_V=output_V, time_s=10.0 * np.arange(len(at)))
    assert "frozen" not in codes(analyse(long))


def test_a_coil_that_warms_the_device_moves_no_coefficient() -> None:
    (fault,) = [one for one in FAULTS if one.name == "coil warms the device, 15 rows; efficient"]
    found = judged(fault, 1)
    assert found["named"] and found["error_u"] < 4.0


def test_a_noisy_accelerometer_follows_angle_and_field() -> None:
    analysis = analyse(record(3, ("io", "ip", "op"), 12, FIVE_T, noise_V=1e-3))
    assert "misfit" not in codes(analysis)
    assert max(off_in_u(analysis).values()) < 4.0
