"""What is no reading of a channel: wild, frozen, copied, saturated, missing, stepped, coarse.

A channel of any procedure goes through `screen`: the output of a device at rest, which is noise
about a level, or a slow one such as a thermometer, which goes on from reading to reading. A slow
channel is judged by its changes: one that lies outside of those before and after it is a jump, and
what stands between a jump and the one back is wild.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from procedures.common.frozen import (
    CHANCE_OF_ROWS,
    IN_A_ROW,
    equal_runs,
    frozen_flag,
    repeated_rows,
    stuck_rows,
)
from station.findings import Flag

from .flags import counted
from .linear import MAD_TO_SIGMA, robust_sigma
from .recorder import MANY, resolution, visits

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

BEYOND = 5.0
"""Robust standard deviations from its neighbours beyond which a reading is wild."""
AROUND = 31
"""Readings whose median a reading of a noisy channel is held against."""
MAX_RUN = 20
"""Equal readings of a noisy channel in a row that are never taken for frozen."""
OFTEN_EQUAL = 0.1
"""Of the readings: in a channel that repeats so often twice as many in a row are never."""
SIGMAS_MORE = 2.0
"""By so many of its standard deviations the share of repeats beside a run is taken larger."""
FAR = 8.0
"""Standard deviations from all others beyond which frozen readings stand at a limit."""
BESIDE = 7
"""Changes before, and as many after, that a change of a slow channel is held against."""
BRIDGED = 3
"""Rows over which a slow channel still goes on as before: nothing is judged beside longer gaps."""
MAX_STEPS = 2.5
"""Steps by which a coarse channel changes from row to row without a jump."""
LONGEST_WILD, WILD_PART = 30, 0.2
"""Rows, or part of a record, within which a slow channel that jumped must be back."""
RETURNED = 0.2
"""Part of a jump by which the one back may differ: the course goes on in between."""
MIN_BLUR = 0.45
"""Noise over step from which rounding averages out; less may be a level between two steps."""
LARGE_PART = 0.3
"""Of a record: a run of equal readings that hides the noise of the others."""
COPIED = 0.5
"""Of two channels: more readings are alike, and more differ from the one before, in a copy."""
COARSE = 0.05
"""Of the readings beside those that stand still: more repeat in a coarse thermometer."""
PAUSE = 10.0
"""Times the usual between two readings: nobody measured in between."""
ROUNDS = 4


@dataclass(frozen=True)
class Channel:
    """A channel as a procedure declares it.

    `name` is as a sentence needs it (`the output of IA`), `source` is what gives it, `low` and
    `high` what no sound reading goes beyond, `quantum` a step that is known, `harmless` a jump or
    a step that spoils nothing, all in `unit`; `then` is what is done with readings that are taken
    out. A `slow` channel goes on from row to row. A coarse and a stepped one have a flag where it
    is stated what that means.
    """

    name: str
    source: str
    unit: str
    low: float = -math.inf
    high: float = math.inf
    quantum: float = 0.0
    harmless: float = 0.0
    slow: bool = False
    then: str = "They are left out."
    when_coarse: str = ""
    when_stepped: str = ""
    limit_code: Literal["saturated", "overload"] = "saturated"


@dataclass(frozen=True)
class Jump:
    """The first row after a step of the level, and its size."""

    row: int
    size: float


@dataclass(frozen=True)
class Screened:
    """A channel's readings (n,) and what they are: masks (n,) of which no two share a row.

    `step` is the least difference of two readings, `noise` their standard deviation from one row to
    the next without the rounding.
    """

    channel: Channel
    values: Array
    missing: Mask
    wild: Mask
    frozen: Mask
    copied: Mask
    saturated: Mask
    step: float = 0.0
    noise: float = 0.0
    jump: Jump | None = None
    beyond: float = BEYOND

    @property
    def good(self) -> Mask:
        """The readings that are none of these."""
        return ~(self.missing | self.wild | self.still)

    @property
    def still(self) -> Mask:
        """The readings that an instrument gave that stood still, or somebody filled in."""
        return self.frozen | self.copied | self.saturated

    @property
    def there(self) -> Array:
        """The good readings alone."""
        return self.values[self.good]

    @property
    def coarse(self) -> bool:
        """Whether noise and rounding hardly move a reading from one step to the next."""
        seen = self.step > self.channel.harmless and int(self.good.sum()) >= AROUND
        return seen and self.noise**2 + self.step**2 / 12.0 < self.step**2

    def u_of_step(self, averaged: float = 1.0) -> float:
        """Return what rounding alone leaves unknown of a mean of so many readings: u's floor.

        It averages out where noise moves the readings over the steps.
        """
        blurred = self.noise > MIN_BLUR * self.step
        return self.step / math.sqrt(12.0 * (max(averaged, 1.0) if blurred else 1.0))

    def on_grid(self, index: Index) -> Array:
        """Return the good readings at their places (n,) on a grid, NaN elsewhere."""
        filled = np.full(int(index[-1]) + 1, np.nan)
        filled[index[self.good]] = self.there
        return filled


def flags(records: Sequence[Screened], axis: str | None = None, noun: str = "row") -> list[Flag]:
    """Return the flags of a channel in all its records; `noun` is what it calls a reading."""
    if not records:
        return []
    channel, raised = records[0].channel, []
    name, then = channel.name, channel.then
    start = name[0].upper() + name[1:]
    if count := sum(int(record.wild.sum()) for record in records):
        wild_text = (
            f"{counted(count, noun)} of {name} lie more than {records[0].beyond:g} standard "
            f"deviations from their neighbours, or beyond what can be. {then}"
        )
        raised.append(Flag("outliers-rejected", wild_text, axis, {"count": count}))
    if count := sum(int(record.frozen.sum() + record.copied.sum()) for record in records):
        extent = counted(count, noun)
        raised.append(frozen_flag(start, extent, channel.source, then, {"count": count}, axis))
    if count := sum(int(record.saturated.sum()) for record in records):
        limit_text = f"Saturated: {name} stands at a limit in {counted(count, noun)}. {then}"
        raised.append(Flag(channel.limit_code, limit_text, axis, {"count": count}))
    if channel.when_coarse and any(record.coarse for record in records):
        step = max(record.step for record in records)
        coarse_text = (
            f"{start} has steps of {step:.3g} {channel.unit}, as large as its noise; "
            f"{channel.when_coarse}"
        )
        raised.append(Flag("coarse-output", coarse_text, axis, {"step": step}))
    jumps = [record.jump for record in records if record.jump is not None]
    if channel.when_stepped and jumps:
        step_text = (
            f"At about row {jumps[0].row}, counted from 0, {name} steps by {jumps[0].size:.3g} "
            f"{channel.unit}. {channel.when_stepped}"
        )
        where = {"row": jumps[0].row, "step": jumps[0].size}
        raised.append(Flag("output-step", step_text, axis, where))
    return raised


def screen(
    channel: Channel,
    values: Array,
    beyond: float = BEYOND,
    free: Mask | None = None,
    paused: Mask | None = None,
) -> Screened:
    """Return which readings (n,) of a channel are none, and how it reads.

    `beyond` is in robust standard deviations; a slow channel may jump in the rows that are `free`,
    and begins anew in those before which its record `paused`.
    """
    missing = ~np.isfinite(values)
    nothing = np.zeros(len(values), dtype=bool)
    wild = ~missing & ((values < channel.low) | (values > channel.high))
    sound = ~missing & ~wild
    if not sound.any():
        return Screened(channel, values, missing, wild, nothing, nothing, nothing, beyond=beyond)
    kept = values[sound]
    if channel.slow:
        step, noise = _slow_scale(kept, channel.quantum)
        anew = nothing if paused is None else paused
        may = anew if free is None else anew | free
        slack = beyond * math.sqrt(2.0) * noise + MAX_STEPS * step, channel.harmless
        *parts, jump = _slow(kept, np.flatnonzero(sound), step, noise, max(slack), may, anew)
    else:
        step = max(channel.quantum, smallest_step(kept))
        *parts, jump = _noisy(kept, step, beyond)
        noise = _noise(kept[~np.any(parts, axis=0)], step)
    masks = np.zeros((len(parts), len(values)), dtype=bool)
    masks[:, sound] = parts
    still, copied, saturated, far = masks
    if jump is not None:
        jump = Jump(int(np.flatnonzero(sound)[jump.row]), jump.size)
    return Screened(
        channel, values, missing, wild | far, still, copied, saturated, step, noise, jump, beyond
    )


def still(temperature_degC: Array) -> Mask:
    """Return which readings (n,) of a thermometer stand still, NaN aside.

    None of one that repeats elsewhere, too: it is coarse, and repeats where the temperature rests.
    """
    thermometer = Channel("the thermometer", "the thermometer", "degC", slow=True)
    stood = screen(thermometer, temperature_degC).still
    moving = ~stood[1:] & ~stood[:-1]
    repeats = (np.diff(temperature_degC) == 0.0)[moving]
    return stood & (np.mean(repeats) <= COARSE if len(repeats) else True)


def after_a_pause(time_s: Array) -> Mask:
    """Return before which readings (n,) far more time passed than between others: all may change.

    A run that was interrupted goes on when somebody has resumed it.
    """
    passed_s = np.diff(time_s)
    long_s = PAUSE * float(np.median(passed_s)) if len(passed_s) else math.inf
    return np.append(False, passed_s > long_s)[: len(time_s)]


def copied(values: Array, other: Array) -> bool:
    """Return whether two channels (n,) are one: mostly equal, though noise moves them on.

    Coarse ones are equal as often as they stand still.
    """
    changes = np.diff(values)
    if len(changes) < IN_A_ROW:
        return False
    return bool(min(np.mean(values == other), np.mean(changes != 0.0)) > COPIED)


def smallest_step(values: Array) -> float:
    """Return the resolution of an output: the smallest difference of two of its values."""
    levels = np.unique(values)
    steps = np.diff(levels)
    steps = steps[steps > 1e-12 * max(1.0, float(np.max(np.abs(levels), initial=0.0)))]
    return float(steps.min()) if len(steps) else 0.0


def _noise(values: Array, step: float) -> float:
    """Return the standard deviation of noise about a level (n,), without the rounding."""
    square = float(np.var(np.diff(values))) / 2.0 if len(values) > 2 else 0.0
    return math.sqrt(max(square - step**2 / 12.0, 0.0))


def _slow_scale(values: Array, quantum: float) -> tuple[float, float]:
    """Return step and noise of a course (n,): of the others where a long run hides their noise."""
    lengths = equal_runs(values)[1]
    others = values[~np.repeat(lengths > LARGE_PART * len(values), lengths)]
    step = max(quantum, resolution(others))
    noise = _slow_noise(others, step)
    if len(others) < len(values) and noise <= MIN_BLUR * step:
        step = max(quantum, resolution(values))
        noise = _slow_noise(values, step)
    return step, noise


def _slow_noise(values: Array, step: float) -> float:
    """Return the standard deviation about a course (n,) that goes on, without the rounding."""
    if len(values) < 4:
        return 0.0
    square = (MAD_TO_SIGMA * float(np.median(np.abs(np.diff(values, 2))))) ** 2 / 6.0
    return math.sqrt(max(square - step**2 / 12.0, 0.0))


def _noisy(values: Array, step: float, beyond: float) -> tuple[Mask, Mask, Mask, Mask, None]:
    """Return what is frozen, copied, saturated and wild of noise about a level; no jump."""
    still = _runs(values)
    good = ~still
    wild = still & False
    saturated = wild.copy()
    if good.sum() > AROUND:
        kept = values[good]
        apart = kept - median_filter(kept, AROUND, mode="nearest")
        sigma = robust_sigma(apart, max(0.3 * step, _sigma_of_steps(apart, step)))
        wild[good] = np.abs(apart) > beyond * sigma + step
        saturated = still & (np.abs(values - np.median(kept)) > FAR * sigma + step)
        saturated |= _cut_off(values, good & ~wild, step, sigma)
    copied = _copied(values, step, ~(still | wild | saturated))
    return still & ~saturated, copied, saturated, wild, None


def _slow(
    values: Array, place: Index, step: float, noise: float, slack: float, free: Mask, paused: Mask
) -> tuple[Mask, Mask, Mask, Mask, Jump | None]:
    """Return what is frozen, copied, saturated and wild of a channel that goes on, and a step.

    `place` (n,) are the rows of the values, `free` those of the whole record in which a change by
    more than `slack` is no jump, `paused` those in which it begins anew.
    """
    longest = IN_A_ROW
    if step > 0.0:
        equal = math.erf(0.25 * step / noise) if noise > 0.0 else 1.0
        often = math.log(len(values) / CHANCE_OF_ROWS)
        longest = max(longest, math.ceil(often / -math.log(equal)) if equal < 1.0 else len(values))
    starts, lengths = equal_runs(values)
    still = np.repeat(lengths >= longest, lengths)
    copied = still & False
    if noise > 0.5 * step:
        copied = _copied(values, step, ~still)
    jump = None
    begins = np.searchsorted(place, np.flatnonzero(paused))
    far = np.concatenate([_far(part, slack) for part in np.split(values, begins)])
    wild = far & ~still & ~copied
    for _ in range(ROUNDS):
        rows = np.flatnonzero(~(still | copied | wild))
        excess = _excess(values[rows], place[rows])
        excess[free[place[rows[1:]]]] = 0.0
        jumps = np.flatnonzero(np.abs(excess) > slack * (2 * np.diff(place[rows]) - 1))
        # A coarse channel that stood still jumps to where it should have gone.
        held = _held_until(rows[jumps + 1], starts, lengths) & ~(still | copied | wild)
        fresh, jump = _between_jumps(values[rows], rows, excess, jumps, slack, len(values))
        still |= held
        fresh &= ~still
        wild |= fresh
        if not (held.any() or fresh.any()):
            break
    limits = values[~wild].min(), values[~wild].max()
    saturated = still & np.isin(values, limits) & (limits[0] < limits[1])
    return still & ~saturated, copied, saturated, wild, jump


def _far(values: Array, slack: float) -> Mask:
    """Return which readings (n,) are farther from the median around than the course goes there."""
    if len(values) <= AROUND:
        return np.zeros(len(values), dtype=bool)
    middle = median_filter(values, AROUND, mode="nearest")
    half = AROUND // 2
    padded = np.pad(middle, half, mode="edge")
    goes = np.abs(middle - padded[: len(values)]) + np.abs(middle - padded[2 * half :])
    far = np.abs(values - middle) > goes + slack
    # What stands off for longer has two jumps, which say better where it begins and ends.
    lengths = equal_runs(far)[1]
    return np.asarray(far & np.repeat(lengths <= BRIDGED, lengths))


def _excess(values: Array, rows: Index) -> Array:
    """Return by how much each change (n - 1,) lies outside of those before and after it.

    A ramp that begins or ends within a row changes by something between the two; where the changes
    themselves change, as much again may be more.
    """
    gaps = np.diff(rows)
    slopes = np.diff(values) / gaps
    count = len(slopes)
    if count < 2 * BESIDE + 1:
        return slopes * 0.0
    padded = np.pad(slopes, 2 * BESIDE, mode="symmetric")
    medians = np.median(sliding_window_view(padded, BESIDE), axis=1)
    earlier, before = medians[:count], medians[BESIDE : BESIDE + count]
    after = medians[2 * BESIDE + 1 : 2 * BESIDE + 1 + count]
    later = medians[3 * BESIDE + 1 : 3 * BESIDE + 1 + count]
    more = np.maximum(np.abs(before - earlier), np.abs(later - after))
    inside = np.clip(slopes, np.minimum(before, after) - more, np.maximum(before, after) + more)
    beside_a_gap = maximum_filter1d(gaps, 2 * BESIDE + 1) > BRIDGED
    return np.asarray(np.where(beside_a_gap, 0.0, (slopes - inside) * gaps))


def _between_jumps(
    values: Array, rows: Index, excess: Array, jumps: Index, slack: float, count: int
) -> tuple[Mask, Jump | None]:
    """Return which of the rows (count,) stand off their course until they return, and a step.

    `values` are those of the `rows` (n,), `excess` (n - 1,) what is too much of their changes.
    """
    off = np.zeros(count, dtype=bool)
    longest = max(LONGEST_WILD, int(WILD_PART * count))
    lasting = None
    first = 0
    while first < len(jumps):
        begin = int(jumps[first])
        near = max(slack, RETURNED * abs(float(excess[begin])))
        level = 0.0
        for at in range(first, len(jumps)):
            end = int(jumps[at])
            level += float(excess[end])
            if end - begin > longest or (at > first and abs(level) <= near):
                break
            if at > first and _joins(values, rows, begin, end, slack):
                break
        else:
            end = begin + longest + 1
        if end - begin <= longest:
            off[rows[begin + 1 : end + 1]] = True
            first = at
        elif begin < BESIDE:
            off[rows[: begin + 1]] = True
        elif len(rows) - 1 - begin <= BESIDE:
            off[rows[begin + 1 :]] = True
        elif lasting is None or abs(excess[begin]) > abs(lasting.size):
            lasting = Jump(int(rows[begin + 1]), float(excess[begin]))
        first += 1
    return off, lasting


def _joins(values: Array, rows: Index, begin: int, end: int, slack: float) -> bool:
    """Return whether a course goes on after the reading `end` as it came to the one `begin`."""
    slopes = [
        abs(float(values[b] - values[a])) / (rows[b] - rows[a])
        for a, b in (
            (max(begin - BESIDE, 0), begin),
            (end + 1, min(end + 1 + BESIDE, len(values) - 1)),
        )
        if b > a
    ]
    gap = rows[end + 1] - rows[begin]
    goes = gap * max(slopes, default=0.0)
    return bool(abs(values[end + 1] - values[begin]) <= goes + slack)


def _held_until(jumps: Index, starts: Index, lengths: Index) -> Mask:
    """Return which rows stand in a long run of equal readings that ends where there is a jump."""
    return np.repeat(np.isin(starts + lengths, jumps) & (lengths >= IN_A_ROW), lengths)


def _cut_off(values: Array, sound: Mask, step: float, sigma: float) -> Mask:
    """Return which readings (n,) stand at a limit, where far more are than next to it."""
    cut = sound & False
    if step == 0.0 or sigma <= 2.0 * step:
        return cut
    for limit in (float(values[sound].min()), float(values[sound].max())):
        away = np.rint(np.abs(values - limit) / step)
        at, beside = sound & (away == 0.0), sound & (away > 0.0) & (away <= 3.0)
        if visits(at) > MANY * visits(beside) / 3.0 + MANY:
            cut |= at
    return cut


def _copied(values: Array, step: float, among: Mask) -> Mask:
    """Return which of some readings (n,) were there before, or are on a line to the last digit."""
    kept = values[among]
    own = np.zeros(len(kept), dtype=bool)
    if (twice := repeated_rows(kept, step)) is not None:
        _, second, length = twice
        own[second : second + length] = True
    if (filled := stuck_rows(kept, step)) is not None:
        own[filled[0] : filled[1] + 1] = True
    copied = np.zeros(len(values), dtype=bool)
    copied[among] = own
    return copied


def _sigma_of_steps(apart: Array, step: float) -> float:
    """Return the robust standard deviation of noise (n,) that is rounded to steps, with that.

    Most of it may stand on one level: each is taken as spread over its step.
    """
    if step == 0.0:
        return 0.0
    levels, count = np.unique(np.rint(np.abs(apart) / step), return_counts=True)
    edges = np.append(np.maximum(levels - 0.5, 0.0), levels[-1] + 0.5)
    part = np.append(0.0, np.cumsum(count) / len(apart))
    return MAD_TO_SIGMA * step * float(np.interp(0.5, part, edges))


def _runs(values: Array) -> Mask:
    """Return which readings stand in a run of equal ones longer than chance lets them be.

    Coarse readings repeat more often for a while, where the noise lies in the middle of a step.
    """
    count = len(values)
    lengths = equal_runs(values)[1]
    equal = float(np.mean(values[1:] == values[:-1])) if count > 1 else 0.0
    longest = MAX_RUN
    if len(lengths) > 1 and 0.0 < equal < 1.0:
        # Among short runs: how often a reading equals the one before it, frozen stretches aside.
        short = lengths <= np.percentile(lengths, 99)
        equal = 1.0 - float(short.sum() / max(lengths[short].sum(), 1))
        if equal > 0.0:
            longest = _longest_by_chance(count, equal)
    still = np.repeat(lengths > longest, lengths)
    starts = np.cumsum(lengths) - lengths
    others = np.flatnonzero(~still)
    repeats = np.append(False, values[1:] == values[:-1])[others]
    for start, length in zip(starts[lengths > longest], lengths[lengths > longest], strict=True):
        at = int(np.searchsorted(others, start))
        around = repeats[max(at - AROUND, 0) : at + AROUND]
        if len(around) == 0:
            continue
        often = float(around.mean())
        often += SIGMAS_MORE * math.sqrt(often * (1.0 - often) / len(around))
        if length <= _longest_by_chance(count, often):
            still[start : start + length] = False
    return still


def _longest_by_chance(count: int, equal: float) -> int:
    """Return how many readings of so many stand in a row, each equal to the last so often."""
    if equal <= 0.0:
        return MAX_RUN
    fewest = MAX_RUN if equal < OFTEN_EQUAL else 2 * MAX_RUN
    return max(fewest, math.ceil(2.0 * math.log(count) / -math.log(min(equal, 0.999))))
