"""The analysis of the angles between three coils: a pure function of the dataset."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Estimate, Flag, Published, undetermined

from .angles import NAMES, Solution
from .checks import checks_of
from .dataset import (
    ANGLE,
    FACTOR,
    JOINT,
    LAW_OF_COSINES,
    MODULATION,
    RESIDUAL,
    SLOWING_DOWN,
    WEIGHTED,
    Frequencies,
    Precession,
    SerfAnalysis,
    SerfDataset,
    ShotResult,
    scale_axis,
)
from .flags import data_flags, result_flags
from .frequencies import agreed
from .misfit import misfit_flags
from .parameters import AnalysisSettings
from .precession import look_at_all
from .published import published_angles
from .relabelled import relabelled_flags
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
    frequencies: Frequencies | None = None
    doubts: list[Flag] = []
    if any(precession.used for precession in seen):
        try:
            dataset, seen, frequencies, doubts = agreed(dataset, seen, settings)
            frequencies, unseen = held_to_steady_fields(frequencies)
            doubts += unseen
        except np.linalg.LinAlgError:
            frequencies = None
    used = [precession.used_fit for precession in seen if precession.used]
    freedom = float(sum(fit.degrees_of_freedom for fit in used))
    results = estimates(dataset, frequencies, freedom)
    # The law of cosines on the single fits; the published rule knows no chirp.
    omega = [shot.used_fit.omega_rad_per_s if shot.used else np.nan for shot in seen]
    paper = published_angles(dataset.commanded_nT, np.array(omega), dataset.gamma_rad_per_s_nT)
    shots = tuple(_shots(dataset, seen, frequencies))
    size_nT = None
    if frequencies is not None:
        size_nT = residual_magnitude_nT(dataset, frequencies.solution)
    flags = [
        *data_flags(dataset, shots, settings),
        *doubts,
        *misfit_flags(shots),
        *sign_flags(dataset, frequencies),
        *relabelled_flags(dataset, frequencies),
        *result_flags(dataset, frequencies, results, paper.wanting, size_nT, settings),
    ]
    return SerfAnalysis(
        estimates=results,
        published=(
            *(Published(ANGLE, k, paper.angles_deg[k], "deg", LAW_OF_COSINES) for k in PAIRS),
            *(Published(RESIDUAL, k, b, "nT", MODULATION) for k, b in dataset.modulated_nT.items()),
        ),
        flags=tuple(flags),
        shots=shots,
        frequencies=frequencies,
        checks=checks_of(dataset, frequencies, results, size_nT),
        residual_field_nT=size_nT,
    )


def _shots(
    dataset: SerfDataset, seen: list[Precession], frequencies: Frequencies | None
) -> Iterator[ShotResult]:
    scale, place = np.nan, 0
    if frequencies is not None and (axis := scale_axis(dataset, frequencies.solution)):
        scale = float(frequencies.solution.scale[AXES.index(axis)])
    for shot in seen:
        own = vars(shot)
        if shot.used and frequencies is not None:
            omega = float(frequencies.omega_rad_per_s[place])
            u = float(np.sqrt(frequencies.covariance[place, place]))
            misfit = float(frequencies.solution.misfit_rad_per_s[place]) / u
            final = frequencies.kept[place], frequencies.residual_V[place]
            yield ShotResult(
                **own,
                kept=final[0],
                residual_V=final[1],
                omega_rad_per_s=omega,
                omega_u=u,
                field_nT=omega / scale,
                misfit=misfit,
            )
            place += 1
        elif shot.fit is not None:
            yield ShotResult(**own, kept=shot.fit.kept, residual_V=shot.fit.residual_V)
        else:
            yield ShotResult(**own, kept=shot.usable & False, residual_V=np.zeros(0))


def estimates(
    dataset: SerfDataset, frequencies: Frequencies | None, degrees_of_freedom: float
) -> tuple[Estimate, ...]:
    """Return all ten results, null where the shots do not determine them."""
    method = JOINT if frequencies is not None and frequencies.joint is not None else WEIGHTED
    axis = scale_axis(dataset, frequencies.solution) if frequencies is not None else None
    solution = frequencies.solution if frequencies is not None else None
    if solution is None or axis is None or not solution.sound:
        names = [
            *((ANGLE, pair, "deg") for pair in PAIRS),
            *((RESIDUAL, axis, "nT") for axis in AXES),
            *((FACTOR, axis, "1") for axis in AXES),
            (SLOWING_DOWN, None, "1"),
        ]
        return tuple(undetermined(*name, method) for name in names)
    freedom = float(solution.degrees_of_freedom) if solution.enlarged else degrees_of_freedom
    solved = Solved(dataset, solution, axis, method, freedom)
    angles = [solved.angle(pair) for pair in PAIRS]
    some_angle = any(angle.value is not None for angle in angles)
    return (
        *angles,
        *(solved.residual_field(axis) for axis in AXES),
        *(solved.factor(axis, some_angle) for axis in AXES),
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

    def residual_field(self, axis: str) -> Estimate:
        """Return the residual field's projection on a coil."""
        if not self.solution.determined[NAMES.index(f"r{axis}")]:
            return undetermined(RESIDUAL, axis, "nT", self.method)
        value = float(self.solution.residual[AXES.index(axis)]) / self.scale
        slope = self._slope({f"r{axis}": 1.0 / self.scale, self.axis: -value / self.scale})
        depends = self._sensitivities(slope, self.axis, self.dataset.constants_known)
        return self._estimate(RESIDUAL, axis, value, "nT", slope, depends)

    def factor(self, axis: str, some_angle: bool) -> Estimate:
        """Return the factor of a coil."""
        if self.dataset.constants_known:
            return Estimate(FACTOR, axis, 1.0, "1", 0.0, None, self.method, {f"coil_{axis}": 1.0})
        if not self.solution.determined[AXES.index(axis)] or not some_angle:
            return undetermined(FACTOR, axis, "1", self.method)
        if axis == self.axis:
            return Estimate(FACTOR, axis, 1.0, "1", 0.0, None, self.method)
        value = float(self.solution.scale[AXES.index(axis)]) / self.scale
        slope = self._slope({axis: 1.0 / self.scale, self.axis: -value / self.scale})
        return self._estimate(FACTOR, axis, value, "1", slope, {})

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
            for k, name in enumerate(AXES):
                result[f"coil_{name}"] = float(slope @ solution.by_field[:, k])
        if not solution.free_of_residual:
            scale = float(solution.scale[AXES.index(axis)])
            for k, name in enumerate(AXES):
                result[f"residual_{name}_nT"] = float(slope @ solution.by_residual[:, k]) * scale
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
