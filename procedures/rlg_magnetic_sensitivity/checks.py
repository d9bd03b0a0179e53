"""What the data deny: conditions as stated, an answer in proportion, a sound recorder."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procedures.common.constants import EARTH_RATE_DEG_PER_H
from procedures.estimation.flags import frozen
from procedures.estimation.frozen import repeated_rows, stuck_rows
from procedures.estimation.noise import grid_index
from procedures.estimation.recorder import (
    Beat,
    find_beat,
    folded_Hz,
    largest_jump,
    piled_up,
    resolution,
)
from station.findings import Flag, contradiction

from .dataset import AXES, LineDetail, Segment, SegmentDetail
from .field import FieldFit
from .frequencies import (
    FEWEST_CYCLES,
    FREQUENCY_RANGE_HZ,
    LARGEST_CYCLES_PER_SAMPLE,
    allowed_Hz,
    second_order,
    third_order,
)
from .gyro import GyroFit

AMPLITUDE_RANGE_MT = (0.1, 2.0)
TURNS_TOO_FAST = 3.0 * EARTH_RATE_DEG_PER_H
"""A mean output beyond three times the earth's rate is no gyro at rest."""
TOO_QUIET_DEG_PER_SQRT_H, TOO_SLOW_DEG_PER_H = 5e-5, 0.5
"""A tenth of the random walk of the best laser gyros, beside hardly any earth rate."""
INTERVAL_OFF = 0.01
OVERTONE_CHANCE = 1e-6
COARSE = 0.58
"""Scatter over a step of the output: with noise below half a step, rounding is no noise."""
COUNTED_OUT = 0.7
ANGLE_ROWS = 32
ROUNDING = 1e-3
ROUND_NUMBERS = (1.0, 1.25, 1.6, 2.0, 2.5, 4.0, 5.0, 8.0)
INTERVALS_S = tuple(round(m * 10.0**e, 6) for e in (-2, -1, 0) for m in ROUND_NUMBERS)


def condition_flags(segment: Segment) -> Iterator[Flag]:
    """Yield flags of a drive outside the published ranges and of statements that the data deny."""
    span_s = segment.recorded_span_s
    for axis, drive in segment.drive.items():
        if drive.amplitude_mT <= 0.0:
            continue
        cycles = drive.frequency_Hz * (span_s + segment.sample_interval_s)  # one may be lost
        held = (
            ("frequency", drive.frequency_Hz, *FREQUENCY_RANGE_HZ, "Hz"),
            ("amplitude", drive.amplitude_mT, *AMPLITUDE_RANGE_MT, "mT"),
            ("record", cycles, FEWEST_CYCLES, math.inf, "cycles"),
        )
        for what, value, low, high, unit in held:
            if not low * (1.0 - ROUNDING) <= value <= high * (1.0 + ROUNDING):
                span = f"{low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
                range_text = (
                    f"Outside the published range: {what} of {value:.4g} {unit} on {axis} "
                    f"(published {span} {unit}). The result stands, but is no result of the "
                    "published method."
                )
                yield Flag("outside-published-range", range_text, axis, {what: value})
    if len(segment.time_s) > 1:
        step_s = float(np.median(np.diff(segment.time_s)))
        if abs(step_s / segment.sample_interval_s - 1.0) > INTERVAL_OFF:
            interval_text = (
                f"The samples are {step_s:.4g} s apart; the stated sample interval is "
                f"{segment.sample_interval_s:g} s. Rates from counts and the correction for "
                "averaging go by the stated one: state what is true, or find the missing rows."
            )
            yield contradiction("sample_interval", interval_text, step_s=step_s)


def output_flags(segment: Segment, detail: SegmentDetail) -> Iterator[Flag]:
    """Yield flags of an output whose size says that its unit is another one."""
    used = segment.rate_deg_per_h[detail.kept]
    mean = float(np.mean(used)) if len(used) else 0.0
    column = "pulse_weight" if segment.quantum_deg_per_h else "rate_deg_per_h"
    walk = detail.residual_sigma_deg_per_h * math.sqrt(segment.sample_interval_s) / 60.0
    slow = abs(mean) < TOO_SLOW_DEG_PER_H and walk < TOO_QUIET_DEG_PER_SQRT_H
    if abs(mean) > TURNS_TOO_FAST or slow:
        unit_text = (
            f"The output's mean is {mean:.3g} deg/h and its noise {walk:.2g} deg/sqrt(h): no laser "
            "gyro at rest on the earth, which turns at 15 deg/h. Check the unit of the output, the "
            "pulse weight and the sample interval; the result has the same factor in it."
        )
        yield contradiction(column, unit_text, mean_deg_per_h=mean)


def collisions(segment: Segment) -> Iterator[Flag]:
    """Yield a flag for each driven line on which a product of second or third order falls."""
    driven = {a: d.frequency_Hz for a, d in segment.drive.items() if d.amplitude_mT > 0.0}
    span_s = segment.recorded_span_s
    for axis, f in driven.items():
        hits = [
            f"{name} ({g:.4g} Hz)"
            for name, g in (*second_order(driven), *third_order(driven))
            if abs(folded_Hz(g, segment.sample_interval_s) - f) * span_s < 1.0
        ]
        if hits:
            collides_text = (
                f"{', '.join(hits)} falls on the line of {axis} ({f:.4g} Hz): what gyro or coils "
                f"make of second or third order counts as sensitivity of {axis}, uncertainty "
                "aside. Drive at frequencies whose doubles, sums and differences stand apart."
            )
            yield Flag("lines-collide", collides_text, axis, {"products": hits})


def recorder_findings(
    segment: Segment, field: FieldFit, gyro: GyroFit, detail: SegmentDetail
) -> tuple[list[Flag], float]:
    """Return flags of what the recorder did, and the part of the result that it makes uncertain."""
    axis = detail.axis
    flags: list[Flag] = []
    doubt = 0.0
    kept = gyro.kept
    rate, sigma = segment.rate_deg_per_h[kept], gyro.residual_sigma_deg_per_h
    finite = np.isfinite(segment.rate_deg_per_h)
    step = max(resolution(segment.rate_deg_per_h[finite]), segment.quantum_deg_per_h)
    limited, filled = piled_up(rate, step, sigma, gyro.model_deg_per_h[kept])
    channels = [("output", limited)]
    for line in field.lines:
        for a in line.axes:
            values = segment.field_mT[~field.wild, AXES.index(a)]
            left_mT = math.sqrt(0.5 * len(values) * float(line.variance_mT2[AXES.index(a)]))
            channels.append((f"field on {a}", piled_up(values, resolution(values), left_mT)[0]))
    # A limit, or one value for many, takes no more of the slope than it takes of the samples.
    for part in [filled, *(cut for _, cut in channels)]:
        doubt = math.hypot(doubt, part / max(1.0 - part, 0.1) / math.sqrt(3.0))
    for name, cut in channels:
        if cut > 0.0:
            saturated_text = (
                f"{100.0 * cut:.2g} % of the samples of the {name} stand at its highest or lowest "
                "value: a limit of the instrument or its recorder cuts them. The uncertainty holds "
                "what that may take from the result. Choose a wider range and measure again."
            )
            flags.append(Flag("saturated", saturated_text, axis, {"part": cut, "channel": name}))
    if filled > 0.0:
        filled_flag = frozen(
            "One value of the output",
            f"{100.0 * filled:.2g} % of the samples",
            "the gyro",
            "The uncertainty holds what that may take from the result. Leave filled rows out and "
            "analyse again.",
            {"part": filled, "what": "output"},
            axis,
        )
        flags.append(filled_flag)
    coarse = step > 0.0 and sigma < COARSE * step
    if coarse and not _counted(segment, gyro, step):
        noise = math.sqrt(max((sigma / step) ** 2 - 1.0 / 12.0, 0.0))
        doubt = math.hypot(doubt, math.sqrt(2.0) * math.exp(-2.0 * (math.pi * noise) ** 2))
        coarse_text = (
            f"The output has steps of {step:.3g} deg/h, and its noise is smaller than half of one: "
            "its rounding follows the signal and does not average out. The uncertainty holds that. "
            "Record the output with more digits, or as counts."
        )
        flags.append(Flag("coarse-output", coarse_text, axis, {"step_deg_per_h": step}))
    if limited == filled == 0.0 and not coarse:
        flags += _stuck(segment, axis, step)
    return [*flags, *_jumps(segment, gyro, axis, step)], doubt


def _counted(segment: Segment, gyro: GyroFit, step: float) -> bool:
    """Whether rounding errors of the output take each other back: pulses of an angle, counted.

    Their sum over many samples then wanders less than they do alone; and successive ones differ in
    sign, or some are larger than half a step, as no rounding of a value for itself is.
    """
    index = grid_index(segment.time_s, segment.sample_interval_s)
    residual = np.zeros(int(index[-1]) + 1)
    residual[index[gyro.kept]] = gyro.residual_deg_per_h[gyro.kept]
    power = float(np.mean(residual**2))
    if power == 0.0:
        return False
    angle = np.cumsum(residual)
    if len(angle) < 4 * ANGLE_ROWS:
        return segment.quantum_deg_per_h > 0.0  # too short to tell: as it is stated
    wandered, next_to = (float(np.mean((angle[m:] - angle[:-m]) ** 2)) / m for m in (ANGLE_ROWS, 2))
    beyond = float(np.mean(np.abs(residual) > 0.7 * step))
    return wandered < COUNTED_OUT * power and (next_to < COUNTED_OUT * power or beyond > 0.02)


def _stuck(segment: Segment, axis: str | None, step: float) -> Iterator[Flag]:
    """Yield a flag of a stretch that was not measured."""
    stuck = stuck_rows(segment.rate_deg_per_h, step)
    if stuck is not None:
        first, last = stuck
        what, rows = "The output, or its slope,", f"rows {first} to {last}"
        details = {"row": first, "count": last - first + 1, "what": "output"}
    else:
        again = repeated_rows(segment.rate_deg_per_h, step)
        if again is None:
            return
        first, row, count = again
        what, rows = f"The output from row {first} on", f"rows {row} to {row + count - 1}"
        details = {"row": row, "count": count, "what": "repeated"}
    then = "Leave these rows out and analyse again."
    yield frozen(what, f"{rows}, counted from 0", "the gyro", then, details, axis)


def _jumps(segment: Segment, gyro: GyroFit, axis: str | None, step: float) -> Iterator[Flag]:
    """Yield a flag of a mean that jumps."""
    slowest_Hz = min(drive.frequency_Hz for drive in segment.drive.values())
    period = 1.0 / (slowest_Hz * segment.sample_interval_s)
    jump = largest_jump(gyro.residual_deg_per_h[gyro.kept], period, step)
    if jump is not None:
        row, size = int(np.flatnonzero(gyro.kept)[jump[0]]), jump[1]
        jump_text = (
            f"At about row {row}, counted from 0, the output steps by {size:+.3g} deg/h. The "
            "uncertainty follows the data; look at gyro, cables and recorder, and measure again."
        )
        yield Flag("output-step", jump_text, axis, {"row": row, "step_deg_per_h": size})


def overtone_flags(segment: Segment, gyro: GyroFit, detail: SegmentDetail) -> Iterator[Flag]:
    """Yield a flag for each line whose third harmonic is there, unless rounding makes one."""
    walk = detail.noise.angle_random_walk_deg_per_sqrt_h if detail.noise else 0.0
    tau_s = segment.sample_interval_s
    mean = float(np.mean(segment.rate_deg_per_h[gyro.kept]))
    span_s = len(segment.time_s) * tau_s
    for overtone in gyro.overtones:
        if overtone.chance > OVERTONE_CHANCE:
            continue
        weight = segment.quantum_deg_per_h * tau_s
        lines = (overtone.frequency_Hz, overtone.driven_Hz)
        if weight > 0.0 and find_beat(mean, weight, tau_s, walk, lines, span_s) is not None:
            continue
        axes = [
            a
            for a, d in segment.drive.items()
            if math.isclose(d.frequency_Hz, overtone.driven_Hz, rel_tol=0.02)
        ]
        overtone_text = (
            f"The output has a line at {overtone.frequency_Hz:.4g} Hz, three times the frequency "
            f"of {' and '.join(axes)}, with {overtone.power:.3g} times the power of the noise: the "
            "answer is not in proportion to the field, as that of a shield near saturation, a "
            "limited output or bursts. State the sensitivity with its field, and measure at half "
            "of it."
        )
        details = {"frequency_Hz": overtone.frequency_Hz}
        yield Flag("not-linear", overtone_text, axes[0] if len(axes) == 1 else None, details)


@dataclass(frozen=True)
class BeatAdvice:
    """What a beat does, in a sentence, and what would help, in words and as plain data."""

    does: str
    helps: str
    details: Mapping[str, object]


def beat_advice(
    rate_deg_per_h: float,
    pulse_arcsec: float,
    interval_s: float,
    walk_deg_per_sqrt_h: float,
    driven_Hz: Sequence[float],
    span_s: float,
) -> BeatAdvice | None:
    """Return what to know of a beat of counted pulses, None where none does harm.

    It proposes the nearest frequency and the nearest sample interval at which there is none.
    """

    def beat_at(tau_s: float, lines_Hz: Sequence[float]) -> Beat | None:
        return find_beat(rate_deg_per_h, pulse_arcsec, tau_s, walk_deg_per_sqrt_h, lines_Hz, span_s)

    beat = beat_at(interval_s, driven_Hz)
    if beat is None:
        return None
    offers: list[str] = []
    details: dict[str, object] = {"harmonic": beat.harmonic, "beat_Hz": beat.frequency_Hz}
    does = "stands still and follows the signal"
    if beat.line_Hz is not None:
        near_Hz = beat.line_Hz
        does = f"beats at {beat.frequency_Hz:.4g} Hz with the field"
        clear = [f for f in allowed_Hz(span_s, interval_s) if beat_at(interval_s, [f]) is None]
        if clear:
            best_Hz = min(clear, key=lambda f: abs(f - near_Hz))
            offers.append(f"a frequency of {best_Hz:.3g} Hz")
            details["frequency_Hz"] = best_Hz
    intervals = [
        tau_s
        for tau_s in INTERVALS_S
        if tau_s * max(driven_Hz) <= LARGEST_CYCLES_PER_SAMPLE and beat_at(tau_s, driven_Hz) is None
    ]
    if intervals:
        best_s = min(intervals, key=lambda tau_s: abs(np.log(tau_s / interval_s)))
        offers.append(f"a sample interval of {best_s:g} s")
        details["sample_interval_s"] = best_s
    offers.append("another azimuth of the base")
    pulses = rate_deg_per_h * interval_s / pulse_arcsec
    return BeatAdvice(
        f"the output makes {pulses:.4g} pulses an interval: their rounding {does}, which may add "
        f"up to {beat.amplitude_deg_per_h:.2g} deg/h to the line or take it away, uncertainty "
        "aside",
        " or ".join(offers),
        details,
    )


def beat_flags(
    segment: Segment, detail: SegmentDetail, lines: Sequence[LineDetail]
) -> Iterator[Flag]:
    """Yield a flag where the rounding of pulses beats next to a driven line or stands still."""
    if segment.quantum_deg_per_h <= 0.0 or detail.noise is None or not lines:
        return
    interval_s = segment.sample_interval_s
    beat = beat_advice(
        float(np.mean(segment.rate_deg_per_h[detail.kept])),
        segment.quantum_deg_per_h * interval_s,
        interval_s,
        detail.noise.angle_random_walk_deg_per_sqrt_h,
        [line.frequency_Hz for line in lines],
        len(segment.time_s) * interval_s,
    )
    if beat is not None:
        quantisation_text = f"In the record, {beat.does}. Measure again with {beat.helps}."
        yield Flag(
            "quantisation-beat",
            quantisation_text,
            detail.axis,
            beat.details,
        )
