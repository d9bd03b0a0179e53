"""What the gyro's part commands and records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from station.method.commands import GyroSampling, Power
from station.method.work import Rows, Work, on_the_way
from station.procedure import RecordUse

from .parameters import CHANNELS, CHANNELS_UNIT, REST_UNIT, GyroParameters

if TYPE_CHECKING:
    from station.instruments.bench import Bench

GYRO = "gyro_acquisition"
POWER = "dut_power"
SCALE = (GYRO, "scale", 1.0, "1")
"""What the calibration record states of the pulse weight."""
LOOK_S = 2.0


def instruments(parameters: GyroParameters) -> tuple[str, ...]:
    """Return the bench instances that are commissioned."""
    return (GYRO, POWER)


def sampling(parameters: GyroParameters, channel: int) -> GyroSampling:
    """Return the command that samples a channel."""
    return GyroSampling(GYRO, parameters.sample_interval_s, channel)


def work(parameters: GyroParameters) -> Iterator[Work]:
    """Yield the look at each channel, then the record at rest."""
    looks = tuple(sampling(parameters, channel) for channel in CHANNELS)
    yield Work(
        "G1",
        CHANNELS_UNIT,
        (Power(POWER, True), *looks),
        (),
        decided=on_the_way(LOOK_S * len(CHANNELS)),
    )
    yield Work("G2", None, (), (), parameters.warm_up_s)
    rows = Rows(GYRO, parameters.record_s, parameters.record_s / parameters.sample_interval_s)
    yield Work("G2", REST_UNIT, (), (rows,), parameters.record_s)
    yield Work("G2", None, (Power(POWER, False),))


def records(parameters: GyroParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the pulse weight's uncertainty."""
    return (RecordUse(*SCALE, needed=False),)
