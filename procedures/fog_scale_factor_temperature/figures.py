"""What this procedure adds to the report: curves, residuals, proof, and the compensation."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from station.findings import Findings
from station.report.drawing import STYLE
from station.report.numbers import NOTHING, format_number, format_with_uncertainty
from station.report.parts import Part, Plot, Table
from station.results import ResultDocument

from . import plots
from .analysis import FogAnalysis
from .curve import Band
from .dataset import FogDataset

TABLE_STEP_DEGC = 5.0
MOST_ROWS = 40


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: curves first, then proof and compensation."""
    analysis: FogAnalysis = findings.detail.analysis
    dataset: FogDataset = findings.detail.dataset
    parts: list[Part] = [_curves(analysis)]
    fitted = [fit for fit in analysis.fits.values() if fit.curve is not None]
    with mpl.rc_context(STYLE):
        if dataset.history:
            parts.append(
                Plot(
                    "Temperatures",
                    "Against time. The model's argument is the gyro's own temperature, the mean "
                    "of before and after a turn, not the chamber's.",
                    plots.temperatures(dataset),
                )
            )
        if fitted:
            parts.append(
                Plot(
                    "Scale-factor error over temperature",
                    "Above: each turn, the curve, and the published rule's. Turns scatter more "
                    "than their noise where the gyro's bias has not been taken off yet. Below: "
                    "what the solution leaves of each turn, and the curve's bands: the dark one "
                    "is ±U, which holds the truth at any one temperature in 95 % of records; the "
                    "wider one holds the true curve over the whole range at once in 95 %. "
                    "Triangles: turns that were left out, at the edge where they lie beyond it.",
                    plots.curves(analysis, dataset.gyro_bias_deg_per_h or 0.0),
                )
            )
        parts.append(_before_and_after(analysis, document))
        if analysis.verified:
            parts.append(
                Plot(
                    "Verification ramp",
                    "Turn errors of another ramp before and after compensation, below enlarged. "
                    "None of these turns was used for the curve.",
                    plots.verification(dict(analysis.verified)),
                )
            )
        if analysis.driven is not None:
            reference = dataset.drive.heading_deg if dataset.drive is not None else None
            parts.append(
                Plot(
                    "Vehicle test",
                    "A drive's rates integrated to heading, the earth's rate taken off, without "
                    "and with compensation. Turns in one sense add up the error of the scale "
                    "factor, turns in both senses hide it.",
                    plots.drive(analysis.driven, reference),
                )
            )
    if fitted:
        parts.append(_compensation(analysis, dataset.gyro_bias_deg_per_h or 0.0))
    if any(len(fit.rejected) for fit in analysis.fits.values()):
        parts.append(_left_out(analysis))
    return tuple(parts)


def _curves(analysis: FogAnalysis) -> Table:
    rows = []
    for axis, fit in analysis.fits.items():
        curve = fit.curve
        if curve is None:
            rows.append([axis, str(len(fit.rows)), *[NOTHING] * 7])
            continue
        low, high = curve.domain_degC
        rows.append(
            [
                axis,
                f"{int(fit.kept.sum())} of {len(fit.rows)}",
                f"{low:.2f} … {high:.2f}",
                str(curve.order),
                format_number(fit.noise_ppm, 3),
                format_number(fit.lag_one_correlation, 2),
                "taken off" if fit.paired else "in u",
                format_number(fit.bias_deg_per_h, 2),
                format_number(fit.walk_deg_per_h_per_sqrt_h, 2),
            ]
        )
    return Table(
        "Curves",
        "Robust fit of Chebyshev polynomials of the scaled temperature, the order by the Bayesian "
        "information criterion; the noise is that of one turn. Where turns of both senses stand "
        "side by side the gyro's bias is fitted as a polynomial of temperature and a random walk, "
        "and taken off.",
        [
            "axis",
            "turns used",
            "range, degC",
            "order",
            "noise, ppm",
            "correlation of neighbours",
            "gyro bias",
            "mean bias, deg/h",
            "its walk, deg/h/√h",
        ],
        rows,
    )


def _before_and_after(analysis: FogAnalysis, document: ResultDocument) -> Table:
    verdicts = {
        result.estimate.axis: (
            str(result.decision.verdict),
            "" if result.limit is None else ", ".join(f"{v:g}" for v in _limits(result.limit)),
        )
        for result in document.results
        if result.estimate.name == "residual_scale_factor_error"
    }
    rows = []
    for axis, fit in analysis.fits.items():
        if fit.curve is None:
            continue
        heat = fit.temperature_degC[fit.kept]
        size = fit.curve.error_ppm(heat)
        rows.append(
            _row(axis, "the curve's own turns", size, fit.residual_ppm[fit.kept], NOTHING, NOTHING)
        )
        verified = analysis.verified.get(axis)
        if verified is not None:
            verdict, limit = verdicts.get(axis, ("none", ""))
            rows.append(
                _row(
                    axis,
                    "verification ramp",
                    verified.before_ppm,
                    verified.after_ppm,
                    limit or NOTHING,
                    verdict,
                )
            )
    return Table(
        "Before and after compensation",
        "Errors of turns. A ratio above 1 would mean that the compensation was applied with the "
        "wrong sign. The curve's own turns prove nothing; a verification ramp does.",
        ["axis", "turns", "rms before, ppm", "rms after, ppm", "ratio", "largest", "limit", "held"],
        rows,
    )


def _row(
    axis: str, name: str, before: np.ndarray, after: np.ndarray, limit: str, verdict: str
) -> list[str]:
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    rms = [float(np.sqrt(np.mean(one**2))) if len(one) else np.nan for one in (before, after)]
    ratio = rms[1] / rms[0] if rms[0] else np.nan
    largest = float(np.max(np.abs(after))) if len(after) else np.nan
    cells = [format_number(one, 3) for one in (*rms, ratio, largest)]
    return [axis, name, *cells, limit, verdict]


def _limits(limit: object) -> list[float]:
    return list(limit.to_data().values())  # type: ignore[attr-defined]


def _compensation(analysis: FogAnalysis, gyro_bias_deg_per_h: float) -> Table:
    bands = {
        axis: Band(fit.curve, gyro_bias_deg_per_h)
        for axis, fit in analysis.fits.items()
        if fit.curve is not None
    }
    ends = np.array([band.curve.domain_degC for band in bands.values()])
    grid = np.arange(
        np.ceil(ends[:, 0].min() / TABLE_STEP_DEGC),
        np.floor(ends[:, 1].max() / TABLE_STEP_DEGC) + 1,
    )
    rows = []
    for heat in grid * TABLE_STEP_DEGC:
        cells = [f"{heat:g}"]
        for band in bands.values():
            at = np.array([heat])
            if not band.curve.holds(float(heat)):
                cells += [NOTHING] * 3
                continue
            value, wide = float(band.curve.error_ppm(at)[0]), float(band.whole_ppm(at)[0])
            cells += format_with_uncertainty(value, float(band.expanded_ppm(at)[0]))
            cells.append(format_number(wide, 2))
        rows.append(cells)
    columns = ["gyro temperature, degC"]
    for axis in bands:
        columns += [f"δ {axis}, ppm", f"U {axis}", f"whole {axis}"]
    return Table(
        "Compensation",
        "A true rate is the measured one over 1 + δ(T), with T the gyro's own temperature, held "
        "at the ends of the range: divide, never multiply. U holds the truth at a temperature by "
        "itself in 95 % of records; ± the column beside it holds it at all temperatures at once. "
        "Files beside the results hold the curve as a table and as source code.",
        columns,
        rows,
    )


def _left_out(analysis: FogAnalysis) -> Table:
    rows: list[list[str]] = []
    more = 0
    for axis, fit in analysis.fits.items():
        for n in fit.rejected:
            more += len(rows) >= MOST_ROWS
            if len(rows) < MOST_ROWS:
                rows.append(
                    [
                        str(fit.rows[n]),
                        axis,
                        f"{fit.temperature_degC[n]:.2f}",
                        format_number(float(fit.residual_ppm[n]), 3),
                    ]
                )
    return Table(
        "Turns left out",
        "Rows of the turn table, counted from 0."
        + (f" {more} more are not shown." if more > 0 else ""),
        ["row", "axis", "gyro temperature, degC", "turn − curve, ppm"],
        rows,
    )
