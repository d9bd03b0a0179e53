"""What this procedure adds to the report: a summary, each record's plots, and tables of the fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from procedures.common import homogeneity
from station.findings import Findings
from station.parts import Part, Table
from station.report.numbers import NOTHING, format_number, format_with_uncertainty
from station.results import ResultDocument

from . import plots, spectrum_plot
from .coils import CoilResponse
from .dataset import AXES
from .evaluate import RlgDetail
from .fitted import FittedRecord, LineDetail
from .steadiness import Tested

TESTS = {
    "linearity": "half the field",
    "frequency": "another frequency",
    "background": "coils off: magnitude of the line",
}


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report, from the most to the least condensed."""
    detail: RlgDetail = findings.detail
    analysis = detail.analysis
    if not analysis.segments:
        return ()
    parts: list[Part] = [plots.summary(document)]
    for number, record in enumerate(analysis.segments):
        lines = [line for line in analysis.lines if line.segment == number]
        if len(record.segment.time_s) > 2 and lines:
            read = any(p.value is not None for p in analysis.published if p.axis in record.axes)
            parts.append(plots.time_series(record, lines))
            parts.append(spectrum_plot.spectrum(record, lines, published=read))
            if record.gyro.residual_sigma_deg_per_h > 0.0:
                parts.append(plots.residuals(record))
    if any(line.slope is not None for line in analysis.lines):
        parts.append(spectrum_plot.phase_diagram(analysis.lines))
    if any(len(record.allan.tau_s) for record in analysis.segments):
        parts.append(spectrum_plot.allan(analysis.segments))
    if analysis.lines:
        parts.append(line_table(analysis.lines))
    if detail.coils:
        parts.append(coil_table(detail.coils))
    if detail.dataset.at_device is not None:
        parts.append(homogeneity.table(detail.dataset.at_device))
    if detail.tested:
        parts.append(check_table(detail.tested))
    return (*parts, record_table(analysis.segments))


def line_table(driven: Sequence[LineDetail]) -> Table:
    """Return the lines as columns: what was driven, what answered, along and across the field."""
    rows: list[tuple[str, Callable[[LineDetail], str]]] = [
        (
            "Frequency, fitted to the field, Hz",
            lambda x: with_u(x.frequency_Hz, x.field.frequency_uncertainty_Hz),
        ),
        ("Field amplitude, mT", lambda x: format_number(abs(x.own_field_mT), 5)),
        ("Field phase at the record’s middle, deg", lambda x: f"{x.field_phase_deg:.1f}"),
        (
            "Ambient field along the axis, mT",
            lambda x: format_number(float(x.ambient_field_mT[AXES.index(x.axis)]), 3),
        ),
        ("Response amplitude, deg/h", response),
        ("Phase of the response before the field, deg", phase_before_field),
        ("In phase with the field, deg/h/mT", lambda x: with_u(x.slope, x.slope_uncertainty)),
        ("In quadrature, deg/h/mT", lambda x: with_u(x.quadrature, x.quadrature_uncertainty)),
        ("Second-order term, deg/h/mT²", lambda x: with_u(x.quadratic, x.quadratic_uncertainty)),
        ("Value over its uncertainty (type A)", lambda x: plain(x.significance, "{:.1f}")),
        ("Magnitude below, with 95 %, deg/h/mT", lambda x: format_number(x.upper_bound, 2)),
    ]
    texts = [[title, *(text(line) for line in driven)] for title, text in rows]
    return Table(
        "The driven lines",
        "A real sensitivity answers in phase with the field, or against it where it is negative; "
        "a part in quadrature would point to a delay, eddy currents or pickup. Uncertainties are "
        "standard, type A. The bound is given where the value is not distinguished from zero.",
        ["", *(line_name(line, driven) for line in driven)],
        [row for row in texts if any(cell != NOTHING for cell in row[1:])],
    )


def coil_table(responses: Mapping[str, CoilResponse]) -> Table:
    """Return the 3 x 3 response of the coils: field on each axis over the commanded field."""
    rows = []
    for response in responses.values():
        own = AXES.index(response.axis)
        cells = [f"coil of {response.axis}"]
        for a in range(3):
            text = with_u(float(response.components[a]), float(response.uncertainty[a]))
            lean = with_u(float(response.lean_deg[a]), float(response.lean_uncertainty_deg[a]))
            cells.append(text if a == own or text == NOTHING else f"{text} ({lean} deg)")
        cells.append(
            with_u(float(response.lean_deg[own]), float(response.lean_uncertainty_deg[own]))
        )
        rows.append(cells)
    return Table(
        "The field of each coil",
        "The measured field along each axis of the probe over the commanded field, in phase with "
        "the coil, and by which angle it leans towards the others. One on the diagonal and zero "
        "elsewhere are a coil that makes what was asked for. The sensitivities are solved with the "
        "measured components, so that neither spoils them. Uncertainties are standard, type A; "
        "how the probe itself stands against the gyro is not in them.",
        ["driven", *(f"on {axis}" for axis in AXES), "angle to its axis, deg"],
        rows,
    )


def check_table(tested: Sequence[Tested]) -> Table:
    """Return the repeats under other conditions, each against the result."""
    rows = [
        [
            TESTS[test.check],
            test.axis or "all",
            f"{test.frequency_Hz:.4g}",
            f"{test.amplitude_mT:g}",
            with_u(test.value, test.uncertainty),
            NOTHING
            if test.check == "background"
            else with_u(test.difference, test.difference_uncertainty),
            format_number(test.bound, 2),
            "differs" if test.differs else "agrees",
        ]
        for test in tested
    ]
    return Table(
        "The result under other conditions",
        "In deg/h/mT, with standard uncertainties. A difference within the bound is what noise "
        "makes. With the coils off the line at the field’s frequency is divided by M: what it "
        "would add to a result.",
        ["repeated with", "axis", "f, Hz", "M, mT", "found", "less the result", "bound", ""],
        rows,
    )


def record_table(records: Sequence[FittedRecord]) -> Table:
    """Return each record with its noise: what was kept, drift, and the noise coefficients."""
    rows = []
    for record in records:
        gyro, noise, count = record.gyro, record.noise, len(record.gyro.kept)
        floor = float(gyro.noise_floor_deg_per_h[0]) if record.fitted else None
        coefficients = [NOTHING] * 4
        if noise is not None:
            coefficients = [
                format_number(noise.quantisation_arcsec, 2),
                format_number(noise.angle_random_walk_deg_per_sqrt_h, 3),
                format_number(noise.bias_instability_deg_per_h, 2),
                format_number(noise.rate_random_walk_deg_per_h_sqrt_h, 2),
            ]
        rows.append(
            [
                plots.joined(record.axes),
                str(count),
                str(count - int(gyro.kept.sum())),
                str(gyro.drift_order),
                str(gyro.autoregression_order),
                f"{gyro.lag_one_correlation:.3f}",
                format_number(gyro.residual_sigma_deg_per_h, 3),
                format_number(random_walk(record, floor), 3),
                *coefficients,
            ]
        )
    return Table(
        "The records and their noise",
        "Drift is a polynomial of the order given, fitted together with the lines. The noise at f "
        "is the density next to the driven frequency, written as an angle random walk: "
        "uncertainties come from it, not from the total scatter. Q, N, B, K are fitted to the "
        "Allan deviation; zero where the record shows nothing of one.",
        [
            "Driven",
            "Samples",
            "Rejected",
            "Drift order",
            "Noise model order",
            "Lag-1 correlation",
            "Residual σ, deg/h",
            "Noise at f, deg/√h",
            "Q, arcsec",
            "N, deg/√h",
            "B, deg/h",
            "K, deg/h/√h",
        ],
        rows,
    )


def random_walk(record: FittedRecord, floor_deg_per_h: float | None) -> float | None:
    """Return the angle random walk in deg/sqrt(h) of white noise with this floor.

    The floor is 2 sigma / sqrt(N) with sigma = 60 Q / sqrt(tau0): Q = floor sqrt(N tau0) / 120.
    """
    if floor_deg_per_h is None or len(record.segment.time_s) < 2:
        return None
    interval_s = float(np.median(np.diff(record.segment.time_s)))
    return floor_deg_per_h * float(np.sqrt(record.gyro.kept.sum() * interval_s)) / 120.0


def line_name(line: LineDetail, driven: Sequence[LineDetail]) -> str:
    """Return the axis of a line, with the number of its record where several records drive it."""
    again = sum(other.axis == line.axis for other in driven) > 1
    return f"{line.axis}, record {line.segment + 1}" if again else line.axis


def response(line: LineDetail) -> str:
    """Return the amplitude of the response in deg/h."""
    phasor = line.gyro_phasor_deg_per_h
    return NOTHING if phasor is None else format_number(abs(phasor), 3)


def phase_before_field(line: LineDetail) -> str:
    """Return by how many deg the response comes before the field, within half a turn."""
    if line.gyro_phasor_deg_per_h is None:
        return NOTHING
    phase_deg = float(np.degrees(np.angle(line.gyro_phasor_deg_per_h)))
    return f"{(phase_deg - line.field_phase_deg + 180.0) % 360.0 - 180.0:.0f}"


def with_u(value: float | None, uncertainty: float | None) -> str:
    """Return a value with its uncertainty, rounded together."""
    if value is None or not np.isfinite(value):
        return NOTHING
    value_text, u_text = format_with_uncertainty(value, uncertainty)
    return value_text if u_text == NOTHING else f"{value_text} ± {u_text}"


def plain(value: float | None, form: str) -> str:
    """Return a value in a form of its own."""
    return NOTHING if value is None else form.format(value)
