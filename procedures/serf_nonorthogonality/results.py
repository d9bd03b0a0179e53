"""From the solution to the results: values, uncertainties, and what each depends on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate, undetermined

from .angles import NAMES, Solution
from .dataset import SerfDataset
from .frequencies import Frequencies
from .shots import AXES, PAIRS

Array = NDArray[np.float64]

RAD_PER_DEG = np.pi / 180.0
ANGLE, RESIDUAL = "nonorthogonality_angle", "residual_field"
FACTOR, SLOWING_DOWN = "coil_factor", "slowing_down_factor"
WEIGHTED, JOINT, LAW_OF_COSINES = "weighted", "joint-chirp", "law-of-cosines"


def scale_axis(dataset: SerfDataset, solution: Solution) -> str | None:
    """Return the coil whose factor is one by convention, None where no factor is determined.

    That of the first shot with a single coil; where its factor is not determined, or there is no
    such shot, the first that is.
    """
    single = [shot.axes for shot in dataset.shots if len(shot.axes) == 1]
    for axis in [*single, *AXES]:
        if solution.determined[NAMES.index(axis)]:
            return axis
    return None


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
