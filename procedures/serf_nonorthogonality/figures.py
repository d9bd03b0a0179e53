"""What this procedure adds to the report: the angles, checks, every shot, and what was fitted."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from station.findings import Findings
from station.report.drawing import STYLE
from station.report.numbers import (
    NOTHING,
    format_limit,
    format_number,
    format_result,
    format_with_uncertainty,
)
from station.report.parts import Part, Plot, Table
from station.results import ResultDocument

from . import plots
from .dataset import (
    ANGLE,
    FACTOR,
    RESIDUAL,
    SLOWING_DOWN,
    SerfAnalysis,
    SerfDataset,
)
from .shots import AXES, PAIRS

ARCSEC_PER_DEG = 3600.0


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: the angles first, then what is behind them."""
    analysis: SerfAnalysis = findings.detail.analysis
    dataset: SerfDataset = findings.detail.dataset
    parts: list[Part] = [_angles(analysis, document)]
    parts.append(_coils(analysis, dataset, document))
    if analysis.checks:
        parts.append(_checks(analysis))
    shots = plots.drawn_shots(analysis, dataset)
    with mpl.rc_context(STYLE):
        if shots:
            said = "The fit is a decaying tone with decaying baseline and offset"
            if analysis.joint is not None:
                said = "The fit is that of all shots, whose frequency falls as their spins fade"
            parts += [
                Plot(
                    "Shots and their fits",
                    f"Samples (dots) and fit (line) over the first {plots.DECAYS_SHOWN:g} 1/e "
                    f"times. {said}; where the field lies between pump and probe the baseline is "
                    "as large as the tone.",
                    plots.signals(shots),
                ),
                Plot(
                    "What the fits leave",
                    "Residuals over the standard deviation of a sample: noise without a shape "
                    "where the model is right.",
                    plots.residuals(shots),
                ),
                Plot(
                    "Spectra",
                    "Amplitude of signal (blue) and residual (green); dashed, the fitted "
                    "frequency. The highest point of a spectrum is not it: lines are as wide as "
                    "they fade, and the baseline leaks into them.",
                    plots.spectra(shots),
                ),
            ]
        if any(shot.used and np.isfinite(shot.misfit) for shot in analysis.shots):
            parts.append(
                Plot(
                    "Shots against the solution",
                    "Frequency of each shot less that of angles, factors and residual field as "
                    "solved, over its uncertainty. With as many shots as unknowns all are zero.",
                    plots.misfit(analysis),
                )
            )
    return (*parts, _shots(analysis))


def _angles(analysis: SerfAnalysis, document: ResultDocument) -> Table:
    paper = {one.axis: one.value for one in analysis.published}
    rows = []
    for pair in PAIRS:
        one = document.result(ANGLE, pair)
        value, spread = format_result(one)
        off = None if one.estimate.value is None else (one.estimate.value - 90.0) * ARCSEC_PER_DEG
        u = one.expanded_uncertainty
        off_text, off_spread = format_with_uncertainty(
            off, None if u is None else u * ARCSEC_PER_DEG
        )
        limit = format_limit(one.limit)
        published = NOTHING if paper[pair] is None else f"{paper[pair]:.4f}"
        rows.append([f"θ{pair}", value, spread, off_text, off_spread, limit, published])
    return Table(
        "Angles between the coil axes",
        "Between the positive axes; 90 deg is orthogonal. U is the expanded uncertainty; the last "
        "column is the law of cosines of the source document on the same frequencies.",
        [
            "",
            "angle, deg",
            "U (95 %), deg",
            "less 90 deg, arcsec",
            "U (95 %), arcsec",
            "limit",
            "as published, deg",
        ],
        rows,
    )


def _coils(analysis: SerfAnalysis, dataset: SerfDataset, document: ResultDocument) -> Table:
    rows = []
    for axis in AXES:
        factor, residual = (document.result(name, axis) for name in (FACTOR, RESIDUAL))
        rows.append([axis, *format_result(factor), *format_result(residual)])
    value, spread = format_result(document.result(SLOWING_DOWN))
    said = f"Slowing-down factor Q = {value} ± {spread} (95 %) without polarisation. "
    if analysis.residual_field_nT is not None:
        said += f"Residual field {format_number(analysis.residual_field_nT, 3)} nT in all. "
    if analysis.joint is not None:
        said += (
            f"Polarisation at the beginning {analysis.joint.polarisation:.3f}; the frequency falls "
            f"by {100.0 * analysis.chirp:.3g} % over the decay. "
        )
    if analysis.lean is not None:
        aside, towards = np.degrees(analysis.lean.rad[:2])
        u = np.degrees(np.sqrt(np.diag(analysis.lean.covariance)[:2]).max())
        said += (
            f"The spins began {aside:.2f} deg aside of the plane of pump and probe and "
            f"{towards:.2f} deg towards the probe from the pump light (u = {u:.2g} deg). "
        )
    if analysis.rate_per_s is not None:
        said += f"Decay R/Q(0) = {format_number(analysis.rate_per_s, 4)} /s"
        if analysis.beta_s > 0.0:
            said += f", spin-exchange broadening {format_number(analysis.beta_s, 3)} s × ω²"
        said += ". "
    said += (
        "Commanded fields were taken as exact."
        if dataset.constants_known
        else "Factors are true over commanded field, relative to the coil whose factor is one."
    )
    return Table(
        "Coils, residual field and slowing-down factor",
        said,
        ["coil", "factor", "U (95 %)", "residual field, nT", "U (95 %), nT"],
        rows,
    )


def _checks(analysis: SerfAnalysis) -> Table:
    words = {True: "yes", False: "NO", None: "not to be told"}
    rows = [[one.what, one.found, one.wanted, words[one.passed]] for one in analysis.checks]
    return Table(
        "Checks", "What the result should agree with.", ["check", "found", "wanted", "holds"], rows
    )


def _shots(analysis: SerfAnalysis) -> Table:
    rows = []
    for shot in analysis.shots:
        fit = shot.fit
        name = shot.name.replace("-", "−")
        if fit is None:
            rows.append([name, *[NOTHING] * 8, shot.rejected or ""])
            continue
        omega, omega_u = shot.omega_rad_per_s, shot.omega_u
        if not np.isfinite(omega):
            omega, omega_u = fit.omega_rad_per_s, fit.omega_u
        value, u = format_with_uncertainty(omega, omega_u)
        rows.append(
            [
                name,
                value,
                u,
                format_number(omega / (2.0 * np.pi), 6),
                format_number(fit.decay_per_s, 4),
                f"{fit.cycles:.2f}",
                format_number(fit.amplitude_V, 3),
                format_number(fit.baseline_V, 3),
                format_number(shot.field_nT, 6) if np.isfinite(shot.field_nT) else NOTHING,
                shot.rejected or "used",
            ]
        )
    return Table(
        "Shots",
        "ω as it is in the solution, without the pull of spin exchange, at the end of the decay "
        "where the fit is a joint one; decay, cycles within the 1/e time, tone and baseline from "
        "the fit of the shot alone; field = ω Q / γ.",
        [
            "shot",
            "ω, rad/s",
            "u",
            "f, Hz",
            "decay, 1/s",
            "cycles",
            "tone, V",
            "baseline, V",
            "field, nT",
            "",
        ],
        rows,
    )
