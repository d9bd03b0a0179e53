"""Faults of records of a gyro's bias over temperature."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from bias_records import Gyro, record, truths

from campaigns.planted.judging import Array, Held, Row, Sample, but, example, refusals, row
from procedures.gyro_bias_temperature.analysis import TemperatureAnalysis, analyse
from procedures.gyro_bias_temperature.dataset import TemperatureDataset

USUAL_FLAGS: frozenset[str] = frozenset()


def made(gyro: Gyro, seed: int) -> Held:
    """Return a record of a gyro."""
    dataset = record(gyro, seed)

    def off_u(analysis: TemperatureAnalysis) -> float:
        true = truths(gyro, dataset)
        return max(
            (
                abs(one.value - true[one.name]) / one.standard_uncertainty
                for one in analysis.estimates
                if one.value is not None and one.standard_uncertainty
            ),
            default=0.0,
        )

    return Held(dataset, analyse, off_u)


def of(gyro: Gyro) -> Callable[[int], Held]:
    """Return the maker of records of a gyro."""
    return partial(made, gyro)


def times(factor: float) -> Callable[[TemperatureDataset, int], TemperatureDataset]:
    """Return the change of an output that is a multiple of what it should be."""
    return lambda one, _: replace(one, rate_deg_per_h=factor * one.rate_deg_per_h)


def rows_of(change: Callable[[Array], Array]) -> Callable[..., TemperatureDataset]:
    """Return the change of the output (n, 1)."""
    return lambda one, _: replace(one, rate_deg_per_h=change(one.rate_deg_per_h.copy()))


def stuck(at: float | None, rate: Array) -> Array:
    """Return an output that stands for 40 rows, at a value or where it was."""
    rate[300:340] = rate[300] if at is None else at
    return rate


def wave(rate: Array) -> Array:
    """Return an output with a sine of 0.1 deg/h and five rows."""
    return np.asarray(rate + 0.1 * np.sin(0.4 * np.pi * np.arange(len(rate)))[:, None])


CLEAN: Sequence[Callable[[int], Sample]] = (of(Gyro()),)
LONE_RAMP = Gyro(steps=((60, 0.2),), soak_h=0.05)
SPOILT = Gyro(spikes=(100, 700, 1100), lost=slice(400, 420))

# fmt: off
ROWS: Sequence[Row] = (
    row("one ramp, one way", of(LONE_RAMP), "not-identifiable", seeds=(1,), null="hysteresis"),
    row("a reference outside the record", of(Gyro(reference_degC=90.0)), "extrapolation",
        seeds=(1,), null="bias bias_temperature_sensitivity", known="largest_bias_slope"),
    row("no thermometer of its own", of(Gyro(thermometer=False)), "not-identifiable", seeds=(1,),
        null="chamber_lag"),
    row("a straight curve", of(Gyro(curve=(0.1, 0.1))), "lag-by-prior", seeds=(1,)),
    row("output in deg/s", but(of(Gyro()), times(1.0 / 3600.0)), "contradicts-statement",
        seeds=(4,), clean=of(Gyro())),
    row("output reversed", but(of(Gyro()), times(-1.0)), "contradicts-statement", seeds=(4,)),
    row("wild and lost rows", of(SPOILT), "outliers-rejected gap", seeds=(4,), below_u=4.0),
    row("no hysteresis", of(Gyro(hysteresis=0.0)), "not-significant", seeds=(3,), below_u=4.0),
    row("output at a limit for 40 rows", but(of(Gyro()), rows_of(partial(stuck, 400.0))),
        "overload", seeds=(4,), details={"count": 40}, below_u=4.0),
    row("output frozen for 40 rows", but(of(Gyro()), rows_of(partial(stuck, None))), "frozen",
        seeds=(4,), details={"count": 40}, below_u=4.0),
    row("output with a wave of 5 rows", but(of(Gyro()), rows_of(wave)), "model-too-stiff",
        seeds=(4,), others="", below_u=4.0),
    row("a record at one temperature", of(Gyro(steps=((23.5, 1.0),))), "not-identifiable",
        seeds=(1,), null="*"),
    *refusals(
        example("gyro-bias-temperature"),
        ("samples.csv", "60,soak,23,", "60,wait,23,", "no phase"),
        ("samples.csv", "120,soak,23,", "30,soak,23,", "t_s"),
        ("samples.csv", "set_point_degC,rate_deg_per_h", "set_point_degC,rate", "rate"),
    ),
)
# fmt: on
