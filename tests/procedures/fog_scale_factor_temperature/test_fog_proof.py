"""Compensation, its sources in three languages, the verification ramp and the vehicle test."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fog_records import CURVES, TURN_S, quartic, record
from numpy.polynomial.chebyshev import poly2cheb
from simulated_drive import (
    drive_csv,
    drive_of_truth,
    simulated_drive,
)

from procedures.fog_scale_factor_temperature.analysis import analyse
from procedures.fog_scale_factor_temperature.compensation import (
    compensation_files,
    definition_of,
    matlab_source,
    python_source,
)
from procedures.fog_scale_factor_temperature.curve import Curve
from procedures.fog_scale_factor_temperature.dataset import FogDataset, TurnTable
from procedures.fog_scale_factor_temperature.from_import import read_drive
from procedures.fog_scale_factor_temperature.parameters import Departure
from procedures.fog_scale_factor_temperature.verification import evaluate_drive, heading_deg
from station.files.lookup import BENCHES, find

COMPILER = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
HEAT = (-60.0, -38.0, -12.3, 0.0, 21.7, 59.0, 80.0)


@pytest.fixture(scope="module")
def curves() -> dict[str, Curve]:
    fits = analyse(record(0, axes=("x", "y", "z"))).fits
    return {axis: fit.curve for axis, fit in fits.items() if fit.curve is not None}


def expected(curves: dict[str, Curve], rate: float = 12.5) -> list[float]:
    return [
        rate / (1.0 + 1e-6 * float(curves[axis].error_ppm(np.array([heat]))[0]))
        for axis in curves
        for heat in HEAT
    ]


def test_the_python_source_compensates_as_the_curve_says(curves: dict[str, Curve]) -> None:
    space: dict[str, Any] = {}
    exec(python_source(definition_of(curves)), space)
    found = [space["compensated"](axis, 12.5, heat) for axis in curves for heat in HEAT]
    assert found == pytest.approx(expected(curves), rel=1e-14)


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
def test_the_c_source_compensates_as_the_curve_says(
    curves: dict[str, Curve], tmp_path: Path
) -> None:
    text = '#include <stdio.h>\n#include "compensation.c"\nint main(void) {\n'
    for axis in curves:
        for heat in HEAT:
            text += f"printf(\"%.17g\\n\", compensated('{axis}', 12.5, {heat!r}));\n"
    (tmp_path / "main.c").write_text(text + "return 0; }\n", encoding="utf-8")
    source = compensation_files(curves)["compensation.c"]
    (tmp_path / "compensation.c").write_text(source, encoding="utf-8")
    build = [str(COMPILER), "-std=c99", "-Wall", "-Werror", "-pedantic", "-o", "it", "main.c"]
    subprocess.run(build, cwd=tmp_path, check=True)
    done = subprocess.run([str(tmp_path / "it")], capture_output=True, text=True, check=True)
    assert [float(one) for one in done.stdout.split()] == pytest.approx(expected(curves), rel=1e-14)


def test_the_matlab_source_compensates_as_the_curve_says(curves: dict[str, Curve]) -> None:
    space: dict[str, Any] = {}
    exec(python_of(matlab_source(definition_of(curves))), space)
    found = [space["compensated"](axis, 12.5, heat) for axis in curves for heat in HEAT]
    assert found == pytest.approx(expected(curves), rel=1e-14)


def python_of(matlab: str) -> str:
    """Return the few words of MATLAB that the source uses as Python."""
    lines, depth, result = [], 0, ""
    for raw in matlab.replace("; ", "\n").splitlines():
        line = re.sub(r"%.*", "", raw).strip().rstrip(";")
        if found := re.fullmatch(r"function (\w+) = (\w+)\((.*)\)", line):
            result = found.group(1)
            lines.append(f"def {found.group(2)}({found.group(3)}):")
            depth = 1
        elif line == "end":
            depth -= 1
            if depth == 0:
                lines.append(f"    return {result}")
        elif line.startswith("switch"):
            lines.append("    " * depth + "if False: pass")
            depth += 1
        elif line.startswith("case"):
            lines.append(f"    elif axis == {line.split()[1]}:")
        elif found := re.fullmatch(r"for k = length\(c\):-1:2", line):
            lines.append("    " * depth + "for k in range(len(c), 1, -1):")
            depth += 1
        elif line:
            lines.append("    " * depth + re.sub(r"\bc\(([k1])\)", r"c[\1 - 1]", line))
    return "\n".join(lines)


def test_the_table_has_every_degree_of_the_range_and_nothing_beyond(
    curves: dict[str, Curve],
) -> None:
    rows = compensation_files(curves)["compensation.csv"].splitlines()
    assert rows[0] == "temperature_degC,delta_x_ppm,delta_y_ppm,delta_z_ppm"
    by_heat = {row.split(",")[0]: row.split(",")[1:] for row in rows[1:]}
    for place, curve in enumerate(curves.values()):
        rows_of_axis = {float(heat): cells[place] for heat, cells in by_heat.items()}
        assert all((cell != "") == curve.holds(heat) for heat, cell in rows_of_axis.items())
        told = np.array([(heat, float(cell)) for heat, cell in rows_of_axis.items() if cell])
        assert told[:, 1] == pytest.approx(curve.error_ppm(told[:, 0]), abs=0.0005001)
    assert float(by_heat["20"][0]) == pytest.approx(float(quartic(np.array([20.0]))[0]), abs=1.0)
    assert len(by_heat) == 98 - (by_heat["59"][0] == "" == by_heat["59"][2])
    assert compensation_files({}) == {}


def with_verification(seed: int, turns: tuple[int, ...] = (360, -360)) -> FogDataset:
    dataset = record(seed, axes=("x", "y", "z"))
    down = record(seed + 100, turns, axes=("x", "y", "z"), first_degC=58.0, last_degC=-37.0)
    return replace(dataset, verification=down.turns)


def test_a_verification_ramp_shows_what_compensation_leaves() -> None:
    analysis = analyse(with_verification(0))
    for one in analysis.verified.values():
        assert np.sqrt(np.mean(one.before_ppm**2)) > 50.0
        assert np.sqrt(np.mean(one.after_ppm**2)) < 1.1
        assert abs(one.after_ppm[one.worst]) < 4.0
        assert not bool(one.by_bias_ppm.any())
    sizes = [np.mean((one.after_ppm / one.u_ppm) ** 2) for one in analysis.verified.values()]
    assert np.mean(sizes) == pytest.approx(1.0, abs=0.3)


def test_single_verification_turns_have_the_bias_in_their_uncertainty() -> None:
    one = analyse(with_verification(0, (360,))).verified["x"]
    assert one.by_bias_ppm == pytest.approx(47.0 / 3600.0 / 360.0 * 1e6)


def test_hysteresis_that_a_ramp_hides_comes_out_on_the_way_back() -> None:
    dataset = record(0)
    cold = {axis: lambda heat: quartic(heat) + 12.0 for axis in CURVES}
    down = record(9, first_degC=58.0, last_degC=-37.0, curves=cold)
    one = analyse(replace(dataset, verification=down.turns)).verified["x"]
    assert np.mean(one.after_ppm) == pytest.approx(12.0, abs=0.5)


@pytest.mark.parametrize("made_again", [True, False])
def test_turns_that_a_gap_took_apart_are_no_pair(made_again: bool) -> None:
    calibrated, down = record(0), record(9, first_degC=58.0, last_degC=-37.0).turns
    first = int(np.flatnonzero(down.set_number == 20)[0])
    rows = np.sort(np.concatenate((np.arange(len(down)), np.repeat(first, made_again))))
    table = TurnTable(**{name: values[rows] for name, values in vars(down).items()})
    later = np.arange(len(rows)) > first
    for times in (table.before_s, table.after_s):
        times[later] += 10800.0
    table.attitude_after_deg[later, 0] += 1.0 * TURN_S / 3600.0  # 1 deg/h, or 36 ppm
    one = analyse(replace(calibrated, verification=table)).verified["x"]
    assert len(one.after_ppm) == len(down) - 2 * (not made_again)
    assert np.abs(one.after_ppm).max() < 4.0


def exact() -> dict[str, Curve]:
    coefficients = np.array([100.0, -150.0, 60.0, 20.0, 10.0])
    curve = Curve((-40.0, 60.0), coefficients, 0.01 * np.eye(5), 100.0, np.zeros(5))
    return dict.fromkeys(("x", "y", "z"), curve)


@pytest.mark.parametrize("known", [True, False])
def test_a_drives_heading_comes_back_to_where_it_began(known: bool) -> None:
    still = dict.fromkeys(CURVES, np.zeros_like)
    drive = simulated_drive(still, laps=3, first_heading_known=known)
    course = heading_deg(drive, drive.rate_deg_per_s)
    assert course[-1] - course[0] == pytest.approx(3 * 360.0, abs=2e-3)


@pytest.mark.parametrize("latitude", [-40.0, 0.0, 60.0])
def test_the_earths_rate_is_taken_off_at_every_latitude(latitude: float) -> None:
    still = dict.fromkeys(CURVES, np.zeros_like)
    drive = simulated_drive(still, laps=2, latitude_deg=latitude)
    driven = evaluate_drive(drive, exact())
    assert driven.raw_error_deg == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("reference", [True, False])
def test_compensation_takes_the_heading_error_of_many_turns_away(reference: bool) -> None:
    curves = exact()
    true = {axis: curve.error_ppm for axis, curve in curves.items()}
    drive = simulated_drive(true, laps=10, temperature_degC=(-20.0, -30.0))
    driven = evaluate_drive(drive if reference else replace(drive, heading_deg=None), curves)
    assert driven.raw_error_deg is not None
    assert driven.compensated_error_deg is not None
    between = curves["z"].error_ppm(np.array([-20.0, -30.0])) * 3600e-6
    assert min(between) < driven.raw_error_deg < max(between)
    assert abs(driven.compensated_error_deg) < 0.003
    assert driven.turned_deg == pytest.approx(3600.0, rel=0.01)
    assert driven.model_u_deg > 0.0


def test_the_drive_that_comes_with_the_station_is_of_the_simulated_benchs_gyros() -> None:
    path = find("drives", "fog-yard-laps", ".csv")
    truth = json.loads(path.with_suffix(".truth.json").read_text(encoding="utf-8"))
    assert drive_csv(drive_of_truth(truth)) == path.read_text(encoding="utf-8")
    gyros = yaml.safe_load(find(BENCHES, "sim").read_text(encoding="utf-8"))["simulation"]["fog"]
    for axis, powers in truth["scale_factor_error_ppm"].items():
        told = gyros["gyros"][axis]["scale_factor_error"]
        assert [float(told[f"u{k}"].removesuffix(" ppm")) for k in range(5)] == powers
    began = Departure.model_validate({"initial_heading": "25 deg"})
    drive = read_drive(path, None, 39.9, began)
    low, high = truth["temperature_range_degC"]
    curves = {
        axis: replace(curve, domain_degC=(low, high), coefficients_ppm=poly2cheb(powers))
        for (axis, curve), powers in zip(
            exact().items(), truth["scale_factor_error_ppm"].values(), strict=True
        )
    }
    driven = evaluate_drive(drive, curves)
    for name, error_deg in (
        ("uncompensated", driven.raw_error_deg),
        ("compensated", driven.compensated_error_deg),
    ):
        told_deg = truth[f"heading_error_{name}_deg"]
        assert error_deg == pytest.approx(told_deg, abs=truth["tolerance_deg"])


def test_the_rates_noise_is_in_the_uncertainty_of_the_heading() -> None:
    curves = exact()
    true = {axis: curve.error_ppm for axis, curve in curves.items()}
    walk = 0.02
    pulls = []
    for seed in range(6):
        drive = simulated_drive(true, laps=4, random_walk_deg_per_sqrt_h=walk, seed=seed)
        driven = evaluate_drive(drive, curves)
        assert driven.noise_u_deg == pytest.approx(walk * np.sqrt(driven.duration_h), rel=0.05)
        assert driven.compensated_error_deg is not None
        pulls.append(driven.compensated_error_deg / driven.noise_u_deg)
    assert 0.2 < np.sqrt(np.mean(np.square(pulls))) < 2.0
