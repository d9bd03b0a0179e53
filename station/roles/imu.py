"""A nine-axis inertial sensor under test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from station.roles.base import SampledSource
from station.roles.role import TEMPERATURE, Limit, Role


@dataclass(frozen=True)
class SensorStatus:
    """What a nine-axis sensor says of itself; `faults` are words, none when all is well."""

    faults: tuple[str, ...]


@runtime_checkable
class Imu(SampledSource, Protocol):
    """Three gyros, three accelerometers and three magnetometers that are read together.

    Columns, all along the sensor's own axes: `counter` (16 bits, one more with every output, from
    1 after a start), `gyro_x_deg_per_s` `…_y…` `…_z…` and `accelerometer_x_g` … (means over the
    output's interval, which ends at the output), `magnetometer_x_nT` … and `temperature_degC`
    (interleaved: NaN in an output that has none of them), `status` (bits 0, 1, 2: gyro x, y, z not
    valid, beyond its range or failed; bits 4, 5, 6: accelerometer x, y, z). An output that is lost
    on the line leaves a gap in `counter`.
    """

    @classmethod
    def rates_said(cls, rate_Hz: float) -> str:
        """Return in words which rates it has where this is none of them, else nothing."""
        ...

    def start(self, rate_Hz: float) -> None:
        """Begin to output with the counter from 1; what came before is forgotten.

        Raises InputError for a rate that the sensor does not have and names those that it has,
        InstrumentError when the sensor is switched off.
        """
        ...

    def stop(self) -> None:
        """End the output; what came before can still be drained."""
        ...

    def status(self) -> SensorStatus:
        """Ask what is wrong with it."""
        ...


IMU = Role(
    "imu",
    Imu,
    limits={"rate": Limit("deg/s", "largest rate")},
    quantities={"temperature": TEMPERATURE},
    start_samples=lambda source: source.start(rate_Hz=10.0),
    reads_device=True,
)
