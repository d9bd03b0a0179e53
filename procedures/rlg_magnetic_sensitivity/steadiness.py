"""Whether field and answer stay what they are: throughout a record, and from record to record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import binary_opening
from scipy.special import erfc, fdtrc

from procedures.estimation.linear import least_squares
from procedures.estimation.noise import LocalNoise, Periodogram, grid_index, periodogram
from procedures.estimation.sine import legendre_columns, line_columns, phasors
from station.findings import Flag

from .dataset import AXES, Array, Complex, Segment
from .fitted import FittedRecord, RlgAnalysis
from .gyro import fit_gyro
from .parameters import AnalysisSettings

MAX_BLOCKS = 12
MIN_CYCLES = 2.0
WANDERS = 0.02
"""Part of its amplitude by which a field may differ in a block."""
WANDERS_SIGMAS = 6.0
CHANCE = 1e-5
"""That a steady answer is called unsteady, of one line."""
ISOLATED_ROWS = 3
REDDER = 1.5
"""Noise at a line over that beside it, at most: drift that is left is small there."""
MIN_ORDINATES = 16


def block_edges(start_s: float, stop_s: float, frequencies_Hz: Sequence[float]) -> Array:
    """Return the edges in s of blocks that tell the lines apart and hold two cycles of each."""
    ordered = sorted(frequencies_Hz)
    apart_Hz = min([b - a for a, b in pairwise(ordered)], default=np.inf)
    least_s = max(MIN_CYCLES / ordered[0], 1.0 / apart_Hz)
    blocks = int(min((stop_s - start_s) / least_s + 1e-6, MAX_BLOCKS))
    return np.linspace(start_s, stop_s, max(blocks, 1) + 1)


def block_phasors(
    time_s: Array, data: Array, frequencies_Hz: Sequence[float], edges_s: Array
) -> tuple[Complex, Array, Array]:
    """Return phasors (blocks, lines) about time zero, and their variances over that of a sample.

    Each block is fitted for itself, with a mean and a slope; too few samples make NaN. Third, what
    the fits leave of the data (n,).
    """
    count = len(frequencies_Hz)
    result = np.full((len(edges_s) - 1, count), np.nan + 0j)
    variance = np.full(result.shape, np.nan)
    residuals = np.zeros(len(data))
    place = np.clip(np.searchsorted(edges_s, time_s, side="right") - 1, 0, len(result) - 1)
    for block in range(len(result)):
        here = place == block
        if int(here.sum()) < 3 * (2 * count + 2):
            continue
        t = time_s[here]
        drift = legendre_columns(t, 1, float(t.min()), float(t.max()))
        fit = least_squares(np.hstack((line_columns(t, frequencies_Hz), drift)), data[here])
        result[block] = phasors(fit.coefficients[: 2 * count])
        residuals[here] = fit.residuals
        variance[block] = np.diag(fit.inverse_normal)[: 2 * count].reshape(count, 2).mean(axis=1)
    return result, variance, residuals


def field_by_block(record: FittedRecord, edges_s: Array) -> tuple[Complex, Array]:
    """Return what each coil's own component does in each block (blocks, lines), over its phasor.

    With it the standard uncertainty. Single wild readings are left out, stretches of them are not:
    they are what is looked for.
    """
    segment, field = record.segment, record.field
    frequencies = [line.frequency_Hz for line in field.lines]
    stretches = binary_opening(field.wild, np.ones(ISOLATED_ROWS + 1))
    used = np.isfinite(segment.field_mT).all(axis=1) & (~field.wild | stretches)
    time_s = segment.field_time_s[used] - segment.middle_s
    relative = np.full((len(edges_s) - 1, len(frequencies)), np.nan + 0j)
    spread = np.full(relative.shape, np.nan)
    for k, line in enumerate(field.lines):
        own = max((AXES.index(axis) for axis in line.axes), key=lambda a: abs(line.phasor_mT[a]))
        values = segment.field_mT[used, own]
        whole, *_ = block_phasors(time_s, values, frequencies, edges_s[[0, -1]])
        phasors, variance, _ = block_phasors(time_s, values, frequencies, edges_s)
        sample = float(line.variance_mT2[own]) * len(time_s)
        relative[:, k] = phasors[:, k] / whole[0, k]
        spread[:, k] = np.sqrt(variance[:, k] * sample) / abs(whole[0, k])
    return relative, spread


def steadiness_flags(record: FittedRecord) -> Iterator[Flag]:
    """Yield flags of fields that are not one sine, and of answers that do not follow the field."""
    lines = record.field.lines
    if not record.fitted or any(line.problem for line in lines):
        return
    half_s = 0.5 * (float(record.segment.time_s[-1]) - float(record.segment.time_s[0]))
    edges_s = block_edges(-half_s, half_s, [line.frequency_Hz for line in lines])
    if len(edges_s) < 3:
        return
    relative, spread = field_by_block(record, edges_s)
    for k, line in enumerate(lines):
        off = np.nan_to_num(np.abs(relative[:, k] - 1.0))
        beyond = off > np.maximum(WANDERS, WANDERS_SIGMAS * np.nan_to_num(spread[:, k]))
        if beyond.any():
            block = int(np.argmax(np.where(beyond, off, 0.0)))
            start_s, stop_s = (float(edge) + half_s for edge in edges_s[block : block + 2])
            size, phase_deg = abs(relative[block, k]), np.degrees(np.angle(relative[block, k]))
            wanders_text = (
                f"The field on {' and '.join(line.axes)} is not one steady sine: from "
                f"{start_s:.4g} s to {stop_s:.4g} s of the record its amplitude is {size:.3g} of "
                f"that of the whole and its phase {phase_deg:+.3g} deg off. Look at coil supply, "
                "gaussmeter and time stamps, and measure again."
            )
            details = {"start_s": start_s, "stop_s": stop_s, "relative_amplitude": size}
            yield Flag("field-wanders", wanders_text, line.axis, details)
    yield from _unfaithful(record, edges_s, relative)


def _unfaithful(record: FittedRecord, edges_s: Array, relative: Complex) -> Iterator[Flag]:
    """Yield a flag for each line whose answer changes at some time though the field does not."""
    segment, gyro = record.segment, record.gyro
    kept, interval_s = gyro.kept, segment.sample_interval_s
    time_s = segment.time_s[kept] - 0.5 * float(segment.time_s[0] + segment.time_s[-1])
    data = gyro.lines_deg_per_h[kept] + gyro.residual_deg_per_h[kept]
    frequencies = [line.frequency_Hz for line in record.field.lines]
    phasors, variance, left = block_phasors(time_s, data, frequencies, edges_s)
    index = grid_index(segment.time_s, interval_s)[kept]
    spectrum = periodogram(left, index - index[0], interval_s)
    block_Hz = 1.0 / float(edges_s[1] - edges_s[0])
    cut_pulse = segment.quantum_deg_per_h * interval_s * block_Hz  # at an edge
    for k, line in enumerate(record.field.lines):
        noise = 0.25 * float(gyro.noise_floor_deg_per_h[k]) ** 2 * len(time_s)
        freedom = float(gyro.degrees_of_freedom[k])
        beside = noise_beside(spectrum, line.frequency_Hz, frequencies, block_Hz)
        if beside is not None and REDDER * beside.variance < noise:
            noise, freedom = REDDER * beside.variance, beside.degrees_of_freedom
        used = np.isfinite(variance[:, k]) & np.isfinite(relative[:, k])
        if int(used.sum()) < 2 or noise <= 0.0:
            continue
        weight = 1.0 / (variance[used, k] * noise + cut_pulse**2)
        gained = changes(phasors[used, k], relative[used, k], weight)
        worst = int(np.argmax(gained))
        chance = len(gained) * float(fdtrc(2.0, freedom, gained[worst] / 2.0))
        if chance < CHANCE:
            at_s = float(edges_s[:-1][used][worst + 1] - edges_s[0])
            unfaithful_text = (
                f"The answer to the field on {' and '.join(line.axes)} is not the same throughout "
                f"the record, though the field is (F test, {chance:.1g} by chance); it changes "
                f"most at {at_s:.4g} s. The output changed its scale, sign or delay or lost rows, "
                "or the field was not what was recorded. Look at the record and measure again."
            )
            yield Flag("misfit", unfaithful_text, line.axis, {"at_s": at_s, "chance": chance})


def noise_beside(
    spectrum: Periodogram, frequency_Hz: float, lines_Hz: Sequence[float], block_Hz: float
) -> LocalNoise | None:
    """Return the noise some blocks' width beside a line, where no modulation of it reaches."""
    away = np.abs(spectrum.frequency_Hz - frequency_Hz)
    ring = (away < 4.0 * block_Hz) & (spectrum.frequency_Hz > block_Hz)
    for f in lines_Hz:
        ring &= np.abs(spectrum.frequency_Hz - f) > 1.2 * block_Hz
    count = int(ring.sum())
    if count < MIN_ORDINATES:
        return None
    # Ordinates are exponentially distributed: a median, which no line moves, is ln 2 of the mean.
    return LocalNoise(float(np.median(spectrum.ordinate[ring])) / np.log(2.0), float(count) / 2.0)


def changes(answers: Complex, field: Complex, weight: Array) -> Array:
    """Return by how much the weighted sum of squares falls with another answer from each block on.

    `answers` (blocks,) is `field` (blocks,) times an answer; `weight` is over each part's variance.
    """

    def explained(product: Complex, power: Array) -> Array:
        return np.abs(product) ** 2 / np.where(power > 0.0, power, np.inf)

    product = np.cumsum(weight * answers * field.conj())
    power = np.cumsum(weight * np.abs(field) ** 2)
    before, after = explained(product, power), explained(product[-1] - product, power[-1] - power)
    return np.asarray((before + after - before[-1])[:-1])


@dataclass(frozen=True)
class Tested:
    """One axis under another condition, in deg/h/mT.

    `value` is the sensitivity there, or for the background the line's magnitude over M;
    `difference` is that to the result, for the background the value itself; `bound` is what chance
    may make of it.
    """

    check: str
    axis: str | None
    frequency_Hz: float
    amplitude_mT: float
    value: float
    uncertainty: float
    difference: float
    difference_uncertainty: float
    bound: float

    @property
    def differs(self) -> bool:
        """Whether the difference is more than chance makes it."""
        return abs(self.difference) > self.bound

    def to_data(self) -> dict[str, object]:
        """Return it as it stands in the results."""
        return {
            "check": self.check,
            "frequency_Hz": self.frequency_Hz,
            "amplitude_mT": self.amplitude_mT,
            "value": self.value,
            "standard_uncertainty": self.uncertainty,
            "difference": self.difference,
            "difference_standard_uncertainty": self.difference_uncertainty,
            "differs": self.differs,
        }


def repeated(
    check: str, result: RlgAnalysis, again: RlgAnalysis, segments: Sequence[Segment], reach: float
) -> Iterator[Tested]:
    """Yield each axis that was measured again; `reach` is in standard uncertainties."""
    before = {estimate.axis: estimate for estimate in result.estimates}
    for estimate in again.estimates:
        first = before.get(estimate.axis)
        if first is None or first.value is None or estimate.value is None:
            continue
        drive = next(d for s in segments for axis, d in s.drive.items() if axis == estimate.axis)
        own = estimate.standard_uncertainty or 0.0
        u = math.hypot(own, first.standard_uncertainty or 0.0)
        change = estimate.value - first.value
        sine = drive.frequency_Hz, drive.amplitude_mT
        yield Tested(check, estimate.axis, *sine, estimate.value, own, change, u, reach * u)


def background(
    segment: Segment, amplitude_mT: float, settings: AnalysisSettings
) -> Iterator[Tested]:
    """Yield the gyro's line at each frequency of a record without field, over the field's M.

    Its phase means nothing, so the magnitude is held against what noise alone exceeds as rarely as
    it exceeds `checks_differ` standard uncertainties.
    """
    driven = {axis: drive.frequency_Hz for axis, drive in segment.drive.items()}
    fit = fit_gyro(segment, list(driven.values()), settings)
    if fit is None:
        return
    chance = float(erfc(settings.checks_differ / np.sqrt(2.0)))
    reach = float(np.sqrt(-2.0 * np.log(chance)))
    for k, (axis, frequency_Hz) in enumerate(driven.items()):
        part = np.diag(fit.covariance)[2 * k : 2 * k + 2]
        u = float(np.sqrt(part.mean())) / amplitude_mT
        size = float(abs(fit.phasor_deg_per_h[k])) / amplitude_mT
        named = axis if len(driven) > 1 else None
        yield Tested("background", named, frequency_Hz, 0.0, size, u, size, u, reach * u)


def flags_of(tested: Sequence[Tested]) -> Iterator[Flag]:
    """Yield a flag for each difference that chance does not explain."""
    for test in (test for test in tested if test.differs):
        u = test.difference_uncertainty
        off = f"another one by {test.difference:+.2g} deg/h/mT ({test.difference / u:+.1f} u)"
        details = {"difference": test.difference, "standard_uncertainty": u}
        if test.check == "linearity":
            not_text = (
                f"At {test.amplitude_mT:g} mT the magnetic sensitivity of {test.axis} is {off}: "
                "the response is not in proportion to the field, as that of a shield near "
                "saturation; state the sensitivity with its field."
            )
            yield Flag("not-linear", not_text, test.axis, details)
        elif test.check == "frequency":
            differs_text = (
                f"At {test.frequency_Hz:.4g} Hz the magnetic sensitivity of {test.axis} is {off}: "
                "a delay, eddy currents and pickup grow with the frequency; the lower one is "
                "nearer to a steady field."
            )
            yield Flag("differs-with-frequency", differs_text, test.axis, details)
        else:
            line = f"{test.value:.2g} deg/h/mT"
            if test.axis is not None:
                line = f"{line} of {test.axis}"
            background_text = (
                f"With the coils off the output has a line at {test.frequency_Hz:.4g} Hz that "
                f"would pass for {line}: something else acts at the field's frequency; choose "
                "another frequency."
            )
            yield Flag("background-line", background_text, test.axis, details)
