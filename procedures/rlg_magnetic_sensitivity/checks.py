"""What the data deny: conditions as stated, an answer in proportion, a sound recorder."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from procedures.estimation.noise import grid_index
from procedures.estimation.quantisation import find_beat, folded_Hz
from procedures.estimation.recorder import (
    largest_jump,
    piled_up,
    repeated_rows,
    resolution,
    stuck_rows,
)
from station.findings import Flag

from .dataset import AXES, Segment
from .field import FieldFit
from .findings import SegmentDetail
from .flags import recorded_span_s
from .frequencies import FEWEST_CYCLES, FREQUENCY_RANGE_HZ, second_order, third_order
from .gyro import GyroFit

AMPLITUDE_RANGE_MT = (0.1, 2.0)
EARTH_RATE_DEG_PER_H = 15.041
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


def condition_flags(segment: Segment) -> Iterator[Flag]:
    """Yield flags of a drive outside the published ranges and of statements that the data deny."""
    span_s = recorded_span_s(segment)
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
                range_said = (
                    f"Outside the published range: {what} of {value:.4g} {unit} on {axis} "
                    f"(published {span} {unit}). The result stands, but is no result of the "
                    "published method."
                )
                yield Flag("outside-published-range", range_said, axis, {what: value})
    if len(segment.time_s) > 1:
        step_s = float(np.median(np.diff(segment.time_s)))
        if abs(step_s / segment.sample_interval_s - 1.0) > INTERVAL_OFF:
            interval_said = (
                f"The samples are {step_s:.4g} s apart; the stated sample interval is "
                f"{segment.sample_interval_s:g} s. Rates from counts and the correction for "
                "averaging go by the stated one: state what is true, or find the missing rows."
            )
            details = {"statement": "sample_interval", "step_s": step_s}
            yield Flag("contradicts-statement", interval_said, None, details)


def output_flags(segment: Segment, detail: SegmentDetail) -> Iterator[Flag]:
    """Yield flags of an output whose size says that its unit is another one."""
    used = segment.rate_deg_per_h[detail.kept]
    mean = float(np.mean(used)) if len(used) else 0.0
    column = "pulse_weight" if segment.quantum_deg_per_h else "rate_deg_per_h"
    walk = detail.residual_sigma_deg_per_h * math.sqrt(segment.sample_interval_s) / 60.0
    slow = abs(mean) < TOO_SLOW_DEG_PER_H and walk < TOO_QUIET_DEG_PER_SQRT_H
    if abs(mean) > TURNS_TOO_FAST or slow:
        unit_said = (
            f"The output's mean is {mean:.3g} deg/h and its noise {walk:.2g} deg/sqrt(h): no laser "
            "gyro at rest on the earth, which turns at 15 deg/h. Check the unit of the output, the "
            "pulse weight and the sample interval; the result has the same factor in it."
        )
        details = {"statement": column, "mean_deg_per_h": mean}
        yield Flag("contradicts-statement", unit_said, None, details)


def collisions(segment: Segment) -> Iterator[Flag]:
    """Yield a flag for each driven line on which a product of second or third order falls."""
    driven = {a: d.frequency_Hz for a, d in segment.drive.items() if d.amplitude_mT > 0.0}
    span_s = recorded_span_s(segment)
    for axis, f in driven.items():
        hits = [
            f"{name} ({g:.4g} Hz)"
            for name, g in (*second_order(driven), *third_order(driven))
            if abs(folded_Hz(g, segment.sample_interval_s) - f) * span_s < 1.0
        ]
        if hits:
            collides_said = (
                f"{', '.join(hits)} falls on the line of {axis} ({f:.4g} Hz): what gyro or coils "
                f"make of second or third order counts as sensitivity of {axis}, uncertainty "
                "aside. Drive at frequencies whose doubles, sums and differences stand apart."
            )
            yield Flag("lines-collide", collides_said, axis, {"products": hits})


def recorder_findings(
    segment: Segment, field: FieldFit, gyro: GyroFit, detail: SegmentDetail
) -> tuple[list[Flag], float]:
    """Return flags of what the recorder did, and the part of the result that it makes uncertain."""
    axis = detail.axes[0] if len(detail.axes) == 1 else None
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
            saturated_said = (
                f"{100.0 * cut:.2g} % of the samples of the {name} stand at its highest or lowest "
                "value: a limit of the instrument or its recorder cuts them. The uncertainty holds "
                "what that may take from the result. Choose a wider range and measure again."
            )
            flags.append(Flag("saturated", saturated_said, axis, {"part": cut, "channel": name}))
    if filled > 0.0:
        filled_said = (
            f"{100.0 * filled:.2g} % of the samples of the output have one and the same value: "
            "missing ones were filled in, or the output rests there. The uncertainty holds what "
            "that may take from the result. Leave filled rows out and analyse again."
        )
        flags.append(Flag("frozen", filled_said, axis, {"part": filled, "what": "output"}))
    coarse = step > 0.0 and sigma < COARSE * step
    if coarse and not _counted(segment, gyro, step):
        noise = math.sqrt(max((sigma / step) ** 2 - 1.0 / 12.0, 0.0))
        doubt = math.hypot(doubt, math.sqrt(2.0) * math.exp(-2.0 * (math.pi * noise) ** 2))
        coarse_said = (
            f"The output has steps of {step:.3g} deg/h, and its noise is smaller than half of one: "
            "its rounding follows the signal and does not average out. The uncertainty holds that. "
            "Record the output with more digits, or as counts."
        )
        flags.append(Flag("coarse-output", coarse_said, axis, {"step_deg_per_h": step}))
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
        stuck_said = (
            f"From row {first} to row {last}, counted from 0, the output is a straight line to the "
            "last digit: the gyro or its recorder stood still, or missing rows were filled in. "
            "Leave these rows out and analyse again."
        )
        details = {"row": first, "count": last - first + 1, "what": "output"}
        yield Flag("frozen", stuck_said, axis, details)
        return
    again = repeated_rows(segment.rate_deg_per_h, step)
    if again is not None:
        first, row, count = again
        repeated_said = (
            f"{count} rows of the output from row {row} on, counted from 0, repeat those from row "
            f"{first} on to the last digit: a buffer was read twice or rows were copied. Leave "
            "these rows out and analyse again."
        )
        details = {"row": row, "count": count, "what": "repeated"}
        yield Flag("frozen", repeated_said, axis, details)


def _jumps(segment: Segment, gyro: GyroFit, axis: str | None, step: float) -> Iterator[Flag]:
    """Yield a flag of a mean that jumps."""
    slowest_Hz = min(drive.frequency_Hz for drive in segment.drive.values())
    period = 1.0 / (slowest_Hz * segment.sample_interval_s)
    jump = largest_jump(gyro.residual_deg_per_h[gyro.kept], period, step)
    if jump is not None:
        row, size = int(np.flatnonzero(gyro.kept)[jump[0]]), jump[1]
        jump_said = (
            f"At about row {row}, counted from 0, the output steps by {size:+.3g} deg/h. The "
            "uncertainty follows the data; look at gyro, cables and recorder, and measure again."
        )
        yield Flag("output-step", jump_said, axis, {"row": row, "step_deg_per_h": size})


def overtone_flags(segment: Segment, gyro: GyroFit, detail: SegmentDetail) -> Iterator[Flag]:
    """Yield a flag for each line whose third harmonic is there, unless rounding makes one."""
    walk = detail.noise.angle_random_walk_deg_per_sqrt_h if detail.noise else 0.0
    tau_s = segment.sample_interval_s
    mean = float(np.mean(segment.rate_deg_per_h[gyro.kept]))
    span_s = len(segment.time_s) * tau_s
    for one in gyro.overtones:
        if one.chance > OVERTONE_CHANCE:
            continue
        weight = segment.quantum_deg_per_h * tau_s
        lines = (one.frequency_Hz, one.driven_Hz)
        if weight > 0.0 and find_beat(mean, weight, tau_s, walk, lines, span_s) is not None:
            continue
        axes = [
            a
            for a, d in segment.drive.items()
            if math.isclose(d.frequency_Hz, one.driven_Hz, rel_tol=0.02)
        ]
        overtone_said = (
            f"The output has a line at {one.frequency_Hz:.4g} Hz, three times the frequency of "
            f"{' and '.join(axes)}, with {one.power:.3g} times the power of the noise: the answer "
            "is not in proportion to the field, as that of a shield near saturation, a limited "
            "output or bursts. State the sensitivity with its field, and measure at half of it."
        )
        details = {"frequency_Hz": one.frequency_Hz}
        yield Flag("not-linear", overtone_said, axes[0] if len(axes) == 1 else None, details)
