"""The analysis of an accelerometer's magnetic sensitivity: a pure function of the dataset."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.slow_terms import FEWEST_LEFT, K0_T, KI_T, USUAL
from station.findings import Estimate, Flag, undetermined

from .causes import cause_flags
from .dataset import AccelerometerAnalysis, AccelerometerDataset, LeftOut, Nuisance, Path, Rows
from .finite_memory import finite_memory_path, published_values
from .flags import result_flags, solution_flags
from .misread import misread_flags
from .model import (
    COEFFICIENTS,
    FIELD_POWER,
    GRAVITY_POWER,
    UNITS,
    Identifiability,
    judge,
    model_columns,
)
from .nuisances import KO, KP, OFFSET
from .nuisances import UNITS as NUISANCE_UNITS
from .parameters import AnalysisSettings
from .screening import BEYOND, coarse_step_V, data_flags, screen
from .solution import solve_rows
from .solved import Solution, groups_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

__all__ = ["AccelerometerAnalysis", "AnalysisSettings", "analyse"]

SMALLEST_SINGULAR = 1e-7
METHOD = "weighted"
ASTRAY = "The measured angles or fields do not follow the commanded ones: no value is given."
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
    screened = screen(dataset)
    lost = dataset.temperature_degC is not None and screened.dataset.temperature_degC is None
    dataset, usable, left_out = screened.dataset, screened.usable, screened.left_out
    places = np.flatnonzero(usable)
    planned = judge(
        dataset.plane[usable],
        dataset.theta_commanded_deg[usable],
        dataset.field_commanded_T[usable],
        dataset.gravity_g,
    )
    rows = _rows(dataset, usable)
    path = _path(rows, places, planned, settings)
    solution, unsolved, more = _solution(rows, planned, settings)
    measured, residual_V = planned, np.full(len(dataset), np.nan)
    used = np.zeros(len(dataset), dtype=bool)
    covariance = np.zeros((0, 0))
    nuisances: tuple[Nuisance, ...] = ()
    if solution is not None:
        residual_V[usable], used[usable] = solution.residual_V, solution.kept
        far = [LeftOut(int(row), BEYOND.format(settings.outlier)) for row in places[~solution.kept]]
        left_out = tuple(sorted((*left_out, *far), key=lambda left: left.row))
        largest_T = float(np.max(np.abs(rows.commanded_T))) or 1.0
        measured = planned.as_measured(solution.shares[: planned.rank], largest_T)
        covariance = solution.covariance[: planned.rank, : planned.rank]
        nuisances = _nuisances(solution, planned.rank)
        more += solution_flags(solution, coarse_step_V(rows.output_V), settings)
        more += cause_flags(solution, dataset, places)
    estimates = _estimates(measured, solution, rows, settings, lost)
    return AccelerometerAnalysis(
        identifiability=measured,
        estimates=estimates,
        covariance=covariance,
        published=published_values(path),
        nuisances=nuisances,
        not_separable=solution.not_separable if solution else (),
        left_out=left_out,
        flags=(
            *data_flags(screened, left_out, settings),
            *result_flags(planned, measured, estimates, unsolved, settings),
            *more,
        ),
        used=used,
        residual_V=residual_V,
        noise_V=solution.noise_V if solution else None,
        lag_one_correlation=solution.lag_one_correlation if solution else None,
        condition=solution.condition if solution else None,
        drift_order=solution.drift_order if solution else 0,
        path=path,
        temperature_lost=lost,
    )


def _solution(
    rows: Rows, planned: Identifiability, settings: AnalysisSettings
) -> tuple[Solution | None, str, list[Flag]]:
    """Return the solution, or why there is none, and the flags of columns that mean another."""
    if planned.rank > 0 and not _as_planned(rows, planned):
        return None, ASTRAY, []
    few = f"{len(rows.time_s)} usable rows are too few."
    if not 0 < planned.rank < len(rows.time_s):
        return None, few, []
    solution = solve_rows(rows, planned.kept, settings)
    if solution.degrees_of_freedom < FEWEST_LEFT:
        return None, few, []
    misread, certain = misread_flags(rows, solution)
    return (None, ASTRAY, misread) if certain else (solution, "", misread)


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
    rows: Rows,
    settings: AnalysisSettings,
    lost: bool,
) -> tuple[Estimate, ...]:
    """Return all thirteen in order, null where they are folded or nothing could be solved.

    They hold at the mean temperature of the rows, which the temperature terms are taken from.
    """
    values: dict[str, float] = {}
    at: dict[str, object] = {}
    if rows.temperature_degC is not None and len(rows.temperature_degC):
        degC = float(np.mean(rows.temperature_degC))
        at = {"conditions": {"temperature": f"{degC:.2f} degC"}}
    if solution is not None:
        values = {name: solution.values[name] for name in measured.kept}
    ki = values.get("Ki", settings.scale_factor_V_per_g)
    estimates = []
    for name, unit in UNITS.items():
        if solution is None or name not in values:
            estimates.append(undetermined(name, None, unit, METHOD))
            continue
        place, terms = measured.kept.index(name), dict(measured.terms[name])
        sensitivities = (
            _sensitivities(name, values, rows.gravity_g)
            | _by_thermometer(name, solution, abs(ki) if lost else 0.0)
            | _by_graduation(terms, values)
            | _by_mounting(solution, place, ki)
        )
        u, freedom = np.sqrt(solution.covariance[place, place]), solution.degrees_of_freedom
        estimates.append(
            Estimate(
                name,
                None,
                values[name],
                unit,
                float(u),
                float(freedom),
                METHOD,
                sensitivities,
                {"terms": terms, **at},
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


def _by_thermometer(name: str, solution: Solution, lost_ki: float) -> dict[str, float]:
    """Return the derivative of K0 and Ki by an error of the temperature that they hold at.

    Where the temperatures are lost it is what is usual at a scale factor of `lost_ki`, else 0.
    """
    term = {"K0": K0_T, "Ki": KI_T}.get(name, "")
    by = lost_ki * USUAL[term] if lost_ki and term else solution.values.get(term)
    return {} if by is None else {"thermometer_degC": by}


def _by_graduation(terms: Mapping[str, float], values: Mapping[str, float]) -> dict[str, float]:
    """Return the derivatives of a combination by an error of the angle once a turn, in rad.

    What goes with the sine of the angle, times Ki cos, is Kio and Kip; with the cosine Koo and Kpp.
    In plane `op` neither is there, and these are those by its perturbation (`evaluate.py`).
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
    rows: Rows, places: NDArray[np.int64], planned: Identifiability, settings: AnalysisSettings
) -> Path | None:
    kept = [COEFFICIENTS.index(name) for name in planned.kept]
    columns = model_columns(rows.accelerations(), rows.field_T)[:, kept]
    return finite_memory_path(columns, rows.output_V, planned.kept, places, settings.window)


def _nuisances(solution: Solution, rank: int) -> tuple[Nuisance, ...]:
    cause, units = solution.cause, NUISANCE_UNITS
    if cause is not None:
        units = {**units, **dict.fromkeys(cause.names, cause.unit)}
    u = np.sqrt(np.diag(solution.covariance))
    terms = list(solution.values.items())[rank:]
    return tuple(
        Nuisance(name, value, float(own), units.get(name, "V"))
        for (name, value), own in zip(terms, u[rank:], strict=True)
    )
