"""The analysis of the angles between three coils: a pure function of the dataset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate, Flag, Published, undetermined

from .angles import NAMES, Solution
from .checks import PublishedAngles, checks_of, published_angles
from .dataset import (
    ANGLE,
    FACTOR,
    JOINT,
    LAW_OF_COSINES,
    RESIDUAL,
    SLOWING_DOWN,
    WEIGHTED,
    AnalysisSettings,
    SerfAnalysis,
    SerfDataset,
    ShotResult,
    scale_axis,
)
from .flags import result_flags
from .frequencies import Frequencies, agreed
from .precession import Precession, look_at_all
from .shot_flags import data_flags, misfit_flags
from .shots import AXES, PAIRS

Array = NDArray[np.float64]
__all__ = ["AnalysisSettings", "SerfAnalysis", "analyse"]

RAD_PER_DEG = np.pi / 180.0


def analyse(dataset: SerfDataset, settings: AnalysisSettings | None = None) -> SerfAnalysis:
    """Estimate angles, residual field, coil factors and slowing-down factor from all shots.

    Each shot is fitted on its own; where the frequency falls while the polarisation fades, all are
    fitted once more together, in turn with the angles, which say how the fields lie to the light.
    Beside it stands the law of cosines on the frequencies of the single fits. Deterministic; raises
    nothing for poor data: what they do not determine is None and flagged.
    """
    settings = settings or AnalysisSettings()
    seen = look_at_all(dataset, settings)
    found: Frequencies | None = None
    denied: list[Flag] = []
    if any(one.used for one in seen):
        try:
            dataset, seen, found, denied = agreed(dataset, seen, settings)
        except np.linalg.LinAlgError:
            found = None
    freedom = float(sum(one.used_fit.degrees_of_freedom for one in seen if one.used))
    results = estimates(dataset, found, freedom)
    paper = _published(dataset, seen)
    shots = _shots(dataset, seen, found)
    solution = found.solution if found is not None else None
    size_nT = residual_magnitude_nT(dataset, solution) if solution is not None else None
    flags = [*data_flags(dataset, seen, shots, settings), *denied, *misfit_flags(dataset, shots)]
    flags += result_flags(dataset, found, results, paper, size_nT, settings)
    return SerfAnalysis(
        shots=shots,
        solution=solution,
        joint=found.joint if found is not None else None,
        lean=found.lean if found is not None else None,
        estimates=results,
        published=tuple(
            Published(ANGLE, pair, paper.angles_deg[pair], "deg", LAW_OF_COSINES) for pair in PAIRS
        ),
        flags=tuple(flags),
        checks=checks_of(dataset, shots, found, results, size_nT),
        chirp=found.chirp if found is not None else 0.0,
        chirp_u=found.chirp_u if found is not None else np.inf,
        rate_per_s=found.rate_per_s if found is not None else None,
        beta_s=found.beta_s if found is not None else 0.0,
        residual_field_nT=size_nT,
    )


def _published(dataset: SerfDataset, seen: list[Precession]) -> PublishedAngles:
    """Return the law of cosines on the single fits; the published rule knows no chirp."""
    omega = [one.used_fit.omega_rad_per_s if one.used else np.nan for one in seen]
    return published_angles(dataset.commanded_nT, np.array(omega), dataset.gamma_rad_per_s_nT)


def _shots(
    dataset: SerfDataset, seen: list[Precession], found: Frequencies | None
) -> tuple[ShotResult, ...]:
    scale = np.nan
    if found is not None:
        axis = scale_axis(dataset, found.solution)
        scale = float(found.solution.scale[AXES.index(axis)]) if axis else np.nan
    results, place = [], 0
    for one in seen:
        omega = omega_u = misfit = np.nan
        kept = np.zeros(len(one.shot.time_s), dtype=bool) if one.fit is None else one.fit.kept
        residual_V = np.zeros(0) if one.fit is None else one.fit.residual_V[kept]
        if one.used and found is not None:
            omega = float(found.omega_rad_per_s[place])
            omega_u = float(np.sqrt(found.covariance[place, place]))
            misfit = float(found.solution.misfit_rad_per_s[place]) / omega_u
            kept, residual_V = found.kept[place], found.residual_V[place]
            place += 1
        results.append(
            ShotResult(
                name=one.shot.name,
                fit=one.fit,
                rejected=one.rejected,
                omega_rad_per_s=omega,
                omega_u=omega_u,
                field_nT=omega / scale,
                misfit=misfit,
                kept=kept,
                residual_V=residual_V,
            )
        )
    return tuple(results)


# From the solution to the results: values, uncertainties, and what each depends on.


def estimates(
    dataset: SerfDataset, found: Frequencies | None, degrees_of_freedom: float
) -> tuple[Estimate, ...]:
    """Return all ten results, null where the shots do not determine them."""
    method = JOINT if found is not None and found.joint is not None else WEIGHTED
    if found is None:
        return _nothing(method)
    solution = found.solution
    freedom = float(solution.degrees_of_freedom) if solution.enlarged else degrees_of_freedom
    axis = scale_axis(dataset, solution)
    sound = solution.positive_definite and solution.converged
    if axis is None or not sound:
        return _nothing(method)
    angles = [_angle(pair, solution, found, method, freedom) for pair in PAIRS]
    residual = [_residual(one, axis, dataset, solution, found, method, freedom) for one in AXES]
    some_angle = any(one.value is not None for one in angles)
    factors = [_factor(one, axis, dataset, solution, method, freedom, some_angle) for one in AXES]
    return (*angles, *residual, *factors, _slowing_down(axis, dataset, found, method, freedom))


def _nothing(method: str) -> tuple[Estimate, ...]:
    names = [
        *((ANGLE, pair, "deg") for pair in PAIRS),
        *((RESIDUAL, axis, "nT") for axis in AXES),
        *((FACTOR, axis, "1") for axis in AXES),
        (SLOWING_DOWN, None, "1"),
    ]
    return tuple(undetermined(*one, method) for one in names)


def _sensitivities(
    slope: Array, solution: Solution, found: Frequencies, axis: str, known: bool
) -> dict[str, float]:
    """Return what a value depends on whose derivatives by the nine unknowns are `slope` (9,)."""
    result: dict[str, float] = {}
    if known:
        result = {
            f"coil_{one}": float(slope @ solution.by_field[:, k]) for k, one in enumerate(AXES)
        }
    if not solution.free_of_residual:
        scale = float(solution.scale[AXES.index(axis)])
        for k, one in enumerate(AXES):
            result[f"residual_{one}_nT"] = float(slope @ solution.by_residual[:, k]) * scale
    result["trigger_delay_s"] = 0.0
    return result


def _u(slope: Array, solution: Solution) -> float:
    return float(np.sqrt(max(float(slope @ solution.covariance @ slope), 0.0)))


def _angle(
    pair: str, solution: Solution, found: Frequencies, method: str, freedom: float
) -> Estimate:
    place = NAMES.index(pair)
    if not solution.determined[place]:
        return undetermined(ANGLE, pair, "deg", method)
    cosine = float(solution.cosine[place - 3])
    slope = np.zeros(len(NAMES))
    slope[place] = -1.0 / float(np.sqrt(1.0 - cosine * cosine)) / RAD_PER_DEG
    known = bool(np.ptp(solution.scale) == 0.0)
    return Estimate(
        ANGLE,
        pair,
        float(np.degrees(np.arccos(cosine))),
        "deg",
        _u(slope, solution),
        freedom,
        method,
        _sensitivities(slope, solution, found, pair[0], known),
    )


def _residual(
    one: str,
    axis: str,
    dataset: SerfDataset,
    solution: Solution,
    found: Frequencies,
    method: str,
    freedom: float,
) -> Estimate:
    place, scale_place = NAMES.index(f"r{one}"), AXES.index(axis)
    if not solution.determined[place]:
        return undetermined(RESIDUAL, one, "nT", method)
    scale = float(solution.scale[scale_place])
    value = float(solution.residual[place - 6]) / scale
    slope = np.zeros(len(NAMES))
    slope[place], slope[scale_place] = 1.0 / scale, -value / scale
    sensitivities = _sensitivities(slope, solution, found, axis, dataset.constants_known)
    return Estimate(RESIDUAL, one, value, "nT", _u(slope, solution), freedom, method, sensitivities)


def _factor(
    one: str,
    axis: str,
    dataset: SerfDataset,
    solution: Solution,
    method: str,
    freedom: float,
    some_angle: bool,
) -> Estimate:
    if dataset.constants_known:
        return Estimate(FACTOR, one, 1.0, "1", 0.0, None, method, {f"coil_{one}": 1.0})
    if not solution.determined[AXES.index(one)] or not some_angle:
        return undetermined(FACTOR, one, "1", method)
    if one == axis:
        return Estimate(FACTOR, one, 1.0, "1", 0.0, None, method)
    scale = float(solution.scale[AXES.index(axis)])
    value = float(solution.scale[AXES.index(one)]) / scale
    slope = np.zeros(len(NAMES))
    slope[AXES.index(one)], slope[AXES.index(axis)] = 1.0 / scale, -value / scale
    return Estimate(FACTOR, one, value, "1", _u(slope, solution), freedom, method)


def _slowing_down(
    axis: str, dataset: SerfDataset, found: Frequencies, method: str, freedom: float
) -> Estimate:
    solution = found.solution
    scale = float(solution.scale[AXES.index(axis)])
    value = dataset.gamma_rad_per_s_nT / scale
    slope = np.zeros(len(NAMES))
    slope[AXES.index(axis)] = -value / scale
    sensitivities = _sensitivities(slope, solution, found, axis, dataset.constants_known)
    sensitivities |= {"gyromagnetic_ratio": value, "sample_clock": value}
    return Estimate(
        SLOWING_DOWN, None, value, "1", _u(slope, solution), freedom, method, sensitivities
    )


def residual_magnitude_nT(dataset: SerfDataset, solution: Solution) -> float | None:
    """Return the size of the residual field, None where it is not determined."""
    axis = scale_axis(dataset, solution)
    if axis is None or not solution.free_of_residual or not solution.positive_definite:
        return None
    r = solution.residual
    size = float(np.sqrt(r @ np.linalg.solve(solution.gram, r)))
    return size / float(solution.scale[AXES.index(axis)])
