"""What a run commands and records, and what it says beforehand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from station.method.commands import GyroSampling, Power
from station.method.motion import AxisAtRate, AxisTo
from station.method.work import NO_TIME, Duration, Rows, Work, on_the_way
from station.procedure import Problem, RecordUse
from station.roles.turntable import unnamed_axes

from .parameters import FULL_TURN_DEG, RateTableParameters, Turn, unit_of

if TYPE_CHECKING:
    from station.instruments.bench import Bench

GYRO, POWER, TURNTABLE = "gyro_acquisition", "dut_power", "turntable"
FIRST, AGAIN, OFF = "2", "6", "7"
RATES = ("parameters", "rates")
UP_SENSE = -1.0
"""Rates are positive counter-clockwise seen from above, the table's outer axis turns clockwise."""
USUAL_ACCELERATION_DEG_PER_S2 = 50.0
CLOSE_S = 10.0
REACHING_S, MORE_INTERVALS = 3.0, 3
"""Time until a rate or rest is reached beside the ramps; intervals recorded beyond whole turns."""
LATE_SAMPLES_S = 2.0
"""Samples of a record's last moments may still be on their way when it ends."""


def instruments(parameters: RateTableParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    return (TURNTABLE, GYRO, POWER)


def records(parameters: RateTableParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records."""
    return (
        RecordUse(GYRO, "scale", 1.0, "1"),
        RecordUse(TURNTABLE, "angle", FULL_TURN_DEG, "deg"),
    )


def sampling(parameters: RateTableParameters) -> GyroSampling:
    """Return how the gyro is read out."""
    return GyroSampling(GYRO, parameters.sample_interval_s, parameters.channel)


def to_level(parameters: RateTableParameters) -> tuple[AxisTo, ...]:
    """Return the moves that level the plate of a three-axis table; a person levels another."""
    if parameters.levelled_by != "table":
        return ()
    text = "middle and inner axis to 0 deg"
    return tuple(
        AxisTo(TURNTABLE, axis, text, angle_deg=0.0, decided_by=("parameters", "levelled_by"))
        for axis in ("middle", "inner")
    )


def check(parameters: RateTableParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the bench does not say of a table that levels its plate itself."""
    table = bench.instruments.get(TURNTABLE)
    if table is not None and parameters.levelled_by == "table":
        for what in unnamed_axes(TURNTABLE, table.settings):
            yield Problem(("parameters", "levelled_by"), f"{what}, or take levelled_by: person")


def spin(parameters: RateTableParameters, turn: Turn) -> AxisAtRate:
    """Return the command that lets the vertical axis turn for a record."""
    rate = UP_SENSE * turn.rate_deg_per_s
    return AxisAtRate(TURNTABLE, "outer", turn.words, parameters.table_axis, rate, decided_by=RATES)


def record_s(parameters: RateTableParameters, turn: Turn) -> float:
    """Return how long a record lasts: whole turns, and intervals to choose whole ones from."""
    return turn.record_s + MORE_INTERVALS * parameters.sample_interval_s


def moving_s(parameters: RateTableParameters, turn: Turn) -> Duration:
    """Return the bench time of a record beside its own: to the rate and back to rest.

    A record ends with the first reading of the angle after its time.
    """
    every_s = parameters.reading_interval_s
    late = Duration(every_s / 2.0, 0.0, every_s)
    if not turn.rate_deg_per_s:
        return late
    ramps_s = 2.0 * abs(turn.rate_deg_per_s) / USUAL_ACCELERATION_DEG_PER_S2
    return late + on_the_way(ramps_s + REACHING_S)


def work(parameters: RateTableParameters) -> Iterator[Work]:
    """Yield the table made level, each switch-on with its records, and the end."""
    yield Work(FIRST, None, to_level(parameters), (), decided=on_the_way(CLOSE_S))
    recorded_s = sum(record_s(parameters, turn) for turn in parameters.turns)
    recorded_s += parameters.settle_s * sum(turn.rate_deg_per_s != 0.0 for turn in parameters.turns)
    moving = sum((moving_s(parameters, turn) for turn in parameters.turns), NO_TIME)
    turning_s = recorded_s + moving.expected_s
    spins = tuple(spin(parameters, turn) for turn in parameters.turns if turn.rate_deg_per_s)
    for number in range(1, parameters.switch_ons + 1):
        before_s = parameters.warm_up_s + (parameters.cool_s if number > 1 else 0.0)
        powered: tuple[Power, ...] = (Power(POWER, True),)
        if number > 1:
            powered = (Power(POWER, False), *powered)
        rows = (
            Rows(GYRO, turning_s, turning_s / parameters.sample_interval_s),
            Rows(TURNTABLE, turning_s, turning_s / parameters.reading_interval_s),
        )
        yield Work(
            FIRST if number == 1 else AGAIN,
            unit_of(number),
            (*powered, sampling(parameters), *spins),
            rows,
            before_s + recorded_s + LATE_SAMPLES_S,
            decided=moving,
        )
    yield Work(OFF, commands=(Power(POWER, False),))


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
