"""Why a plan cannot run on a bench; nothing is energised to find out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.nine_axis_calibration.parameters import FULL_TURN_DEG, NineAxisParameters
from station import registry
from station.procedure import Problem, RecordUse

if TYPE_CHECKING:
    from station.instruments.bench import Bench

TURNTABLE = "turntable"
IMU = "imu"
POWER = "dut_power"
RATES = ("parameters", "rates")
RATE = "rate"
AXIS_SETTINGS = ("outer_axis", "middle_axis", "inner_axis")
"""Settings of the table in the bench file: which number the controller gives each axis."""


def instruments(parameters: NineAxisParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    return (TURNTABLE, IMU, POWER)


def records(parameters: NineAxisParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the table's angle."""
    return (RecordUse(TURNTABLE, "angle", FULL_TURN_DEG, "deg"),)


def check(parameters: NineAxisParameters, bench: Bench) -> Iterator[Problem]:
    """Yield each rate that the sensor cannot follow, and what the bench does not say of its table.

    A sensor's range is the bench file's `rate` limit of the imu.
    """
    table = bench.instruments.get(TURNTABLE)
    for key in AXIS_SETTINGS if table is not None and parameters.positioning == "table" else ():
        if table is not None and not isinstance(table.settings.get(key), int):
            yield Problem(
                ("parameters", "positioning"),
                f"the bench file does not say which axis of {TURNTABLE} is the {key[:-5]} one; "
                f"write instruments.{TURNTABLE}.settings.{key}, such as 1, or take positioning: "
                "plate",
            )
    sensor = bench.instruments.get(IMU)
    if sensor is None:
        return
    driver = registry.load(registry.DRIVERS, sensor.driver)
    if said := getattr(driver, "rates_said", lambda rate_Hz: "")(parameters.sample_rate_Hz):
        yield Problem(("parameters", "sample_rate"), said)
    range_deg_per_s = sensor.limits.get(RATE)
    if range_deg_per_s is None:
        return
    for rate in parameters.rates_deg_per_s:
        if rate >= range_deg_per_s:
            yield Problem(
                RATES,
                f"{rate:g} deg/s is not below the gyro's range on this bench, "
                f"{range_deg_per_s:g} deg/s",
            )
