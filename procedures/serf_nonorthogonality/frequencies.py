"""From the fits of single shots to frequencies and angles, jointly where the frequency falls.

A shot that contradicts all others is left out, and so are coil constants that the shots deny.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from station.findings import Flag, contradiction

from .angles import DOUBTFUL, IMPROBABLE, Solution, solve
from .dataset import Frequencies, Precession, SerfDataset
from .fading import fading_trend
from .joint import SHARED, JointModel, NoJointFit, Record
from .parameters import AnalysisSettings
from .precession import common_decay, decays
from .shots import SPINS, SlowingDown
from .spin_motion import NO_LEAN, Lean, decay_line, fields_in_light, lean_of
from .tone import pooled, wild_samples

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
WEAK_CHIRP = 0.02
"""Up to here the fits of single shots are near enough to begin the joint one."""
ROUNDS = 6
OWN = 5
"""Unknowns of a shot's own in the joint fit, mains aside."""
STILL = 0.02
"""A change of the cosines, in their uncertainties, at which the directions stand still."""
BETA_U = 3.0
LEAN_RAD = 2e-3
EXCHANGED = 25.0
"""Chi-square of all samples that is saved where pump and probe light change places."""
MIN_FREEDOM = 2
CONTRADICTED = (
    "all others agree and its frequency contradicts them: its name or its commanded field is "
    "wrong, or the field was not steady; look at its supply and repeat it"
)
MODEL_U = 5e-5
"""Relative, of a coil factor: what spin exchange does to a frequency and the model may miss."""


def frequencies_and_angles(
    dataset: SerfDataset, used: Sequence[Precession], settings: AnalysisSettings
) -> Frequencies:
    """Solve for angles from all usable shots; jointly where a falling frequency is significant."""
    spin = SPINS[dataset.nuclear_spin]
    fits = [precession.used_fit for precession in used]
    commanded_nT = np.array([precession.shot.field_nT for precession in used])
    line = common_decay(fits) or decay_line(*decays(fits))
    beta = line.beta_s if line.beta_s > BETA_U * line.beta_u else 0.0
    chirp, chirp_u = pooled([fit.chirp for fit in fits])
    omega = np.array([fit.omega_rad_per_s for fit in fits])
    by_rate = np.array([fit.rate_per_s.moves for fit in fits])
    covariance = np.diag([fit.omega_u**2 for fit in fits])
    covariance += line.rate_u**2 * np.outer(by_rate, by_rate)
    if np.isfinite(chirp_u):
        # A chirp too weak to be seen moves all frequencies alike, and with them the factor.
        by_chirp = np.array([fit.chirp.moves for fit in fits])
        omega = omega + chirp * by_chirp
        covariance += chirp_u**2 * np.outer(by_chirp, by_chirp)
    omega /= 1.0 + spin.pull(beta, omega)
    alone = Frequencies(
        tuple(used),
        omega,
        covariance,
        solve(commanded_nT, omega, covariance, known=dataset.constants_known),
        (chirp, chirp_u),
        line.rate_per_s,
        beta,
        tuple(fit.kept for fit in fits),
        tuple(fit.residual_V for fit in fits),
        pooled([fit.drift_per_s for fit in fits]),
        fading_trend(*decays(fits)),
    )
    if not chirp > settings.chirp_u * chirp_u:
        return alone
    try:
        return _jointly(dataset, spin, alone)
    except (NoJointFit, np.linalg.LinAlgError) as error:
        return replace(alone, failed=str(error))


def _jointly(dataset: SerfDataset, spin: SlowingDown, alone: Frequencies) -> Frequencies:
    used, commanded_nT = alone.used, alone.commanded_nT
    fits = [precession.used_fit for precession in used]
    # What stands out of a fit that knows no chirp may be the chirp.
    kept = [precession.usable & np.isfinite(precession.shot.voltage_V) for precession in used]
    records = _records(used, kept, [fit.noise_V for fit in fits])
    solution, chirp = alone.solution, alone.chirp[0]
    along = _along(_fields(dataset, commanded_nT, solution), NO_LEAN)
    model = JointModel(records, spin, along, dataset.mains_Hz)
    if chirp < WEAK_CHIRP:
        measured = np.array([fit.omega_rad_per_s for fit in fits]) / (1.0 + 0.5 * chirp)
        start = np.array([1.5 * chirp, alone.rate_per_s, alone.beta_s, *measured])
    else:
        start = model.start(fits)
    for round_ in range(ROUNDS):
        joint = model.fit(start)
        start = joint.unknowns
        if round_ == 0:
            kept = [_without_wild(k, r) for k, r in zip(kept, joint.residual_V, strict=True)]
        if round_ < 2:
            own = OWN + (2 if dataset.mains_Hz is not None else 0)
            records = _records(used, kept, [_noise(left, own) for left in joint.residual_V])
        beta_u = float(np.sqrt(joint.covariance[2, 2]))
        beta = joint.beta_s if joint.beta_s > BETA_U * beta_u else 0.0
        omega = joint.omega_rad_per_s / (1.0 + spin.pull(beta, joint.omega_rad_per_s))
        covariance = joint.covariance[SHARED:, SHARED:]
        before = solution.cosine
        solution = solve(commanded_nT, omega, covariance, known=dataset.constants_known)
        if not solution.positive_definite:
            raise NoJointFit("no three axes have the angles that it leads to")
        fields = _fields(dataset, commanded_nT, solution)
        lean = lean_of(fields, joint.baseline_over_tone, joint.baseline_over_tone_u)
        model = replace(model, records=records, along=_along(fields, lean))
        size = np.sqrt(np.diag(solution.covariance)[3:6])
        if round_ >= 2 and bool(np.all(np.abs(solution.cosine - before) <= STILL * size)):
            break
    turned = replace(dataset, pump_axis=dataset.probe_axis, probe_axis=dataset.pump_axis)
    across = _fields(turned, commanded_nT, solution)
    swapped = lean_of(across, joint.baseline_over_tone, joint.baseline_over_tone_u)
    other = replace(model, along=_along(across, swapped)).fit(start)
    moved = [
        replace(model, along=_along(fields, lean.but(towards, LEAN_RAD))).fit(start)
        for towards in (0, 1)
    ]
    by_lean = np.column_stack([fit.omega_rad_per_s - joint.omega_rad_per_s for fit in moved])
    by_lean /= LEAN_RAD
    covariance = covariance + by_lean @ lean.covariance[:2, :2] @ by_lean.T
    covariance += np.diag((joint.by_late_start * dataset.start_u_s) ** 2)
    # The relative fall of the frequency from P² to none, and what it changes by with P².
    near = np.array([joint.square, joint.square + 1e-5])
    fall, more = (spin.at_rest / spin.at(near) - 1.0).tolist()
    chirp_u = abs(more - fall) / 1e-5 * float(np.sqrt(joint.covariance[0, 0]))
    decay, decay_u, _ = np.array(joint.decay_per_s).T
    return Frequencies(
        used,
        omega,
        covariance,
        solve(commanded_nT, omega, covariance, known=dataset.constants_known),
        (fall, chirp_u),
        joint.rate_per_s,
        beta,
        tuple(kept),
        joint.residual_V,
        pooled(joint.drift_per_s),
        fading_trend(joint.omega_rad_per_s, decay, decay_u),
        joint,
        lean,
        joint.chi_square - other.chi_square > EXCHANGED,
    )


def _fields(dataset: SerfDataset, commanded_nT: Array, solution: Solution) -> Array:
    """Return the directions (shots, 3) of the fields in the frame of the light.

    Where axes with the solved angles do not exist, those of orthogonal coils.
    """
    if not solution.positive_definite:
        solution = replace(solution, cosine=np.zeros(3), residual=np.zeros(3))
    return fields_in_light(commanded_nT, solution, dataset.pump_axis, dataset.probe_axis)


def _along(fields: Array, lean: Lean) -> Array:
    """Return the squares (shots,) of the cosine between field and spins at the beginning."""
    return np.asarray((fields @ lean.spins) ** 2)


def _records(
    used: Sequence[Precession], kept: Sequence[Mask], noise_V: Sequence[float]
) -> list[Record]:
    return [
        Record(precession.shot.time_s[mask], precession.shot.voltage_V[mask], noise)
        for precession, mask, noise in zip(used, kept, noise_V, strict=True)
    ]


def _without_wild(kept: Mask, residual_V: Array) -> Mask:
    """Return which samples stay when those that stand out of the joint fit go."""
    left = kept.copy()
    left[np.flatnonzero(kept)[wild_samples(residual_V)]] = False
    return left


def _noise(residual_V: Array, own: int) -> float:
    """Return the standard deviation of a sample, by what a fit with so many own columns leaves."""
    return float(np.sqrt(residual_V @ residual_V / max(len(residual_V) - own, 1)))


def agreed(
    dataset: SerfDataset, seen: Sequence[Precession], settings: AnalysisSettings
) -> tuple[SerfDataset, list[Precession], Frequencies, list[Flag]]:
    """Return dataset and shots as they are believed, with the solution and what speaks against.

    A single shot that all others contradict is left out. Coil constants that the shots contradict
    are solved for: the dataset that is returned does not have them known. Raises LinAlgError, and
    ValueError without a usable shot.
    """
    shots = list(seen)
    used = [shot for shot in shots if shot.used]
    frequencies = frequencies_and_angles(dataset, used, settings)
    odd = _odd_one(frequencies)
    if odd is not None:
        used = [shot for shot in used if shot is not odd]
        shots = [replace(odd, rejected=CONTRADICTED) if shot is odd else shot for shot in seen]
        frequencies = frequencies_and_angles(dataset, used, settings)
    flags: list[Flag] = []
    free = _solved(frequencies, range(len(used))) if dataset.constants_known else None
    known = frequencies.solution
    if (
        free is None
        or not all(free.determined[:3])
        or known.degrees_of_freedom <= free.degrees_of_freedom
    ):
        return dataset, shots, frequencies, flags
    ratios, covariance = free.ratios()
    chance = _chance(ratios, covariance)
    if IMPROBABLE <= chance < DOUBTFUL:
        # Too little to overrule what is stated, too much to count on it: what it moves is in u.
        moved = known.unknowns - free.unknowns
        wide = replace(known, covariance=known.covariance + np.outer(moved, moved))
        frequencies = replace(frequencies, solution=wide)
    elif chance < IMPROBABLE:
        dataset = replace(dataset, constants_known=False)
        frequencies = frequencies_and_angles(dataset, used, settings)
        stated = np.square(dataset.coil_u or (0.0, 0.0, 0.0)) + MODEL_U**2
        if _chance(ratios, covariance + np.diag(stated[1:]) + stated[0]) < IMPROBABLE:
            y, z = 1.0 + ratios
            text = (
                "The coil constants are stated as known, and the shots deny it: relative to coil "
                f"x the factors are y {y:.5f} and z {z:.5f}. They are solved for, as with nominal "
                "constants. Calibrate the coils, or look for a wrong commanded field or a supply's "
                "range."
            )
            flags.append(contradiction("coil_constants", text))
    return dataset, shots, frequencies, flags


def _solved(frequencies: Frequencies, rows: Sequence[int]) -> Solution | None:
    """Return the solution of some of the shots, coil constants left free; None without one."""
    at = np.array(rows)
    omega, covariance = frequencies.omega_rad_per_s[at], frequencies.covariance[np.ix_(at, at)]
    try:
        solution = solve(frequencies.commanded_nT[at], omega, covariance, known=False)
    except np.linalg.LinAlgError:
        return None
    return solution if solution.sound else None


def _chance(ratios: Array, covariance: Array) -> float:
    """Return how probable ratios as far from zero as these are."""
    return float(chdtrc(len(ratios), float(ratios @ np.linalg.solve(covariance, ratios))))


def _odd_one(frequencies: Frequencies) -> Precession | None:
    """Return the only shot without which the others agree; None without."""
    count = len(frequencies.used)
    whole = _solved(frequencies, range(count))
    if whole is None or whole.degrees_of_freedom < MIN_FREEDOM or not whole.disagree:
        return None
    without = np.zeros(count)
    for k in range(count):
        solution = _solved(frequencies, [n for n in range(count) if n != k])
        if solution is not None and solution.determined == whole.determined:
            without[k] = solution.probability
    second, best = np.argsort(without)[-2:].tolist()
    if without[best] < DOUBTFUL or without[second] >= IMPROBABLE:
        return None
    odd: Precession = frequencies.used[best]
    return odd
