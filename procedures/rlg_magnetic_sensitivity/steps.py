"""The source's steps S1 to S9.

S3 is split: the source asks for a warm gyro before its field is switched on. Simultaneous
excitation does S3 to S7 for all coils at once; then S8 repeats them for checks only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from station.method.commands import CoilOff, FieldRange, GyroSampling, Power, SineField
from station.method.duration import NO_TIME, Duration, exactly, on_the_way
from station.method.run import Run
from station.method.set_points import Bounded
from station.method.verbs import POLL_S, Recording, record_published, require_off
from station.procedure import Prompt, Step
from station.roles import CoilSupply, Gaussmeter, GyroAcquisition

from .parameters import COIL_OF_AXIS, RlgParameters
from .records import (
    GAUSSMETER,
    GYRO,
    PlannedRecord,
    all_records,
    reading_back_s,
    sensitivity_records,
)
from .stopping import Patience, until_steady, warm_up_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .dataset import Segment

POWER = "dut_power"
WARM_UP = "warm-up"
AMPLITUDE = ("parameters", "amplitude")
UPLOAD_S, RAMP_DOWN_S = 5.0, 1.0
FIELD_HEADROOM = 1.5
"""The gaussmeter's range covers the field of all coils together and the ambient field."""

MOUNT = Prompt(
    "mount",
    "Mount the gyro on its non-magnetic base in the centre of the three-axis Helmholtz coil, "
    "IA, NA and LA parallel to the normals of coils X, Y and Z; set the field probe beside it.",
    picture="mounting.svg",
    then="cables; nothing is energised yet",
)
CABLES = Prompt(
    "connect-cables",
    "Connect the gyro to its acquisition board and each coil to its supply.",
    checklist=(
        "Each coil is on the supply of its own axis.",
        "No tool and no loose iron is in the coils.",
    ),
    then="each supply gets its limits, then the coils are energised in turn",
)


def mount(run: Run) -> None:
    """S1: gyro in the centre of the coil, axes along the coils' normals."""
    run.ask(MOUNT)


def connect(run: Run) -> None:
    """S2: cables; every instrument was identified, now each supply gets its own limits."""
    run.ask(CABLES)
    for axis in run.parameters.axes:
        run.role(coil_supply(axis), CoilSupply).programme_limits()


def warm_up(run: Run) -> None:
    """S3, first part: gyro on, and wait until its output is steady.

    It is done again where a run was interrupted before its last record.
    """
    parameters: RlgParameters = run.parameters
    if all(run.is_finished(planned.unit) for planned in all_records(parameters)):
        return
    interval_s = parameters.sample_interval_s
    with run.toward(WARM_UP):
        run.apply(Power(POWER, True))
        run.apply(GyroSampling(GYRO, interval_s, parameters.channel))
        gyro = Recording(run, WARM_UP, {GYRO: 1.0 / interval_s})
        run.read(
            partial(until_steady, run, gyro), takes=warm_up_s(parameters.warm_up), rates=gyro.rates
        )


def drive(run: Run, planned: PlannedRecord) -> None:
    """S3: each coil of a record produces a sine of its frequency f and amplitude M."""
    parameters: RlgParameters = run.parameters
    for _ in run.unfinished([planned.unit]):
        run.apply(field_range(parameters, planned))
        for axis in planned.energised:
            run.prepare(sine(planned, axis))
        for axis in planned.energised:
            switch_on(run, axis, sine(planned, axis))
        if planned.energised:
            run.wait(parameters.settle_s, f"{planned.unit}: the field settles")


def switch_on(run: Run, axis: str, driven: SineField) -> None:
    """Switch a coil's sine on."""
    frequency_Hz = run.apply(driven, takes=on_the_way(UPLOAD_S))
    amplitude_A = run.read(lambda: driven.current_A(run.bench))
    run.event(
        "field-on", axis=axis, amplitude_A=amplitude_A, frequency_Hz=frequency_Hz, durable=True
    )


def record(run: Run, planned: PlannedRecord) -> None:
    """S4: N samples of the gyro at tau0, the field measured beside it; then the field goes off.

    Where the plan has a stop, N is decided by what the samples so far determine.
    """
    interval_s = run.parameters.sample_interval_s
    for unit in run.unfinished([planned.unit], pauses=False):
        gaussmeter = run.role(GAUSSMETER, Gaussmeter)
        run.role(GYRO, GyroAcquisition).drain()
        gaussmeter.drain()
        run.declare(samples_of(planned))
        with run.unit(
            unit,
            drive={axis: vars(driven) for axis, driven in planned.drive.items()},
            field_averaging_s=gaussmeter.averaging_s,
            field_timestamp=gaussmeter.timestamp,
        ) as facts:
            samples = Recording(run, unit, {GYRO: 1.0 / interval_s, GAUSSMETER: None})
            act = partial(until_enough, run, planned, samples, facts)
            run.read(act, takes=record_s(planned, interval_s), rates=samples.rates)
        for axis in planned.energised:
            run.apply(CoilOff(coil_supply(axis)), takes=off_s(planned, axis))
            run.event("field-off", axis=axis)


def transform(run: Run, planned: PlannedRecord) -> None:
    """S5: the discrete Fourier transform of the N samples, read back from the record."""

    def act() -> None:
        from .from_record import segment_of_unit
        from .gyro import plotted_spectrum

        with run.clock.allow(reading_back_s(planned.most, run.parameters.sample_interval_s)):
            segment = segment_of_unit(run.read_back(), planned.unit, run.parameters, run.bench)
            run.state(Spectra).of_unit[planned.unit] = segment, plotted_spectrum(segment)

    run.read(act)


def draw(run: Run, planned: PlannedRecord) -> None:
    """S6: the curve y = 2|X[k]|/N against x = k/T, as a table in the run folder."""

    def act() -> None:
        _, curve = run.state(Spectra).of_unit[planned.unit]
        rows = zip(*curve, strict=True)
        lines = ["frequency_Hz,amplitude_deg_per_h", *(f"{x:.9g},{y:.9g}" for x, y in rows)]
        run.write_text(f"spectrum-{planned.unit}.csv", "\n".join(lines) + "\n")

    run.read(act)


def read_peak(run: Run, planned: PlannedRecord) -> None:
    """S7: the peak near each f divided by M, as published; the best estimate follows at the end."""

    def act() -> None:
        from .gyro import published_value

        segment, _ = run.state(Spectra).of_unit.pop(planned.unit)
        for axis in planned.energised:
            published = published_value(segment, axis)
            record_published(run, published.value, published.unit, axis=axis)
            if published.value is not None:
                value = f"{published.value:.4f} {published.unit}"
                run.say(f"    {axis}: as published |S| = {value}")

    run.read(act)


def repeat(run: Run) -> None:
    """S8: S3 to S7 again for the other coils, then S3 and S4 for what tests the results."""
    if run.parameters.excitation == "simultaneous":
        run.say("    every coil was driven in S3 already, at a frequency of its own")
    for planned in all_records(run.parameters)[1:]:
        parts = (drive, record, transform, draw, read_peak)
        for part in parts if planned.purpose == "sensitivity" else parts[:2]:
            part(run, planned)


def switch_off(run: Run) -> None:
    """S9: coils off, read back; then the gyro off.

    Raises InstrumentError when a coil's supply does not read back as off.
    """
    require_off(run, *(coil_supply(axis) for axis in run.parameters.axes))
    run.role(GYRO, GyroAcquisition).stop()
    run.apply(Power(POWER, False))


def first(part: Callable[[Run, PlannedRecord], None]) -> Callable[[Run], None]:
    """Return a step body that does `part` for the plan's first record."""

    def body(run: Run) -> None:
        part(run, sensitivity_records(run.parameters)[0])

    body.__doc__ = part.__doc__
    return body


STEPS = (
    Step("S1", "Mount the gyro in the centre of the coil", mount),
    Step("S2", "Connect the cables, identify the instruments", connect),
    Step("S3.1", "Switch the gyro on and warm it up", warm_up),
    Step("S3.2", "Drive coil X with a sine of frequency f and amplitude M", first(drive)),
    Step("S4", "Record N samples of the gyro, and the field", first(record)),
    Step("S5", "Transform the record", first(transform)),
    Step("S6", "Draw the spectrum 2|X|/N against k/T", first(draw)),
    Step("S7", "Read the peak near f, divide by M", first(read_peak)),
    Step("S8", "Repeat S3 to S7 for coils Y and Z", repeat),
    Step("S9", "Switch the coils and the gyro off", switch_off),
)


@dataclass
class Spectra:
    """The records that S5 has transformed, and their curves, until S7 has read their peaks."""

    of_unit: dict[str, tuple[Segment, Any]] = field(default_factory=dict)


class SampleCounter:
    """Count samples by the board's own 16-bit sequence number."""

    def __init__(self, wanted: int) -> None:
        self.wanted = wanted
        self.counted = 0
        self._last: int | None = None

    def enough(self, newest: Mapping[str, NDArray[Any]]) -> bool:
        """Take the newest row of the board; True once `wanted` intervals have passed."""
        sequence = int(newest[GYRO]["sequence"][0])
        step = 0 if self._last is None else (sequence - self._last) % 65536
        if step >= 32768:
            return False  # a late frame: the counter never runs backwards by itself
        self.counted += step
        self._last = sequence
        return self.counted >= self.wanted


def until_enough(
    run: Run, planned: PlannedRecord, samples: Recording, facts: dict[str, Any]
) -> None:
    """Record until the samples are as many as they should be, which the data may decide."""
    counter, patience = SampleCounter(planned.samples), Patience(run, planned)
    more: int | None = planned.samples
    while more is not None:
        facts["samples"] = counter.wanted = more
        samples.until(
            counter.enough, NO_TIME, lambda: patience.said(counter.counted, counter.wanted)
        )
        more = patience.more(facts)


def record_s(planned: PlannedRecord, interval_s: float) -> Duration:
    """Return how long a record lasts, up to the look after its last sample."""
    longer_s = (planned.most - planned.samples) * interval_s
    at_least = exactly(planned.samples * interval_s)
    return at_least + Duration(longer_s + POLL_S / 2.0, 0.0, longer_s + 2.0 * POLL_S)


def samples_of(planned: PlannedRecord) -> Bounded:
    """Return how many samples a record has, as far as that is known before."""
    longer = f" to {planned.most}" if planned.most > planned.samples else ""
    return Bounded(GYRO, f"{planned.samples}{longer} samples for {planned.unit}")


def coil_supply(axis: str) -> str:
    """Return the supply whose coil drives a gyro axis."""
    return f"coil_supply.{COIL_OF_AXIS[axis]}"


def field_range(parameters: RlgParameters, planned: PlannedRecord) -> FieldRange:
    """Return the range of a record's field; several coils add up where their peaks coincide."""
    together_mT = planned.largest_field_mT
    return FieldRange(
        GAUSSMETER,
        FIELD_HEADROOM * (together_mT or parameters.amplitude_mT),
        COIL_OF_AXIS[next(iter(planned.drive))],
        together_mT if len(planned.energised) > 1 else None,
        decided_by=AMPLITUDE,
    )


def sine(planned: PlannedRecord, axis: str) -> SineField:
    """Return the sine of a coil of a record."""
    f, amplitude_mT = planned.drive[axis].frequency_Hz, planned.drive[axis].amplitude_mT
    return SineField(coil_supply(axis), f, amplitude_mT, decided_by=AMPLITUDE)


def off_s(planned: PlannedRecord, axis: str) -> Duration:
    """Return how long a coil takes to be off: its sine goes on to a zero, then the rest is ramped.

    That zero is a quarter of a period away in the mean, and half of one at most.
    """
    period_s = 1.0 / planned.drive[axis].frequency_Hz
    return Duration(period_s / 4.0, 0.0, period_s / 2.0) + on_the_way(RAMP_DOWN_S)
