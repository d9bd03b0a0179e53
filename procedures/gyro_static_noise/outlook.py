"""What a plan determines, and how well, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from station.procedure import RecordUse

from .parameters import StaticParameters
from .steps import GYRO

if TYPE_CHECKING:
    from station.instruments.bench import Bench


def records(parameters: StaticParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records."""
    return (RecordUse(GYRO, "scale", 1.0, "1"),)


def outlook(parameters: StaticParameters) -> Sequence[str]:
    """Return how well a plan determines what, before anything moves.

    u of N is that of a white record; flicker and walk are seen by the record's longest periods.
    """
    samples = parameters.record_s / parameters.sample_interval_s
    share = 100.0 / math.sqrt(2.0 * samples)
    longest_s = parameters.record_s / 9.0
    white = 0.38 * parameters.pulse_weight_arcsec
    lines = [
        f"angle random walk to {share:.2g} % at best, while it is more than what {white:.2g} "
        "arcsec of rounding leave",
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
