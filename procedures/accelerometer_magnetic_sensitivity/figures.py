"""What this procedure adds to the report: what is determined, plots, and tables of the fit."""

from __future__ import annotations

import numpy as np

from station.findings import Findings, combination_text
from station.parts import Part, Table, first_rows
from station.report.numbers import (
    NOTHING,
    format_limit,
    format_number,
    format_result,
    format_with_uncertainty,
)
from station.results import ResultDocument

from . import plots
from .dataset import AccelerometerAnalysis, AccelerometerDataset
from .model import COEFFICIENTS, describe


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: coefficients first, then what is behind them."""
    analysis: AccelerometerAnalysis = findings.detail.analysis
    dataset: AccelerometerDataset = findings.detail.dataset
    parts: list[Part] = [_coefficients(analysis, document)]
    if bool(analysis.used.any()):
        parts.append(plots.output_by_field(dataset, analysis))
        parts.append(plots.residual_map(dataset, analysis))
    if analysis.path is not None and analysis.noise_V is not None:
        parts.append(plots.convergence(analysis))
    if len(analysis.covariance):
        parts.append(plots.correlation(analysis))
    if analysis.nuisances or analysis.not_separable:
        parts.append(_nuisances(analysis, dataset))
    if analysis.left_out:
        parts.append(_left_out(analysis, dataset))
    return tuple(parts)


def _coefficients(analysis: AccelerometerAnalysis, document: ResultDocument) -> Table:
    determined = analysis.identifiability
    published = {entry.name: entry.value for entry in analysis.published}
    rows = []
    for name in COEFFICIENTS:
        result = document.result(name)
        value, spread = format_result(result)
        terms = determined.terms.get(name)
        stands = combination_text(terms) if terms else ""
        if not terms:
            inside = [kept for kept, own in determined.terms.items() if name in own]
            stands = f"in {', '.join(inside)}" if inside else "not excited"
        rows.append(
            [
                name,
                stands,
                value,
                spread,
                result.estimate.unit,
                format_limit(result.limit),
                format_number(published[name], 5),
            ]
        )
    return Table(
        "Coefficients, and what is not identifiable",
        " ".join(describe(determined))
        + " U is the expanded uncertainty; the last column is the finite-memory solution."
        + _held_at(document),
        ["", "what is measured", "value", "U (95 %)", "unit", "limit", "finite memory"],
        rows,
    )


def _held_at(document: ResultDocument) -> str:
    """Return the sentence on the temperature that the coefficients hold at."""
    at = next(
        (result.estimate.holds_at for result in document.results if result.estimate.holds_at), ""
    )
    return f" All hold at {at}, the mean temperature of the rows." if at else ""


def _nuisances(analysis: AccelerometerAnalysis, dataset: AccelerometerDataset) -> Table:
    rows = []
    for nuisance in analysis.nuisances:
        value, u = format_with_uncertainty(nuisance.value, nuisance.standard_uncertainty)
        rows.append([nuisance.name, value, u, nuisance.unit])
    note = (
        "Fitted beside the coefficients: encoder offset (common to all planes) and misalignment Ko "
        "and Kp wherever they are independent of the coefficients, temperature and drift where "
        "the information criterion asks for them."
    )
    if dataset.temperature_degC is None:
        note += " No temperature was recorded: there are no temperature terms."
    if analysis.not_separable:
        note += (
            " Not distinguished from other terms, and so not fitted: "
            f"{', '.join(analysis.not_separable)}."
        )
    return Table("Nuisance terms", note, ["term", "value", "u", "unit"], rows)


def _left_out(analysis: AccelerometerAnalysis, dataset: AccelerometerDataset) -> Table:
    rows = []
    for left_out in analysis.left_out:
        left = float(analysis.residual_V[left_out.row])
        rows.append(
            [
                str(left_out.row),
                str(dataset.plane[left_out.row]),
                f"{dataset.theta_deg[left_out.row]:.3f}",
                f"{1e3 * dataset.field_T[left_out.row]:.3f}",
                format_number(1e6 * left, 3) if np.isfinite(left) else NOTHING,
                left_out.reason,
            ]
        )
    return first_rows(
        "Rows left out",
        "Counted from 0.",
        ["row", "plane", "angle, deg", "field, mT", "output − fit, µV", "why"],
        rows,
    )
