"""Gyros that are switched on, warmed up and recorded, again and again: steps and thresholds."""

from __future__ import annotations

from typing import Annotated, Protocol

from pydantic import Field

from procedures.common.gyro_source import IMU, start_samples
from station.fields import StrictModel
from station.findings import FlagThresholds
from station.method.commands import Power
from station.method.run import Run
from station.roles.base import Driver

POWER = "dut_power"


class Thresholds(StrictModel):
    """Where a flag is raised; the defaults are those of the result format."""

    not_significant: Annotated[float, Field(gt=0)] = FlagThresholds.not_significant
    gap: Annotated[float, Field(gt=1)] = FlagThresholds.gap
    outlier: Annotated[float, Field(gt=1)] = FlagThresholds.outlier
    drift_removed: Annotated[float, Field(gt=0)] = 3.0


class SwitchOns(Protocol):
    """What a plan says of each switch-on."""

    warm_up_s: float
    cool_s: float


def unit_of(number: int) -> str:
    """Return the name of a switch-on's unit of work, counted from 1."""
    return f"switch-on {number}"


def cool(run: Run, number: int) -> None:
    """Switch the gyro off and let it cool, before every switch-on but the first."""
    parameters: SwitchOns = run.parameters
    if number > 1:
        run.apply(Power(POWER, False))
        run.wait(parameters.cool_s, f"{unit_of(number)}: the gyro cools, switched off")


def warm_up(run: Run, number: int) -> float:
    """Switch the gyro on, let it warm up, start its samples; return when it was switched on."""
    parameters: SwitchOns = run.parameters
    run.apply(Power(POWER, True))
    on_s = run.now_s
    run.wait(parameters.warm_up_s, f"{unit_of(number)}: the gyro warms up")
    start_samples(run)
    return on_s


def switch_off(run: Run) -> None:
    """Switch the gyro off, when all is recorded; before that put back what a sensor keeps."""

    def put_back() -> None:
        sensor = run.instruments.get(IMU)
        if isinstance(sensor, Driver):
            sensor.kept.put_back()

    run.read(put_back)  # switched off it takes none
    run.apply(Power(POWER, False))
