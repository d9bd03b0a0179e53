"""What the reader must know about records at rest, one flag a sentence."""

from __future__ import annotations

from procedures.estimation.flags import counted, not_identifiable
from station.findings import Flag

from .axis import AxisAnalysis
from .dataset import COEFFICIENTS, AnalysisSettings, StaticDataset
from .parameters import UNITS
from .screening import is_coarse, smallest_step


def data_flags(dataset: StaticDataset, one: AxisAnalysis, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on samples: what was left out, and an output of few steps."""
    flags = []
    totals = {
        "outliers-rejected": (
            sum(s.wild for s in one.screened),
            f"lie more than {settings.outlier:g} standard deviations from their neighbours and are "
            "left out",
        ),
        "frozen": (
            sum(s.frozen for s in one.screened),
            "repeat one value longer than noise lets them and are left out",
        ),
        "saturated": (
            sum(s.saturated for s in one.screened),
            "stand at one value far from all others and are left out",
        ),
    }
    for code, (count, what) in totals.items():
        if count:
            said = f"{counted(count, 'sample')} of {one.axis} {what}."
            flags.append(Flag(code, said, one.axis, {"count": count}))
    return flags + _coarse(dataset, one)


def _coarse(dataset: StaticDataset, one: AxisAnalysis) -> list[Flag]:
    if one.fit is None:
        return []
    if dataset.pulse_arcsec:
        if not one.fit.sawtooth:
            return []
        said = (
            f"{one.axis} walks by less than half a pulse from sample to sample: its roundings "
            "follow one another, and u of the quantisation noise is twice as large."
        )
        return [Flag("coarse-output", said, one.axis)]
    step = max(smallest_step(piece) for piece in one.fit.pieces)
    if not any(is_coarse(piece, step) for piece in one.fit.pieces):
        return []
    said = (
        f"The output of {one.axis} has steps of {step:.3g} deg/h, as large as its noise; the "
        "rounding of a rate is white and stands in the angle random walk."
    )
    return [Flag("coarse-output", said, one.axis, {"step_deg_per_h": step})]


def noise_flags(one: AxisAnalysis, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on the noise of an axis."""
    fit = one.fit
    if fit is None:
        lost = [name for name in UNITS if name not in ("bias", "bias_repeatability")]
        said = f"No record of {one.axis} is long enough to show its noise; record longer."
        return [not_identifiable(said, lost, one.axis)]
    flags = []
    small = []
    for n, name in enumerate(COEFFICIENTS):
        if n == 0 and not fit.quantisation_seen:
            said = (
                f"The output of {one.axis} is filtered: up to a quarter of its bandwidth "
                "quantisation noise does not show."
            )
            flags.append(not_identifiable(said, [name], one.axis))
        elif fit.theta[n] < settings.not_significant * fit.u[n]:
            small.append(name)
    if small:
        said = (
            f"Of {one.axis} the squares of {', '.join(small)} are less than "
            f"{settings.not_significant:g} of their standard uncertainties: the upper limits say "
            "what the record shows."
        )
        flags.append(Flag("not-significant", said, one.axis, {"coefficients": small}))
    if abs(fit.ramp) > settings.drift_removed * fit.ramp_u:
        said = (
            f"{one.axis} drifts by {fit.ramp:.3g} deg/h^2, u = {fit.ramp_u:.2g}; the drift is "
            "fitted with the noise and is not in its coefficients."
        )
        flags.append(Flag("drift-removed", said, one.axis, {"ramp_deg_per_h2": fit.ramp}))
    for line in fit.lines:
        said = (
            f"{one.axis} swings by {line.amplitude_deg_per_h:.3g} deg/h with a period of "
            f"{1.0 / line.frequency_Hz:.4g} s; the line is fitted with the noise. Look for what "
            "has this period: air conditioning, dither, a neighbour."
        )
        details = {
            "period_s": 1.0 / line.frequency_Hz,
            "amplitude_deg_per_h": line.amplitude_deg_per_h,
        }
        flags.append(Flag("periodic", said, one.axis, details))
    if one.minimum is not None and one.minimum.at_end:
        said = (
            f"The Allan deviation of {one.axis} still falls at {one.minimum.tau_s:.4g} s, a ninth "
            "of the longest record: its minimum lies beyond. Record longer."
        )
        flags.append(Flag("short-record", said, one.axis, {"tau_s": one.minimum.tau_s}))
    return flags
