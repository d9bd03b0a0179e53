"""What the data of a record deny: its statements, an answer in proportion, a sound recorder."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procedures.common.constants import EARTH_RATE_DEG_PER_H
from procedures.common.frozen import frozen_flag, repeated_rows, stuck_rows
from procedures.estimation.flags import Gaps, gaps_of, too_stiff
from procedures.estimation.noise import grid_index
from procedures.estimation.plausibility import Bounds, implausible
from procedures.estimation.recorder import (
    Beat,
    find_beat,
    folded_Hz,
    largest_jump,
    piled_up,
    resolution,
)
from station.findings import Flag

from .dataset import AXES, Segment
from .fitted import FittedRecord
from .frequencies import (
    FEWEST_CYCLES,
    FREQUENCY_RANGE_HZ,
    LARGEST_CYCLES_PER_SAMPLE,
    allowed_Hz,
    loss,
    second_order,
    third_order,
)
from .parameters import AMPLITUDE_RANGE_MT, AnalysisSettings

TURNS_TOO_FAST = 3.0 * EARTH_RATE_DEG_PER_H
"""A mean output beyond three times the earth's rate is no gyro at rest."""
TOO_QUIET_DEG_PER_SQRT_H, TOO_SLOW_DEG_PER_H = 5e-5, 0.5
"""A tenth of the random walk of the best laser gyros, beside hardly any earth rate."""
MAX_WALK_DEG_PER_SQRT_H = 1e3
INTERVAL_OFF = 0.01
OVERTONE_CHANCE = 1e-6
COARSE = 0.58
"""Scatter over a step of the output: with noise below half a step, rounding is no noise."""
COUNTED_OUT = 0.7
ANGLE_ROWS = 32
ROUNDING = 1e-3
ROUND_NUMBERS = (1.0, 1.25, 1.6, 2.0, 2.5, 4.0, 5.0, 8.0)
INTERVALS_S = tuple(round(m * 10.0**e, 6) for e in (-2, -1, 0) for m in ROUND_NUMBERS)
UNIT_LOOK = (
    "No laser gyro at rest on the earth, which turns at 15 deg/h, has such an output. Check its "
    "unit, the pulse weight and the sample interval; the result has the same factor in it."
)
INTERVAL_LOOK = (
    "Rates from counts and the correction for averaging go by the stated interval: state what is "
    "true, or find the missing rows."
)


def statement_flags(record: FittedRecord) -> Iterator[Flag]:
    """Yield flags of a drive outside the published ranges and of statements that the data deny."""
    segment, interval_s = record.segment, record.segment.sample_interval_s
    for axis, drive in segment.drive.items():
        if drive.amplitude_mT <= 0.0:
            continue
        cycles = drive.frequency_Hz * (segment.recorded_span_s + interval_s)  # one may be lost
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
        allowed_s = ((1.0 - INTERVAL_OFF) * interval_s, (1.0 + INTERVAL_OFF) * interval_s)
        apart = Bounds(
            "sample_interval", "The time between samples", *allowed_s, "s", INTERVAL_LOOK
        )
        yield from implausible(step_s, apart)
    column = "pulse_weight" if segment.quantum_deg_per_h else "rate_deg_per_h"
    at_rest = Bounds(column, "The mean output", -TURNS_TOO_FAST, TURNS_TOO_FAST, "deg/h", UNIT_LOOK)
    yield from implausible(record.mean_deg_per_h, at_rest)
    walk = record.gyro.residual_sigma_deg_per_h * math.sqrt(interval_s) / 60.0
    if abs(record.mean_deg_per_h) < TOO_SLOW_DEG_PER_H and record.fitted:
        low, high = TOO_QUIET_DEG_PER_SQRT_H, MAX_WALK_DEG_PER_SQRT_H
        noise = Bounds(column, "The output's noise", low, high, "deg/sqrt(h)", UNIT_LOOK)
        yield from implausible(walk, noise)


def record_flags(record: FittedRecord, settings: AnalysisSettings) -> Iterator[Flag]:
    """Yield the flags of a record's samples and of the model fitted to it."""
    segment, gyro, before = record.segment, record.gyro, record.segment.averaged
    axis, named = record.axis, record.named
    rejected, samples = int(np.sum(~gyro.kept)), len(gyro.kept)
    if before:
        rejected, samples = rejected + before.rejected, before.samples
        highest_Hz = max((driven.frequency_Hz for driven in segment.drive.values()), default=0.0)
        lost = loss(before.group, before.sample_interval_s, highest_Hz)
        samples_text = (
            f"The record with {named} driven holds {samples} gyro samples, which were averaged in "
            f"groups of {before.group}: it is evaluated as if sampled every "
            f"{segment.sample_interval_s:g} s, with an uncertainty up to {100.0 * lost:.2g} % "
            "larger."
        )
        details = {"count": samples, "group": before.group, "relative_loss": lost}
        yield Flag("samples-averaged", samples_text, axis, details)
    if rejected:
        outliers_text = (
            f"{rejected} of {samples} gyro samples of the record with {named} driven lie more than "
            f"{settings.outlier:g} sigma from the fit and were left out."
        )
        yield Flag("outliers-rejected", outliers_text, axis, {"count": rejected})
    if before:
        interval_s = before.sample_interval_s
        gaps = Gaps(before.gaps, before.places - before.samples, before.longest_gap_s)
    else:
        interval_s = segment.sample_interval_s
        gaps = gaps_of(segment.time_s, interval_s, settings.gap)
        gaps = replace(gaps, missing=segment.places - len(segment.time_s) if gaps.count else 0)
    consequence = "the fit uses the time stamps"
    if gaps.missing:
        consequence = (
            "the fit uses the time stamps, the published formula needs an unbroken row and was not "
            "evaluated"
        )
    yield from gaps.flags(f"The record with {named} driven has", interval_s, consequence, axis)
    if gyro.lag_one_correlation > settings.model_too_stiff:
        yield too_stiff(gyro.lag_one_correlation, f" of the record with {named} driven", axis=axis)
    if gyro.drift_evident:
        drift_text = (
            f"The output drifted in the record with {named} driven; a polynomial of order "
            f"{gyro.drift_order} was fitted with the lines and removed."
        )
        yield Flag("drift-removed", drift_text, axis, {"order": gyro.drift_order})


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


def recorder_findings(record: FittedRecord) -> tuple[list[Flag], float]:
    """Return flags of what gyro and recorder did, and the part of the result that is in doubt."""
    if not record.fitted:
        return [], 0.0
    segment, field, gyro, axis = record.segment, record.field, record.gyro, record.axis
    flags: list[Flag] = []
    kept, rate, sigma = gyro.kept, segment.rate_deg_per_h, gyro.residual_sigma_deg_per_h
    step = max(resolution(rate[np.isfinite(rate)]), segment.quantum_deg_per_h)
    limited, filled = piled_up(rate[kept], step, sigma, gyro.model_deg_per_h[kept])
    channels = {"output": limited}
    for line in field.lines:
        for a in line.axes:
            values = segment.field_mT[~field.wild, AXES.index(a)]
            left_mT = math.sqrt(0.5 * len(values) * float(line.variance_mT2[AXES.index(a)]))
            channels[f"field on {a}"] = piled_up(values, resolution(values), left_mT)[0]
    for name, cut in channels.items():
        if cut > 0.0:
            saturated_text = (
                f"{100.0 * cut:.2g} % of the samples of the {name} stand at its highest or lowest "
                "value: a limit of the instrument or its recorder cuts them. The uncertainty holds "
                "what that may take from the result. Choose a wider range and measure again."
            )
            flags.append(Flag("saturated", saturated_text, axis, {"part": cut, "channel": name}))
    # A limit, or one value for many, takes no more of the slope than it takes of the samples.
    parts = [part / max(1.0 - part, 0.1) / math.sqrt(3.0) for part in (filled, *channels.values())]
    rounded = step > 0.0 and sigma < COARSE * step
    if rounded and not _counted(record, step):
        noise = math.sqrt(max((sigma / step) ** 2 - 1.0 / 12.0, 0.0))
        parts.append(math.sqrt(2.0) * math.exp(-2.0 * (math.pi * noise) ** 2))
        coarse_text = (
            f"The output has steps of {step:.3g} deg/h, and its noise is smaller than half of one: "
            "its rounding follows the signal and does not average out. The uncertainty holds that. "
            "Record the output with more digits, or as counts."
        )
        flags.append(Flag("coarse-output", coarse_text, axis, {"step_deg_per_h": step}))
    if filled > 0.0 or (limited == 0.0 and not rounded):
        flags += _frozen(record, filled, step)
    slowest_Hz = min(drive.frequency_Hz for drive in segment.drive.values())
    period = 1.0 / (slowest_Hz * segment.sample_interval_s)
    if jump := largest_jump(gyro.residual_deg_per_h[kept], period, step):
        row, size = int(np.flatnonzero(kept)[jump[0]]), jump[1]
        jump_text = (
            f"At about row {row}, counted from 0, the output steps by {size:+.3g} deg/h. The "
            "uncertainty follows the data; look at gyro, cables and recorder, and measure again."
        )
        flags.append(Flag("output-step", jump_text, axis, {"row": row, "step_deg_per_h": size}))
    return [*flags, *overtone_flags(record)], math.hypot(*parts)


def _counted(record: FittedRecord, step: float) -> bool:
    """Whether rounding errors of the output take each other back: pulses of an angle, counted.

    Their sum over many samples then wanders less than they do alone; and successive ones differ in
    sign, or some are larger than half a step, as no rounding of a value for itself is.
    """
    segment, gyro = record.segment, record.gyro
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


def _frozen(record: FittedRecord, filled: float, step: float) -> Iterator[Flag]:
    """Yield the flag of an output of which a part, or a stretch, was not measured."""
    rate, then = record.segment.rate_deg_per_h, "Leave these rows out and analyse again."
    details: dict[str, object]
    if filled > 0.0:
        then = f"The uncertainty holds what that may take from the result. {then}"
        what, where = "One value of the output", f"{100.0 * filled:.2g} % of the samples"
        details = {"part": filled, "what": "output"}
    else:
        if stuck := stuck_rows(rate, step):
            row, count, what = stuck[0], stuck[1] - stuck[0] + 1, "The output, or its slope,"
        elif again := repeated_rows(rate, step):
            _, row, count = again
            what = f"The output from row {again[0]} on"
        else:
            return
        where = f"rows {row} to {row + count - 1}, counted from 0"
        details = {"row": row, "count": count, "what": "output" if stuck else "repeated"}
    yield frozen_flag(what, where, "the gyro", then, details, record.axis)


def overtone_flags(record: FittedRecord) -> Iterator[Flag]:
    """Yield a flag for each line whose third harmonic is there."""
    for overtone in record.gyro.overtones:
        tripled_Hz = 3.0 * overtone.driven_Hz
        if overtone.chance > OVERTONE_CHANCE:
            continue
        line = next(x for x in record.field.lines if x.frequency_Hz == overtone.driven_Hz)
        overtone_text = (
            f"The output has a line at {tripled_Hz:.4g} Hz, three times the frequency of "
            f"{' and '.join(line.axes)}, with {overtone.power:.3g} times the power of the noise: "
            "the answer is not in proportion to the field, as that of a shield near saturation, a "
            "limited output or bursts. State the sensitivity with its field, and measure at half "
            "of it."
        )
        yield Flag("not-linear", overtone_text, line.axis, {"frequency_Hz": tripled_Hz})


@dataclass(frozen=True)
class Counting:
    """How the pulses of an output are counted: what the beat of their rounding goes by."""

    rate_deg_per_h: float
    pulse_arcsec: float
    interval_s: float
    walk_deg_per_sqrt_h: float
    span_s: float

    def beat(self, lines_Hz: Sequence[float], interval_s: float | None = None) -> Beat | None:
        """Return the beat that harms a line, at this or another sample interval."""
        return find_beat(
            self.rate_deg_per_h,
            self.pulse_arcsec,
            interval_s or self.interval_s,
            self.walk_deg_per_sqrt_h,
            lines_Hz,
            self.span_s,
        )


def counting_of(record: FittedRecord) -> Counting | None:
    """Return how the pulses of a record are counted, None where the output is a rate."""
    segment = record.segment
    if segment.quantum_deg_per_h <= 0.0:
        return None
    interval_s, samples = segment.sample_interval_s, len(segment.time_s)
    pulse_arcsec = segment.quantum_deg_per_h * interval_s
    walk = record.noise.angle_random_walk_deg_per_sqrt_h if record.noise else 0.0
    return Counting(record.mean_deg_per_h, pulse_arcsec, interval_s, walk, samples * interval_s)


@dataclass(frozen=True)
class BeatAdvice:
    """What a beat does, in a sentence, and what would help, in words and as plain data."""

    does: str
    helps: str
    details: Mapping[str, object]


def beat_advice(counting: Counting, driven_Hz: Sequence[float]) -> BeatAdvice | None:
    """Return what to know of a beat of counted pulses, None where none does harm.

    It proposes the nearest frequency and the nearest sample interval at which there is none.
    """
    beat, interval_s = counting.beat(driven_Hz), counting.interval_s
    if beat is None:
        return None
    offers: list[str] = []
    details: dict[str, object] = {"harmonic": beat.harmonic, "beat_Hz": beat.frequency_Hz}
    does = "stands still and follows the signal"
    if beat.line_Hz is not None:
        near_Hz = beat.line_Hz
        does = f"beats at {beat.frequency_Hz:.4g} Hz with the field"
        clear = [f for f in allowed_Hz(counting.span_s, interval_s) if not counting.beat([f])]
        if clear:
            details["frequency_Hz"] = best_Hz = min(clear, key=lambda f: abs(f - near_Hz))
            offers.append(f"a frequency of {best_Hz:.3g} Hz")
    short = [tau_s for tau_s in INTERVALS_S if tau_s * max(driven_Hz) <= LARGEST_CYCLES_PER_SAMPLE]
    intervals = [tau_s for tau_s in short if not counting.beat(driven_Hz, tau_s)]
    if intervals:
        best_s = min(intervals, key=lambda tau_s: abs(np.log(tau_s / interval_s)))
        details["sample_interval_s"] = best_s
        offers.append(f"a sample interval of {best_s:g} s")
    pulses = counting.rate_deg_per_h * interval_s / counting.pulse_arcsec
    return BeatAdvice(
        f"the output makes {pulses:.4g} pulses an interval: their rounding {does}, which may add "
        f"up to {beat.amplitude_deg_per_h:.2g} deg/h to the line or take it away, uncertainty "
        "aside",
        " or ".join([*offers, "another azimuth of the base"]),
        details,
    )


def beat_flags(record: FittedRecord) -> Iterator[Flag]:
    """Yield a flag where the rounding of pulses beats next to a driven line or stands still."""
    counting = counting_of(record)
    if counting is None or record.noise is None:
        return
    if beat := beat_advice(counting, [line.frequency_Hz for line in record.field.lines]):
        quantisation_text = f"In the record, {beat.does}. Measure again with {beat.helps}."
        yield Flag("quantisation-beat", quantisation_text, record.axis, beat.details)
