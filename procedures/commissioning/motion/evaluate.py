"""From the record of the table's part to its findings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from procedures.commissioning.not_measured import not_measured
from station.findings import Findings, InputQuantity, findings_of

from .analysis import (
    ENCODER,
    MISALIGNMENT,
    PLACING,
    SCALE,
    VERTICAL,
    Array,
    Level,
    MotionDataset,
    Turn,
    analyse,
)
from .measuring import AT_RATE
from .parameters import (
    AXES,
    HALF_TURNS,
    RESULTS,
    TURNED_UNIT,
    MotionParameters,
    TableTurn,
    level_unit,
)
from .placing import ANGLE, NAVIGATOR, TURNTABLE
from .sensed import sensed

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

ON_THE_WAY_S = 0.2
"""An output reaches the computer so long after its interval at most."""


def findings(folder: RunFolder, parameters: MotionParameters, bench: Bench) -> Findings:
    """Return the figures of the table; a run without all their records gives none."""
    finished = folder.finished_units()
    units = [
        *(turn.unit for turn in parameters.turns),
        *(level_unit(angles_deg) for angles_deg in HALF_TURNS),
        TURNED_UNIT,
    ]
    if missing := [unit for unit in units if unit not in finished]:
        return findings_of(not_measured("motion", RESULTS, missing), None, [])
    encoder = list(bench.stated_input(ANGLE, ENCODER, "angle of the table"))
    encoder_u_deg = encoder[0].standard_uncertainty or 0.0
    data = dataset_of_run(folder, parameters, encoder_u_deg)
    plan = "the plan"
    inputs = [
        *encoder,
        InputQuantity(PLACING, "placing of the sensor", data.placing_u_deg, "deg", plan),
        InputQuantity(VERTICAL, "level of the navigator", data.vertical_u_deg, "deg", plan),
        InputQuantity(
            MISALIGNMENT, "misalignment of the gyros", data.misalignment_u_deg, "deg", plan
        ),
        InputQuantity(SCALE, "scale factors of the sensor's gyros", data.scale_u, "1", plan),
    ]
    return findings_of(analyse(data), data, inputs)


def dataset_of_run(
    folder: RunFolder, parameters: MotionParameters, encoder_u_deg: float = 0.0
) -> MotionDataset:
    """Return turns and levels of a run; ValueError where a rest has too few outputs."""

    def level(unit: str) -> Level:
        return mean_of(sensed(folder, unit, parameters).force_g)

    by_unit = {turn.unit: turn_of(folder, turn, parameters) for turn in parameters.turns}
    small = {turn.axis: by_unit[turn.unit] for turn in parameters.small_turns[: len(AXES)]}
    whole = parameters.turns[len(parameters.small_turns) :]
    return MotionDataset(
        small,
        by_unit[parameters.small_turns[-1].unit],
        {turn.axis: by_unit[turn.unit] for turn in whole},
        tuple(level(level_unit(angles_deg)) for angles_deg in HALF_TURNS),
        level(TURNED_UNIT),
        parameters.placing_deg,
        parameters.gyro_scale,
        encoder_u_deg,
        parameters.navigator_level_deg if parameters.device == NAVIGATOR else 0.0,
        parameters.gyro_misalignment_deg,
    )


def turn_of(folder: RunFolder, turn: TableTurn, parameters: MotionParameters) -> Turn:
    """Return a turn: what the gyros gain beyond their outputs at rest, whole intervals counted."""
    output = sensed(folder, turn.unit, parameters)
    rates, arrived_s = output.rate_deg_per_s, output.arrived_s
    marks_s = np.array(folder.finished_units()[turn.unit]["marks_s"])
    rests = [
        (arrived_s > marks_s[k] + ON_THE_WAY_S) & (arrived_s < marks_s[k + 1]) for k in (0, 2, 4)
    ]
    forces = [mean_of(output.force_g[rest]).force_g for rest in rests]
    at_rest = np.array([mean_of(rates[rest]).force_g for rest in rests])
    gained, u = [], 0.0
    for k in (0, 1):
        moving = (arrived_s >= marks_s[2 * k + 1]) & (arrived_s < marks_s[2 * k + 2] + ON_THE_WAY_S)
        bias = (at_rest[k] + at_rest[k + 1]) / 2.0
        gained.append(output.steps[moving] @ (rates[moving] - bias) / parameters.sample_rate_Hz)
        noise = np.std(rates[rests[k]], axis=0, ddof=1).max()
        count = float(moving.sum())
        share = count / min(int(rests[k].sum()), int(rests[k + 1].sum()))
        u = max(u, float(noise) * math.sqrt(count * (1.0 + share)) / parameters.sample_rate_Hz)
    table = folder.rows(TURNTABLE, turn.unit)
    moving = table["at_rate"] == AT_RATE
    angles_deg = table["angle_deg"][table["at_rate"] != AT_RATE]
    ratios = table["rate_deg_per_s"][moving] / table["commanded_deg_per_s"][moving]
    return Turn(np.diff(angles_deg), np.array(gained), u, np.array(forces), ratios)


def mean_of(values: Array) -> Level:
    """Return the mean of outputs at rest (n, 3); ValueError of fewer than two, or no numbers."""
    if len(values) < 2 or not np.isfinite(values).all():
        raise ValueError("a mean at rest needs two outputs that are numbers")
    return Level(values.mean(axis=0), np.std(values, axis=0, ddof=1) / math.sqrt(len(values)))
