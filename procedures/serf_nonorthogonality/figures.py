"""What this procedure adds to the report: the angles, checks, every shot, and what was fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Findings
from station.parts import Part, Table
from station.plots import GREEN, GREY, VERMILION, Axis, Line, Panel, Plot, Points, Rule, in_grid
from station.report.numbers import (
    NOTHING,
    format_limit,
    format_number,
    format_result,
    format_with_uncertainty,
)
from station.results import ResultDocument

from .dataset import ANGLE, FACTOR, RESIDUAL, SLOWING_DOWN, SerfAnalysis, SerfDataset
from .shots import AXES, PAIRS

Array = NDArray[np.float64]
COLUMNS, WIDE_COLUMNS = 4, 2
DECAYS_SHOWN = 3.0
"""1/e times of a signal that are drawn; what comes later is in its residuals."""
MILLI = 1e3
PADDING = 4
NOISE_SPAN = 4.5
ARCSEC_PER_DEG = 3600.0


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: the angles first, then what is behind them."""
    analysis: SerfAnalysis = findings.detail.analysis
    dataset: SerfDataset = findings.detail.dataset
    parts: list[Part] = [_angles(analysis, document), _coils(analysis, dataset, document)]
    if analysis.checks:
        parts.append(_checks(analysis))
    shots = drawn_shots(analysis, dataset)
    if shots:
        frequencies = analysis.frequencies
        joint = frequencies is not None and frequencies.joint is not None
        parts += [signals(shots, joint=joint), residuals(shots), spectra(shots)]
    if any(shot.used and np.isfinite(shot.misfit) for shot in analysis.shots):
        parts.append(misfit(analysis))
    return (*parts, _shots(analysis))


@dataclass(frozen=True)
class Drawn:
    """A shot as it is drawn: its samples, those used, and what the fit says at these."""

    name: str
    time_s: Array
    voltage_V: Array
    used_s: Array
    model_V: Array
    residual_V: Array
    noise_V: float
    frequency_Hz: float
    decay_per_s: float


def drawn_shots(analysis: SerfAnalysis, dataset: SerfDataset) -> tuple[Drawn, ...]:
    """Return all shots with a fit; that of the joint fit where there is one."""
    drawn = []
    for shot, outcome in zip(dataset.shots, analysis.shots, strict=True):
        fit, kept = outcome.fit, outcome.kept
        if fit is None:
            continue
        frequency_Hz = fit.frequency_Hz
        if np.isfinite(outcome.omega_rad_per_s):
            frequency_Hz = outcome.omega_rad_per_s / (2.0 * np.pi)
        drawn.append(
            Drawn(
                shot.name.replace("-", "−"),
                shot.time_s,
                shot.voltage_V,
                shot.time_s[kept],
                shot.voltage_V[kept] - outcome.residual_V,
                outcome.residual_V,
                float(np.std(outcome.residual_V)),
                frequency_Hz,
                fit.decay_per_s,
            )
        )
    return tuple(drawn)


def signals(shots: Sequence[Drawn], *, joint: bool) -> Plot:
    """Return each shot's samples and its fit; `joint`: that of all shots."""
    end_s = DECAYS_SHOWN / min(shot.decay_per_s for shot in shots)
    panels = []
    for shot in shots:
        seen, fitted = shot.time_s <= end_s, shot.used_s <= end_s
        time_ms, voltage_V = shot.time_s[seen] * MILLI, shot.voltage_V[seen]
        samples = Points(time_ms, voltage_V, marker=".", colour=VERMILION, size=2.2)
        fit = Line(shot.used_s[fitted] * MILLI, shot.model_V[fitted], width=0.8)
        panels.append(Panel((samples, fit), title=f"{shot.name}  {shot.frequency_Hz:.2f} Hz"))
    note = "The fit is a decaying tone with decaying baseline and offset"
    if joint:
        note = "The fit is that of all shots, whose frequency falls as their spins fade"
    return _in_panels(
        "Shots and their fits",
        f"Samples (dots) and fit (line) over the first {DECAYS_SHOWN:g} 1/e times. {note}; where "
        "the field lies between pump and probe the baseline is as large as the tone.",
        panels,
        WIDE_COLUMNS,
        "time, ms",
        "signal, V",
    )


def residuals(shots: Sequence[Drawn]) -> Plot:
    """Return what the fits leave, each on the scale of its own noise."""
    panels = []
    for shot in shots:
        left = shot.residual_V / (shot.noise_V if shot.noise_V > 0.0 else 1.0)
        panels.append(
            Panel(
                (Points(shot.used_s * MILLI, left, marker=".", size=1.6), Rule(y=0.0)),
                title=f"{shot.name}  σ = {MILLI * shot.noise_V:.3g} mV",
                y=Axis(low=-NOISE_SPAN, high=NOISE_SPAN),
            )
        )
    return _in_panels(
        "What the fits leave",
        "Residuals over the standard deviation of a sample: noise without a shape where the model "
        "is right.",
        panels,
        COLUMNS,
        "time, ms",
        "residual, σ",
    )


def spectra(shots: Sequence[Drawn]) -> Plot:
    """Return the amplitude spectra of signal and residual, the fitted frequency marked."""
    end_Hz = 3.0 * max(shot.frequency_Hz for shot in shots)
    panels = []
    for shot in shots:
        frequency_Hz, amplitude = _spectrum(shot.used_s, shot.model_V + shot.residual_V)
        _, left = _spectrum(shot.used_s, shot.residual_V)
        span_s = float(shot.used_s[-1] - shot.used_s[0])
        shown = (frequency_Hz <= end_Hz) & (frequency_Hz >= 1.0 / span_s)
        panels.append(
            Panel(
                (
                    Line(frequency_Hz[shown], amplitude[shown] * MILLI, width=0.9),
                    Line(frequency_Hz[shown], left[shown] * MILLI, colour=GREEN, width=0.7),
                    Rule(x=shot.frequency_Hz, colour=VERMILION, width=0.8, dashes="--"),
                ),
                title=shot.name,
                x=Axis(low=0.0, high=end_Hz, most=3),
                y=Axis(log=True),
            )
        )
    return _in_panels(
        "Spectra",
        "Amplitude of signal (blue) and residual (green); dashed, the fitted frequency. The "
        "highest point of a spectrum is not it: lines are as wide as they fade, and the baseline "
        "leaks into them.",
        panels,
        COLUMNS,
        "frequency, Hz",
        "mV",
    )


def _in_panels(
    title: str, caption: str, panels: Sequence[Panel], columns: int, below: str, beside: str
) -> Plot:
    return Plot(
        title,
        caption,
        in_grid(panels, columns, below, beside, share_y=True),
        0.5 + 1.45 * -(-len(panels) // columns),
        gap_x=0.08,
        gap_y=0.62,
        share_y="all",
    )


def misfit(analysis: SerfAnalysis) -> Plot:
    """Return how far each shot's frequency is from the solution, in its uncertainty."""
    used = [shot for shot in analysis.shots if shot.used and np.isfinite(shot.misfit)]
    places = range(len(used))
    names = tuple(shot.name.replace("-", "−") for shot in used)
    reach = max(3.0, 1.2 * max(abs(shot.misfit) for shot in used))
    return Plot(
        "Shots against the solution",
        "Frequency of each shot less that of angles, factors and residual field as solved, over "
        "its uncertainty. With as many shots as unknowns all are zero.",
        (
            Panel(
                (
                    Points(places, [shot.misfit for shot in used], size=5.0),
                    Rule(y=0.0, width=0.7),
                    Rule(y=-2.0, colour=GREY, width=0.8, dashes="--"),
                    Rule(y=2.0, colour=GREY, width=0.8, dashes="--"),
                ),
                x=Axis(ticks=places, texts=names, turned=len(used) > 8),
                y=Axis("misfit, u", low=-reach, high=reach),
            ),
        ),
        2.6,
    )


def _spectrum(time_s: Array, volts: Array) -> tuple[Array, Array]:
    count = len(volts)
    length = PADDING * int(2 ** np.ceil(np.log2(count)))
    interval_s = float(time_s[-1] - time_s[0]) / (count - 1)
    # Falling from the beginning, where the signal is, to the end, which would leak else.
    window = 0.5 + 0.5 * np.cos(np.pi * np.arange(count) / count)
    amplitude = 2.0 / window.sum() * np.abs(np.fft.rfft((volts - volts.mean()) * window, length))
    return np.asarray(np.fft.rfftfreq(length, interval_s)), np.maximum(amplitude, 1e-9)


def _angles(analysis: SerfAnalysis, document: ResultDocument) -> Table:
    paper = {entry.axis: entry.value for entry in analysis.published}
    rows = []
    for pair in PAIRS:
        result = document.result(ANGLE, pair)
        value, spread = format_result(result)
        off = (
            None
            if result.estimate.value is None
            else (result.estimate.value - 90.0) * ARCSEC_PER_DEG
        )
        u = result.expanded_uncertainty and result.expanded_uncertainty * ARCSEC_PER_DEG
        published = NOTHING if paper[pair] is None else f"{paper[pair]:.4f}"
        less_90_deg = format_with_uncertainty(off, u)
        rows.append(
            [f"θ{pair}", value, spread, *less_90_deg, format_limit(result.limit), published]
        )
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
    note = f"Slowing-down factor Q = {value} ± {spread} (95 %) without polarisation. "
    if analysis.residual_field_nT is not None:
        note += f"Residual field {format_number(analysis.residual_field_nT, 3)} nT in all. "
    frequencies = analysis.frequencies
    if frequencies is not None and frequencies.joint is not None and frequencies.lean is not None:
        aside, towards = np.degrees(frequencies.lean.rad[:2])
        u = np.degrees(np.sqrt(np.diag(frequencies.lean.covariance)[:2]).max())
        note += (
            f"Polarisation at the beginning {frequencies.joint.polarisation:.3f}; the frequency "
            f"falls by {100.0 * frequencies.chirp[0]:.3g} % over the decay. "
            f"The spins began {aside:.2f} deg aside of the plane of pump and probe and "
            f"{towards:.2f} deg towards the probe from the pump light (u = {u:.2g} deg). "
        )
    if frequencies is not None:
        note += f"Decay R/Q(0) = {format_number(frequencies.rate_per_s, 4)} /s"
        if frequencies.beta_s > 0.0:
            note += f", spin-exchange broadening {format_number(frequencies.beta_s, 3)} s × ω²"
        note += ". "
    note += (
        "Commanded fields were taken as exact."
        if dataset.constants_known
        else "Factors are true over commanded field, relative to the coil whose factor is one."
    )
    return Table(
        "Coils, residual field and slowing-down factor",
        note,
        ["coil", "factor", "U (95 %)", "residual field, nT", "U (95 %), nT"],
        rows,
    )


def _checks(analysis: SerfAnalysis) -> Table:
    words = {True: "yes", False: "NO", None: "not determined"}
    rows = [
        [check.what, check.value, check.wanted, words[check.passed]] for check in analysis.checks
    ]
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
