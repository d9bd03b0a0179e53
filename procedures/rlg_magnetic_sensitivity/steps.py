"""S1 to S9 of the laser-gyro bias magnetic-sensitivity method, with the source's own numbers.

Source: "a method to accurately measure the magnetic-field sensitivity of the bias of a laser
gyro", steps S1-S9. S3 is split: the source asks for a warm gyro before its field is switched on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from procedures.rlg_magnetic_sensitivity.parameters import COIL_OF_AXIS, RlgParameters
from station.errors import ConditionNotReached, InstrumentError
from station.procedure import Prompt, Step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.runner.run import Run

GYRO = "gyro_acquisition"
GAUSSMETER = "gaussmeter"
POWER = "dut_power"
WARM_UP = "warm-up"
WARM_UP_LOOKS_EVERY_S = 30.0
UPLOAD_S = 5.0
RAMP_DOWN_S = 6.0
FIELD_HEADROOM = 1.5
"""The gaussmeter's range covers the amplitude and the ambient field."""

MOUNT = Prompt(
    "mount",
    "Mount the gyro on its non-magnetic base in the centre of the three-axis Helmholtz coil, "
    "IA, NA and LA parallel to the normals of coils X, Y and Z; set the field probe beside it.",
)
CABLES = Prompt(
    "connect-cables",
    "Connect the gyro to its acquisition board and each coil to its supply.",
)


def coil_supply(axis: str) -> str:
    """Return the supply whose coil drives a gyro axis."""
    return f"coil_supply.{COIL_OF_AXIS[axis]}"


def instruments(parameters: RlgParameters) -> tuple[str, ...]:
    """Return the bench instances the plan needs."""
    return (*(coil_supply(axis) for axis in parameters.axes), GAUSSMETER, GYRO, POWER)


def units(parameters: RlgParameters) -> tuple[str, ...]:
    """Return the units of work in the order they are measured: the warm-up, then each axis."""
    return (WARM_UP, *parameters.axes)


def prompts(parameters: RlgParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    return (MOUNT, CABLES)


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


@dataclass(frozen=True)
class Look:
    """When the next look at the warm-up is due, and what the last one said."""

    due_s: float
    now: Callable[[], float]
    said: str

    def due(self, newest: Mapping[str, NDArray[Any]]) -> bool:
        """Whether it is time to look again."""
        return self.now() >= self.due_s

    def detail(self) -> str:
        """What the technician reads meanwhile."""
        return self.said


def mount(run: Run) -> None:
    """S1: gyro in the centre of the coil, axes along the coils' normals."""
    run.ask(MOUNT.id, MOUNT.text)


def connect(run: Run) -> None:
    """S2: cables; every instrument was identified, now each supply gets its own limits."""
    from drivers.roles import CoilSupply

    run.ask(CABLES.id, CABLES.text)
    for axis in run.parameters.axes:
        run.role(coil_supply(axis), CoilSupply).programme_limits()


def warm_up(run: Run) -> None:
    """S3, first part: gyro on, and wait until its output is steady.

    Raises ConditionNotReached when |slope| + 2 u stays above the plan's limit for too long.
    """
    from drivers.roles import DutPower, GyroAcquisition
    from procedures.estimation.slope import slope_with_uncertainty
    from procedures.rlg_magnetic_sensitivity.from_record import gyro_rates
    from station.runner.acquisition import acquire

    parameters: RlgParameters = run.parameters
    if all(run.is_finished(axis) for axis in parameters.axes):
        return
    rule = parameters.warm_up
    run.role(POWER, DutPower).switch_on()
    board = run.role(GYRO, GyroAcquisition)
    board.start(parameters.sample_interval_s, parameters.channel)
    began_s = run.clock.now()
    said = "filling the window"
    while True:
        look = Look(run.clock.now() + WARM_UP_LOOKS_EVERY_S, run.clock.now, said)
        acquire(run, WARM_UP, {GYRO: board}, enough=look.due, detail=look.detail)
        elapsed_s = run.clock.now() - began_s
        if elapsed_s < rule.window_s:
            continue
        time_s, rate_deg_per_h = gyro_rates(run.read_back(), WARM_UP, parameters)
        recent = time_s > time_s[-1] - rule.window_s
        slope, u = slope_with_uncertainty(time_s[recent], rate_deg_per_h[recent])
        slope_deg_per_h2, u_deg_per_h2 = 3600 * slope, 3600 * u
        said = f"slope {slope_deg_per_h2:+.3f} ± {2 * u_deg_per_h2:.3f} deg/h^2"
        if abs(slope_deg_per_h2) + 2 * u_deg_per_h2 < rule.slope_limit_deg_per_h2:
            run.record.finish_unit(WARM_UP, slope_deg_per_h2=slope_deg_per_h2, u=u_deg_per_h2)
            run.progress.say(f"    warm: {said}")
            return
        if elapsed_s >= rule.at_most_s:
            raise ConditionNotReached(
                f"the gyro did not become steady within {rule.at_most_s / 60:g} min: {said}, the "
                f"plan allows {rule.slope_limit_deg_per_h2:g}; wait longer (warm_up.at_most), or "
                "look for air currents, a warming table or a gyro that was just carried in"
            )


def drive(run: Run, axis: str) -> None:
    """S3: the coil of `axis` produces a sine of frequency f and amplitude M."""
    from drivers.roles import CoilSupply, Gaussmeter

    parameters: RlgParameters = run.parameters
    if run.is_finished(axis):
        run.progress.say(f"    {axis}: measured before the run was interrupted")
        return
    run.may_pause()
    supply = run.role(coil_supply(axis), CoilSupply)
    run.role(GAUSSMETER, Gaussmeter).start(FIELD_HEADROOM * parameters.amplitude_mT)
    amplitude_A = parameters.amplitude_mT / supply.coil_constant_mT_per_A
    given_Hz = supply.load_sine(parameters.drive_frequency_Hz, amplitude_A)
    supply.start_sine()
    run.record.event(
        "field-on", axis=axis, amplitude_A=amplitude_A, frequency_Hz=given_Hz, durable=True
    )
    run.wait(parameters.settle_s, f"{axis}: the field settles")


def record(run: Run, axis: str) -> None:
    """S4: N samples of the gyro at tau0, the field measured beside it; then the field goes off."""
    from drivers.roles import CoilSupply, Gaussmeter, GyroAcquisition
    from station.runner.acquisition import acquire

    parameters: RlgParameters = run.parameters
    if run.is_finished(axis):
        return
    board = run.role(GYRO, GyroAcquisition)
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    board.drain()
    gaussmeter.drain()
    counter = SampleCounter(parameters.samples)
    with run.unit(
        axis,
        frequency_Hz=parameters.drive_frequency_Hz,
        amplitude_mT=parameters.amplitude_mT,
        samples=parameters.samples,
        field_averaging_s=gaussmeter.averaging_s,
        field_timestamp=gaussmeter.timestamp,
    ):
        acquire(
            run,
            axis,
            {GYRO: board, GAUSSMETER: gaussmeter},
            enough=counter.enough,
            detail=lambda: f"{axis}: {counter.counted} of {counter.wanted} samples",
        )
    run.role(coil_supply(axis), CoilSupply).stop()
    run.record.event("field-off", axis=axis)


def transform(run: Run, axis: str) -> None:
    """S5: the discrete Fourier transform of the N samples, read back from the record."""
    from procedures.rlg_magnetic_sensitivity.from_record import segment_of_unit
    from procedures.rlg_magnetic_sensitivity.published import plotted_spectrum

    segment = segment_of_unit(run.read_back(), axis, run.parameters, run.bench)
    run.handed_on[axis] = segment, plotted_spectrum(segment)


def draw(run: Run, axis: str) -> None:
    """S6: the curve y = 2|X[k]|/N against x = k/T, as a table in the run folder."""
    _, curve = run.handed_on[axis]
    rows = zip(*curve, strict=True)
    lines = ["frequency_Hz,amplitude_deg_per_h", *(f"{x:.9g},{y:.9g}" for x, y in rows)]
    run.record.write_text(f"spectrum-{axis}.csv", "\n".join(lines) + "\n")


def read_peak(run: Run, axis: str) -> None:
    """S7: the peak near f divided by M, as published; the best estimate follows at the end."""
    from procedures.rlg_magnetic_sensitivity.published import published_value

    segment, _ = run.handed_on.pop(axis)
    published = published_value(segment, axis)
    run.record.event("published-value", axis=axis, value=published.value, unit=published.unit)
    if published.value is not None:
        run.progress.say(f"    {axis}: as published |S| = {published.value:.4f} {published.unit}")


def repeat(run: Run) -> None:
    """S8: S3 to S7 again for the other coils."""
    for axis in run.parameters.axes[1:]:
        for part in (drive, record, transform, draw, read_peak):
            part(run, axis)


def switch_off(run: Run) -> None:
    """S9: coils off, read back; then the gyro off.

    Raises InstrumentError when a coil's supply does not read back as off.
    """
    from drivers.roles import CoilSupply, DutPower, GyroAcquisition

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


def first(part: Any) -> Any:
    """Return a step body that does `part` for the plan's first axis."""

    def body(run: Run) -> None:
        part(run, run.parameters.axes[0])

    body.__doc__ = part.__doc__
    return body


def expected_warm_up_s(parameters: RlgParameters) -> float:
    """Return the bench time in s that the warm-up is expected to take."""
    return 1.3 * parameters.warm_up.window_s


def record_s(parameters: RlgParameters) -> float:
    """Return the bench time in s of one axis: upload, settling, record, ramp down."""
    recorded_s = parameters.samples * parameters.sample_interval_s
    return UPLOAD_S + parameters.settle_s + recorded_s + RAMP_DOWN_S


STEPS = (
    Step("S1", "Mount the gyro in the centre of the coil", mount, lambda _: 0.0),
    Step("S2", "Connect the cables, identify the instruments", connect, lambda _: 1.0),
    Step("S3.1", "Switch the gyro on and warm it up", warm_up, expected_warm_up_s),
    Step(
        "S3.2",
        "Drive coil X with a sine of frequency f and amplitude M",
        first(drive),
        lambda p: UPLOAD_S + p.settle_s,
    ),
    Step(
        "S4",
        "Record N samples of the gyro, and the field",
        first(record),
        lambda p: p.samples * p.sample_interval_s + RAMP_DOWN_S,
    ),
    Step("S5", "Transform the record", first(transform), lambda _: 0.0),
    Step("S6", "Draw the spectrum 2|X|/N against k/T", first(draw), lambda _: 0.0),
    Step("S7", "Read the peak near f, divide by M", first(read_peak), lambda _: 0.0),
    Step(
        "S8",
        "Repeat S3 to S7 for coils Y and Z",
        repeat,
        lambda p: (len(p.axes) - 1) * record_s(p),
    ),
    Step("S9", "Switch the coils and the gyro off", switch_off, lambda _: 1.0),
)
