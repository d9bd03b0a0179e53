"""What this procedure adds to the report: what is determined, plots as data, tables of the fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.common import homogeneity
from procedures.common.places import table_of
from station.findings import Findings, combination_text
from station.parts import Part, Table, first_rows
from station.plots import (
    VERMILION,
    Axis,
    Cells,
    Item,
    Line,
    Panel,
    Plot,
    Points,
    Rule,
    Scale,
    in_grid,
)
from station.report.numbers import (
    NOTHING,
    format_limit,
    format_number,
    format_result,
    format_with_uncertainty,
)
from station.results import ResultDocument

from .dataset import AccelerometerAnalysis, AccelerometerDataset
from .model import COEFFICIENTS, FIELD_POWER, accelerations, describe, model_columns

Array = NDArray[np.float64]

MICRO = 1e6
MILLI = 1e3
COLUMNS = 3
LIMIT_SIGMA = 5.0
CONVERGED_U = 10.0
ANGLES = Scale(0.0, 360.0, colours="angle", label="deg", ticks=(0, 90, 180, 270, 360))
"""Colours that end where they begin, as angles do."""


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[Part, ...]:
    """Return the parts of the report: coefficients first, then what is behind them."""
    analysis: AccelerometerAnalysis = findings.detail.analysis
    dataset: AccelerometerDataset = findings.detail.dataset
    parts: list[Part] = [_coefficients(analysis, document)]
    if bool(analysis.used.any()):
        parts.append(output_by_field(dataset, analysis))
        parts.append(residual_map(dataset, analysis))
    if analysis.path is not None and analysis.noise_V is not None:
        parts.append(convergence(analysis))
    if len(analysis.covariance):
        parts.append(correlation(analysis))
    if analysis.nuisances or analysis.not_separable:
        parts.append(_nuisances(analysis, dataset))
    if dataset.at_device is not None:
        parts.append(homogeneity.table(dataset.at_device))
    if analysis.left_out:
        parts.append(_left_out(analysis, dataset))
    return (*parts, *table_of(dataset.places))


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


def output_by_field(dataset: AccelerometerDataset, analysis: AccelerometerAnalysis) -> Plot:
    """Return, plane by plane, how the output moves with the field at each angle.

    From each row the part of the solution that knows no field is taken off: gravity's part is ten
    thousand times larger, and drift and temperature would part the passes of a plan. Dots are
    measured, lines the solution.
    """
    by_field = magnetic_part(dataset, analysis)
    angle_deg = np.round(np.mod(dataset.theta_commanded_deg, 360.0), 3)
    panels = []
    for column, plane in enumerate(planes_of(dataset)):
        used = analysis.used & (dataset.plane == plane)
        items: list[Item] = []
        for angle in np.unique(angle_deg[used]):
            rows = np.flatnonzero(used & (angle_deg == angle))
            rows = rows[np.argsort(dataset.field_T[rows], kind="stable")]
            field_mT, line = dataset.field_T[rows] * MILLI, by_field[rows]
            measured = (line + analysis.residual_V[rows]) * MICRO
            items += [
                Line(field_mT, line * MICRO, colour=float(angle), width=0.9),
                Points(field_mT, measured, marker=".", colour=float(angle), size=4.5),
            ]
        panels.append(
            Panel(
                tuple(items),
                title=f"plane {plane}",
                column=column,
                x=Axis("field, mT"),
                y=Axis("" if column else "output by the field, µV"),
                scale=ANGLES,
            )
        )
    return Plot(
        "Output against field at each angle",
        "What the field adds to the output, one colour for each angle: measured points and the "
        "solution. The part without field is taken off; field as measured. Lines that fan out are "
        "the coupling Kim, Kom, Kpm, their common slope is Km, their curvature Kmm.",
        tuple(panels),
        3.6,
        gap_x=0.06,
        share_y="row",
    )


def planes_of(dataset: AccelerometerDataset) -> list[str]:
    """Return the planes of a dataset in the order in which they were measured."""
    return list(dict.fromkeys(dataset.plane.tolist()))


def magnetic_part(dataset: AccelerometerDataset, analysis: AccelerometerAnalysis) -> Array:
    """Return the part of the solution that the field makes, in V (rows,)."""
    acceleration_g = accelerations(dataset.plane, np.radians(dataset.theta_deg), dataset.gravity_g)
    columns = model_columns(acceleration_g, dataset.field_T)
    own = {
        estimate.name: estimate.value or 0.0
        for estimate in analysis.estimates
        if estimate.name in FIELD_POWER
    }
    return np.asarray(sum(own[name] * columns[:, COEFFICIENTS.index(name)] for name in own))


def residual_map(dataset: AccelerometerDataset, analysis: AccelerometerAnalysis) -> Plot:
    """Return the residuals over angle and field as colours, and against time below."""
    planes = planes_of(dataset)
    noise = float(analysis.noise_V or 1.0) * MICRO
    residual = analysis.residual_V * MICRO
    panels = []
    for column, plane in enumerate(planes):
        angle_deg, field_mT, left = points_of(
            dataset, residual, analysis.used & (dataset.plane == plane)
        )
        panels.append(
            Panel(
                (Points(angle_deg, field_mT, values=left, marker="s", size=4.7),),
                title=f"plane {plane}",
                column=column,
                x=Axis("angle, deg", low=-10.0, high=370.0, ticks=(0, 90, 180, 270, 360)),
                y=Axis("" if column else "field, mT"),
                scale=Scale(-3.0 * noise, 3.0 * noise, label="µV"),
            )
        )
    return Plot(
        "What the solution leaves",
        "Residuals over angle and field (their mean where a point was measured again), and in the "
        "order of time: noise without a shape where the model is right. Triangles: rows that were "
        "left out, at the edge where they lie beyond it.",
        (*panels, _over_time(dataset, analysis, residual, noise, len(planes))),
        5.2,
        heights=(1.2, 1),
        gap_x=0.06,
        gap_y=0.42,
        share_y="row",
    )


def _over_time(
    dataset: AccelerometerDataset,
    analysis: AccelerometerAnalysis,
    residual_uV: Array,
    noise_uV: float,
    columns: int,
) -> Panel:
    minutes, used = dataset.time_s / 60.0, analysis.used
    edge = 1.1 * LIMIT_SIGMA * noise_uV
    out = np.isfinite(residual_uV) & ~used
    beyond = np.clip(residual_uV, -edge, edge)
    triangles = [
        Points(minutes[rows], beyond[rows], marker=marker, colour=VERMILION, size=6.0, beyond=True)
        for rows, marker in ((out & (residual_uV >= 0), "^"), (out & (residual_uV < 0), "v"))
    ]
    return Panel(
        (*triangles, Rule(y=0.0), Points(minutes[used], residual_uV[used], marker=".", size=3.0)),
        title=f"{int(used.sum())} rows in the solution, σ = {noise_uV:.3g} µV; "
        f"{int(out.sum())} left out",
        row=1,
        columns=columns,
        x=Axis("time, min"),
        y=Axis("output − fit, µV", low=-edge, high=edge),
    )


def points_of(
    dataset: AccelerometerDataset, residual: Array, rows: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Return angle (deg), field (mT) and mean residual of each point that the rows measured."""
    angle_deg = np.mod(np.round(dataset.theta_deg[rows], 1), 360.0)
    points = np.column_stack((angle_deg, dataset.field_commanded_T[rows]))
    points, number = np.unique(points, axis=0, return_inverse=True)
    count = np.bincount(number.ravel())
    field_mT = np.bincount(number.ravel(), weights=dataset.field_T[rows] * MILLI) / count
    return points[:, 0], field_mT, np.bincount(number.ravel(), weights=residual[rows]) / count


def convergence(analysis: AccelerometerAnalysis) -> Plot:
    """Return each coefficient of the finite-memory solution, less the full-data one, in its u."""
    path = analysis.path
    assert path is not None
    own = {estimate.name: estimate for estimate in analysis.estimates}
    place = np.arange(1, len(path.estimates) + 1)
    there = np.flatnonzero(np.isfinite(path.estimates).any(axis=1))
    first = max(float(there[0]) - 0.02 * len(place), 0.0) if len(there) else 0.0
    panels = []
    for name, estimates in zip(path.names, path.estimates.T, strict=True):
        value, u = own[name].value, own[name].standard_uncertainty
        if value is None or u is None or u <= 0.0:
            panels.append(Panel(()))
            continue
        deviation = (estimates - value) / u
        last = deviation[np.isfinite(deviation)][-len(deviation) // 3 :]
        reach = max(CONVERGED_U, 1.3 * float(np.max(np.abs(last)))) if len(last) else CONVERGED_U
        panels.append(
            Panel(
                (
                    Line(place, deviation, width=1.0),
                    Rule(y=0.0, width=0.7),
                    Rule(x=path.window, colour=VERMILION, width=0.8, dashes="--"),
                ),
                title=name,
                x=Axis(low=first, high=len(place)),
                y=Axis(low=-reach, high=reach),
            )
        )
    return Plot(
        "Convergence of the finite-memory solution",
        "The published recursion after each row, as its distance from the full-data solution in "
        "standard uncertainties of that. It begins where the rows first determine all columns; "
        "from the dashed line on a row is forgotten for each new one "
        f"(memory {path.window} rows). It knows no nuisance terms and rejects no row.",
        in_grid(panels, COLUMNS, "rows", "in u"),
        0.7 + 1.25 * -(-len(panels) // COLUMNS),
        gap_x=0.24,
        gap_y=0.5,
        share_x="all",
    )


def correlation(analysis: AccelerometerAnalysis) -> Plot:
    """Return the correlation of the determined coefficients as numbers on colours."""
    names, covariance = tuple(analysis.identifiability.kept), analysis.covariance
    deviations = np.sqrt(np.diag(covariance))
    scales = np.outer(deviations, deviations)
    matrix = np.divide(covariance, scales, out=np.zeros_like(covariance), where=scales > 0.0)
    axis = Axis(ticks=range(len(names)), texts=names, grid=False)
    return Plot(
        "Correlation of the coefficients",
        "Of the determined coefficients, or combinations, in the full-data solution. "
        "Condition number of all its columns, scaled: "
        f"{format_number(analysis.condition, 3)}.",
        (Panel((Cells(matrix.tolist()),), x=axis, y=axis, scale=Scale(-1.0, 1.0, strip=False)),),
        0.9 + 0.3 * len(names),
    )
