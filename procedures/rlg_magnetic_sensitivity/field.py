"""The driven field as it was measured: frequency, phasors on three axes, ambient field.

A gaussmeter of one axis is turned along each coil's normal in turn. The two other components are
taken as zero; that gyro and field do not lie exactly so is an uncertainty of type B.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from procedures.estimation.flags import SEEN
from procedures.estimation.linear import combine, least_squares, robust_sigma
from procedures.estimation.recorder import resolution
from procedures.estimation.sine import (
    averaging_factor,
    coarse_frequency,
    legendre_columns,
    line_columns,
    phasors,
    refine_frequency,
)

from .dataset import AXES, Array, Complex, Mask, Segment
from .frequencies import Drive

Groups = list[tuple[tuple[str, ...], float]]
"""The lines of a field: the axes that drive each, and the commanded frequency in Hz."""

_DRIFT_ORDER = 2
_OUTLIER = 8.0
_FEWEST_SIGMAS = 8.0
_MIN_KEPT = 0.5
"""Where more of the field's samples are wild than not, nobody can say which of them are right."""
_MIN_EXPLAINED = 0.5
"""Of the power of a coil's own component, the part that its own line must have."""


@dataclass(frozen=True)
class FieldLine:
    """One frequency of the field: who drives it, its phasors on IA, NA, LA and at twice f.

    Phasors (mT) refer to the middle of the gyro record and are corrected for the gaussmeter's
    averaging. `variance_mT2` (3,) is the noise variance of one part (real or imaginary) of each.
    `second_mT` is the field's own line at 2f, zero where it could not be fitted. `problem` says why
    the line cannot be used; `measured`, whether the phasors say what field there was all the same.
    """

    axes: tuple[str, ...]
    frequency_Hz: float
    frequency_uncertainty_Hz: float
    phasor_mT: Complex
    variance_mT2: Array
    second_mT: Complex
    problem: str | None
    measured: bool

    @property
    def axis(self) -> str | None:
        """The axis that drives it, None where several do."""
        return self.axes[0] if len(self.axes) == 1 else None


@dataclass(frozen=True)
class FieldFit:
    """The lines of one segment's field, its mean (ambient) field, rows set aside as wild.

    `wild` (m,) marks these rows.
    """

    lines: tuple[FieldLine, ...]
    ambient_mT: Array
    wild: Mask

    @property
    def rows_rejected(self) -> int:
        """The number of wild rows."""
        return int(self.wild.sum())


def fit_field(segment: Segment) -> FieldFit:
    """Fit every driven line in the field record of a segment.

    The frequency of each line comes from the component along the axis that drives it (variable
    projection, ambient field and slow drift beside it); the phasors of all three components then
    come from one linear fit at those frequencies. Time zero is the middle of the gyro's record.
    """
    span_s = float(np.ptp(segment.field_time_s)) if len(segment.field_time_s) else 0.0
    groups = _groups(segment.drive, span_s)
    finite = np.isfinite(segment.field_mT).all(axis=1) & np.isfinite(segment.field_time_s)
    time_s = segment.field_time_s[finite] - segment.middle_s
    field_mT = segment.field_mT[finite]
    columns = _DRIFT_ORDER + 1 + 4 * len(groups)
    if len(time_s) < 2 * columns or time_s[-1] <= time_s[0]:
        reason = f"the field record holds {len(time_s)} samples, too few for a fit"
        return _no_fit(groups, field_mT, ~finite, reason)
    frequencies, uncertainties, kept = _frequencies(segment.drive, groups, time_s, field_mT)
    wild = ~finite
    wild[np.flatnonzero(finite)[~kept]] = True
    rejected = int((~kept).sum())
    if len(time_s) - rejected < max(2 * columns, _MIN_KEPT * len(time_s)):
        reason = f"{rejected} of {len(time_s)} samples of the field fit no sine of one amplitude"
        return _no_fit(groups, field_mT, ~finite, reason)
    lines_Hz = frequencies, uncertainties
    return _linear_fit(segment, groups, *lines_Hz, time_s[kept], field_mT[kept], wild)


def stretch_of_field(
    drive: Mapping[str, Drive], time_s: Array, field_mT: Array
) -> tuple[Mask, Callable[[Array], Array]]:
    """Return which readings of a stretch fit its sines, and the field (n, 3) at given times.

    Where most of them do not, all are kept: the fit of the whole record will tell.
    """
    start_s, stop_s = float(time_s[0]), float(time_s[-1])
    everything = np.ones(len(time_s), dtype=bool)
    groups = _groups(drive, stop_s - start_s)
    if len(time_s) < 2 * (_DRIFT_ORDER + 1 + 4 * len(groups)) or stop_s <= start_s:
        mean_mT = field_mT.mean(axis=0)
        return everything, lambda at_s: np.tile(mean_mT, (len(at_s), 1))
    middle_s = 0.5 * (start_s + stop_s)
    frequencies, _, kept = _frequencies(drive, groups, time_s - middle_s, field_mT)
    if int(kept.sum()) < _MIN_KEPT * len(time_s):
        kept = everything

    def columns(at_s: Array) -> Array:
        drift = legendre_columns(at_s, _DRIFT_ORDER, start_s, stop_s)
        return np.hstack((drift, line_columns(at_s - middle_s, frequencies)))

    design = columns(time_s[kept])
    coefficients = [least_squares(design, field_mT[kept, a]).coefficients for a in range(3)]
    return kept, lambda at_s: columns(at_s) @ np.column_stack(coefficients)


def _no_fit(groups: Groups, field_mT: Array, wild: Mask, reason: str) -> FieldFit:
    ambient = np.median(field_mT, axis=0) if len(field_mT) else np.zeros(3)
    zero, nothing = np.zeros(3), np.zeros(3, dtype=np.complex128)
    lines = (
        FieldLine(axes, f, 0.0, nothing, zero, nothing, reason, measured=False)
        for axes, f in groups
    )
    return FieldFit(tuple(lines), ambient, wild)


def _groups(drive: Mapping[str, Drive], span_s: float) -> Groups:
    """Axes driven at the same frequency (within a hundredth of 1/T) share one line."""
    groups: Groups = []
    for axis in (a for a in AXES if a in drive):
        own_Hz = drive[axis].frequency_Hz
        shared = [k for k, (_, f) in enumerate(groups) if abs(f - own_Hz) * span_s <= 0.01]
        if shared:
            axes, f = groups[shared[0]]
            groups[shared[0]] = ((*axes, axis), f)
        else:
            groups.append(((axis,), own_Hz))
    return groups


def _frequencies(
    drive: Mapping[str, Drive], groups: Groups, time_s: Array, field_mT: Array
) -> tuple[list[float], list[float], Mask]:
    span_s = float(time_s[-1] - time_s[0])
    # A wild reading must not choose the starting point: clip far outside of any sine.
    middle = np.median(field_mT, axis=0)
    reach = 6.0 * np.array([robust_sigma(field_mT[:, a]) for a in range(3)])
    reach = np.where(reach > 0.0, reach, np.inf)
    clipped = np.clip(field_mT, middle - reach, middle + reach)
    parts: list[int] = []
    frequencies = [f for _, f in groups]
    for k, (axes, commanded) in enumerate(groups):
        spacing = [0.4 * abs(f - commanded) for j, (_, f) in enumerate(groups) if j != k]
        reach_Hz = min([max(2.0 / span_s, 0.02 * commanded), 0.9 * commanded, *spacing])
        least_mT = SEEN * drive[axes[0]].amplitude_mT
        part, frequencies[k] = _strongest(axes, time_s, clipped, commanded, reach_Hz, least_mT)
        parts.append(part)
    uncertainties = [0.0] * len(groups)
    for k, part in enumerate(parts):
        frequencies[k], _ = refine_frequency(time_s, clipped[:, part], frequencies, k, _DRIFT_ORDER)
    design = np.hstack((_drift(time_s), line_columns(time_s, frequencies)))
    kept = np.ones(len(time_s), dtype=bool)
    for a in range(3):
        fit = least_squares(design, clipped[:, a])
        residuals = field_mT[:, a] - combine(design, fit.coefficients)
        # The waveform of a programmed list is not a perfect sine; its steps are no outliers, nor
        # are those of a gaussmeter with few digits.
        floor = max(0.01 * float(np.ptp(clipped[:, a])), resolution(field_mT[:, a]))
        kept &= np.abs(residuals) <= _OUTLIER * robust_sigma(residuals, floor) + 1e-12
    for k, part in enumerate(parts if kept.any() else ()):
        frequencies[k], uncertainties[k] = refine_frequency(
            time_s[kept], field_mT[kept, part], frequencies, k, _DRIFT_ORDER
        )
    return frequencies, uncertainties, kept


def _strongest(
    axes: tuple[str, ...],
    time_s: Array,
    field_mT: Array,
    commanded_Hz: float,
    reach_Hz: float,
    least_mT: float,
) -> tuple[int, float]:
    """Return the component that holds a line, and about its frequency.

    That is a component along an axis that drives it; where the line is not there, as with two coils
    exchanged, whichever has it.
    """

    def line_of(part: int) -> tuple[float, float]:
        frequency = coarse_frequency(time_s, field_mT[:, part], commanded_Hz, reach_Hz)
        moved = field_mT[:, part] - np.mean(field_mT[:, part])
        return 2.0 * abs(np.mean(moved * np.exp(-2j * np.pi * frequency * time_s))), frequency

    own = max((AXES.index(a) for a in axes), key=lambda a: float(np.std(field_mT[:, a])))
    lines = {own: line_of(own)}
    if lines[own][0] < least_mT:
        lines |= {part: line_of(part) for part in range(3) if part != own}
    part = max(lines, key=lambda axis: lines[axis][0])
    return part, lines[part][1]


def _drift(time_s: Array) -> Array:
    return legendre_columns(time_s, _DRIFT_ORDER, float(time_s[0]), float(time_s[-1]))


def _linear_fit(
    segment: Segment,
    groups: Groups,
    frequencies: list[float],
    uncertainties: list[float],
    time_s: Array,
    field_mT: Array,
    wild: Mask,
) -> FieldFit:
    span_s = float(time_s[-1] - time_s[0])
    step_s = float(np.median(np.diff(time_s)))
    count, first = len(frequencies), _DRIFT_ORDER + 1
    doubles = [
        2.0 * f
        for f in frequencies
        if 2.0 * f * step_s < 0.45 and all(abs(2.0 * f - g) * span_s > 1.0 for g in frequencies)
    ]
    design = np.hstack((_drift(time_s), line_columns(time_s, frequencies + doubles)))
    freedom = max(len(time_s) - design.shape[1], 1)
    fits = [least_squares(design, component) for component in field_mT.T]
    ambient = np.array([fit.coefficients[0] for fit in fits])
    lines_mT = np.column_stack([phasors(fit.coefficients[first:]) for fit in fits])
    spread = np.column_stack([np.diag(x.inverse_normal) * x.sum_of_squares for x in fits]) / freedom
    variance = spread[first : first + 2 * count].reshape(count, 2, 3).mean(axis=1)
    scatter_mT = np.std(field_mT, axis=0)
    lines = []
    for k, (axes, _) in enumerate(groups):
        factor, double_factor = (
            averaging_factor(times * frequencies[k], segment.field_averaging_s) for times in (1, 2)
        )
        double = np.zeros(3, dtype=np.complex128)
        if 2.0 * frequencies[k] in doubles and abs(double_factor) >= 0.1:
            double = lines_mT[count + doubles.index(2.0 * frequencies[k])] / double_factor
        blurred = None
        if frequencies[k] * step_s >= 0.45:
            blurred = "the field was sampled too slowly for the driven frequency"
        elif any(abs(f - frequencies[k]) * span_s < 1.0 for f in np.delete(frequencies, k)):
            blurred = "another axis was driven at almost the same frequency"
        elif abs(factor) < 0.1:
            blurred, factor = "the gaussmeter's averaging removes the driven frequency", 1.0
        absent = _absent(axes, segment.drive, frequencies, k, lines_mT, variance[k], scatter_mT)
        lines.append(
            FieldLine(
                axes=axes,
                frequency_Hz=frequencies[k],
                frequency_uncertainty_Hz=uncertainties[k],
                phasor_mT=lines_mT[k] / factor,
                variance_mT2=variance[k] / factor**2,
                second_mT=double,
                problem=blurred or absent,
                measured=blurred is None,
            )
        )
    return FieldFit(tuple(lines), ambient, wild)


def _absent(
    axes: tuple[str, ...],
    drive: Mapping[str, Drive],
    frequencies: list[float],
    k: int,
    lines_mT: Complex,
    variance: Array,
    scatter_mT: Array,
) -> str | None:
    """Return that an axis which should drive line `k` does not, or not alone; None where all do.

    `lines_mT` (n, 3) holds the phasors of all lines, `scatter_mT` (3,) is that of the readings.
    """
    lines_mT = lines_mT[: len(frequencies)]
    line_mT = lines_mT[k]
    for axis in axes:
        a = AXES.index(axis)
        size = abs(line_mT[a])
        wanted = 1e-3 * drive[axis].amplitude_mT
        if size <= max(_FEWEST_SIGMAS * float(np.sqrt(variance[a])), wanted, 1e-12):
            return f"the field record shows no line at the driven frequency on {axis}"
        beside = max(
            [abs(line_mT[b]) for b, other in enumerate(AXES) if other not in axes], default=0
        )
        explained = size**2 > 2.0 * _MIN_EXPLAINED * float(scatter_mT[a]) ** 2
        if size < 0.5 * beside or not explained:
            at, of = int(np.argmax(np.abs(line_mT))), int(np.argmax(np.abs(lines_mT[:, a])))
            seen = "swings otherwise"
            if AXES[at] not in axes:
                seen = f"swings more on {AXES[at]} at this frequency"
            elif of != k:
                seen = f"swings more at {frequencies[of]:.4g} Hz"
            return (
                f"the field on {axis} should swing at {frequencies[k]:.4g} Hz and {seen}: look for "
                "exchanged columns, probes or coils, for a wrong drive, and for rows that were "
                "lost or copied"
            )
    return None
