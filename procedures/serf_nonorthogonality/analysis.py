"""The analysis of the angles between three coils: a pure function of the dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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
    Frequencies,
    SerfAnalysis,
    SerfDataset,
    ShotResult,
    scale_axis,
)
from .flags import result_flags
from .frequencies import agreed
from .precession import Precession, look_at_all
from .relabelled import relabelled_flags
from .settings import AnalysisSettings
from .shot_flags import data_flags, misfit_flags
from .shots import AXES, PAIRS
from .signs import sign_flags
from .steady import held_to_steady_fields

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
    doubts: list[Flag] = []
    if any(one.used for one in seen):
        try:
            dataset, seen, found, doubts = agreed(dataset, seen, settings)
            found, unseen = held_to_steady_fields(seen, found)
            doubts += unseen
        except np.linalg.LinAlgError:
            found = None
    freedom = float(sum(one.used_fit.degrees_of_freedom for one in seen if one.used))
    results = estimates(dataset, found, freedom)
    paper = _published(dataset, seen)
    shots = _shots(dataset, seen, found)
    size_nT = residual_magnitude_nT(dataset, found.solution) if found is not None else None
    flags = [*data_flags(dataset, seen, shots, settings), *doubts, *misfit_flags(dataset, shots)]
    flags += [*sign_flags(dataset, seen, found), *relabelled_flags(dataset, seen, found)]
    flags += result_flags(dataset, found, results, paper, size_nT, settings)
    return SerfAnalysis(
        estimates=results,
        published=tuple(
            Published(ANGLE, pair, paper.angles_deg[pair], "deg", LAW_OF_COSINES) for pair in PAIRS
        ),
        flags=tuple(flags),
        shots=shots,
        frequencies=found,
        checks=checks_of(dataset, shots, found, results, size_nT),
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


def estimates(
    dataset: SerfDataset, found: Frequencies | None, degrees_of_freedom: float
) -> tuple[Estimate, ...]:
    """Return all ten results, null where the shots do not determine them."""
    method = JOINT if found is not None and found.joint is not None else WEIGHTED
    axis = scale_axis(dataset, found.solution) if found is not None else None
    solution = found.solution if found is not None else None
    if solution is None or axis is None or not (solution.positive_definite and solution.converged):
        names = [
            *((ANGLE, pair, "deg") for pair in PAIRS),
            *((RESIDUAL, one, "nT") for one in AXES),
            *((FACTOR, one, "1") for one in AXES),
            (SLOWING_DOWN, None, "1"),
        ]
        return tuple(undetermined(*one, method) for one in names)
    freedom = float(solution.degrees_of_freedom) if solution.enlarged else degrees_of_freedom
    solved = Solved(dataset, solution, axis, method, freedom)
    angles = [solved.angle(pair) for pair in PAIRS]
    some_angle = any(one.value is not None for one in angles)
    return (
        *angles,
        *(solved.residual_field(one) for one in AXES),
        *(solved.factor(one, some_angle) for one in AXES),
        solved.slowing_down(),
    )


@dataclass(frozen=True)
class Solved:
    """A sound solution, and the coil `axis` whose factor is one by convention."""

    dataset: SerfDataset
    solution: Solution
    axis: str
    method: str
    degrees_of_freedom: float

    @property
    def scale(self) -> float:
        """The factor of the coil whose factor is one, in rad/s/nT."""
        return float(self.solution.scale[AXES.index(self.axis)])

    def angle(self, pair: str) -> Estimate:
        """Return the angle between two coils."""
        if not self.solution.determined[NAMES.index(pair)]:
            return undetermined(ANGLE, pair, "deg", self.method)
        cosine = float(self.solution.cosine[PAIRS.index(pair)])
        slope = self._slope({pair: -1.0 / float(np.sqrt(1.0 - cosine * cosine)) / RAD_PER_DEG})
        known = bool(np.ptp(self.solution.scale) == 0.0)
        depends = self._sensitivities(slope, pair[0], known)
        value = float(np.degrees(np.arccos(cosine)))
        return self._estimate(ANGLE, pair, value, "deg", slope, depends)

    def residual_field(self, one: str) -> Estimate:
        """Return the residual field's projection on a coil."""
        if not self.solution.determined[NAMES.index(f"r{one}")]:
            return undetermined(RESIDUAL, one, "nT", self.method)
        value = float(self.solution.residual[AXES.index(one)]) / self.scale
        slope = self._slope({f"r{one}": 1.0 / self.scale, self.axis: -value / self.scale})
        depends = self._sensitivities(slope, self.axis, self.dataset.constants_known)
        return self._estimate(RESIDUAL, one, value, "nT", slope, depends)

    def factor(self, one: str, some_angle: bool) -> Estimate:
        """Return the factor of a coil."""
        if self.dataset.constants_known:
            return Estimate(FACTOR, one, 1.0, "1", 0.0, None, self.method, {f"coil_{one}": 1.0})
        if not self.solution.determined[AXES.index(one)] or not some_angle:
            return undetermined(FACTOR, one, "1", self.method)
        if one == self.axis:
            return Estimate(FACTOR, one, 1.0, "1", 0.0, None, self.method)
        value = float(self.solution.scale[AXES.index(one)]) / self.scale
        slope = self._slope({one: 1.0 / self.scale, self.axis: -value / self.scale})
        return self._estimate(FACTOR, one, value, "1", slope, {})

    def slowing_down(self) -> Estimate:
        """Return the slowing-down factor without polarisation."""
        value = self.dataset.gamma_rad_per_s_nT / self.scale
        slope = self._slope({self.axis: -value / self.scale})
        depends = self._sensitivities(slope, self.axis, self.dataset.constants_known)
        depends |= {"gyromagnetic_ratio": value, "sample_clock": value}
        return self._estimate(SLOWING_DOWN, None, value, "1", slope, depends)

    def _slope(self, by_name: Mapping[str, float]) -> Array:
        """Return derivatives by the nine unknowns (9,)."""
        return np.array([by_name.get(name, 0.0) for name in NAMES])

    def _sensitivities(self, slope: Array, axis: str, known: bool) -> dict[str, float]:
        """Return what a value depends on, from its derivatives `slope` (9,) by the unknowns."""
        solution, result = self.solution, dict[str, float]()
        if known:
            for k, one in enumerate(AXES):
                result[f"coil_{one}"] = float(slope @ solution.by_field[:, k])
        if not solution.free_of_residual:
            scale = float(solution.scale[AXES.index(axis)])
            for k, one in enumerate(AXES):
                result[f"residual_{one}_nT"] = float(slope @ solution.by_residual[:, k]) * scale
        return result | {"trigger_delay_s": 0.0}

    def _estimate(
        self,
        name: str,
        axis: str | None,
        value: float,
        unit: str,
        slope: Array,
        depends: Mapping[str, float],
    ) -> Estimate:
        u = float(np.sqrt(max(float(slope @ self.solution.covariance @ slope), 0.0)))
        freedom = self.degrees_of_freedom
        return Estimate(name, axis, value, unit, u, freedom, self.method, depends)


def residual_magnitude_nT(dataset: SerfDataset, solution: Solution) -> float | None:
    """Return the size of the residual field, None where it is not determined."""
    axis = scale_axis(dataset, solution)
    if axis is None or not solution.free_of_residual or not solution.positive_definite:
        return None
    r = solution.residual
    size = float(np.sqrt(r @ np.linalg.solve(solution.gram, r)))
    return size / float(solution.scale[AXES.index(axis)])
