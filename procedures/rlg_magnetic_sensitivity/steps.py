"""S1 to S9 of the laser-gyro bias magnetic-sensitivity method, with the source's own numbers.

Source: "a method to accurately measure the magnetic-field sensitivity of the bias of a laser
gyro", steps S1-S9. S3 is split: the source asks for a warm gyro before its field is switched on.
Simultaneous excitation does S3 to S7 for all coils at once; then S8 repeats them for checks only.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from procedures.rlg_magnetic_sensitivity.check import sees_one_axis
from procedures.rlg_magnetic_sensitivity.measuring import (
    GAUSSMETER,
    coil_supply,
    draw,
    drive,
    preparation_s,
    read_peak,
    record,
    recording_s,
    transform,
)
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from procedures.rlg_magnetic_sensitivity.records import (
    PlannedRecord,
    all_records,
    sensitivity_records,
)
from procedures.rlg_magnetic_sensitivity.warming import (
    GYRO,
    POWER,
    WARM_UP,
    expected_warm_up_s,
    warm_up,
)
from station.errors import InstrumentError
from station.procedure import Prompt, RecordUse, Step

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.runner.run import Run

MOUNT = Prompt(
    "mount",
    "Mount the gyro on its non-magnetic base in the centre of the three-axis Helmholtz coil, "
    "IA, NA and LA parallel to the normals of coils X, Y and Z; set the field probe beside it.",
)
CABLES = Prompt(
    "connect-cables",
    "Connect the gyro to its acquisition board and each coil to its supply.",
)


def instruments(parameters: RlgParameters) -> tuple[str, ...]:
    """Return the bench instances the plan needs."""
    return (*(coil_supply(axis) for axis in parameters.axes), GAUSSMETER, GYRO, POWER)


def records(parameters: RlgParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records.

    An uncertainty of the gaussmeter's direction is needed where it sees one axis alone.
    """
    return (
        RecordUse(GAUSSMETER, "field", parameters.amplitude_mT, "mT"),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=sees_one_axis(bench), corrected=False),
        RecordUse(GYRO, "scale", 1.0, "1"),
    )


def units(parameters: RlgParameters) -> tuple[str, ...]:
    """Return the units of work in the order they are measured: the warm-up, then each record."""
    return (WARM_UP, *(planned.unit for planned in all_records(parameters)))


def prompts(parameters: RlgParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    return (MOUNT, CABLES)


def mount(run: Run) -> None:
    """S1: gyro in the centre of the coil, axes along the coils' normals."""
    run.ask(MOUNT.id, MOUNT.text)


def connect(run: Run) -> None:
    """S2: cables; every instrument was identified, now each supply gets its own limits."""
    from station.roles import CoilSupply

    run.ask(CABLES.id, CABLES.text)
    for axis in run.parameters.axes:
        run.role(coil_supply(axis), CoilSupply).programme_limits()


def repeat(run: Run) -> None:
    """S8: S3 to S7 again for the other coils, then S3 and S4 for what tests the results."""
    if run.parameters.excitation == "simultaneous":
        run.progress.say("    every coil was driven in S3 already, at a frequency of its own")
    for planned in all_records(run.parameters)[1:]:
        parts = (drive, record, transform, draw, read_peak)
        for part in parts if planned.purpose == "sensitivity" else parts[:2]:
            part(run, planned)


def switch_off(run: Run) -> None:
    """S9: coils off, read back; then the gyro off.

    Raises InstrumentError when a coil's supply does not read back as off.
    """
    from station.roles import CoilSupply, DutPower, GyroAcquisition

    for axis in run.parameters.axes:
        name = coil_supply(axis)
        reading = run.role(name, CoilSupply).read_safety()
        if not reading.safe:
            raise InstrumentError(
                name,
                "switched the coil off",
                f"it reads back {reading.read_back}",
                "switch the supply off by hand",
            )
    run.role(GYRO, GyroAcquisition).stop()
    run.role(POWER, DutPower).switch_off()


def first(part: Callable[[Run, PlannedRecord], None]) -> Callable[[Run], None]:
    """Return a step body that does `part` for the plan's first record."""

    def body(run: Run) -> None:
        part(run, sensitivity_records(run.parameters)[0])

    body.__doc__ = part.__doc__
    return body


def repeating_s(parameters: RlgParameters) -> float:
    """Return the bench time in s of S8: all records but the first."""
    return sum(
        preparation_s(parameters, planned) + recording_s(parameters, planned)
        for planned in all_records(parameters)[1:]
    )


STEPS = (
    Step("S1", "Mount the gyro in the centre of the coil", mount, lambda _: 0.0),
    Step("S2", "Connect the cables, identify the instruments", connect, lambda _: 1.0),
    Step("S3.1", "Switch the gyro on and warm it up", warm_up, expected_warm_up_s),
    Step(
        "S3.2",
        "Drive coil X with a sine of frequency f and amplitude M",
        first(drive),
        lambda p: preparation_s(p, all_records(p)[0]),
    ),
    Step(
        "S4",
        "Record N samples of the gyro, and the field",
        first(record),
        lambda p: recording_s(p, all_records(p)[0]),
    ),
    Step("S5", "Transform the record", first(transform), lambda _: 0.0),
    Step("S6", "Draw the spectrum 2|X|/N against k/T", first(draw), lambda _: 0.0),
    Step("S7", "Read the peak near f, divide by M", first(read_peak), lambda _: 0.0),
    Step("S8", "Repeat S3 to S7 for coils Y and Z", repeat, repeating_s),
    Step("S9", "Switch the coils and the gyro off", switch_off, lambda _: 1.0),
)
