"""The scale factor of a rate gyro by whole turns on a rate table.

Numbered as the station does it: mount, switch on, stand, turn, stand, off; again after each
switch-on. The terms are those of IEEE Std 952 and 647; no clause of a standard is quoted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from procedures.common.constants import FULL_TURN_DEG
from procedures.common.gyro_source import IMU, check_source, records_of_source
from station.procedure import LazyImport, Problem, Procedure, RecordUse, ResultKind
from station.roles.turntable import unnamed_axes

from .parameters import UNITS, RateTableParameters
from .steps import STEPS, TURNTABLE

if TYPE_CHECKING:
    from station.instruments.bench import Bench


AXES = ("IA", "X", "Y", "Z")


def records(parameters: RateTableParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records."""
    table = RecordUse(TURNTABLE, "angle", FULL_TURN_DEG, "deg")
    return (*records_of_source(parameters), table)


def check(parameters: RateTableParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the bench does not say of a table that levels its plate itself, what the source
    does not output, and rates beyond its range: the bench file's `rate` limit of the imu.
    """
    yield from check_source(parameters, bench)
    sensor = bench.instruments.get(IMU)
    largest = sensor.limits.get("rate") if sensor and parameters.source == IMU else None
    for rate in parameters.rates_deg_per_s:
        if largest is not None and rate >= largest:
            what = f"{rate:g} deg/s is not below the gyro's range on this bench, {largest:g} deg/s"
            yield Problem(("parameters", "rates"), what)
    table = bench.instruments.get(TURNTABLE)
    if table is not None and parameters.levelled_by == "table":
        for what in unnamed_axes(TURNTABLE, table.settings):
            yield Problem(("parameters", "levelled_by"), f"{what}, or take levelled_by: person")


def outlook(parameters: RateTableParameters) -> Sequence[str]:
    """Return how well a plan determines what in white noise, before anything moves."""
    scale, asymmetry, slowest = expected(parameters)
    lean = 1e6 * (1.0 - math.cos(math.radians(parameters.alignment_arcmin / 60.0)))
    lines = [
        f"scale factor: u = {scale:.2g} ppm by the gyro's noise, {lean:.2g} ppm by how its input "
        "axis lies along the table's",
        f"asymmetry: u = {asymmetry:.2g} ppm; a nonlinearity is noise below {slowest:.2g} ppm",
    ]
    if parameters.switch_ons > 1:
        relative = 100.0 / math.sqrt(2.0 * (parameters.switch_ons - 1))
        lines.append(
            f"repeatability of {parameters.switch_ons} switch-ons; of any other set within "
            f"{relative:.2g} %"
        )
    return lines


def undetermined(parameters: RateTableParameters) -> Mapping[str, str]:
    """Return what one switch-on alone does not determine."""
    if parameters.switch_ons > 1:
        return {}
    what = "One switch-on shows no repeatability of the scale factor; set `switch_ons`."
    return {"scale_factor_repeatability": what}


def expected(parameters: RateTableParameters) -> tuple[float, float, float]:
    """Return u in ppm of scale factor, asymmetry and the K of the slowest rate, in white noise."""
    rates = sorted(parameters.rates_deg_per_s)
    white = parameters.angle_random_walk_deg_per_sqrt_h / 60.0
    # The variance of the mean of both senses, in (deg/s)^2.
    noise = [
        white**2 / parameters.record_s_at(rate) / (2.0 * parameters.switch_ons) for rate in rates
    ]
    squares = sum(rate**2 for rate in rates)
    pairs = list(zip(rates, noise, strict=True))
    scale = math.sqrt(sum(rate**2 * own for rate, own in pairs)) / squares
    weight = sum(1.0 / own for own in noise)
    middle = sum(rate / own for rate, own in pairs) / weight
    asymmetry = 2.0 / math.sqrt(sum((rate - middle) ** 2 / own for rate, own in pairs))
    return 1e6 * scale, 1e6 * asymmetry, 1e6 * math.sqrt(noise[0]) / rates[0]


PROCEDURE = Procedure(
    name="gyro-rate-table",
    title="Rate table: scale factor, nonlinearity, asymmetry of a gyro",
    source="Scale factor of a rate gyro on a rate table (terms of IEEE Std 952 and 647; no clause "
    "is quoted)",
    parameters=RateTableParameters,
    results={name: ResultKind(AXES, unit) for name, unit in UNITS.items()},
    steps=STEPS,
    records=records,
    check=check,
    evaluate_run=LazyImport(f"{__name__}.evaluate:findings_of_run"),
    evaluate_dataset=LazyImport(f"{__name__}.evaluate:findings_of_dataset"),
    conditions=LazyImport(f"{__name__}.dataset:Conditions").get,
    report=LazyImport(f"{__name__}.figures:draw_parts"),
    outlook=outlook,
    measured_axes=lambda parameters: dict.fromkeys(UNITS, parameters.axes),
    undetermined=undetermined,
    assumptions=(
        "K is the slope of the unweighted line through the noise-free response at the recorded "
        "rates; a mean over the rates is another number where the response is no line.",
        "K is that along the table's axis: an input axis that leans by 10 arcmin reads 4.2 ppm "
        "less.",
        "The repeatability is that of the switch-ons measured; another set scatters about it.",
        "K is steady within a switch-on unless a flag says that it drifts: rates that follow one "
        "another make a curve of a drift, and a small one is taken for it.",
        "Threshold and resolution are not measured.",
    ),
)
