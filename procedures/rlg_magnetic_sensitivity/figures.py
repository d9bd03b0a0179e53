"""What this procedure adds to the report: a summary, each record's plots, and tables of the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.rlg_magnetic_sensitivity import (
    allan_plot,
    phase_plot,
    plots,
    spectrum_plot,
    tables,
)
from procedures.rlg_magnetic_sensitivity.dataset import Segment
from procedures.rlg_magnetic_sensitivity.evaluate import RlgDetail
from procedures.rlg_magnetic_sensitivity.findings import LineDetail, RlgAnalysis, SegmentDetail
from procedures.rlg_magnetic_sensitivity.summary_plot import SummaryRow, summary
from station.findings import Findings
from station.report.parts import Part, Plot
from station.results import ResultDocument

ALLAN = (
    "Of the output without the fitted lines, drift included: the overlapping estimator (NIST "
    "SP 1065). The curve is σ²(τ) = 3 Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 with the "
    "coefficients of the table of the records, not below zero (IEEE Std 952, annex C): Q "
    "quantisation, N angle random walk, B bias instability, K rate random walk. A short record "
    "tells nothing of those that act in long times."
)


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report, from the most to the least condensed."""
    detail: RlgDetail = findings.detail
    analysis: RlgAnalysis = detail.analysis
    if not analysis.segments:
        return ()
    parts: list[Part] = []
    parts.append(
        Plot(
            "Sensitivity of each axis",
            "Best estimates with their expanded uncertainty, against the limits where the "
            "plan sets any. The published formula takes a magnitude: it has no sign, and noise "
            "alone makes it larger than zero.",
            summary(_summary_rows(analysis, document)),
        )
    )
    records = zip(analysis.segments, detail.dataset.segments, strict=True)
    for number, (record, segment) in enumerate(records):
        lines = [line for line in analysis.lines if line.segment == number]
        if len(record.time_s) > 2 and lines:
            read = any(p.value is not None for p in analysis.published if p.axis in record.axes)
            parts += _record_plots(record, lines, segment, read)
    parts += _overviews(analysis)
    if analysis.lines:
        parts.append(tables.lines(analysis.lines))
    if detail.coils:
        parts.append(tables.coils(detail.coils))
    if detail.tested:
        parts.append(tables.tests(detail.tested))
    return (*parts, tables.records(analysis.segments))


def _overviews(analysis: RlgAnalysis) -> list[Part]:
    """Return what all records have in common: responses against the field, and the noise."""
    parts: list[Part] = []
    if any(line.slope is not None for line in analysis.lines):
        parts.append(
            Plot(
                "Response against field",
                "The response of each axis over its field, as a phasor: to the right what answers "
                "in phase with the field, upwards what comes before it. A sensitivity lies on the "
                "horizontal line; the circles are where 95 % of such measurements would lie. What "
                "other driven axes contribute is taken off.",
                phase_plot.phase_diagram(analysis.lines),
            )
        )
    if any(len(detail.allan.tau_s) for detail in analysis.segments):
        parts.append(Plot("Allan deviation", ALLAN, allan_plot.allan(analysis.segments)))
    return parts


def _record_plots(
    detail: SegmentDetail, lines: Sequence[LineDetail], segment: Segment, published: bool
) -> list[Part]:
    driven = tables.joined(detail.axes)
    several = len(lines) > 1
    peaks = "Circles: the peaks" if several else "Circle: the peak"
    peaks += " that the published formula reads (S7)."
    if not published:
        peaks = (
            "The published formula cannot run on this record; its spectrum is drawn about the mean "
            "without the missing samples."
        )
    quantum = segment.quantum_deg_per_h
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
                f"{tables.signed(detail.lag_one_correlation)}{counted}; "
                f"the curve is a normal distribution of the same spread.{outside}",
                plots.residuals(detail, quantum),
            )
        )
    return parts


def _summary_rows(analysis: RlgAnalysis, document: ResultDocument) -> list[SummaryRow]:
    published = {one.axis: one.value for one in analysis.published}
    rows = []
    for result in document.results:
        axis = result.estimate.axis or ""
        rows.append(
            SummaryRow(
                axis,
                result.estimate.value,
                result.expanded_uncertainty,
                published.get(axis),
                result.limit.interval() if result.limit else None,
            )
        )
    return rows
