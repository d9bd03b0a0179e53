"""A gyro at rest: its noise, its bias, and what switching it off and on does to the bias.

Numbered as the station does it: mount, warm up, a long record, short ones after each switch-on.
The coefficients are those of IEEE Std 952, annex C; no clause of a standard is quoted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from procedures.common.gyro_source import check_source, records_of_source
from station.procedure import LazyImport, Procedure, RecordUse, ResultKind

from .parameters import UNITS, StaticParameters
from .steps import STEPS

if TYPE_CHECKING:
    from station.instruments.bench import Bench


AXES = ("IA", "X", "Y", "Z")


def records(parameters: StaticParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records."""
    return records_of_source(parameters)


def outlook(parameters: StaticParameters) -> Sequence[str]:
    """Return how well a plan determines what, before anything moves.

    u of N is that of a white record; flicker and walk are seen by the record's longest periods.
    """
    samples = parameters.record_s / parameters.sample_interval_s
    share = 100.0 / math.sqrt(2.0 * samples)
    longest_s = parameters.record_s / 9.0
    walk = f"angle random walk to {share:.2g} % at best"
    if parameters.pulse_weight_arcsec is not None:
        white = 0.38 * parameters.pulse_weight_arcsec
        walk = (
            f"angle random walk to {share:.2g} % at best, while it is more than what {white:.2g} "
            "arcsec of rounding leave"
        )
    lines = [
        walk,
        f"Allan deviation to {longest_s:.4g} s within 42 %; rate random walk needs 12 h to 24 h",
    ]
    if parameters.repeats:
        relative = 100.0 / math.sqrt(2.0 * parameters.repeats)
        lines.append(
            f"bias repeatability of {parameters.repeats + 1} switch-ons; of any other set "
            f"within {relative:.2g} %"
        )
    return lines


def undetermined(parameters: StaticParameters) -> Mapping[str, str]:
    """Return what one switch-on alone does not determine."""
    if parameters.repeats:
        return {}
    return {"bias_repeatability": "One switch-on shows no repeatability; set `repeats`."}


PROCEDURE = Procedure(
    name="gyro-static-noise",
    title="Gyro at rest: noise coefficients, bias, repeatability",
    source="Allan variance of a gyro at rest (IEEE Std 952, annex C; no clause is quoted)",
    parameters=StaticParameters,
    results={name: ResultKind(AXES, unit) for name, unit in UNITS.items()},
    steps=STEPS,
    check=check_source,
    records=records,
    evaluate_run=LazyImport(f"{__name__}.evaluate:findings_of_run"),
    evaluate_dataset=LazyImport(f"{__name__}.evaluate:findings_of_dataset"),
    conditions=LazyImport(f"{__name__}.dataset:Conditions").get,
    report=LazyImport(f"{__name__}.figures:draw_parts"),
    outlook=outlook,
    measured_axes=lambda parameters: dict.fromkeys(UNITS, tuple(parameters.input_axis)),
    undetermined=undetermined,
    assumptions=(
        "The bias instability B is that of the density B^2/(2πf): the Allan deviation's floor "
        "is 0.664 B. The minimum of the curve, often quoted instead, is a result of its own.",
        "The noise is that of one temperature and attitude; the earth's rate is taken off the "
        "bias for the stated input axis.",
        "The repeatability is that of the switch-ons measured, short noise taken off; another set "
        "of switch-ons scatters about it.",
    ),
)
