"""What this procedure adds to the report: a summary, each record's plots, and tables of the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import matplotlib as mpl
import numpy as np
from scipy.special import stdtrit

from procedures.rlg_magnetic_sensitivity import plots, spectrum_plot
from procedures.rlg_magnetic_sensitivity.dataset import AXES, RlgDataset, Segment
from procedures.rlg_magnetic_sensitivity.findings import LineDetail, RlgAnalysis, SegmentDetail
from procedures.rlg_magnetic_sensitivity.summary_plot import SummaryRow, summary
from station.report.drawing import STYLE
from station.report.numbers import NOTHING, format_number, format_with_uncertainty
from station.report.parts import Part, Plot, Table
from station.results import ResultDocument


def draw_parts(
    analysis: RlgAnalysis,
    *,
    document: ResultDocument | None = None,
    dataset: RlgDataset | None = None,
) -> tuple[Part, ...]:
    """Return the parts of the report, from the most to the least condensed.

    `document` gives combined uncertainties and limits to the summary; without it the bars hold
    type A only. `dataset` gives the measured field and the commanded frequency to the plots of the
    records; without it the fitted ones are drawn.
    """
    parts: list[Part] = []
    with mpl.rc_context(STYLE):
        parts.append(
            Plot(
                "Sensitivity of each axis",
                "Best estimates with their expanded uncertainty"
                + (" (type A only)" if document is None else "")
                + ", against the limits where the plan sets any. The published formula takes a "
                "magnitude: it has no sign, and noise alone makes it larger than zero.",
                summary(_summary_rows(analysis, document)),
            )
        )
        for number, detail in enumerate(analysis.segments):
            lines = [line for line in analysis.lines if line.segment == number]
            if len(detail.time_s) > 2 and lines:
                segment = dataset.segments[number] if dataset is not None else None
                read = any(p.value is not None for p in analysis.published if p.axis in detail.axes)
                parts += _record_plots(detail, lines, segment, read)
    if analysis.lines:
        parts.append(_line_table(analysis.lines))
    if analysis.segments:
        parts.append(_record_table(analysis.segments))
    return tuple(parts)


def _record_plots(
    detail: SegmentDetail, lines: Sequence[LineDetail], segment: Segment | None, published: bool
) -> list[Part]:
    driven = _joined(detail.axes)
    several = len(lines) > 1
    peaks = "Circles: the peaks" if several else "Circle: the peak"
    peaks += " that the published formula reads (S7)."
    if not published:
        peaks = (
            "The published formula cannot run on this record; its spectrum is drawn about the mean "
            "without the missing samples."
        )
    quantum = segment.quantum_deg_per_h if segment is not None else 0.0
    counted = " (counting whole pulses makes it negative)" if quantum > 0.0 else ""
    left_out = int((~detail.kept).sum())
    outside = (
        " Samples left out of the fit are marked; arrows stand for those beyond the picture."
        if left_out
        else ""
    )
    parts: list[Part] = [
        Plot(
            f"{driven} driven: the record",
            "Output of the gyro: single samples; their running mean, in which the response to "
            "the field shows where it is strong enough. Below, the driving field.",
            plots.time_series(detail, lines, segment),
        ),
        Plot(
            f"{driven} driven: "
            + (
                "the lines at the fields’ frequencies"
                if several
                else "the line at the field’s frequency"
            ),
            f"{peaks} Black bar: the amplitude that noise alone "
            " gives near f. Right: the same samples averaged over the phase of the field, "
            "drift and other lines taken off; 0 deg is where the field is largest.",
            spectrum_plot.spectrum(detail, lines, segment),
        ),
    ]
    if np.isfinite(detail.residual_sigma_deg_per_h) and detail.residual_sigma_deg_per_h > 0.0:
        parts.append(
            Plot(
                f"{driven} driven: what the fit leaves",
                "Residuals should be noise without a shape. Their lag-1 correlation is "
                f"{_signed(detail.lag_one_correlation)}{counted}; "
                f"the curve is a normal distribution of the same spread.{outside}",
                plots.residuals(detail, quantum),
            )
        )
    return parts


def _summary_rows(analysis: RlgAnalysis, document: ResultDocument | None) -> list[SummaryRow]:
    published = {one.axis: one.value for one in analysis.published}
    rows = []
    if document is None:
        for one in analysis.estimates:
            expanded = None
            if one.standard_uncertainty is not None:
                freedom = min(one.degrees_of_freedom or 1e6, 1e6)
                expanded = float(stdtrit(freedom, 0.975)) * one.standard_uncertainty
            rows.append(SummaryRow(one.axis, one.value, expanded, published.get(one.axis), None))
        return rows
    for result in document.results:
        axis = result.estimate.axis or ""
        rows.append(
            SummaryRow(
                axis,
                result.estimate.value,
                result.combined.expanded_uncertainty if result.combined else None,
                published.get(axis),
                result.limit.interval() if result.limit else None,
            )
        )
    return rows


def _line_table(lines: Sequence[LineDetail]) -> Table:
    """Return the lines as columns: what was driven, what answered, along and across the field."""
    rows: list[tuple[str, Callable[[LineDetail], str]]] = [
        (
            "Frequency, fitted to the field, Hz",
            lambda x: _with_u(x.frequency_Hz, x.frequency_uncertainty_Hz),
        ),
        ("Field amplitude, mT", lambda x: format_number(x.field_amplitude_mT, 5)),
        ("Field phase at the record’s middle, deg", lambda x: f"{x.field_phase_deg:.1f}"),
        (
            "Ambient field along the axis, mT",
            lambda x: format_number(float(x.ambient_field_mT[AXES.index(x.axis)]), 3),
        ),
        ("Response amplitude, deg/h", _response),
        ("Phase of the response after the field, deg", _phase_after_field),
        ("In phase with the field, deg/h/mT", lambda x: _with_u(x.slope, x.slope_uncertainty)),
        ("In quadrature, deg/h/mT", lambda x: _with_u(x.quadrature, x.quadrature_uncertainty)),
        ("Second-order term, deg/h/mT²", lambda x: _with_u(x.quadratic, x.quadratic_uncertainty)),
        ("Value over its uncertainty (type A)", lambda x: _plain(x.significance, "{:.1f}")),
        ("Magnitude below, with 95 %, deg/h/mT", lambda x: format_number(x.upper_bound, 2)),
    ]
    texts = [[title, *(text(line) for line in lines)] for title, text in rows]
    return Table(
        "The driven lines",
        "A real sensitivity answers in phase with the field, or against it where it is negative; "
        "a part in quadrature would point to a delay, eddy currents or pickup. Uncertainties are "
        "standard, type A. The bound is given where the value is not told from zero.",
        ["", *(_line_name(line, lines) for line in lines)],
        [row for row in texts if any(cell != NOTHING for cell in row[1:])],
    )


def _record_table(segments: Sequence[SegmentDetail]) -> Table:
    rows = []
    for detail in segments:
        floor = detail.noise_floor_deg_per_h
        kept = int(detail.kept.sum())
        rows.append(
            [
                _joined(detail.axes),
                str(len(detail.time_s)),
                str(kept),
                str(len(detail.kept) - kept),
                str(detail.drift_order),
                str(detail.autoregression_order),
                f"{detail.lag_one_correlation:.3f}",
                format_number(detail.residual_sigma_deg_per_h, 3),
                format_number(_random_walk(detail, floor), 3),
            ]
        )
    return Table(
        "The records and their noise",
        "Drift is a polynomial of the order given, fitted together with the lines. The angle "
        "random walk is the noise density next to the driven frequency.",
        [
            "Driven",
            "Samples",
            "Kept",
            "Rejected",
            "Drift order",
            "Noise model order",
            "Lag-1 correlation",
            "Residual σ, deg/h",
            "Angle random walk, deg/√h",
        ],
        rows,
    )


def _random_walk(detail: SegmentDetail, floor_deg_per_h: float | None) -> float | None:
    """Return the angle random walk in deg/sqrt(h) of white noise with this floor.

    The floor is 2 sigma / sqrt(N) with sigma = 60 Q / sqrt(tau0): Q = floor sqrt(N tau0) / 120.
    """
    if floor_deg_per_h is None or len(detail.time_s) < 2:
        return None
    interval_s = float(np.median(np.diff(detail.time_s)))
    return floor_deg_per_h * float(np.sqrt(detail.kept.sum() * interval_s)) / 120.0


def _line_name(line: LineDetail, lines: Sequence[LineDetail]) -> str:
    again = sum(other.axis == line.axis for other in lines) > 1
    return f"{line.axis}, record {line.segment + 1}" if again else line.axis


def _response(line: LineDetail) -> str:
    phasor = line.gyro_phasor_deg_per_h
    return NOTHING if phasor is None else format_number(abs(phasor), 3)


def _phase_after_field(line: LineDetail) -> str:
    if line.gyro_phase_deg is None:
        return NOTHING
    return f"{(line.gyro_phase_deg - line.field_phase_deg + 180.0) % 360.0 - 180.0:.0f}"


def _with_u(value: float | None, uncertainty: float | None) -> str:
    if value is None:
        return NOTHING
    value_text, u_text = format_with_uncertainty(value, uncertainty)
    return value_text if u_text == NOTHING else f"{value_text} ± {u_text}"


def _plain(value: float | None, form: str) -> str:
    return NOTHING if value is None else form.format(value)


def _joined(axes: Sequence[str]) -> str:
    return axes[0] if len(axes) == 1 else ", ".join(axes[:-1]) + " and " + axes[-1]


def _signed(value: float) -> str:
    return f"{value:.3f}".replace("-", "−")
