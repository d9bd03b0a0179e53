"""From the record of the stage's part to its findings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, InputQuantity, findings_of

from .analysis import ANGLE, MOUNTING, StageDataset, analyse
from .parameters import RESULTS, StageParameters, StageRecord
from .steps import ANGLE as STATED
from .steps import METER, STAGE

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings(folder: RunFolder, parameters: StageParameters, bench: Bench) -> Findings:
    """Return the figures of the stage; a run without all their records gives none."""
    finished = folder.finished_units()
    if missing := [record.unit for record in parameters.records if record.unit not in finished]:
        return findings_of(not_measured("stage", RESULTS, missing), None, [])
    angle = list(bench.stated_input(STATED, ANGLE, "angle of the rotary stage"))
    angle_u_deg = angle[0].standard_uncertainty or 0.0
    data = dataset_of_run(folder, parameters, angle_u_deg)
    about = "mounting of the accelerometer on the stage"
    mounting = InputQuantity(MOUNTING, about, parameters.mounting_deg, "deg", "the plan")
    return findings_of(analyse(data), data, [mounting, *angle])


def dataset_of_run(
    folder: RunFolder, parameters: StageParameters, angle_u_deg: float
) -> StageDataset:
    """Return the mean outputs of a run; ValueError where one is no number."""

    def burst(record: StageRecord) -> tuple[float, float]:
        voltage_V = folder.rows(METER, record.unit)["voltage_V"]
        if len(voltage_V) < 2 or not np.isfinite(voltage_V).all():
            raise ValueError(f"{record.unit}: two readings that are numbers are needed")
        u_V = float(np.std(voltage_V, ddof=1)) / math.sqrt(len(voltage_V))
        return float(voltage_V.mean()), u_V

    def beyond_deg(record: StageRecord) -> float:
        row = folder.rows(STAGE, record.unit)[0]
        return float(row["angle_deg"] - row["commanded_deg"])

    turning = [record for record in parameters.records if record.plane == "io"]
    along = [record for record in parameters.records if record.plane == "op"]
    means = {record: burst(record) for record in parameters.records}
    return StageDataset(
        np.array([means[record][0] for record in turning]),
        np.array([means[record][0] for record in along]),
        max(u_V for _, u_V in means.values()),
        np.array([beyond_deg(record) for record in turning]),
        parameters.scale_factor_V_per_g,
        parameters.mounting_deg,
        angle_u_deg,
    )
