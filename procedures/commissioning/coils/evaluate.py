"""From the record of the coils to their findings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from procedures.commissioning.not_measured import not_measured
from station.findings import (
    Findings,
    InputQuantity,
    findings_of,
)
from station.units import parse_as

from .analysis import ANGLE, GAIN, ZERO, CoilDataset, CoilFields, Mean, analyse, mean_of
from .parameters import COILS, RESULTS, CoilParameters, ambient_unit
from .steps import GAUSSMETER, supply_of

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

MT_PER_T = 1e3
Array = NDArray[np.float64]


def findings(folder: RunFolder, parameters: CoilParameters, bench: Bench) -> Findings:
    """Return the figures of the coils; a run without all their records gives none."""
    if missing := [unit for unit in units_of(parameters) if unit not in folder.finished_units()]:
        return findings_of(not_measured("coils", RESULTS, missing), None, [])
    data = dataset_of_run(folder, parameters, bench)
    return findings_of(analyse(data), data, inputs(data, bench))


def units_of(parameters: CoilParameters) -> list[str]:
    """Return the records that the figures are computed from."""
    return [
        unit
        for along in parameters.directions
        for unit in (
            ambient_unit(along),
            *(record.unit for record in parameters.coil_records(along)),
        )
    ]


def dataset_of_run(folder: RunFolder, parameters: CoilParameters, bench: Bench) -> CoilDataset:
    """Return the means of all records; ValueError where a record has no readings."""

    def mean(units: Sequence[str]) -> Mean:
        seen = [field_of(folder, unit) for unit in units]
        if not parameters.turn_probe:
            return mean_of(seen[0])
        shortest = min(len(rows) for rows in seen)
        return mean_of(np.column_stack([rows[:shortest, k] for k, rows in enumerate(seen)]))

    def state(coil: str, name: str) -> list[str]:
        return [
            record.unit
            for along in parameters.directions
            for record in parameters.coil_records(along)
            if (record.coil, record.state) == (coil, name)
        ]

    def current_A(coil: str, column: str) -> float:
        """Return half the difference of both senses, which is free of the read-back's zero."""
        plus, minus = (
            np.mean([folder.rows(supply_of(coil), unit)[column].mean() for unit in state(coil, of)])
            for of in ("plus", "minus")
        )
        return float(plus - minus) / 2.0

    coils = tuple(
        CoilFields(
            mean(state(coil, "plus")),
            mean(state(coil, "minus")),
            mean(state(coil, "off")),
            current_A(coil, "current_A"),
            current_A(coil, "commanded_A"),
        )
        for coil in COILS
    )
    settings = [bench.instruments[supply_of(coil)].settings for coil in COILS]
    constants = [parse_as(str(coil["coil_constant"]), "mT/A") for coil in settings]
    gain_u, zero_u_mT, _ = _gaussmeter(bench, parameters.field_mT)
    ambient = mean([ambient_unit(along) for along in parameters.directions])
    known = parameters.ambient
    return CoilDataset(
        ambient,
        coils,
        np.array(constants),
        gain_u,
        zero_u_mT,
        _angle_u_rad(bench),
        None if known is None else np.array(known.field_mT),
        math.inf if known is None else known.standard_uncertainty_mT,
    )


def field_of(folder: RunFolder, unit: str) -> Array:
    """Return the valid readings of a record, shape (n, 3)."""
    rows = folder.rows(GAUSSMETER, unit)
    good = rows[rows["state"] == 0]
    return np.column_stack([good[f"{axis}_T"] for axis in COILS]) * MT_PER_T


def _gaussmeter(bench: Bench, field_mT: float) -> tuple[float, float, str]:
    """Return the standard uncertainties of gain (relative) and zero (mT), and their source."""
    stated = bench.stated(GAUSSMETER, "field", field_mT, "mT")
    if stated is None:
        return 0.0, 0.0, ""
    at_field, source = stated
    at_zero, _ = bench.stated(GAUSSMETER, "field", 0.0, "mT") or (0.0, source)
    # A record states a part at zero and, added to it, a part that grows with the field.
    return max(at_field - at_zero, 0.0) / field_mT, at_zero, source


def _angle_u_rad(bench: Bench) -> float:
    """Return the standard uncertainty of the probe's direction, 0 where no record states it."""
    stated = bench.stated(GAUSSMETER, "angle", 0.0, "deg")
    return 0.0 if stated is None else math.radians(stated[0])


def inputs(data: CoilDataset, bench: Bench) -> list[InputQuantity]:
    """Return gain and zero of the gaussmeter, where its calibration record states them."""
    source = _gaussmeter(bench, 1.0)[2]
    if not source:
        return []
    quantities = [
        InputQuantity(GAIN, "gain of the gaussmeter", data.gain_u, "1", source),
        InputQuantity(ZERO, "zero of the gaussmeter", data.zero_u_mT, "mT", source),
    ]
    if data.angle_u_rad:
        about = "direction of the probe"
        quantities.append(InputQuantity(ANGLE, about, data.angle_u_rad, "rad", source))
    return quantities
