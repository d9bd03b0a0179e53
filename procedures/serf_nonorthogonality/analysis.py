"""The analysis of the angles between three coils: a pure function of the dataset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station.findings import Flag, Published

from .agreement import agreed
from .checks import checks_of
from .dataset import SerfDataset
from .findings import AnalysisSettings, SerfAnalysis, ShotResult
from .flags import result_flags
from .frequencies import Frequencies
from .misfit import misfit_flags
from .precession import Precession, look_at_all
from .published import PublishedAngles, published_angles
from .results import ANGLE, LAW_OF_COSINES, estimates, residual_magnitude_nT, scale_axis
from .shot_flags import data_flags
from .shots import AXES, PAIRS

Array = NDArray[np.float64]

__all__ = ["AnalysisSettings", "SerfAnalysis", "analyse"]


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
    flags = data_flags(dataset, seen, shots, settings) + denied + misfit_flags(dataset, shots)
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
