"""What coils are driven with: frequencies none of whose products fall on another, and grouping.

A gyro or a coil that is not quite linear answers at harmonics, sums and differences of what drives
it. Those of second order are fitted beside the driven lines, so all must stand apart; those of
third order are not, so none may fall on a driven line. What a long record is averaged to goes by
its fastest line. No NumPy here: plans are validated by it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product

LARGEST_UNDRIVEN = 3.0
"""deg/h/mT: what an axis that is not driven may have where nothing is stated. Published values of
two-frequency gyros end there; those of four-frequency ones reach 100."""
FREQUENCY_RANGE_HZ = (0.05, 0.2)
FEWEST_CYCLES = 10
LARGEST_CYCLES_PER_SAMPLE = 0.2
"""Above this the line at twice the drive frequency comes too near to the Nyquist frequency."""
APART = 2.0
"""Least distance of two lines in 1/T."""
GRID_HZ = 0.01
ROUNDING = 1e-6

MAX_ROWS = 2**19
"""A record with no more samples than this is taken as it is: 14.5 h at 0.1 s."""
MAX_CYCLES = 0.1
"""Of the fastest line in an averaged interval: the mean then takes 1.6 % of the line away."""

Line = tuple[str, float]


@dataclass(frozen=True)
class Drive:
    """Frequency and amplitude (a peak) of one coil axis; an amplitude of zero is a coil at rest."""

    frequency_Hz: float
    amplitude_mT: float


def second_order(drive: Mapping[str, float]) -> Iterator[Line]:
    """Yield the doubles, sums and differences of driven frequencies, each with its name."""
    for axis, f in drive.items():
        yield f"2 {axis}", 2 * f
    for (first, f), (other, g) in combinations(drive.items(), 2):
        yield f"{first} + {other}", f + g
        yield (f"{first} - {other}", f - g) if f >= g else (f"{other} - {first}", g - f)


def third_order(drive: Mapping[str, float]) -> Iterator[Line]:
    """Yield the products of third order of driven frequencies, each with its name."""
    for axis, f in drive.items():
        yield f"3 {axis}", 3 * f
    for (first, f), (other, g) in product(drive.items(), repeat=2):
        if first != other:
            yield f"2 {first} + {other}", 2 * f + g
            yield f"2 {first} - {other}", abs(2 * f - g)
    if len(drive) == 3:
        (a, f), (b, g), (c, h) = drive.items()
        yield f"{a} + {b} - {c}", abs(f + g - h)
        yield f"{a} - {b} + {c}", abs(f - g + h)
        yield f"{b} + {c} - {a}", abs(g + h - f)


def nearest_pair(drive: Mapping[str, float]) -> tuple[float, Line, Line]:
    """Return the smallest distance in Hz that matters, and the two lines it lies between."""
    lines = [*drive.items(), *second_order(drive)]
    pairs = [*combinations(lines, 2), *product(drive.items(), third_order(drive))]
    return min((abs(line[1] - other[1]), line, other) for line, other in pairs)


def whole_cycles_Hz(frequency_Hz: float, duration_s: float) -> float:
    """Return the frequency next to one that makes whole cycles in a record, in the method's range.

    Where the record is too short for any the nearest one is returned, outside of it.
    """
    low, high = FREQUENCY_RANGE_HZ
    cycles = round(frequency_Hz * duration_s)
    if cycles < low * duration_s - ROUNDING:
        cycles += 1
    elif cycles > high * duration_s + ROUNDING:
        cycles -= 1
    return cycles / duration_s


def allowed_Hz(duration_s: float, interval_s: float) -> tuple[float, ...]:
    """Return the frequencies to choose from: nearly round, whole cycles, as the method has them."""
    low = max(FREQUENCY_RANGE_HZ[0], FEWEST_CYCLES / duration_s) - ROUNDING
    high = min(FREQUENCY_RANGE_HZ[1], LARGEST_CYCLES_PER_SAMPLE / interval_s) + ROUNDING
    grid = range(math.ceil(low / GRID_HZ), math.floor(high / GRID_HZ) + 1)
    whole_Hz = (whole_cycles_Hz(k * GRID_HZ, duration_s) for k in grid)
    return tuple(dict.fromkeys(f for f in whole_Hz if low <= f <= high))


@lru_cache(maxsize=64)
def choose(
    axes: tuple[str, ...],
    duration_s: float,
    interval_s: float,
    given: tuple[Line, ...] = (),
) -> dict[str, float] | None:
    """Return the frequency of each axis, all lines as far apart as can be; None where none do.

    `given` holds those that are decided. Of equal choices the one with the lowest frequencies: eddy
    currents and averaging grow with the frequency.
    """
    held = dict(given)
    free = [axis for axis in axes if axis not in held]
    best: tuple[float, float, dict[str, float]] | None = None
    for chosen in combinations(allowed_Hz(duration_s, interval_s), len(free)):
        candidate = held | dict(zip(free, chosen, strict=True))
        drive = {axis: candidate[axis] for axis in axes}
        apart_Hz = round(nearest_pair(drive)[0], 9)
        if apart_Hz * duration_s < APART - ROUNDING:
            continue
        rank = (apart_Hz, -sum(drive.values()))
        if best is None or rank > best[:2]:
            best = (*rank, drive)
    return best[2] if best else None


def clash(drive: Mapping[str, float], duration_s: float, interval_s: float) -> str | None:
    """Return in a sentence which lines are too close, and what would do; None where none are."""
    apart_Hz, line, other = nearest_pair(drive)
    if apart_Hz * duration_s >= APART - ROUNDING:
        return None
    clashes = (
        f"{named(other)} is too close to {named(line)}: lines must be {APART / duration_s:.4g} Hz "
        f"apart in a record of {duration_s:g} s"
    )
    blamed = [axis for axis in reversed([*drive]) if axis in f"{line[0]} {other[0]}"]
    for axis in blamed:
        rest = {name: f for name, f in drive.items() if name != axis}
        offers = [
            f
            for f in allowed_Hz(duration_s, interval_s)
            if nearest_pair({**rest, axis: f})[0] * duration_s >= APART - ROUNDING
        ]
        if offers:
            best = min(offers, key=lambda f: abs(f - drive[axis]))
            return f"{clashes}; {axis} at {best:.4g} Hz would do"
    better = choose(tuple(drive), duration_s, interval_s)
    if better is None:
        return f"{clashes}; take a longer record"
    return f"{clashes}; {', '.join(f'{axis} {f:.4g} Hz' for axis, f in better.items())} would do"


def named(line: Line) -> str:
    """Return a line in words: its name and its frequency."""
    return f"{line[0]} ({line[1]:.4g} Hz)"


def second_frequency_Hz(frequency_Hz: float, duration_s: float, interval_s: float) -> float:
    """Return the frequency at which a measurement is repeated: the allowed one farthest away.

    Distance counts as a ratio: a delay and eddy currents grow in proportion to the frequency.
    """
    offers = allowed_Hz(duration_s, interval_s) or (frequency_Hz,)
    return max(offers, key=lambda f: abs(math.log(f / frequency_Hz)))


def with_first(axes: Sequence[str], frequency_Hz: float | None) -> tuple[Line, ...]:
    """Return what is decided by a frequency that belongs to the first axis."""
    return () if frequency_Hz is None else ((axes[0], frequency_Hz),)


def group_size(samples: int, interval_s: float, highest_Hz: float) -> int:
    """Return how many samples are averaged: 1 for a record that is short enough.

    Never so many that the fastest line would suffer: a record that is longer still has more rows.
    """
    if samples <= MAX_ROWS:
        return 1
    allowed = MAX_CYCLES / max(highest_Hz * interval_s, MAX_CYCLES / samples)
    return max(min(math.ceil(samples / MAX_ROWS), math.floor(allowed + 1e-9)), 1)


def averaged_rows(samples: int, interval_s: float, highest_Hz: float) -> int:
    """Return the rows that are left of a record."""
    return math.ceil(samples / group_size(samples, interval_s, highest_Hz))


def loss(group: int, interval_s: float, highest_Hz: float) -> float:
    """Return the relative growth of the standard uncertainty of a line by averaging."""
    return left(highest_Hz * interval_s) / left(highest_Hz * interval_s * group) - 1.0


def left(cycles: float) -> float:
    """Return the part of a line that a mean over so many of its cycles leaves."""
    return math.sin(math.pi * cycles) / (math.pi * cycles) if cycles else 1.0
