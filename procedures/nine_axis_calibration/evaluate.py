"""From data to findings: the analysis, with the type B inputs of the set-up and the bench file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.nine_axis_calibration.analysis import analyse
from procedures.nine_axis_calibration.check import TURNTABLE
from procedures.nine_axis_calibration.dataset import Prior
from procedures.nine_axis_calibration.findings import AnalysisSettings
from procedures.nine_axis_calibration.from_import import dataset_of_import
from procedures.nine_axis_calibration.parameters import FULL_TURN_DEG, NineAxisParameters
from procedures.nine_axis_calibration.pose import PoseLimits
from station.findings import Findings, InputQuantity, findings_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

ARCMIN_PER_RAD = 60.0 * 180.0 / math.pi
PPM = 1e-6


def findings_of_run(folder: RunFolder, parameters: NineAxisParameters, bench: Bench) -> Findings:
    """Return what a run's finished units say, type B inputs from plan and bench file."""
    from procedures.nine_axis_calibration.from_record import dataset_of_run

    dataset = dataset_of_run(folder, parameters, bench)
    inputs = [*prior_inputs(dataset.prior, "the plan"), *bench_inputs(parameters, bench)]
    return findings_of(analyse(dataset, settings(parameters)), dataset, inputs)


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; its type B inputs are the priors it names."""
    dataset = dataset_of_import(raw)
    inputs = list(prior_inputs(dataset.prior, "the dataset's conditions"))
    return findings_of(analyse(dataset), dataset, inputs)


def settings(parameters: NineAxisParameters) -> AnalysisSettings:
    """Return the analysis settings of a plan."""
    return AnalysisSettings(**dict(parameters.thresholds), pose=pose_limits(parameters))


def pose_limits(parameters: NineAxisParameters) -> PoseLimits:
    """Return a plan's limits of the pose check."""
    pose = parameters.pose
    return PoseLimits(pose.acceleration_g, pose.rate_deg_per_h, pose.largest_bias_deg_per_h)


def prior_inputs(prior: Prior, source: str) -> Iterator[InputQuantity]:
    """Yield what is known of the set-up, each in units of its own standard uncertainty."""
    described = {
        "heading": f"heading of the plate, {prior.heading_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "relative_heading": "heading from position to position, "
        f"{prior.relative_heading_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "tilt": f"tilt of each position, {prior.tilt_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "accelerometer_bias": f"accelerometer biases, {prior.accelerometer_bias_g:.3g} g",
        "misalignment": "misalignment of the gyros' input axes",
        "mounting": "mounting of the sensor on the table, "
        f"{prior.mounting_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "table_axes": "axes of the table, "
        f"{prior.table_axes_rad * ARCMIN_PER_RAD * 60.0:.3g} arcsec",
    }
    for name, text in described.items():
        yield InputQuantity(f"prior_{name}", text, 1.0, "1", source)


def bench_inputs(parameters: NineAxisParameters, bench: Bench) -> Iterator[InputQuantity]:
    """Yield what is known of the station's clock, and of the table's angle by its record."""
    clock = parameters.prior.clock_ppm
    yield InputQuantity("time_scale", "rate of the station's clock", clock * PPM, "1", "the plan")
    if stated := bench.stated(TURNTABLE, "angle", FULL_TURN_DEG, "deg"):
        # Both ends of a part turn are read: root two of one reading.
        u = math.sqrt(2.0) * stated[0]
        yield InputQuantity("encoder_angle_deg", "angle of the table", u, "deg", stated[1])
