"""What is known of axes at rest, and what the reader must know of it, one flag a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, permutations

import numpy as np

from procedures.estimation.allan import AllanDeviation
from procedures.estimation.channel import Screened, flags
from procedures.estimation.direction import earth_flags
from procedures.estimation.flags import Gaps, counted, gaps_of, not_identifiable
from procedures.estimation.readings import Reading, Remainder, named, suiting
from station.findings import Flag, contradiction

from .dataset import COEFFICIENTS, AnalysisSettings, Array, StaticDataset
from .means import Minimum
from .noise import Burst, NoiseFit
from .parameters import UNITS

TRIAD = 3
BY_CHANCE = 1e-6
NEAR = 0.255
"""Of what three biases would be as stated: axes of one make whose biases another labelling makes
so much smaller are under each other's names. By chance once in 300 triads at worst."""
COPIED = 0.5
"""Part of the samples in which no two gyros read the same to the last digit."""


@dataclass(frozen=True)
class AxisAnalysis:
    """One axis: screened records, means and samples of switch-ons, noise, and Allan deviation.

    `moving` is how far the warm-up's tail and the walk may move the mean of the means, in deg/h.
    """

    axis: str
    screened: tuple[Screened, ...]
    means: Array
    counts: Array
    fit: NoiseFit | None
    bursts: Sequence[Burst] = ()
    minimum: Minimum | None = None
    curve: AllanDeviation | None = None
    moving: tuple[float, float] = (0.0, 0.0)


def axis_flags(analysed: AxisAnalysis, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags of one axis: its samples, its noise, its switch-ons."""
    return [*flags(analysed.screened, analysed.axis, "sample"), *_noise(analysed, settings)]


def _noise(analysed: AxisAnalysis, settings: AnalysisSettings) -> Iterator[Flag]:
    axis, fit, minimum = analysed.axis, analysed.fit, analysed.minimum
    for burst in analysed.bursts:
        how = f"{axis} lies {burst.shift:.3g} deg/h beside the rest"
        if burst.scatter:
            how = f"{axis} scatters {burst.scatter:.2g} times as much as the rest"
        sentence = (
            f"From {burst.begin_s:.5g} s to {burst.end_s:.5g} s of switch-on {burst.switch_on} "
            f"{how}, which its noise does not do: {counted(burst.count, 'sample')} "
            "left out. Look for a shock, a step or somebody at the plate."
        )
        details = {"count": burst.count, "begin_s": burst.begin_s, "end_s": burst.end_s}
        yield Flag("misfit", sentence, axis, {"what": "burst", **details})
    if fit is None:
        lost = [name for name in UNITS if name != "bias" or len(analysed.means) < 2]
        sentence = f"No record of {axis} is long enough to show its noise; record longer."
        yield not_identifiable(sentence, lost, axis)
        return
    if fit.sawtooth:
        sentence = (
            f"{axis} walks by less than half a pulse from sample to sample: its roundings follow "
            "one another, and u of the quantisation noise is twice as large."
        )
        yield Flag("coarse-output", sentence, axis)
    elif fit.chance() < BY_CHANCE:
        sentence = (
            f"The noise of {axis} spreads over the frequencies as no quantisation, random walk and "
            "bias instability do: the coefficients are not those of the gyro. Look for a filter "
            "behind its output (state `output_bandwidth`) and a recorder that repeats samples."
        )
        yield Flag("misfit", sentence, axis, {"what": "spectrum"})
    if len(analysed.means) == 1:
        sentence = f"{axis} has one switch-on with samples, which shows no repeatability."
        yield not_identifiable(sentence, ["bias_repeatability"], axis)
    small = [
        name
        for name, square, u in zip(COEFFICIENTS, fit.theta, fit.u, strict=True)
        if square < settings.not_significant * u
    ]
    if fit.known.bandwidth_Hz is not None:
        sentence = (
            f"The output of {axis} is filtered: up to a quarter of its bandwidth quantisation "
            "noise does not show."
        )
        yield not_identifiable(sentence, [COEFFICIENTS[0]], axis)
    if small:
        names = ", ".join(small).replace("_", " ")
        sentence = (
            f"Of {axis} the squares of {names} are less than "
            f"{settings.not_significant:g} of their standard uncertainties: the upper limits say "
            "what the record shows."
        )
        yield Flag("not-significant", sentence, axis, {"coefficients": small})
    if abs(fit.ramp) > settings.drift_removed * fit.ramp_u:
        sentence = (
            f"{axis} drifts by {fit.ramp:.3g} deg/h^2, u = {fit.ramp_u:.2g}; the drift is fitted "
            "with the noise and is not in its coefficients."
        )
        yield Flag("drift-removed", sentence, axis, {"ramp_deg_per_h2": fit.ramp})
    for line in fit.lines:
        period_s, amplitude = 1.0 / line.frequency_Hz, line.amplitude_deg_per_h
        sentence = (
            f"{axis} swings by {amplitude:.3g} deg/h with a period of {period_s:.4g} s; the line "
            "is fitted with the noise. Look for what has this period: air conditioning, dither, a "
            "neighbour."
        )
        details = {"period_s": period_s, "amplitude_deg_per_h": amplitude}
        yield Flag("periodic", sentence, axis, details)
    if minimum is not None and minimum.at_end:
        sentence = (
            f"The Allan deviation of {axis} still falls at {minimum.tau_s:.4g} s, a ninth of the "
            "longest record: its minimum lies beyond. Record longer."
        )
        yield Flag("short-record", sentence, axis, {"tau_s": minimum.tau_s})


def dataset_flags(
    dataset: StaticDataset, axes: Sequence[AxisAnalysis], settings: AnalysisSettings
) -> list[Flag]:
    """Return the flags of all axes together: the earth's rate, copied columns, gaps."""
    raised = [*_copied(dataset)]
    names, directions = list(dataset.directions), list(dataset.directions.values())
    read = np.array([axis.means[0] if len(axis.means) else np.nan for axis in axes])
    felt = zip(names, directions, read, strict=True) if dataset.earth_in_output else ()
    for name, direction, mean in felt:
        raised += earth_flags(name, direction, dataset.latitude_rad, float(mean))
    if not raised and len(names) == TRIAD and bool(np.isfinite(read).all()):
        earth = [direction.earth_deg_per_h(dataset.latitude_rad) for direction in directions]
        raised += _labels(names, np.array(earth), read)
    interval_s = dataset.sample_interval_s
    gaps = sum((gaps_of(r.time_s, interval_s, settings.gap) for r in dataset.records), Gaps())
    consequence = (
        "short ones are bridged by what the noise lets stand there, long ones divide the record"
    )
    return raised + gaps.flags("The records have", interval_s, consequence)


def _copied(dataset: StaticDataset) -> Iterator[Flag]:
    """Yield the flag of two axes with one and the same output."""
    if not dataset.records:
        return
    rates = np.concatenate([record.rate_deg_per_h for record in dataset.records])
    columns = zip(dataset.directions, rates.T, strict=True)
    for (a, first), (b, second) in combinations(columns, 2):
        same, new = first == second, np.diff(first) != 0.0
        if len(new) and min(np.mean(same), np.mean(new)) > COPIED:
            extent = counted(int(same.sum()), "sample")
            sentence = (
                f"{a} and {b} read the same to the last digit in {extent}: one column was filled "
                "with the other, and its results are not its own. Look at the recorder and at the "
                "columns."
            )
            yield contradiction("input_axis", sentence, a, copied=b)


def _labels(names: Sequence[str], earth: Array, read: Array) -> Iterator[Flag]:
    """Yield the flag of axes of a triad under each other's names, or of the other sign."""
    signs = [
        Reading[Array](
            f"{name} has the other sign", partial(np.multiply, 1.0 - 2.0 * own), "input_axis"
        )
        for name, own in zip(names, np.eye(TRIAD), strict=True)
    ]
    kinds: dict[int, list[Reading[Array]]] = {1: signs, 2: [], 3: []}
    for order in permutations(range(TRIAD)):
        moved = sum(place != own for place, own in enumerate(order))
        if moved:
            what = f"the columns hold {', '.join(names[k] for k in order)} in this order"
            back = list(np.argsort(order))
            kinds[moved].append(Reading(what, partial(np.take, indices=back), "input_axis"))

    def left(rates: Array) -> Remainder:
        return Remainder(float(np.sum((rates - earth) ** 2)), TRIAD)

    if suits := suiting(read, kinds.values(), left, better=NEAR):
        sentence = (
            f"The means of {', '.join(names)} are off the earth's rate by "
            f"{np.sqrt(left(read).squares / TRIAD):.3g} deg/h; they fit if {named(suits)}. "
            "Correct the columns, their signs or the directions; the biases go with them."
        )
        exchanged = all(suit.reading not in signs for suit in suits)
        yield contradiction("input_axis", sentence, None, exchanged=exchanged)
