"""What a run commands and records, and what it says beforehand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from station.method.commands import GyroSampling, Power
from station.method.work import Rows, Work
from station.procedure import RecordUse

from .parameters import StaticParameters, unit_of

if TYPE_CHECKING:
    from station.instruments.bench import Bench

GYRO, POWER = "gyro_acquisition", "dut_power"
MAIN, AGAIN, OFF = "3", "4", "5"
LATE_S = 2.0
"""A record lasts so much longer than its samples, which come late."""


def instruments(parameters: StaticParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs."""
    return (GYRO, POWER)


def sampling(parameters: StaticParameters) -> GyroSampling:
    """Return how the gyro is read out."""
    return GyroSampling(GYRO, parameters.sample_interval_s, parameters.channel)


def work(parameters: StaticParameters) -> Iterator[Work]:
    """Yield each switch-on with its record, and the end."""
    for number, record_s in enumerate(parameters.lengths_s, 1):
        before_s = parameters.warm_up_s + (parameters.cool_s if number > 1 else 0.0)
        powered: tuple[Power, ...] = (Power(POWER, True),)
        if number > 1:
            powered = (Power(POWER, False), *powered)
        yield Work(
            MAIN if number == 1 else AGAIN,
            unit_of(number),
            (*powered, sampling(parameters)),
            (Rows(GYRO, record_s, record_s / parameters.sample_interval_s),),
            before_s + record_s + LATE_S,
        )
    yield Work(OFF, commands=(Power(POWER, False),))


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
