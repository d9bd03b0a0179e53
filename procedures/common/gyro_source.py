"""Which instrument gives a gyro's output: a pulse board, a navigator or a nine-axis sensor.

A pulse board counts the angle of one gyro. A nine-axis sensor gives the rates of three. A
navigator gives its attitude, whose heading drifts by what its upright gyro gets wrong: it takes the
earth's rate out itself and levels by its accelerometers, so that its other gyros show nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal, Protocol

from pydantic import Field, ValidationInfo, field_validator

from procedures.common.constants import EARTH_RATE_DEG_PER_H, along_earths_axis
from station import registry
from station.errors import ConditionNotReached
from station.fields import InputAxis, StrictModel, Unit
from station.method.commands import GyroSampling
from station.method.duration import Duration
from station.method.set_points import Bounded
from station.procedure import Problem, Prompt, RecordUse
from station.roles import GyroAcquisition, Imu, Navigator

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.method.run import Run

Source = Literal["gyro_acquisition", "navigator", "imu"]
Axis = Literal["IA", "X", "Y", "Z"]
GYRO: Source = "gyro_acquisition"
NAVIGATOR: Source = "navigator"
IMU: Source = "imu"
CABLES: Mapping[str, Prompt] = {
    GYRO: Prompt("connect-cables", "Connect the gyro to its acquisition board and its supply."),
    NAVIGATOR: Prompt("connect-cables", "Connect the navigator's data line and its supply."),
    IMU: Prompt("connect-cables", "Connect the sensor's data line and its supply."),
}
FASTEST_S, SLOWEST_S = 0.1, 1.0
"""Between two outputs of a navigator."""
ALIGNMENT_S, MAX_ALIGNMENT_S, LOOK_S = 300.0, 1200.0, 5.0


class OfSource(StrictModel):
    """The instrument of a plan, and how its output is read."""

    source: Source = GYRO
    sample_interval_s: Annotated[float, Unit("s"), Field(gt=0)]
    pulse_weight_arcsec: Annotated[float, Unit("arcsec"), Field(gt=0)] | None = Field(
        default=None, validate_default=True
    )
    channel: Annotated[int, Field(ge=1, le=3)] = 1

    @field_validator("sample_interval_s")
    @classmethod
    def outputs_so_often(cls, value: float, info: ValidationInfo) -> float:
        """Refuse what no navigator outputs."""
        if info.data.get("source") == NAVIGATOR and not FASTEST_S <= value <= SLOWEST_S:
            raise ValueError(f"a navigator outputs every {FASTEST_S:g} s to {SLOWEST_S:g} s")
        return value

    @field_validator("pulse_weight_arcsec")
    @classmethod
    def weight_of_steps(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Require it where the output is an angle in steps, and nowhere else."""
        source = info.data.get("source")
        if source == GYRO and value is None:
            raise ValueError("pulses need pulse_weight, such as 0.4 arcsec")
        if source == NAVIGATOR and value is None:
            raise ValueError("a navigator needs the step of its angles, such as 0.36 arcsec")
        if source == IMU and value is not None:
            raise ValueError("the sensor outputs rates: leave pulse_weight out")
        return value


def need_axes(source: Source | None, axes: Sequence[Axis]) -> None:
    """Raise ValueError for axes that a source does not have."""
    if source == GYRO and list(axes) != ["IA"]:
        raise ValueError("the pulse board counts one gyro: give IA alone")
    if source != GYRO and "IA" in axes:
        raise ValueError("give the axes X, Y, Z instead of IA")


def axes_of_source(value: dict[Axis, InputAxis], info: ValidationInfo) -> dict[Axis, InputAxis]:
    """Refuse input axes that the plan's source does not measure at rest."""
    source = info.data.get("source")
    need_axes(source, list(value))
    if source == NAVIGATOR and any(abs(axis.elevation_deg) != 90.0 for axis in value.values()):
        raise ValueError(
            "a navigator shows the gyro along the vertical alone: it is mounted for each axis in "
            "turn; give each an elevation of 90 deg or -90 deg"
        )
    return value


class Sampling(Protocol):
    """What a plan says of the source; a navigator needs the latitude."""

    @property
    def source(self) -> Source:
        """The instrument's role."""

    @property
    def sample_interval_s(self) -> float:
        """Time between two outputs."""

    @property
    def channel(self) -> int:
        """Of the pulse board."""

    @property
    def latitude_deg(self) -> float:
        """Of the place."""


def check_source(parameters: Sampling, bench: Bench) -> Iterator[Problem]:
    """Yield the sample interval that the sensor of a bench does not have."""
    sensor = bench.instruments.get(IMU)
    if parameters.source != IMU or sensor is None:
        return
    driver = registry.load(registry.DRIVERS, sensor.driver)
    refusal = getattr(driver, "rates_said", lambda rate_Hz: "")(rate_Hz(parameters))
    if refusal:
        yield Problem(("parameters", "sample_interval"), refusal)


def records_of_source(parameters: Sampling) -> tuple[RecordUse, ...]:
    """Return what an analysis takes of the source's calibration record."""
    return (RecordUse(GYRO, "scale", 1.0, "1"),) if parameters.source == GYRO else ()


def earth_arcsec_per_s(latitude_deg: float, axis: InputAxis) -> float:
    """Return the part of the earth's rate along an axis."""
    angles = map(math.radians, (latitude_deg, axis.azimuth_deg, axis.elevation_deg))
    return EARTH_RATE_DEG_PER_H * along_earths_axis(*angles)  # 1 deg/h is 1 arcsec/s


def rate_Hz(parameters: Sampling) -> float:
    """Return how many samples come in a second."""
    return round(1.0 / parameters.sample_interval_s, 6)


def start_samples(run: Run) -> None:
    """Let the source begin; a navigator finds its attitude first."""
    parameters: Sampling = run.parameters
    if parameters.source == GYRO:
        run.apply(GyroSampling(GYRO, parameters.sample_interval_s, parameters.channel))
        return
    run.declare(Bounded(parameters.source, f"outputs at {rate_Hz(parameters):g} Hz"))
    if parameters.source == IMU:
        run.role(IMU, Imu).start(rate_Hz(parameters))
        return
    align(run)
    run.role(NAVIGATOR, Navigator).start(rate_Hz(parameters))


def align(run: Run) -> None:
    """Let the navigator find its attitude at rest; raises ConditionNotReached if it does not."""
    parameters: Sampling = run.parameters
    navigator = run.role(NAVIGATOR, Navigator)
    navigator.align(parameters.latitude_deg)

    def wait() -> None:
        until_s = run.now_s + MAX_ALIGNMENT_S
        while not (status := navigator.status()).aligned:
            if run.now_s > until_s:
                faults = ", ".join(status.faults) or "none reported"
                raise ConditionNotReached(
                    f"{NAVIGATOR} was not aligned within {MAX_ALIGNMENT_S / 60:g} min "
                    f"(faults: {faults}); let it rest, and compare the plan's latitude with the "
                    "place"
                )
            run.clock.sleep(LOOK_S)
            run.say_progress("the navigator aligns")

    run.read(wait, takes=Duration(ALIGNMENT_S, LOOK_S, MAX_ALIGNMENT_S + LOOK_S))


def stop_samples(run: Run) -> None:
    """Let the source end its output."""
    source = run.parameters.source
    if source == GYRO:
        run.role(GYRO, GyroAcquisition).stop()
    elif source == IMU:
        run.role(IMU, Imu).stop()
    else:
        run.role(NAVIGATOR, Navigator).stop()
