"""The analysis of an accelerometer's magnetic sensitivity: a pure function of the dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate, Flag, undetermined

from .causes import LIKE_HYSTERESIS, cause_flag
from .dataset import AccelerometerAnalysis, AccelerometerDataset, LeftOut, Nuisance, Path, Rows
from .finite_memory import finite_memory_path, published_values
from .flags import (
    SCALE_DRIFT,
    data_flags,
    frozen_flags,
    jump_flag,
    moved_flags,
    residual_flags,
    result_flags,
)
from .history import tells_history
from .misread import misread_flags
from .model import (
    COEFFICIENTS,
    FIELD_POWER,
    GRAVITY_POWER,
    UNITS,
    Identifiability,
    accelerations,
    judge,
    model_columns,
)
from .nuisances import FEWEST_LEFT, K0_T, KI_DRIFT, KI_T, KO, KP, OFFSET, unit_of
from .parameters import AnalysisSettings
from .screening import coarse_step_V, frozen_temperature, screen
from .solution import solve_rows
from .solved import Solution, groups_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

__all__ = ["AccelerometerAnalysis", "AnalysisSettings", "analyse"]

BEYOND = "beyond {:g} sigma from the fit"
SMALLEST_SINGULAR = 1e-7
METHOD = "weighted"
MOUNTING = {
    OFFSET: "mounting_zero_rad",
    KO: "mounting_towards_oa_rad",
    KP: "mounting_towards_pa_rad",
}


def analyse(
    dataset: AccelerometerDataset, settings: AnalysisSettings | None = None
) -> AccelerometerAnalysis:
    """Estimate the thirteen coefficients, or the combinations that the plan determines.

    What the plan determines is judged on its commanded rows; then the kept coefficients are solved
    from all usable rows together with nuisance terms, field as measured, angle from the encoder.
    Beside it stands the finite-memory solution of the source document's step (8). Deterministic;
    raises nothing for poor data: what they do not determine is None and flagged.
    """
    settings = settings or AnalysisSettings()
    frozen = np.zeros(len(dataset), dtype=bool)
    if dataset.temperature_degC is not None:
        frozen = frozen_temperature(dataset.temperature_degC)
        dataset = replace(dataset, temperature_degC=None) if frozen.any() else dataset
    usable, left_out = screen(dataset)
    planned = judge(
        dataset.plane[usable],
        dataset.theta_commanded_deg[usable],
        dataset.field_commanded_T[usable],
        dataset.gravity_g,
    )
    solution: Solution | None = None
    rows = _rows(dataset, usable)
    as_planned = planned.rank > 0 and _as_planned(rows, planned)
    if as_planned and int(usable.sum()) > planned.rank:
        solution = solve_rows(rows, planned.kept, settings)
        if solution.degrees_of_freedom < FEWEST_LEFT:
            solution = None
    misread: list[Flag] = []
    if solution is not None:
        misread, certain = misread_flags(rows, solution)
        solution = None if certain else solution
        as_planned = as_planned and not certain
    residual_V = np.full(len(dataset), np.nan)
    used = np.zeros(len(dataset), dtype=bool)
    if solution is not None:
        residual_V[usable] = solution.residual_V
        used[usable] = solution.kept
        far = np.flatnonzero(usable)[~solution.kept]
        reason = BEYOND.format(settings.outlier)
        left_out = tuple(
            sorted((*left_out, *(LeftOut(int(row), reason) for row in far)), key=lambda x: x.row)
        )
    measured = planned
    if solution is not None and solution.shares is not None:
        largest_T = float(np.max(np.abs(rows.commanded_T))) or 1.0
        measured = planned.as_measured(solution.shares[: planned.rank], largest_T)
    estimates = _estimates(measured, solution, rows.temperature_degC, rows.gravity_g, settings)
    path = _path(dataset, usable, planned, settings)
    drift = solution.drift_order if solution is not None else 0
    lag_one = solution.lag_one_correlation if solution is not None else None
    flags = [*frozen_flags(frozen), *data_flags(dataset, left_out, settings)]
    counted = int(used.sum() if solution is not None else usable.sum())
    flags += result_flags(
        planned, estimates, drift, lag_one, counted, settings, as_planned, measured
    )
    if solution is not None and solution.jump is not None:
        off = [int(row) for row in np.flatnonzero(usable)[solution.jump.rows]]
        flags.append(jump_flag(dataset, off, solution.jump))
    if solution is not None and KI_DRIFT in solution.names:
        flags.append(SCALE_DRIFT)
    flags += [*misread, *moved_flags(planned, measured)]
    if solution is not None:
        flags += residual_flags(solution, coarse_step_V(dataset.output_V[usable]))
    if solution is not None and solution.cause is not None:
        flags.append(cause_flag(solution, solution.cause, np.flatnonzero(usable)))
        distinguished = tells_history(dataset.field_commanded_T[usable])
        if solution.cause.code == "hysteresis" and not distinguished:
            flags.append(LIKE_HYSTERESIS)
    count = planned.rank if solution is not None else 0
    return AccelerometerAnalysis(
        identifiability=measured,
        estimates=estimates,
        covariance=solution.covariance[:count, :count] if solution else np.zeros((0, 0)),
        published=published_values(path),
        nuisances=_nuisances(solution, planned.rank),
        not_separable=solution.not_separable if solution else (),
        left_out=left_out,
        flags=tuple(flags),
        used=used,
        residual_V=residual_V,
        noise_V=solution.noise_V if solution else None,
        lag_one_correlation=lag_one,
        condition=solution.condition if solution else None,
        drift_order=drift,
        path=path,
    )


def _rows(dataset: AccelerometerDataset, usable: Mask) -> Rows:
    temperature, group = dataset.temperature_degC, dataset.noise_group
    return Rows(
        time_s=dataset.time_s[usable],
        plane=dataset.plane[usable],
        theta_rad=np.radians(dataset.theta_deg[usable]),
        field_T=dataset.field_T[usable],
        commanded_T=dataset.field_commanded_T[usable],
        output_V=dataset.output_V[usable],
        temperature_degC=None if temperature is None else temperature[usable],
        noise_group=None if group is None else group[usable],
        gravity_g=dataset.gravity_g,
        groups=groups_of(dataset, usable),
    )


def _as_planned(rows: Rows, planned: Identifiability) -> bool:
    """Whether measured angles and fields tell the columns apart that the commanded ones do."""
    places = [COEFFICIENTS.index(name) for name in planned.kept]
    columns = model_columns(rows.accelerations(), rows.field_T)[:, places]
    size = np.linalg.norm(columns, axis=0)
    if len(columns) < len(places) or not bool(np.all(size > 0.0)):
        return len(columns) < len(places)
    singular = np.linalg.svd(columns / size, compute_uv=False)
    return bool(singular[-1] > SMALLEST_SINGULAR)


def _estimates(
    measured: Identifiability,
    solution: Solution | None,
    temperature_degC: Array | None,
    gravity_g: float,
    settings: AnalysisSettings,
) -> tuple[Estimate, ...]:
    """Return all thirteen in order, null where they are folded or nothing could be solved.

    They hold at the mean temperature of the rows, which the temperature terms are taken from.
    """
    values: dict[str, float] = {}
    ki = settings.scale_factor_V_per_g
    at: dict[str, object] = {}
    if temperature_degC is not None and len(temperature_degC):
        at = {"conditions": {"temperature": f"{float(np.mean(temperature_degC)):.2f} degC"}}
    if solution is not None:
        values = {name: float(solution.coefficients[j]) for j, name in enumerate(measured.kept)}
        ki = values.get("Ki", ki)
    estimates = []
    for name in COEFFICIENTS:
        if solution is None or name not in values:
            estimates.append(undetermined(name, None, UNITS[name], METHOD))
            continue
        place = measured.kept.index(name)
        estimates.append(
            Estimate(
                name,
                None,
                values[name],
                UNITS[name],
                float(np.sqrt(solution.covariance[place, place])),
                float(solution.degrees_of_freedom),
                METHOD,
                _sensitivities(name, values, gravity_g)
                | _by_thermometer(name, solution)
                | _by_graduation(measured.terms[name], values)
                | _by_mounting(solution, place, ki),
                {"terms": dict(measured.terms[name]), **at},
            )
        )
    return tuple(estimates)


def _sensitivities(name: str, values: dict[str, float], gravity_g: float) -> dict[str, float]:
    """Return the derivatives of a coefficient by errors of field and output that the data hide.

    A gaussmeter that reads B (1 + g) + o makes Km too small by the part g and moves Km by
    -2 Kmm o, K0 by -Km o, Ki by -Kim o; a voltmeter's gain is in every coefficient. A probe that
    leans from the coil's axis reads less of its field, the cosine, and of the ambient field across
    it an offset.
    """
    derivatives = {"voltage_gain": values[name]}
    if name in GRAVITY_POWER:
        derivatives["local_gravity"] = -GRAVITY_POWER[name] * values[name] / gravity_g
    if name in FIELD_POWER:
        derivatives["field_gain"] = -FIELD_POWER[name] * values[name]
        derivatives["probe_cosine"] = FIELD_POWER[name] * values[name]
    if name == "K0":
        derivatives["voltage_offset_V"] = 1.0
    for higher, lower, factor in (("Km", "K0", 1), ("Kmm", "Km", 2), ("Kim", "Ki", 1)):
        if name == lower and higher in values:
            derivatives["field_offset_T"] = -factor * values[higher]
            derivatives["ambient_field_T"] = -factor * values[higher]
    return derivatives


def _by_thermometer(name: str, solution: Solution) -> dict[str, float]:
    """Return the derivative of K0 and Ki by an error of the temperature that they hold at."""
    term = {"K0": K0_T, "Ki": KI_T}.get(name)
    if term not in solution.names:
        return {}
    return {"thermometer_degC": float(solution.coefficients[solution.names.index(term)])}


def _by_graduation(terms: Mapping[str, float], values: Mapping[str, float]) -> dict[str, float]:
    """Return the derivatives of a combination by an error of the angle once a turn, in rad.

    What goes with the sine of the angle, times Ki cos, is Kio and Kip; with the cosine Koo and Kpp.
    """
    ki = values.get("Ki", 0.0)
    sine, cosine = (
        ki * sum(terms.get(name, 0.0) for name in pair) for pair in (("Kio", "Kip"), ("Koo", "Kpp"))
    )
    derivatives = {"graduation_sine_rad": sine, "graduation_cosine_rad": cosine}
    return {name: value for name, value in derivatives.items() if value}


def _by_mounting(solution: Solution, place: int, ki: float) -> dict[str, float]:
    """Return the derivatives of a combination by how the input axis is mounted, in rad.

    Only where the rows do not tell a lean of the mounting from the combination, which holds it.
    """
    by = {MOUNTING[name]: ki * float(shares[place]) for name, shares in solution.folded.items()}
    if OFFSET in solution.folded:
        by["stage_angle_rad"] = by[MOUNTING[OFFSET]]
    return {name: value for name, value in by.items() if value}


def _path(
    dataset: AccelerometerDataset,
    usable: Mask,
    planned: Identifiability,
    settings: AnalysisSettings,
) -> Path | None:
    rows = np.flatnonzero(usable)
    places = [COEFFICIENTS.index(name) for name in planned.kept]
    theta_rad = np.radians(dataset.theta_deg[rows])
    acceleration_g = accelerations(dataset.plane[rows], theta_rad, dataset.gravity_g)
    columns = model_columns(acceleration_g, dataset.field_T[rows])[:, places]
    return finite_memory_path(
        columns, dataset.output_V[rows], planned.kept, rows.astype(np.int64), settings.window
    )


def _nuisances(solution: Solution | None, rank: int) -> tuple[Nuisance, ...]:
    if solution is None:
        return ()
    cause = solution.cause
    units = dict.fromkeys(cause.names, cause.unit) if cause is not None else {}
    return tuple(
        Nuisance(
            name,
            float(solution.coefficients[j]),
            float(np.sqrt(solution.covariance[j, j])),
            units.get(name, unit_of(name)),
        )
        for j, name in enumerate(solution.names)
        if j >= rank
    )
