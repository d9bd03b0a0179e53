"""S3, first part: the gyro is switched on and waited for until its output is steady."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from procedures.rlg_magnetic_sensitivity.records import (
    all_records,
    reading_back_s,
    sensitivity_records,
)
from station.errors import ConditionNotReached

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from station.runner.run import Run

GYRO = "gyro_acquisition"
POWER = "dut_power"
WARM_UP = "warm-up"
WARM_UP_LOOKS_EVERY_S = 30.0


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


def warm_up(run: Run) -> None:
    """S3, first part: gyro on, and wait until its output is steady.

    Raises ConditionNotReached when |slope| + 2 u stays above the plan's limit for too long.
    """
    from procedures.estimation.slope import slope_with_uncertainty
    from procedures.rlg_magnetic_sensitivity.from_record import gyro_record
    from station.roles import DutPower, GyroAcquisition
    from station.runner.acquisition import acquire

    parameters: RlgParameters = run.parameters
    if all(run.is_finished(record.unit) for record in all_records(parameters)):
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
        rows = round(elapsed_s / parameters.sample_interval_s)
        with run.clock.allow(reading_back_s(rows, parameters.sample_interval_s)):
            record = gyro_record(run.read_back(), WARM_UP, parameters, run.bench)
        recent = record.time_s > record.time_s[-1] - rule.window_s
        rate_deg_per_h = record.rate_deg_per_h[recent]
        slope, u = slope_with_uncertainty(record.time_s[recent], rate_deg_per_h)
        slope_deg_per_h2, u_deg_per_h2 = 3600 * slope, 3600 * u
        said = f"slope {slope_deg_per_h2:+.3f} ± {2 * u_deg_per_h2:.3f} deg/h^2"
        if abs(slope_deg_per_h2) + 2 * u_deg_per_h2 < rule.slope_limit_deg_per_h2:
            run.record.finish_unit(WARM_UP, slope_deg_per_h2=slope_deg_per_h2, u=u_deg_per_h2)
            run.progress.say(f"    warm: {said}")
            warn_of_beats(run, rate_deg_per_h, record.interval_s)
            return
        if elapsed_s >= rule.at_most_s:
            raise ConditionNotReached(
                f"the gyro did not become steady within {rule.at_most_s / 60:g} min: {said}, the "
                f"plan allows {rule.slope_limit_deg_per_h2:g}; wait longer (warm_up.at_most), or "
                "look for air currents, a warming table or a gyro that was just carried in"
            )


def warn_of_beats(run: Run, rate_deg_per_h: NDArray[Any], interval_s: float) -> None:
    """Say before anything is driven that pulses counted at this mean rate would harm a result."""
    from procedures.estimation.allan import allan_deviation, noise_coefficients
    from procedures.rlg_magnetic_sensitivity.pulse_beat import advice

    parameters: RlgParameters = run.parameters
    noise = noise_coefficients(allan_deviation(rate_deg_per_h, interval_s))
    if noise is None:
        return
    planned = sensitivity_records(parameters)[0]
    told = advice(
        float(rate_deg_per_h.mean()),
        parameters.pulse_weight_arcsec,
        parameters.sample_interval_s,
        noise.angle_random_walk_deg_per_sqrt_h,
        [sine.frequency_Hz for sine in planned.drive.values()],
        planned.samples * parameters.sample_interval_s,
    )
    if told is not None:
        run.progress.say(f"    WARNING: {told.does}; better: {told.helps}")


def expected_warm_up_s(parameters: RlgParameters) -> float:
    """Return the bench time in s that the warm-up is expected to take."""
    return 1.3 * parameters.warm_up.window_s
