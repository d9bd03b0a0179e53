"""S3 to S7 of one record: coils driven, samples recorded, the published rule evaluated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from procedures.rlg_magnetic_sensitivity.parameters import COIL_OF_AXIS, RlgParameters
from procedures.rlg_magnetic_sensitivity.records import PlannedRecord, reading_back_s
from procedures.rlg_magnetic_sensitivity.warming import GYRO

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.runner.run import Run

GAUSSMETER = "gaussmeter"
UPLOAD_S = 5.0
RAMP_DOWN_S = 6.0
FIELD_HEADROOM = 1.5
"""The gaussmeter's range covers the field of all coils together and the ambient field."""


def coil_supply(axis: str) -> str:
    """Return the supply whose coil drives a gyro axis."""
    return f"coil_supply.{COIL_OF_AXIS[axis]}"


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


def drive(run: Run, planned: PlannedRecord) -> None:
    """S3: each coil of a record produces a sine of its frequency f and amplitude M."""
    from station.roles import CoilSupply, Gaussmeter

    parameters: RlgParameters = run.parameters
    if run.is_finished(planned.unit):
        run.progress.say(f"    {planned.unit}: measured before the run was interrupted")
        return
    run.may_pause()
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    gaussmeter.turn_to(COIL_OF_AXIS[next(iter(planned.drive))])
    largest_mT = planned.largest_field_mT or parameters.amplitude_mT
    gaussmeter.start(FIELD_HEADROOM * largest_mT)
    supplies = {axis: run.role(coil_supply(axis), CoilSupply) for axis in planned.energised}
    given_Hz = {}
    for axis, supply in supplies.items():
        sine = planned.drive[axis]
        amplitude_A = sine.amplitude_mT / supply.coil_constant_mT_per_A
        given_Hz[axis] = supply.load_sine(sine.frequency_Hz, amplitude_A), amplitude_A
    for axis, supply in supplies.items():
        supply.start_sine()
        frequency_Hz, amplitude_A = given_Hz[axis]
        run.record.event(
            "field-on", axis=axis, amplitude_A=amplitude_A, frequency_Hz=frequency_Hz, durable=True
        )
    if supplies:
        run.wait(parameters.settle_s, f"{planned.unit}: the field settles")


def record(run: Run, planned: PlannedRecord) -> None:
    """S4: N samples of the gyro at tau0, the field measured beside it; then the field goes off.

    Where the plan has a stop, N is decided by what the samples so far determine.
    """
    from procedures.rlg_magnetic_sensitivity.stopping import Patience
    from station.roles import CoilSupply, Gaussmeter, GyroAcquisition
    from station.runner.acquisition import acquire

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
        run.role(coil_supply(axis), CoilSupply).stop()
        run.record.event("field-off", axis=axis)


def transform(run: Run, planned: PlannedRecord) -> None:
    """S5: the discrete Fourier transform of the N samples, read back from the record."""
    from procedures.rlg_magnetic_sensitivity.from_record import segment_of_unit
    from procedures.rlg_magnetic_sensitivity.published import plotted_spectrum

    with run.clock.allow(reading_back_s(planned.most, run.parameters.sample_interval_s)):
        segment = segment_of_unit(run.read_back(), planned.unit, run.parameters, run.bench)
        run.handed_on[planned.unit] = segment, plotted_spectrum(segment)


def draw(run: Run, planned: PlannedRecord) -> None:
    """S6: the curve y = 2|X[k]|/N against x = k/T, as a table in the run folder."""
    _, curve = run.handed_on[planned.unit]
    rows = zip(*curve, strict=True)
    lines = ["frequency_Hz,amplitude_deg_per_h", *(f"{x:.9g},{y:.9g}" for x, y in rows)]
    run.record.write_text(f"spectrum-{planned.unit}.csv", "\n".join(lines) + "\n")


def read_peak(run: Run, planned: PlannedRecord) -> None:
    """S7: the peak near each f divided by M, as published; the best estimate follows at the end."""
    from procedures.rlg_magnetic_sensitivity.published import published_value

    segment, _ = run.handed_on.pop(planned.unit)
    for axis in planned.energised:
        published = published_value(segment, axis)
        run.record.event("published-value", axis=axis, value=published.value, unit=published.unit)
        if published.value is not None:
            value = f"{published.value:.4f} {published.unit}"
            run.progress.say(f"    {axis}: as published |S| = {value}")


def preparation_s(parameters: RlgParameters, planned: PlannedRecord) -> float:
    """Return the bench time in s before a record: uploads, settling."""
    coils = len(planned.energised)
    return UPLOAD_S * coils + (parameters.settle_s if coils else 0.0)


def recording_s(parameters: RlgParameters, planned: PlannedRecord) -> float:
    """Return the bench time in s of a record at its longest, with the ramps to zero."""
    return planned.most * parameters.sample_interval_s + RAMP_DOWN_S * len(planned.energised)
