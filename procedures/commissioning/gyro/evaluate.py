"""From the record of the gyro's part to its findings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from procedures.commissioning.clocks.analysis import clock_estimate, clock_flags
from procedures.commissioning.not_measured import not_measured
from procedures.estimation.alignment import unwrapped
from station.findings import Analysis, Findings, InputQuantity, findings_of

from .analysis import BIAS, DIRECTION, SCALE, GyroDataset, analyse, earth_of
from .parameters import CHANNELS_UNIT, REST_UNIT, RESULTS, GyroParameters
from .steps import GYRO, LIT
from .steps import SCALE as STATED

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: GyroParameters, bench: Bench) -> Findings:
    """Return the figures of the gyro; a run without its records gives none."""
    finished = folder.finished_units()
    if missing := [unit for unit in (CHANNELS_UNIT, REST_UNIT) if unit not in finished]:
        return findings_of(not_measured("gyro", RESULTS, missing), None, [])
    data = dataset_of_run(folder, parameters, bench)
    inputs = list(bench.stated_input(STATED, SCALE, "pulse weight of the gyro acquisition"))
    if data.earth is not None:
        bias, direction = data.earth.bias_u_deg_per_h, data.earth.direction_u_deg
        inputs += [
            InputQuantity(BIAS, "bias of the gyro", bias, "deg/h", "the plan"),
            InputQuantity(DIRECTION, "direction of the input axis", direction, "deg", "the plan"),
        ]
    analysis = analyse(data, inputs)
    arrival_s = folder.rows(GYRO, REST_UNIT)["arrival_time_s"]
    clock = clock_estimate("board_clock_error", data.time_s, arrival_s)
    whole = Analysis([*analysis.estimates, clock], (), [*analysis.flags, *clock_flags(clock, GYRO)])
    return findings_of(whole, data, inputs)


def dataset_of_run(folder: RunFolder, parameters: GyroParameters, bench: Bench) -> GyroDataset:
    """Return the pulses of a run at rest."""
    rows = folder.rows(GYRO, REST_UNIT)
    earth = parameters.earth
    return GyroDataset(
        unwrapped(rows["sequence"]) * parameters.sample_interval_s,
        rows["counts"].astype(np.float64),
        parameters.pulse_weight_arcsec * bench.corrected(*STATED),
        parameters.channel,
        tuple(folder.finished_units()[CHANNELS_UNIT][LIT]),
        None
        if earth is None
        else earth_of(
            earth.latitude_deg,
            earth.elevation_deg,
            earth.azimuth_deg,
            earth.direction_deg,
            earth.bias_deg_per_h,
        ),
    )
