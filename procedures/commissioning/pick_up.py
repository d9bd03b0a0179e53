"""U1: what the voltmeter reads of driven coils while the device is off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.findings import Analysis, Flag, InputQuantity
from station.method.commands import CoilOff, MeterRange, Power, SineField
from station.method.duration import exactly, on_the_way
from station.method.run import Run
from station.method.verbs import fetch_bursts, keep, require_off
from station.procedure import Prompt, RecordUse, Step
from station.roles import CoilSupply, Multimeter
from station.roles.base import ARRIVAL

from .coils import supply_of
from .part import COILS, COVERAGE, Figure, Part, undetermined

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

PICK_UP_UV = 5.0
"""5 ug of an accelerometer of 1 V/g at 0.5 mT: what its noise leaves of a reading of a second."""
PICK_UP = Figure("pick_up", "uV", COILS, limit=PICK_UP_UV, drift=2.5)
"""Half of the limit: leads that were moved, or whose twist has opened."""
OF_ROOM = 0.5
"""Of a line with a coil driven: so much of it with all coils off is not the coil's."""
UV_PER_V = 1e6
OFF, FREQUENCY = "off", "frequency_Hz"
METER, POWER = "multimeter", "dut_power"
RANGE_V, CYCLES = 0.1, 1.0
SETTLE_S, RAMPS_S = 5.0, 11.0
"""After the sine has begun; to load it, and from it to zero."""
CABLES = Prompt(
    "connect-cables",
    "Leave the device and all its cables as a measurement has them; its power stays off.",
)


class PickUpParameters(StrictModel):
    """What the engineer chooses: the drive that later plans use, and the record."""

    frequency_Hz: Annotated[float, Unit("Hz"), Field(ge=0.05, le=0.2)] = 0.1
    field_mT: Annotated[float, Unit("mT"), Field(gt=0, le=2.0)] = 0.5
    record_s: Annotated[float, Unit("s"), Field(ge=20, le=600)] = 30.0
    every_s: Annotated[float, Unit("s"), Field(ge=0.2, le=2)] = 0.5


def unit_of(coil: str) -> str:
    """Return the name of the unit of work in which a coil is driven, or all are off."""
    return f"pick-up, coils {OFF}" if coil == OFF else f"pick-up, coil {coil} driven"


def pick_up(run: Run) -> None:
    """U1: the voltmeter with all coils off, then with each coil driven at the plan's frequency."""
    parameters: PickUpParameters = run.parameters.pick_up
    run.ask(CABLES)
    run.apply(Power(POWER, False))
    run.apply(meter_range())
    for coil in COILS:
        run.role(supply_of(coil), CoilSupply).programme_limits()
    for coil in run.unfinished((OFF, *COILS), unit_of):
        unit, frequency_Hz = unit_of(coil), parameters.frequency_Hz
        if coil != OFF:
            drive = sine(parameters, coil)
            run.prepare(drive)
            frequency_Hz = run.apply(drive, takes=on_the_way(RAMPS_S))
            run.event("field-on", axis=coil, frequency_Hz=frequency_Hz, durable=True)
            run.wait(SETTLE_S, unit)
        with run.unit(unit, **{FREQUENCY: frequency_Hz}):
            rates = {METER: 1.0 / parameters.every_s}
            act = partial(read, run, unit, run.role(METER, Multimeter))
            run.read(act, takes=exactly(parameters.record_s), rates=rates)
        if coil != OFF:
            run.apply(CoilOff(supply_of(coil)))
            require_off(run, supply_of(coil))


def meter_range() -> MeterRange:
    """Return range and integration time of the voltmeter, one reading at a time."""
    return MeterRange(METER, RANGE_V, CYCLES, 1)


def sine(parameters: PickUpParameters, coil: str) -> SineField:
    """Return the drive of a coil."""
    return SineField(
        supply_of(coil),
        parameters.frequency_Hz,
        parameters.field_mT,
        decided_by=("parameters", "pick_up", "field"),
    )


def read(run: Run, unit: str, meter: Multimeter) -> None:
    """Record single readings, each with the time at which it came."""
    parameters: PickUpParameters = run.parameters.pick_up
    until_s = due_s = run.now_s
    until_s += parameters.record_s
    while due_s < until_s:
        run.clock.sleep_until(max(due_s, run.now_s))
        meter.start(1)
        for _, block in fetch_bursts(run, unit, {METER: meter}, every_s=0.02, doing=unit):
            keep(run, unit, meter, block)
        due_s += parameters.every_s


@dataclass(frozen=True)
class PickUpReadings:
    """Readings (n,) in uV at times in s, and the frequency in Hz of the drive."""

    time_s: Array
    voltage_uV: Array
    frequency_Hz: float


@dataclass(frozen=True)
class PickUpDataset:
    """The readings by driven coil, and those with all coils `off`; coils that went beyond range."""

    readings: Mapping[str, PickUpReadings]
    over: tuple[str, ...] = ()


def dataset(folder: RunFolder, parameters: PickUpParameters, bench: Bench) -> PickUpDataset:
    """Return the readings of a run."""
    rows = {coil: folder.rows(METER, unit_of(coil)) for coil in (OFF, *COILS)}
    units = folder.finished_units()
    readings = {
        coil: PickUpReadings(
            of[ARRIVAL], of["voltage_V"] * UV_PER_V, float(units[unit_of(coil)][FREQUENCY])
        )
        for coil, of in rows.items()
    }
    return PickUpDataset(readings, tuple(coil for coil, of in rows.items() if of["overload"].any()))


@dataclass(frozen=True)
class Line:
    """Amplitude of a line in uV, its standard uncertainty, and the degrees of freedom."""

    amplitude_uV: float
    u_uV: float
    freedom: float


def analyse(data: PickUpDataset, inputs: Sequence[InputQuantity] = ()) -> Analysis:
    """Return the line of each coil, and a flag of those that are beyond the limit."""
    if data.over:
        return beyond_range(data.over)
    lines = {coil: line_of(reading) for coil, reading in data.readings.items()}
    method = "least squares of a sine beside an offset and a drift"
    estimates = [
        PICK_UP.measured(line.amplitude_uV, line.u_uV, method, coil, line.freedom)
        for coil, line in ((coil, lines[coil]) for coil in COILS)
    ]
    return Analysis(estimates, (), causes_of(lines))


def causes_of(lines: Mapping[str, Line]) -> tuple[Flag, ...]:
    """Return the flag of lines beyond the limit: of the leads, or of the room with coils off."""
    beyond = [coil for coil in COILS if lines[coil].amplitude_uV > limit_of(lines[coil])]
    if not beyond:
        return ()
    worst = max(beyond, key=lambda coil: lines[coil].amplitude_uV)
    line, room_uV = lines[worst], lines[OFF].amplitude_uV
    seen = (
        f"The voltmeter reads up to {line.amplitude_uV:.3g} uV (u = {line.u_uV:.1g} uV) at the "
        f"drive frequency of coil {worst}, the device off"
    )
    details = {"coils": beyond, "amplitude_uV": line.amplitude_uV}
    if room_uV > OF_ROOM * line.amplitude_uV:
        message = (
            f"{seen}, and {room_uV:.3g} uV with all coils off: the line is not the coil's. Look "
            "for what else repeats so often, or choose another frequency."
        )
        return (Flag("line-at-drive-frequency", message, details=details),)
    message = f"{seen}: twist and screen its leads, and part them from those of the coil."
    return (Flag("pick-up", message, details=details),)


def beyond_range(over: Sequence[str]) -> Analysis:
    """Return that nothing is determined: readings with coils `over` driven exceed the range."""
    driven = " and ".join(
        "all coils off" if coil == OFF else f"coil {coil} driven" for coil in over
    )
    message = (
        f"The voltmeter reads beyond its range of {RANGE_V:g} V with {driven}, the device off: its "
        "leads are open, or another voltage is on them."
    )
    flag = Flag("pick-up-beyond-range", message)
    return Analysis(undetermined((PICK_UP,), "beyond the range"), (), (flag,))


def limit_of(line: Line) -> float:
    """Return beyond what a line is named, in uV."""
    return PICK_UP_UV + COVERAGE * line.u_uV


def line_of(data: PickUpReadings) -> Line:
    """Return the line of a record of at least six readings; ValueError of fewer."""
    import numpy as np

    if len(data.time_s) < 6:
        raise ValueError("a line needs six readings")
    time_s = data.time_s - data.time_s.mean()
    phase = 2.0 * math.pi * data.frequency_Hz * time_s
    columns = np.column_stack((np.cos(phase), np.sin(phase), np.ones_like(time_s), time_s))
    shares, *_ = np.linalg.lstsq(columns, data.voltage_uV, rcond=None)
    freedom = float(len(time_s) - len(shares))
    left = data.voltage_uV - columns @ shares
    covariance = float(left @ left) / freedom * np.linalg.inv(columns.T @ columns)
    u_uV = math.sqrt((covariance[0, 0] + covariance[1, 1]) / 2.0)
    return Line(float(np.hypot(*shares[:2])), u_uV, freedom)


PART = Part(
    name="pick_up",
    steps=(Step("U1", "Pick-up at the drive frequency, the device off", pick_up),),
    figures=(PICK_UP,),
    needs=(METER, POWER, *map(supply_of, COILS)),
    units=lambda parameters: map(unit_of, (OFF, *COILS)),
    dataset=dataset,
    analyse=analyse,
    short=("parameters.pick_up.record=20 s", "parameters.pick_up.every=1 s"),
    # The few millionths of the voltmeter are nothing beside a limit on microvolts.
    records=lambda parameters, bench: (
        RecordUse(METER, "voltage", RANGE_V, "V", needed=False, corrected=False),
    ),
)
