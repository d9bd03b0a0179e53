"""Position and velocity of a drive, without and with compensation, against the truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fog_records import CURVES, record
from navigated_example import drive_of, files_of_drive, turns_csv
from numpy.polynomial import Polynomial
from simulated_journey import Journey, simulated_journey
from test_import_fog import analysed, by_key, folder_with

from procedures.fog_scale_factor_temperature.analysis import analyse
from procedures.fog_scale_factor_temperature.curve import Curve
from procedures.fog_scale_factor_temperature.dataset import Drive
from procedures.fog_scale_factor_temperature.figures import draw_parts
from procedures.fog_scale_factor_temperature.navigation import NAMES
from procedures.fog_scale_factor_temperature.navigation_checks import navigated
from station.dataset_reading import read_dataset
from station.files.faults import FaultList
from station.parts import Table
from station.runner.evaluation import evaluate_dataset

LEVEL = "  initial_pitch: 0 deg\n  initial_roll: 0 deg\n"
STATED = (
    "  gyro_bias: 0.01 deg/h\n  latitude: 40 deg\n  initial_heading: 25 deg\n"
    "  accelerometer_bias: 20 ug\n  reference_position_uncertainty: 50 mm\n"
)
NAMED = "turns: turns.csv, drive: drive.csv, reference: reference.csv"
STANDARD_G = 9.80665
FORCE, RATES = "specific_force_x_m_per_s2", "rate_x_deg_per_s"
EXCHANGED = [1, 0, 2]


def flawed(seed: int, laps: int = 6, **changes: Any) -> Journey:
    """Return a drive with biases as stated and the noise of a navigator."""
    generator = np.random.default_rng([seed, 43])
    gyro, force = 0.01 * generator.standard_normal(3), 2e-4 * generator.standard_normal(3)
    return simulated_journey(
        CURVES,
        laps=laps,
        seed=seed,
        gyro_bias_deg_per_h=tuple(gyro),
        accelerometer_bias_m_per_s2=tuple(force),
        gyro_noise_deg_per_s=1e-4,
        accelerometer_noise_m_per_s2=1e-3,
        **changes,
    )


def files_of(journey: Journey) -> dict[str, str]:
    turns = turns_csv(record(0, axes=("x", "y", "z")).turns)
    return {"turns.csv": turns, **files_of_drive(journey, 1)}


@pytest.fixture(scope="module")
def curves() -> dict[str, Curve]:
    fits = analyse(record(0, axes=("x", "y", "z"))).fits
    return {axis: fit.curve for axis, fit in fits.items() if fit.curve is not None}


@pytest.fixture(scope="module")
def drive() -> Drive:
    return drive_of(flawed(1, laps=2, climb_m=40.0))


def test_errors_of_a_drive_are_recovered_within_their_uncertainty(curves: dict[str, Curve]) -> None:
    truth, none = navigated(drive_of(simulated_journey(CURVES, laps=6)), curves)
    assert truth is not None
    assert not none
    squares = []
    for seed in range(6):
        course, flags = navigated(drive_of(flawed(seed)), curves)
        assert course is not None
        assert not flags
        for run in (0, 1):
            # Both components of the last error, of each run, over their uncertainty.
            off = course.error[run, -1, :2] - truth.error[run, -1, :2]
            gyro = 0.01 * course.shifts["gyro_bias"][:, -1, :2]
            force = 20.0 * course.shifts["accelerometer_bias"][:, -1, :2]
            noise = course.shifts["noise"][:, -1, :2] / 8.0
            u = np.sqrt(np.sum(np.concatenate((gyro, force, noise)) ** 2, axis=0))
            squares += list((off / u) ** 2)
    assert 0.4 < float(np.mean(squares)) < 2.0
    assert float(np.max(squares)) < 16.0


@pytest.mark.parametrize(("noise", "offset"), [(0.03, 0.0), (0.0, 0.02)])
def test_what_the_first_velocity_of_the_reference_is_off_is_in_u(
    curves: dict[str, Curve], noise: float, offset: float
) -> None:
    plain = drive_of(flawed(3))
    assert plain.reference is not None
    velocity = plain.reference.velocity_m_per_s
    more = noise * np.random.default_rng(4).standard_normal(velocity.shape)
    more[:, :2] += offset
    reference = replace(plain.reference, velocity_m_per_s=velocity + more)
    truth, _ = navigated(plain, curves)
    off, flags = navigated(replace(plain, reference=reference), curves)
    assert truth is not None and off is not None, flags
    sizes = [way.size(curves, "position_error", 1, {}) for way in (truth, off)]
    # What it adds to u holds what it does to the error.
    added = math.sqrt(sizes[1].u ** 2 - sizes[0].u ** 2)
    assert 0.5 < abs(sizes[1].value - sizes[0].value) < 3.0 * added


def test_an_imported_drive_gives_position_and_velocity_errors(
    tmp_path: Path, curves: dict[str, Curve]
) -> None:
    journey = flawed(0)
    truth, _ = navigated(drive_of(simulated_journey(CURVES, laps=6)), curves)
    assert truth is not None
    folder = folder_with(tmp_path, files_of(journey), STATED + LEVEL, NAMED)
    out = tmp_path / "out"
    data = analysed(folder, out)
    for name in NAMES:
        unit = "m/s" if name == "velocity_error" else "m"
        for run, word in enumerate(("uncompensated", "compensated")):
            result = by_key(data, f"{name}_{word}", None)
            true = truth.size(curves, name, run, {}).value
            assert result["unit"] == unit
            assert abs(result["value"] - true) < 3.0 * result["standard_uncertainty"]
    before = by_key(data, "position_error_uncompensated", None)
    assert before["value"] > by_key(data, "position_error_compensated", None)["value"]
    budget = {line["description"]: line["contribution"] for line in before["budget"]}
    assert budget["bias of each accelerometer"] > 0.0
    # Both ends of a drive whose error has no direction, north and east.
    assert budget["positions of the reference"] == pytest.approx(0.05 * math.sqrt(4.0))
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Horizontal distance from the reference trajectory" in page


def test_the_formula_in_the_report_is_the_curve(tmp_path: Path) -> None:
    files = {"turns.csv": files_of(flawed(0, laps=1))["turns.csv"]}
    folder = folder_with(tmp_path, files, "  gyro_bias: 0.02 deg/h\n")
    document, findings = evaluate_dataset(read_dataset(folder))
    tables = [part for part in draw_parts(findings, document) if isinstance(part, Table)]
    (table,) = (part for part in tables if part.title == "Coefficients")
    powers = [float(row[4]) for row in table.rows if row[0] == "y"]
    curve = findings.detail.analysis.fits["y"].curve
    low, high = curve.domain_degC
    heat = np.array([-30.0, 0.0, 41.3])
    scaled = (2.0 * heat - low - high) / (high - low)
    assert Polynomial(powers)(scaled) == pytest.approx(curve.error_ppm(heat), abs=1e-6)


@pytest.mark.parametrize(
    ("lacks", "what"),
    [
        ({"specific_force_m_per_s2": None}, "no specific force"),
        ({"reference": None}, "no reference trajectory"),
        ({"first_pitch_deg": None}, "`initial_pitch`"),
        ({"first_heading_known": False}, "`initial_heading`"),
    ],
)
def test_a_drive_that_lacks_a_part_gives_no_position(
    drive: Drive, curves: dict[str, Curve], lacks: dict[str, Any], what: str
) -> None:
    course, (flag,) = navigated(replace(drive, **lacks), curves)
    assert course is None
    assert flag.code == "not-identifiable"
    assert what in flag.message
    assert "velocity_error_compensated" in flag.details["coefficients"]


def test_a_reference_of_another_time_gives_no_position(
    drive: Drive, curves: dict[str, Curve]
) -> None:
    assert drive.reference is not None
    later = replace(drive.reference, time_s=drive.reference.time_s + 5000.0)
    course, (flag,) = navigated(replace(drive, reference=later), curves)
    assert course is None
    assert "its reference do not hold its beginning" in flag.message


@pytest.mark.parametrize(
    ("column", "change", "statement", "what"),
    [
        ("rate_deg_per_s", np.radians, RATES, "in rad/s"),
        ("rate_deg_per_s", lambda rate: rate * [1, 1, -1], RATES, "their z is reversed"),
        ("rate_deg_per_s", lambda rate: rate[:, EXCHANGED], RATES, "their x and y are exchanged"),
        ("specific_force_m_per_s2", lambda force: force / STANDARD_G, FORCE, "in g"),
        ("specific_force_m_per_s2", lambda force: -force, FORCE, "all their signs are reversed"),
        (
            "specific_force_m_per_s2",
            lambda force: force[:, EXCHANGED],
            FORCE,
            "their x and y are exchanged",
        ),
    ],
)
def test_wrong_columns_of_a_drive_are_named(
    drive: Drive, curves: dict[str, Curve], column: str, change: Any, statement: str, what: str
) -> None:
    wrong = replace(drive, **{column: change(getattr(drive, column))})
    course, (flag,) = navigated(wrong, curves)
    assert course is None
    assert flag.code == "contradicts-statement"
    assert flag.details["statement"] == statement
    assert what in flag.message


@pytest.mark.parametrize(
    ("column", "change"),
    [
        ("height_m", lambda height: height / 1000.0),
        ("latitude_deg", np.radians),
        ("latitude_deg", lambda latitude: latitude[::-1]),
    ],
)
def test_a_reference_that_denies_itself_is_named(
    drive: Drive, curves: dict[str, Curve], column: str, change: Any
) -> None:
    assert drive.reference is not None
    wrong = replace(drive.reference, **{column: change(getattr(drive.reference, column))})
    course, (flag,) = navigated(replace(drive, reference=wrong), curves)
    assert course is None
    assert flag.details["statement"] == column


def test_half_a_sample_between_drive_and_reference_is_noticed_and_in_u(
    drive: Drive, curves: dict[str, Curve]
) -> None:
    assert drive.reference is not None
    late = replace(drive.reference, time_s=drive.reference.time_s - 0.05)
    course, (flag,) = navigated(replace(drive, reference=late), curves)
    assert course is not None
    assert flag.details["statement"] == "t_s"
    assert abs(flag.details["offset_s"]) == pytest.approx(0.05, rel=0.25)


@pytest.mark.parametrize(
    ("column", "factor", "offset", "statement"),
    [
        ("first_pitch_deg", 1.0, 0.1, "initial_pitch"),
        ("first_roll_deg", 1.0, -0.1, "initial_roll"),
        ("specific_force_m_per_s2", 1.01, 0.0, FORCE),
    ],
)
def test_a_level_or_a_scale_that_the_first_rest_denies_is_named(
    drive: Drive,
    curves: dict[str, Curve],
    column: str,
    factor: float,
    offset: float,
    statement: str,
) -> None:
    changed: Any = {column: factor * getattr(drive, column) + offset}
    course, (flag,) = navigated(replace(drive, **changed), curves)
    assert course is not None
    assert (flag.code, flag.details["statement"]) == ("contradicts-statement", statement)


def test_a_reference_needs_its_drive_and_three_axes_of_specific_force(tmp_path: Path) -> None:
    files = files_of(flawed(0, laps=1))
    alone = "turns: turns.csv, reference: reference.csv"
    with pytest.raises(FaultList, match="there is no file drive"):
        analysed(folder_with(tmp_path, files, STATED + LEVEL, alone))
    files["drive.csv"] = "\n".join(
        row.rpartition(",")[0] for row in files["drive.csv"].splitlines()
    )
    with pytest.raises(FaultList, match="specific force has three axes"):
        analysed(folder_with(tmp_path, files, STATED + LEVEL, NAMED))
