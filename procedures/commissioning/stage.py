"""R1, R2: a rotary stage's sense, zero, whole turn and axis, by the accelerometer on it.

The output is K0 + K sin(angle + zero): outputs half a turn apart separate the zero from the bias.
With the input axis along the axis of rotation it is K0 + K sin(lean), whatever the angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from station import registry
from station.errors import InstrumentError
from station.fields import StrictModel, Unit
from station.findings import Analysis, Flag, InputQuantity
from station.method.commands import Angle, Homing, MeterRange, Power
from station.method.duration import exactly, on_the_way
from station.method.run import Run
from station.method.verbs import come_to_rest, fetch_bursts, keep, keep_row
from station.procedure import Problem, Prompt, RecordUse, Step
from station.roles import Multimeter, RotaryStage

from .part import Cause, Figure, Part, ask_at_rest

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

RESPONSE = Figure("stage_response", limit=0.1, nominal=1.0, drift=0.01)
"""Relative. Scale factors are stated nearer; a stage that counts in other units is far off. The
same accelerometer and voltmeter keep theirs ten times better than the drift."""
ZERO = Figure(
    "stage_zero",
    "deg",
    limit=0.025,
    drift=0.025,
    cause=Cause(
        "stage-zero-off",
        "At zero of the rotary stage's encoder the input axis is {value:+.2g} deg off the level: "
        "set the encoder's zero anew, or look at the device's mounting.",
    ),
)
"""Half of 0.05 deg, which an accelerometer feels as 0.9 mg; its mounting is known to 0.008 deg, and
differs from one to the next by 0.011 deg (k = 1): so does the lean."""
CLOSURE = Figure(
    "stage_closure",
    "deg",
    limit=0.01,
    drift=0.01,
    cause=Cause(
        "stage-turn-not-whole",
        "A whole turn of the rotary stage ends {value:+.2g} deg off where it began: its counts per "
        "turn, or a device that is not fixed.",
    ),
)
"""A whole turn comes back to the same level; noise and drift of a minute are a tenth of this."""
LEAN = Figure(
    "stage_lean",
    "deg",
    limit=0.05,
    drift=0.025,
    cause=Cause(
        "stage-axis-leans",
        "The axis of the rotary stage is {value:+.2g} deg out of the level: level the stage.",
    ),
)
"""Half of 0.1 deg, by which a level axis of rotation shows as a bias."""
FAR_DEG = 45.0
"""A zero that is off by more is a device mounted along another axis: nothing else is decided."""

STAGE, METER, POWER = "rotary_stage", "multimeter", "dut_power"
KEY = ("parameters", "stage")
QUARTERS_DEG, WHOLE_DEG = (0.0, 90.0, 180.0, 270.0), 360.0
ANGLE = (STAGE, "angle", WHOLE_DEG, "deg")
"""What the stage's calibration record states."""
LARGEST_G = 1.1
HOMING_S, TURN_S, MAINS_HZ = 15.0, 8.0, 50.0
AUTO_ZERO = 2.0
"""A reading with auto-zero takes twice its integration time."""
STAGE_COLUMNS = {"angle_deg": "deg, encoder", "commanded_deg": "deg, set-point"}
MOUNTS = {
    "io": Prompt(
        "mount-io",
        "Mount the accelerometer on the rotary stage with its pendulous axis (PA) along the "
        "stage's horizontal axis, its input axis (IA) level at 0 deg and rising with the angle. "
        "Connect it to its supply and to the voltmeter, with enough slack for a whole turn.",
    ),
    "op": Prompt(
        "mount-op",
        "Mount the accelerometer on the rotary stage with its input axis (IA) along the stage's "
        "horizontal axis.",
    ),
}


@dataclass(frozen=True)
class StageRecord:
    """A unit of work: the accelerometer's output at an angle, mounted for a plane."""

    plane: str
    angle_deg: float

    @property
    def unit(self) -> str:
        """The name of the unit of work."""
        return f"stage {self.plane} at {self.angle_deg:g} deg"


class StageParameters(StrictModel):
    """What the engineer chooses of the stage's checks."""

    scale_factor_V_per_g: Annotated[float, Unit("V/g"), Field(gt=0)] = 1.0
    mounting_deg: Annotated[float, Unit("deg"), Field(ge=0, le=1)] = 0.008
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0, le=7200)] = 300.0
    readings: Annotated[int, Field(ge=2, le=1000)] = 10
    nplc: Annotated[float, Field(ge=0.02, le=100)] = 10.0

    @property
    def records(self) -> tuple[StageRecord, ...]:
        """All records, in order: a whole turn in the plane io, then a reversal in op."""
        turn = [StageRecord("io", angle_deg) for angle_deg in (*QUARTERS_DEG, WHOLE_DEG)]
        return (*turn, *(StageRecord("op", angle_deg) for angle_deg in reversed(QUARTERS_DEG)))


def turn(run: Run) -> None:
    """R1: the accelerometer's output in quarters of a whole turn, its input axis turning."""
    walk(run, "io")


def axis(run: Run) -> None:
    """R2: the same with its input axis along the stage's axis."""
    walk(run, "op")
    if run.state(StageState).plane:
        run.apply(Power(POWER, False))


@dataclass
class StageState:
    """What this process of a run has done: the plane that the accelerometer is mounted for."""

    plane: str = ""


def meter_range(parameters: StageParameters) -> MeterRange:
    """Return how the voltmeter is read."""
    largest_V = LARGEST_G * parameters.scale_factor_V_per_g
    return MeterRange(METER, largest_V, parameters.nplc, parameters.readings)


def burst_s(parameters: StageParameters) -> float:
    """Return the bench time in s of one burst."""
    return AUTO_ZERO * parameters.readings * parameters.nplc / MAINS_HZ


def walk(run: Run, plane: str) -> None:
    """Measure the records of a plane."""
    parameters: StageParameters = run.parameters.stage
    of_plane = [record for record in parameters.records if record.plane == plane]
    for record in run.unfinished(of_plane, lambda record: record.unit):
        make_ready(run, plane)
        measure(run, record)


def make_ready(run: Run, plane: str) -> None:
    """Have the accelerometer mounted for a plane; at first limits, zero, meter, power, warm-up."""
    state, parameters = run.state(StageState), run.parameters.stage
    if state.plane == plane:
        return
    ask_at_rest(run, MOUNTS[plane])
    if not state.plane:
        run.role(STAGE, RotaryStage).programme_limits()
        if run.apply(Homing(STAGE)):
            come_to_rest(run, STAGE, "the stage looks for its zero", takes=on_the_way(HOMING_S))
        run.apply(meter_range(parameters))
        run.apply(Power(POWER, True))
        run.wait(parameters.warm_up_s, "the accelerometer warms up")
    state.plane = plane


def measure(run: Run, record: StageRecord) -> None:
    """Record the encoder and a burst of the voltmeter at an angle."""
    parameters: StageParameters = run.parameters.stage
    angle = Angle(STAGE, record.angle_deg, f"plane {record.plane}", decided_by=KEY)
    run.apply(angle)
    come_to_rest(run, STAGE, record.unit, takes=on_the_way(TURN_S))
    with run.unit(record.unit):
        angle_deg = run.role(STAGE, RotaryStage).angle_deg()
        keep_row(run, record.unit, STAGE, STAGE_COLUMNS, angle_deg, record.angle_deg)
        act = partial(read_burst, run, record.unit, run.role(METER, Multimeter))
        run.read(act, takes=exactly(burst_s(parameters)))
        run.count_rows(METER, parameters.readings)


def read_burst(run: Run, unit: str, meter: Multimeter) -> None:
    """Record a burst; InstrumentError where the output is beyond the voltmeter's range."""
    parameters: StageParameters = run.parameters.stage
    meter.start(parameters.readings)
    for _, block in fetch_bursts(run, unit, {METER: meter}, lasts_s=burst_s(parameters)):
        keep(run, unit, meter, block)
        if block.columns["overload"].any():
            raise InstrumentError(
                METER,
                f"record {unit}",
                f"the output is beyond its range for {parameters.scale_factor_V_per_g:g} V/g",
                "state scale_factor in the plan, and look at the accelerometer's cable",
            )


@dataclass(frozen=True)
class StageDataset:
    """Mean outputs in V: `turning_V` (5,) at 0, 90, 180, 270, 360 deg, `along_V` (4,).

    `u_V` is the standard uncertainty of the noisiest; `encoder_deg` (5,) is what the encoder reads
    beyond its set-points.
    """

    turning_V: Sequence[float]
    along_V: Sequence[float]
    u_V: float
    encoder_deg: Sequence[float]
    scale_factor_V_per_g: float


def dataset(folder: RunFolder, parameters: StageParameters, bench: Bench) -> StageDataset:
    """Return the mean outputs of a run; ValueError where one is no number."""

    def burst(record: StageRecord) -> tuple[float, float]:
        voltage_V = folder.rows(METER, record.unit)["voltage_V"]
        if len(voltage_V) < 2 or not all(map(math.isfinite, voltage_V)):
            raise ValueError(f"{record.unit}: two readings that are numbers are needed")
        return float(voltage_V.mean()), float(voltage_V.std(ddof=1)) / math.sqrt(len(voltage_V))

    def beyond_deg(record: StageRecord) -> float:
        row = folder.rows(STAGE, record.unit)[0]
        return float(row["angle_deg"] - row["commanded_deg"])

    turning = [record for record in parameters.records if record.plane == "io"]
    along = [record for record in parameters.records if record.plane == "op"]
    means = {record: burst(record) for record in parameters.records}
    return StageDataset(
        [means[record][0] for record in turning],
        [means[record][0] for record in along],
        max(u_V for _, u_V in means.values()),
        [beyond_deg(record) for record in turning],
        parameters.scale_factor_V_per_g,
    )


MOUNTING, ENCODER = "mounting_deg", "stage_angle_deg"


def inputs(parameters: StageParameters, bench: Bench) -> list[InputQuantity]:
    """Return the type B inputs: how well the device is mounted, and the stage's angle."""
    about = "mounting of the accelerometer on the stage"
    mounting = InputQuantity(MOUNTING, about, parameters.mounting_deg, "deg", "the plan")
    return [mounting, *bench.stated_input(ANGLE, ENCODER, "angle of the rotary stage")]


def analyse(data: StageDataset, inputs: Sequence[InputQuantity]) -> Analysis:
    """Return response, zero, closure and lean of the stage; a response that is off has causes."""
    at = dict(zip((0, 90, 180, 270, 360), data.turning_V, strict=True))
    sine_V, cosine_V = (at[0] - at[180]) / 2.0, (at[90] - at[270]) / 2.0
    gain_V, bias_V = math.hypot(sine_V, cosine_V), (at[0] + at[180]) / 2.0
    u_deg = math.degrees(data.u_V / gain_V) * math.sqrt(0.5)
    sense = math.copysign(1.0, cosine_V)
    read_deg = (data.encoder_deg[0] + data.encoder_deg[2]) / 2.0
    zero_deg = math.degrees(math.atan2(sense * sine_V, abs(cosine_V))) - read_deg
    slope_V = max(abs(cosine_V), 1e-9) * sense
    closure_deg = math.degrees((at[360] - at[0]) / slope_V) - (
        data.encoder_deg[4] - data.encoder_deg[0]
    )
    lean_deg = math.degrees((sum(data.along_V) / len(data.along_V) - bias_V) / gain_V)
    response, is_far = cosine_V / data.scale_factor_V_per_g, abs(zero_deg) > FAR_DEG
    response_u = data.u_V / data.scale_factor_V_per_g * math.sqrt(0.5)
    estimates = [
        RESPONSE.measured(
            response,
            response_u,
            "half the difference of outputs at 90 and 270 deg over the stated scale factor",
        ),
        ZERO.measured(
            zero_deg, u_deg, "outputs at 0 and 180 deg", by={MOUNTING: 1.0, ENCODER: 1.0}
        ),
        CLOSURE.undetermined("the output does not change with angle")
        if is_far
        else CLOSURE.measured(closure_deg, 2.0 * u_deg, "outputs at 0 and 360 deg"),
        LEAN.measured(lean_deg, u_deg, "outputs along the axis, less K0", by={MOUNTING: 1.0}),
    ]
    return Analysis(estimates, (), list(_of_response(response, response_u, is_far)))


def _of_response(response: float, u: float, is_far: bool) -> Iterator[Flag]:
    if response < -RESPONSE.limit:
        message = (
            "The output falls where it should rise with the angle: the rotary stage turns against "
            "its sense, or the accelerometer is mounted or connected the other way round."
        )
        yield Flag("stage-sense-reversed", message)
    elif not is_far and RESPONSE.is_off(response, u):
        message = (
            f"A quarter turn of the rotary stage changes the output by {response:.3g} of what the "
            "stated scale factor makes of it: the stage's units, or scale_factor in the plan."
        )
        yield Flag("stage-response-off", message)


def records(parameters: StageParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the uncertainty of an angle."""
    return (
        RecordUse(*ANGLE, needed=False, corrected=False),
        RecordUse(STAGE, "graduation", WHOLE_DEG, "deg", needed=False, corrected=False),
        RecordUse(METER, "voltage", parameters.scale_factor_V_per_g, "V", needed=False),
    )


def check(parameters: StageParameters, bench: Bench) -> Iterator[Problem]:
    """Yield an integration time that the voltmeter does not have."""
    meter = bench.instruments.get(METER)
    if meter is None or registry.why_not(registry.DRIVERS, meter.driver):
        return
    driver = registry.load(registry.DRIVERS, meter.driver)
    if parameters.nplc not in driver.integration_cycles:
        known = ", ".join(f"{cycles:g}" for cycles in driver.integration_cycles)
        yield Problem((*KEY, "nplc"), f"the {METER} integrates over {known} power-line cycles")


PART = Part(
    name="stage",
    steps=(
        Step("R1", "Rotary stage: sense, zero and whole turn against gravity", turn),
        Step("R2", "Rotary stage: its axis against the level", axis),
    ),
    figures=(RESPONSE, ZERO, CLOSURE, LEAN),
    needs=(STAGE, METER, POWER),
    units=lambda parameters: (record.unit for record in parameters.records),
    dataset=dataset,
    inputs=inputs,
    analyse=analyse,
    records=records,
    check=check,
    short=("parameters.stage.warm_up=1 min",),
)
