"""The example of a drive that is navigated to position and velocity, and its truth.

`PYTHONPATH=. python tests/support/navigated_example.py tests/data/fog-drive` writes it: turns of
three axes, and three laps of a yard in gyros that cool meanwhile.

The true errors are those of the same drive without noise and biases, navigated with the rates as
they are; with true curves none is left. The mechanisation by itself is tested against an analytic
trajectory. Tolerances are four times the stated uncertainties.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fog_records import CURVES, record
from simulated_journey import Journey, simulated_journey

from procedures.fog_scale_factor_temperature.curve import Band
from procedures.fog_scale_factor_temperature.dataset import (
    AXES,
    Array,
    Drive,
    Trajectory,
    TurnTable,
)
from procedures.fog_scale_factor_temperature.evaluate import findings_of_dataset
from procedures.fog_scale_factor_temperature.navigation import NAMES, RUNS, navigate_drive
from station.dataset_reading import read_dataset
from station.uncertainty import combine


def times_four(heat_degC: Array, *, curve: Callable[[Array], Array]) -> Array:
    """Return errors of gyros that nobody has compensated, up to 1600 ppm."""
    return 4.0 * curve(heat_degC)


GYRO_BIAS_DEG_PER_H, ACCELEROMETER_BIAS_UG = 2e-4, 5.0
GYRO_NOISE_DEG_PER_S, ACCELEROMETER_NOISE_M_PER_S2 = 5e-6, 1e-4
LAPS, INTERVAL_S, REFERENCE_EVERY = 3, 0.2, 5
LARGE = {axis: partial(times_four, curve=curve) for axis, curve in CURVES.items()}
ORDERS = {"x": 4, "y": 2, "z": 4}
TOLERANCE = 4.0
SEED = 43
DATASET = f"""\
dataset: 1
procedure: fog-scale-factor-temperature
files: {{turns: turns.csv, drive: drive.csv, reference: reference.csv}}
conditions:
  # turns: heading is clockwise positive in [0, 360); a positive commanded turn is clockwise
  # drive: x forward, y right, z down; rates against the stars, specific force is -9.8 along z when
  # level; values at their times. reference: WGS 84, on the clock of the drive
  attitude_output: heading
  turn_sense: heading
  angle_random_walk: 0.002 deg/sqrt(h)
  turntable_accuracy: 1 arcsec
  gyro_bias: {GYRO_BIAS_DEG_PER_H} deg/h     # standard uncertainty, in turns and drive
  latitude: 40 deg
  initial_heading: 25 deg
  initial_pitch: 0 deg
  initial_roll: 0 deg
  accelerometer_bias: {ACCELEROMETER_BIAS_UG:g} ug
"""


def turns_csv(table: TurnTable) -> str:
    """Return the turns as the import reads them."""
    lines = [
        "set,t_before_s,t_after_s,axis,commanded_deg,heading_before_deg,heading_after_deg,"
        "gyro_temperature_before_degC,gyro_temperature_after_degC"
    ]
    for n in range(len(table)):
        cells = (
            table.set_number[n],
            table.before_s[n],
            table.after_s[n],
            table.axis[n],
            f"{table.commanded_deg[n]:g}",
            f"{table.attitude_before_deg[n, 0]:.6f}",
            f"{table.attitude_after_deg[n, 0]:.6f}",
            f"{table.temperature_before_degC[n]:.3f}",
            f"{table.temperature_after_degC[n]:.3f}",
        )
        lines.append(",".join(str(cell) for cell in cells))
    return "\n".join(lines) + "\n"


def columns_csv(columns: dict[str, tuple[str, Array]], every: int = 1) -> str:
    """Return columns as CSV, each in its format, one row of so many."""
    rows = zip(*(own[::every] for _, own in columns.values()), strict=True)
    formats = [shape for shape, _ in columns.values()]
    lines = [
        ",".join(format(cell, shape) for cell, shape in zip(row, formats, strict=True))
        for row in rows
    ]
    return "\n".join([",".join(columns), *lines]) + "\n"


def files_of_drive(journey: Journey, every: int = REFERENCE_EVERY) -> dict[str, str]:
    """Return `drive.csv` and `reference.csv` of a journey, of the latter one row of so many."""
    drive = {"t_s": (".1f", journey.time_s)}
    for name, shape, values in (
        ("rate_{}_deg_per_s", ".7f", journey.rate_deg_per_s),
        ("temperature_{}_degC", ".2f", journey.temperature_degC),
        ("specific_force_{}_m_per_s2", ".5f", journey.force_m_per_s2),
    ):
        drive |= {name.format(axis): (shape, values[:, n]) for n, axis in enumerate(AXES)}
    reference = {
        "t_s": (".1f", journey.time_s),
        "latitude_deg": (".9f", journey.latitude_deg),
        "longitude_deg": (".9f", journey.longitude_deg),
        "height_m": (".3f", journey.height_m),
    }
    for n, way in enumerate(("north", "east", "down")):
        reference[f"velocity_{way}_m_per_s"] = (".5f", journey.velocity_m_per_s[:, n])
    return {
        "drive.csv": columns_csv(drive),
        "reference.csv": columns_csv(reference, every),
    }


def drive_of(journey: Journey) -> Drive:
    """Return a journey as the analysis has it."""
    heading, pitch, roll = journey.attitude_deg[0]
    return Drive(
        time_s=journey.time_s,
        rate_deg_per_s=journey.rate_deg_per_s,
        temperature_degC=journey.temperature_degC,
        latitude_deg=journey.latitude_deg[0],
        first_heading_deg=heading,
        first_heading_known=True,
        first_pitch_deg=pitch,
        first_roll_deg=roll,
        specific_force_m_per_s2=journey.force_m_per_s2,
        reference=Trajectory(
            journey.time_s,
            journey.latitude_deg,
            journey.longitude_deg,
            journey.height_m,
            journey.velocity_m_per_s,
        ),
    )


def flawed(laps: int = LAPS) -> Journey:
    """Return the drive with biases as stated and noise."""
    generator = np.random.default_rng(SEED)
    gyro = GYRO_BIAS_DEG_PER_H * generator.standard_normal(3)
    force = ACCELEROMETER_BIAS_UG * 9.80665e-6 * generator.standard_normal(3)
    return simulated_journey(
        LARGE,
        laps=laps,
        interval_s=INTERVAL_S,
        seed=SEED,
        gyro_bias_deg_per_h=tuple(gyro),
        accelerometer_bias_m_per_s2=tuple(force),
        gyro_noise_deg_per_s=GYRO_NOISE_DEG_PER_S,
        accelerometer_noise_m_per_s2=ACCELEROMETER_NOISE_M_PER_S2,
    )


def truth_of(folder: Path) -> dict[str, Any]:
    """Return what the dataset in a folder is expected to give."""
    findings = findings_of_dataset(read_dataset(folder))
    whole = combine(findings.estimates, findings.inputs)
    pairs = zip(findings.estimates, whole, strict=True)
    u = {estimate.name: own.standard_uncertainty for estimate, own in pairs if own}
    fits = findings.detail.analysis.fits
    curves = {axis: fit.curve for axis, fit in fits.items() if fit.curve is not None}
    expected = {}
    for axis, curve in curves.items():
        heat = np.round(curve.temperatures_degC(21)[1:-1], 3)
        expected[axis] = {
            "T_degC": heat.tolist(),
            "delta_ppm": np.round(LARGE[axis](heat), 3).tolist(),
            "tol_ppm": np.round(TOLERANCE * Band(curve).standard_ppm(heat), 3).tolist(),
            "true_order": ORDERS[axis],
            "outlier_rows": [],
        }
    pure = drive_of(simulated_journey(LARGE, laps=LAPS, interval_s=INTERVAL_S))
    errors = navigate_drive(pure, curves).error
    errors[1] = 0.0
    drive = []
    for name in NAMES:
        part = slice(2, 4) if name == "velocity_error" else slice(0, 2)
        for run, error in zip(RUNS, np.linalg.norm(errors[:, :, part], axis=2), strict=True):
            value = error[-1] if name == "final_position_error" else error.max()
            own = f"{name}_{run}"
            tolerance = round(TOLERANCE * u[own], 4)
            drive.append({"name": own, "value": round(float(value), 4), "tolerance": tolerance})
    procedure = "fog-scale-factor-temperature"
    return {"procedure": procedure, "flags": [], "curves": expected, "drive": drive}


def main() -> None:
    folder = Path(sys.argv[1])
    turns = record(SEED, axes=AXES, curves=LARGE, bias_deg_per_h=GYRO_BIAS_DEG_PER_H).turns
    files = {"turns.csv": turns_csv(turns), **files_of_drive(flawed()), "dataset.yaml": DATASET}
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    truth = json.dumps(truth_of(folder), indent=1) + "\n"
    (folder / "truth.json").write_text(truth, encoding="utf-8")


if __name__ == "__main__":
    main()
