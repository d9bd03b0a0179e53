"""G1, G2: the channel of a laser gyro, and its pulse weight by the earth's rate at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from procedures.common.constants import along_earths_axis
from station.errors import InstrumentError
from station.fields import StrictModel, Unit
from station.findings import Analysis, Flag, InputQuantity
from station.method.commands import GyroSampling, Power
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.verbs import Recording
from station.procedure import Prompt, RecordUse, Step
from station.roles import GyroAcquisition

from .clocks import CLOCK_DRIFT_PPM, CLOCK_PPM, clock_estimate, clock_flags
from .part import COVERAGE, Figure, Part, ask_at_rest, combined_u

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

PULSE_WEIGHT = 0.005
"""Relative. Half of 1 %; a bias of 0.01 deg/h and an input axis within 0.05 deg leave 0.26 %
(k = 2) at 40 deg of latitude, and from one mounting to the next 0.4 %."""
MIN_SHARE = 0.1
"""Of the earth's rate: a gyro that counts less of it counts nothing."""
CHANNEL = Figure("gyro_channel_offset", limit=0.0)
REST_RATE = Figure("rest_rate", "deg/h")
WEIGHT = Figure("pulse_weight_ratio", limit=PULSE_WEIGHT, nominal=1.0, drift=PULSE_WEIGHT)
CLOCK = Figure("board_clock_error", "ppm", limit=CLOCK_PPM, drift=CLOCK_DRIFT_PPM)
EARTH_DEG_PER_H = 15.041067
"""The sidereal rate, IERS Conventions (2010)."""
BLOCKS = 10
SEEN = "the channel on which the board sees a lit gyro, less the plan's"
AT_REST = "pulses over time at rest"
BY_EARTH = "the earth's rate along the input axis over the rate at rest"
BIAS, DIRECTION, OF_SCALE = "gyro_bias_deg_per_h", "input_axis_deg", "gyro_scale"
WEIGHT_STEP = "G2"
CHANNELS = (1, 2, 3)
CHANNELS_UNIT = "gyro channels"
REST_UNIT = "gyro at rest"


class EarthRate(StrictModel):
    """What of the earth's rate the gyro feels at rest, and how well that is known.

    Elevation counts up from the level, azimuth from north over east; uncertainties are standard.
    """

    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    elevation_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    azimuth_deg: Annotated[float, Unit("deg"), Field(ge=-360, le=360)] = 0.0
    direction_deg: Annotated[float, Unit("deg"), Field(gt=0, le=10)] = 0.05
    bias_deg_per_h: Annotated[float, Unit("deg/h"), Field(gt=0, le=10)] = 0.01

    @property
    def _along(self) -> float:
        """The cosine of the angle between the input axis and the earth's axis."""
        angles_deg = (self.latitude_deg, self.azimuth_deg, self.elevation_deg)
        return along_earths_axis(*map(math.radians, angles_deg))

    @property
    def rate_deg_per_h(self) -> float:
        """What the gyro should feel."""
        return EARTH_DEG_PER_H * self._along

    @property
    def per_deg(self) -> float:
        """What a small turn of the axis changes that at most, in deg/h/deg: the part across."""
        return math.radians(EARTH_DEG_PER_H * math.sqrt(max(1.0 - self._along**2, 0.0)))


class GyroParameters(StrictModel):
    """What the engineer chooses. Without `earth`, a key of the plan's own, no pulse weight."""

    channel: Annotated[int, Field(ge=1, le=3)] = 1
    pulse_weight_arcsec: Annotated[float, Unit("arcsec"), Field(gt=0)] = 0.0625
    sample_interval_s: Annotated[float, Unit("s"), Field(ge=0.01, le=10)] = 1.0
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0, le=86400)] = 3600.0
    record_s: Annotated[float, Unit("s"), Field(ge=20, le=86400)] = 600.0
    earth: ClassVar[EarthRate | None] = None


GYRO = "gyro_acquisition"
POWER = "dut_power"
SCALE = (GYRO, "scale", 1.0, "1")
"""What the calibration record states of the pulse weight."""
LOOK_S = 2.0
LIT = "lit"
MOUNT = Prompt(
    "mount",
    "Fix the laser gyro where it shall be measured, its input axis as the plan's `earth` states, "
    "and connect it to its supply and to the pulse board.",
)


def channels(run: Run) -> None:
    """G1: on which channels the board sees a lit gyro.

    Raises InstrumentError where it sees none.
    """
    for unit in run.unfinished([CHANNELS_UNIT], pauses=False):
        switch_on(run)
        board, parameters = run.role(GYRO, GyroAcquisition), run.parameters.gyro
        # A board refuses a channel on which it sees no lit gyro; a broken line refuses all of them.
        lit: list[int] = []
        refused: InstrumentError | None = None
        with run.unit(unit) as facts:
            for channel in CHANNELS:
                try:
                    run.apply(sampling(parameters, channel), takes=on_the_way(LOOK_S))
                except InstrumentError as error:
                    refused = error
                else:
                    lit.append(channel)
                board.stop()
            if not lit and refused is not None:
                raise refused
            facts[LIT] = lit


def rest(run: Run) -> None:
    """G2: the gyro's pulses at rest, on the plan's channel or that on which it is."""
    parameters: GyroParameters = run.parameters.gyro
    for unit in run.unfinished([REST_UNIT], pauses=False):
        switch_on(run)
        run.wait(parameters.warm_up_s, "the gyro warms up")
        channel = run.read(partial(lit_channel, run), assumed=parameters.channel)
        with run.unit(unit, channel=channel):
            run.apply(sampling(parameters, channel))
            pulses = Recording(run, unit, {GYRO: 1.0 / parameters.sample_interval_s})
            pulses.follow(parameters.record_s, unit)
            run.role(GYRO, GyroAcquisition).stop()
            run.read(pulses.take)
        run.apply(Power(POWER, False))


def sampling(parameters: GyroParameters, channel: int) -> GyroSampling:
    """Return the command that samples a channel."""
    return GyroSampling(GYRO, parameters.sample_interval_s, channel)


def lit_channel(run: Run) -> int:
    """Return the plan's channel where the gyro is on it, or the first on which it is."""
    lit: list[int] = run.read_back().finished_units()[CHANNELS_UNIT][LIT]
    wanted: int = run.parameters.gyro.channel
    return wanted if wanted in lit else lit[0]


@dataclass
class GyroState:
    """What this process of a run has done: whether the gyro is on."""

    is_on: bool = False


def switch_on(run: Run) -> None:
    """Have the gyro fixed and switched on, once in a process."""
    state = run.state(GyroState)
    if not state.is_on:
        ask_at_rest(run, MOUNT)
        run.apply(Power(POWER, True))
        state.is_on = True


@dataclass(frozen=True)
class GyroDataset:
    """Pulses at rest: `counts` (n,) at `time_s` (n,) by the board's clock; lit channels.

    `arrival_s` (n,) is when they came, in run time. `earth` is None where the plan does not state
    the input axis.
    """

    time_s: Array
    arrival_s: Array
    counts: Array
    pulse_arcsec: float
    channel: int
    lit: tuple[int, ...]
    earth: EarthRate | None = None


def dataset(folder: RunFolder, parameters: GyroParameters, bench: Bench) -> GyroDataset:
    """Return the pulses of a run at rest."""
    from procedures.estimation.alignment import unwrapped

    rows = folder.rows(GYRO, REST_UNIT)
    return GyroDataset(
        unwrapped(rows["sequence"]) * parameters.sample_interval_s,
        rows["arrival_time_s"],
        rows["counts"].astype(float),
        parameters.pulse_weight_arcsec * bench.corrected(*SCALE),
        parameters.channel,
        tuple(folder.finished_units()[CHANNELS_UNIT][LIT]),
        parameters.earth,
    )


def inputs(parameters: GyroParameters, bench: Bench) -> list[InputQuantity]:
    """Return the type B inputs: the pulse weight's, and what the plan states of the gyro."""
    stated = list(bench.stated_input(SCALE, OF_SCALE, "pulse weight of the gyro acquisition"))
    if (earth := parameters.earth) is None:
        return stated
    by_plan = (
        (BIAS, "bias of the gyro", earth.bias_deg_per_h, "deg/h"),
        (DIRECTION, "direction of the input axis", earth.direction_deg, "deg"),
    )
    return stated + [InputQuantity(*quantity, "the plan") for quantity in by_plan]


def analyse(data: GyroDataset, inputs: Sequence[InputQuantity]) -> Analysis:
    """Return rate at rest, pulse weight, clock, and causes; ValueError for too few samples."""
    rate, u = rate_of(data)
    channel = data.channel if data.channel in data.lit else data.lit[0]
    estimates = [
        CHANNEL.measured(float(channel - data.channel), 0.0, SEEN),
        REST_RATE.measured(rate, u, AT_REST, freedom=BLOCKS - 1.0),
    ]
    flags = [*_channel(data)]
    if data.earth is None:
        estimates.append(WEIGHT.undetermined(AT_REST))
    elif abs(rate) < MIN_SHARE * abs(data.earth.rate_deg_per_h):
        message = (
            f"At rest the gyro counts {rate:.3g} deg/h; it should feel "
            f"{data.earth.rate_deg_per_h:.3g} deg/h of the earth's rate: it gives no pulses, or "
            "its input axis stands otherwise."
        )
        estimates.append(WEIGHT.undetermined(AT_REST))
        flags.append(Flag("gyro-without-pulses", message))
    else:
        ratio = data.earth.rate_deg_per_h / rate
        by = {BIAS: 1.0 / rate, DIRECTION: data.earth.per_deg / rate, OF_SCALE: ratio}
        ratio_u, freedom = abs(ratio * u / rate), BLOCKS - 1.0
        weight = WEIGHT.measured(ratio, ratio_u, BY_EARTH, freedom=freedom, by=by)
        estimates.append(weight)
        flags += _weight(ratio, combined_u(weight, inputs), data)
    clock = clock_estimate(CLOCK, data.time_s, data.arrival_s)
    return Analysis([*estimates, clock], (), [*flags, *clock_flags(clock, GYRO)])


def rate_of(data: GyroDataset) -> tuple[float, float]:
    """Return the mean rate in deg/h (arcsec/s) and its standard uncertainty, from ten blocks."""
    import numpy as np

    if len(data.counts) <= BLOCKS:
        raise ValueError("the record at rest has too few samples")
    angle_arcsec = data.counts * data.pulse_arcsec
    edges = np.linspace(0, len(angle_arcsec) - 1, BLOCKS + 1).astype(int)
    blocks = np.diff(angle_arcsec[edges]) / np.diff(data.time_s[edges])
    whole = (angle_arcsec[-1] - angle_arcsec[0]) / (data.time_s[-1] - data.time_s[0])
    return float(whole), float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS)


def _channel(data: GyroDataset) -> Iterator[Flag]:
    if data.channel not in data.lit:
        channels = " and ".join(map(str, data.lit))
        message = (
            f"The pulse board sees the gyro on channel {channels}, the plan states {data.channel}: "
            "exchange the cables, or state that channel in the plans."
        )
        yield Flag("gyro-on-other-channel", message, details={"channels": list(data.lit)})


def _weight(ratio: float, u: float, data: GyroDataset) -> Iterator[Flag]:
    if ratio < 0.0:
        message = (
            "The gyro counts the earth's rate reversed: the sign of its pulses, or an input axis "
            "that points the other way."
        )
        yield Flag("gyro-sense-reversed", message)
    elif WEIGHT.is_off(ratio, u):
        message = (
            f"The pulse weight is off by {100.0 * (ratio - 1.0):+.2g} %: by the earth's rate it is "
            f"{ratio * data.pulse_arcsec:.4g} arcsec. Compare pulse_weight with the gyro's papers."
        )
        yield Flag("pulse-weight-off", message)
    elif COVERAGE * u > PULSE_WEIGHT:
        message = (
            f"At rest the pulse weight is known to {100.0 * COVERAGE * u:.2g} % only, which does "
            "not decide 1 %: state bias and direction of the input axis better, or turn the gyro "
            "on a table."
        )
        yield Flag("pulse-weight-undecided", message)


def not_tried(parameters: GyroParameters) -> Mapping[str, str]:
    """Return why the pulse weight is not reported."""
    if parameters.earth is not None:
        return {}
    why = "the pulse weight was not compared with the earth's rate: state what the gyro feels of it"
    return {WEIGHT_STEP: f"{why} in parameters.earth"}


PART = Part(
    name="gyro",
    steps=(
        Step("G1", "Laser gyro: its channel on the pulse board", channels),
        Step(WEIGHT_STEP, "Laser gyro: pulse weight by the earth's rate at rest", rest),
    ),
    figures=(CHANNEL, REST_RATE, WEIGHT, CLOCK),
    needs=(GYRO, POWER),
    units=lambda parameters: (CHANNELS_UNIT, REST_UNIT),
    dataset=dataset,
    inputs=inputs,
    analyse=analyse,
    records=lambda parameters, bench: (RecordUse(*SCALE, needed=False),),
    not_tried=not_tried,
    site="earth",
    # A warm-up of 0.12 deg/h and 12 min leaves as much after that as the bias is known to.
    short=("parameters.gyro.warm_up=30 min", "parameters.gyro.record=5 min"),
)
