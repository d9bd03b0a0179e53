"""From data to findings: the analysis, with the type B inputs that the bench file states."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.check import (
    FULL_TURN_DEG,
    GAUSSMETER,
    MULTIMETER,
    STAGE,
)
from procedures.accelerometer_magnetic_sensitivity.findings import AnalysisSettings
from procedures.accelerometer_magnetic_sensitivity.from_import import dataset_of_import
from procedures.accelerometer_magnetic_sensitivity.from_record import (
    dataset_of_run,
    overloaded_readings,
)
from procedures.accelerometer_magnetic_sensitivity.parameters import AccelerometerParameters
from station.findings import Findings, Flag, InputQuantity, findings_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


def findings_of_run(
    folder: RunFolder, parameters: AccelerometerParameters, bench: Bench
) -> Findings:
    """Return what a run's finished points say, type B inputs from the bench's calibrations."""
    dataset = dataset_of_run(folder, parameters, bench)
    analysis = analyse(dataset, settings(parameters))
    findings = findings_of(analysis, dataset, type_b_inputs(parameters, bench))
    finished = folder.finished_units()
    known = [point.unit for point in parameters.points if point.unit in finished]
    count = overloaded_readings(folder, known)
    if not count or any(flag.code == "overload" for flag in findings.flags):
        return findings
    message = (
        f"{count} readings of the voltmeter were overloads; they are left out, and their points "
        "were measured again on a higher range."
    )
    overload = Flag("overload", message, None, {"count": count})
    return replace(findings, flags=[*findings.flags, overload])


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; it brings no calibration records, so type A only."""
    dataset = dataset_of_import(raw)
    return findings_of(analyse(dataset), dataset, [])


def settings(parameters: AccelerometerParameters) -> AnalysisSettings:
    """Return the analysis settings of a plan."""
    return AnalysisSettings(**dict(parameters.thresholds), window=parameters.window)


def type_b_inputs(parameters: AccelerometerParameters, bench: Bench) -> list[InputQuantity]:
    """Return what the data cannot tell: gain and offset of gaussmeter and voltmeter."""
    field_mT = parameters.largest_field_mT
    largest_V = parameters.scale_factor_V_per_g
    return [
        *_gain_and_offset(bench, GAUSSMETER, "field", field_mT, "mT", "field", ("T", 1e-3)),
        *_gain_and_offset(bench, MULTIMETER, "voltage", largest_V, "V", "voltage", ("V", 1.0)),
        *_graduation(bench),
    ]


def _graduation(bench: Bench) -> Iterable[InputQuantity]:
    """Yield what is left of the stage's angle within a turn, where its certificate says it."""
    stated = bench.stated(STAGE, "graduation", FULL_TURN_DEG, "deg")
    if stated is None:
        return
    u_deg, source = stated
    for wave in ("sine", "cosine"):
        yield InputQuantity(
            f"graduation_{wave}_rad",
            f"graduation of {STAGE}, {wave} of the angle",
            math.radians(u_deg),
            "rad",
            source,
        )


def _gain_and_offset(
    bench: Bench,
    instrument: str,
    quantity: str,
    largest: float,
    unit: str,
    name: str,
    offset: tuple[str, float],
) -> Iterable[InputQuantity]:
    """Split a certificate's uncertainty into the part at zero and the part that grows."""
    stated = bench.stated(instrument, quantity, largest, unit)
    if stated is None:
        return
    at_largest, source = stated
    at_zero, _ = bench.stated(instrument, quantity, 0.0, unit) or (0.0, source)
    grown = math.sqrt(max(at_largest**2 - at_zero**2, 0.0))
    yield InputQuantity(
        f"{name}_gain",
        f"{instrument} at {largest:g} {unit}",
        grown / largest,
        "1",
        source,
    )
    offset_unit, factor = offset
    yield InputQuantity(
        f"{name}_offset_{offset_unit}",
        f"zero of {instrument}",
        at_zero * factor,
        offset_unit,
        source,
    )
