"""Laser-gyro bias magnetic-field sensitivity by a sinusoidal field, S1 to S9.

Source: "a method to accurately measure the magnetic-field sensitivity of the bias of a laser
gyro", steps S1-S9. S3 is split: the source asks for a warm gyro before its field is switched on.
Simultaneous excitation does S3 to S7 for all coils at once; then S8 repeats them for checks only.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from procedures.rlg_magnetic_sensitivity.records import (
    PlannedRecord,
    all_records,
    reading_back_s,
    sensitivity_records,
)
from procedures.rlg_magnetic_sensitivity.stopping import warm_up
from procedures.rlg_magnetic_sensitivity.work import (
    GAUSSMETER,
    GYRO,
    POWER,
    check,
    coil_supply,
    field_range,
    held_bytes,
    instruments,
    outlook,
    records,
    sines,
    work,
)
from station.method.commands import CoilOff, Power
from station.method.verbs import acquire, record_published, require_off
from station.procedure import Procedure, Prompt, ResultKind, Step, usual_modules
from station.roles import CoilSupply, Gaussmeter, GyroAcquisition

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.rlg_magnetic_sensitivity.dataset import Segment
    from station.method.run import Run

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


@dataclass
class Spectra:
    """The records that S5 has transformed, and their curves, until S7 has read their peaks."""

    of_unit: dict[str, tuple[Segment, Any]] = dataclasses.field(default_factory=dict)


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


def prompts(parameters: RlgParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    return (MOUNT, CABLES)


def mount(run: Run) -> None:
    """S1: gyro in the centre of the coil, axes along the coils' normals."""
    run.ask(MOUNT)


def connect(run: Run) -> None:
    """S2: cables; every instrument was identified, now each supply gets its own limits."""
    run.ask(CABLES)
    for axis in run.parameters.axes:
        run.role(coil_supply(axis), CoilSupply).programme_limits()


def drive(run: Run, planned: PlannedRecord) -> None:
    """S3: each coil of a record produces a sine of its frequency f and amplitude M."""
    parameters: RlgParameters = run.parameters
    if run.is_finished(planned.unit):
        run.say(f"    {planned.unit}: measured before the run was interrupted")
        return
    run.may_pause()
    run.apply(field_range(parameters, planned))
    driven = sines(planned)
    for sine in driven.values():
        run.prepare(sine)
    for axis, sine in driven.items():
        frequency_Hz, amplitude_A = run.apply(sine), sine.current_A(run.bench)
        run.event(
            "field-on", axis=axis, amplitude_A=amplitude_A, frequency_Hz=frequency_Hz, durable=True
        )
    if driven:
        run.wait(parameters.settle_s, f"{planned.unit}: the field settles")


def record(run: Run, planned: PlannedRecord) -> None:
    """S4: N samples of the gyro at tau0, the field measured beside it; then the field goes off.

    Where the plan has a stop, N is decided by what the samples so far determine.
    """
    from procedures.rlg_magnetic_sensitivity.stopping import Patience

    if run.is_finished(planned.unit):
        return
    board = run.role(GYRO, GyroAcquisition)
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    board.drain()
    gaussmeter.drain()
    counter = SampleCounter(planned.samples)
    patience = Patience(run, planned)
    with run.unit(
        planned.unit,
        drive={axis: vars(sine) for axis, sine in planned.drive.items()},
        field_averaging_s=gaussmeter.averaging_s,
        field_timestamp=gaussmeter.timestamp,
    ) as facts:
        while True:
            facts["samples"] = counter.wanted
            acquire(
                run,
                planned.unit,
                {GYRO: board, GAUSSMETER: gaussmeter},
                enough=counter.enough,
                detail=lambda: patience.said(counter.counted, counter.wanted),
            )
            more = patience.more(facts)
            if more is None:
                break
            counter.wanted = more
    for axis in planned.energised:
        run.apply(CoilOff(coil_supply(axis)))
        run.event("field-off", axis=axis)


def transform(run: Run, planned: PlannedRecord) -> None:
    """S5: the discrete Fourier transform of the N samples, read back from the record."""
    from procedures.rlg_magnetic_sensitivity.from_record import segment_of_unit
    from procedures.rlg_magnetic_sensitivity.gyro import plotted_spectrum

    with run.clock.allow(reading_back_s(planned.most, run.parameters.sample_interval_s)):
        segment = segment_of_unit(run.read_back(), planned.unit, run.parameters, run.bench)
        run.state(Spectra).of_unit[planned.unit] = segment, plotted_spectrum(segment)


def draw(run: Run, planned: PlannedRecord) -> None:
    """S6: the curve y = 2|X[k]|/N against x = k/T, as a table in the run folder."""
    _, curve = run.state(Spectra).of_unit[planned.unit]
    rows = zip(*curve, strict=True)
    lines = ["frequency_Hz,amplitude_deg_per_h", *(f"{x:.9g},{y:.9g}" for x, y in rows)]
    run.write_text(f"spectrum-{planned.unit}.csv", "\n".join(lines) + "\n")


def read_peak(run: Run, planned: PlannedRecord) -> None:
    """S7: the peak near each f divided by M, as published; the best estimate follows at the end."""
    from procedures.rlg_magnetic_sensitivity.gyro import published_value

    segment, _ = run.state(Spectra).of_unit.pop(planned.unit)
    for axis in planned.energised:
        published = published_value(segment, axis)
        record_published(run, published.value, published.unit, axis=axis)
        if published.value is not None:
            value = f"{published.value:.4f} {published.unit}"
            run.say(f"    {axis}: as published |S| = {value}")


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


def limited_results(parameters: RlgParameters) -> Mapping[str, tuple[str, ...]]:
    """Return the results that need a limit: all, where the plan stops when they are decided."""
    early = parameters.stop is not None and parameters.stop.early_decision
    return {"magnetic_sensitivity": tuple(parameters.axes)} if early else {}


PROCEDURE = Procedure(
    name="rlg-magnetic-sensitivity",
    title="Laser gyro: magnetic-field sensitivity of the bias",
    source="A method to accurately measure the magnetic-field sensitivity of the bias of a laser "
    "gyro (Chinese patent text 23757495, 2020-04-11), steps S1 to S9",
    parameters=RlgParameters,
    results={"magnetic_sensitivity": ResultKind(("IA", "NA", "LA"), "deg/h/mT")},
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=prompts,
    check=check,
    **usual_modules(__name__),
    work=work,
    held_bytes=held_bytes,
    outlook=outlook,
    measured_axes=lambda parameters: {"magnetic_sensitivity": tuple(parameters.axes)},
    needs_limits=limited_results,
    assumptions=(
        "The probe's axes stand along the coils' normals and the gyro's axes along both; what they "
        "differ is in the results as far as the measured cross components show it.",
        "The field is measured beside the gyro, not in it; the coil's homogeneity over that "
        "distance is covered only as far as the gaussmeter's record in the bench file covers it.",
        "A magnetic shield of the gyro is part of the gyro: the sensitivity is that to the outer "
        "field at the drive frequency.",
        "The sensitivity is signed, positive when the output rises with the field along the "
        "positive axis. The published rule gives its magnitude only.",
    ),
)
