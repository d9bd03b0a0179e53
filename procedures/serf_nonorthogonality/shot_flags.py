"""What the reader must know about the shots themselves, one flag a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from procedures.estimation.excitation import excitation_flags
from station.findings import Flag

from .dataset import SerfDataset
from .findings import AnalysisSettings, ShotResult
from .precession import Precession
from .shots import AXES, LEAST_SIGNAL_TO_NOISE
from .spins import GAMMA_HZ_PER_NT, SPINS

UNEXPLAINED = 0.3
"""Of the squares of the frequencies: what coils that lean leave at most."""
LARGE_BASELINE = 1.5
"""A baseline beyond this many amplitudes of the tone."""
GAMMA_MARGIN = 1e-3
"""Alkali atoms differ from the free electron, and from one another, by less than 2e-4."""
CLOCK_MARGIN = 2e-4


def data_flags(
    dataset: SerfDataset,
    seen: Sequence[Precession],
    shots: Sequence[ShotResult],
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the shots themselves."""
    flags = [
        *_statements(dataset),
        *_repeated(dataset),
        *_overload(seen),
        *_rejected(seen),
        *_outliers(seen, shots),
        *_excitation(dataset, seen),
    ]
    return [*flags, *_gap(dataset, settings), *_shape(seen, settings)]


def _excitation(dataset: SerfDataset, seen: Sequence[Precession]) -> Iterator[Flag]:
    """Yield a flag for each coil whose field is not the commanded one, by the precession.

    Angles and residual field aside, the squares of the frequencies are sums of those of the coils.
    A coil that no shot with a tone drives, while others are seen, makes no field that turns the
    spins. What the slowing-down factor leaves open counts for the coil.
    """
    clear = [
        one for one in seen if one.used and one.used_fit.signal_to_noise >= LEAST_SIGNAL_TO_NOISE
    ]
    if not clear or 2 * len(clear) < len(seen):
        return  # it is the light, or the cell
    omega = np.array([one.used_fit.omega_rad_per_s for one in clear])
    squares = np.array([one.shot.field_nT**2 for one in clear])
    of_coils = np.linalg.lstsq(squares, omega**2, rcond=None)[0]
    if np.linalg.norm(omega**2 - squares @ of_coils) > UNEXPLAINED * np.linalg.norm(omega**2):
        return  # the coils are not what makes these tones: that is said of the shots
    found = np.sqrt(np.maximum(of_coils, 0.0))
    spin = SPINS[dataset.nuclear_spin]
    for k, axis in enumerate(AXES):
        driving = [one for one in seen if one.shot.field_nT[k]]
        if not driving or (not squares[:, k].any() and any(one.saturated for one in driving)):
            continue
        per_nT = float(found[k]) / dataset.gamma_rad_per_s_nT
        share = min(max(1.0, spin.polarised * per_nT), spin.at_rest * per_nT)
        largest_nT = max(abs(float(one.shot.field_nT[k])) for one in driving)
        yield from excitation_flags(axis, axis, {axis: share}, (largest_nT, "nT"), axis)


def _names(seen: Sequence[Precession]) -> str:
    return ", ".join(one.shot.name for one in seen)


def _repeated(dataset: SerfDataset) -> list[Flag]:
    if not dataset.repeated:
        return []
    names = list(dict.fromkeys(name for name, _ in dataset.repeated))
    why = "; ".join(dict.fromkeys(reason for _, reason in dataset.repeated))
    said = f"Shots were taken again, the bad ones are left out: {', '.join(names)} ({why})."
    return [Flag("shot-repeated", said, None, {"shots": names, "count": len(dataset.repeated)})]


def _overload(seen: Sequence[Precession]) -> list[Flag]:
    over = [one for one in seen if one.saturated]
    if not over:
        return []
    count = sum(one.saturated for one in over)
    said = f"{count} samples are saturated and left out, in {_names(over)}."
    return [
        Flag("overload", said, None, {"count": count, "shots": [one.shot.name for one in over]})
    ]


def _rejected(seen: Sequence[Precession]) -> list[Flag]:
    return [
        Flag(
            "shot-rejected",
            f"The shot {one.shot.name} is not used: {one.rejected}.",
            None,
            {"shot": one.shot.name},
        )
        for one in seen
        if not one.used
    ]


def _outliers(seen: Sequence[Precession], shots: Sequence[ShotResult]) -> list[Flag]:
    left_out = {
        shot.name: int(np.sum(one.usable & ~shot.kept))
        for one, shot in zip(seen, shots, strict=True)
        if shot.used
    }
    count = sum(left_out.values())
    if not count:
        return []
    said = (
        f"{count} samples stand more than six standard deviations from the fit and are left out, "
        f"in {', '.join(name for name, number in left_out.items() if number)}."
    )
    return [Flag("outliers-rejected", said, None, {"count": count})]


def _statements(dataset: SerfDataset) -> list[Flag]:
    """Return a flag for each stated number that nature or the rows' times deny."""
    flags = []
    if abs(dataset.gamma_Hz_per_nT / GAMMA_HZ_PER_NT - 1.0) > GAMMA_MARGIN:
        said = (
            f"The gyromagnetic ratio is stated as {dataset.gamma_Hz_per_nT:.6g} Hz/nT; the "
            f"electron's is {GAMMA_HZ_PER_NT} Hz/nT, and the slowing-down factor is as wrong as "
            "the statement. Correct gyromagnetic_ratio."
        )
        flags.append(Flag("contradicts-statement", said, None, {"statement": "gyromagnetic_ratio"}))
    for shot in dataset.shots:
        steps = np.rint(np.diff(shot.time_s) * dataset.sample_rate_Hz)
        place = np.concatenate([[0.0], np.cumsum(steps)])
        slope, start = np.polyfit(place, shot.time_s, 1)
        uneven_s = float(np.max(np.abs(shot.time_s - start - slope * place)))
        span_s = float(place[-1]) / dataset.sample_rate_Hz
        off = float(slope) * dataset.sample_rate_Hz - 1.0
        if abs(off) > CLOCK_MARGIN + 3.0 * uneven_s / span_s:
            said = (
                f"The rows of {shot.name} are {float(slope):.7g} s apart, {100.0 * off:+.2g} % "
                f"off the stated {dataset.sample_rate_Hz:g} Hz, and the slowing-down factor is as "
                "uncertain. Find out which clock is right, and correct t_s or sample_rate."
            )
            flags.append(Flag("contradicts-statement", said, None, {"statement": "sample_rate"}))
            break
    return flags


def _gap(dataset: SerfDataset, settings: AnalysisSettings) -> list[Flag]:
    nominal_s = 1.0 / dataset.sample_rate_Hz
    gaps, missing = 0, 0
    for shot in dataset.shots:
        steps = np.diff(shot.time_s) / nominal_s
        wide = steps > settings.gap
        gaps += int(wide.sum())
        missing += int(np.sum(np.rint(steps[wide]) - 1.0))
    if not gaps:
        return []
    said = f"The records have {gaps} gaps with {missing} missing samples; the fits do not mind."
    return [Flag("gap", said, None, {"count": gaps, "missing_samples": missing})]


def _shape(seen: Sequence[Precession], settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on what the fits of single shots show."""
    flags = []
    used = [one for one in seen if one.fit is not None]
    few = [one for one in used if one.used_fit.cycles < settings.few_cycles]
    if few:
        least = min(few, key=lambda one: one.used_fit.cycles)
        flags.append(
            Flag(
                "few-cycles",
                f"Fewer than {settings.few_cycles:g} cycles pass within the 1/e time in "
                f"{_names(few)}, the fewest in {least.shot.name}, {least.used_fit.cycles:.2f}; a "
                "larger field would be told better.",
                None,
                {"shots": [one.shot.name for one in few], "cycles": least.used_fit.cycles},
            )
        )
    large = [
        one
        for one in used
        if one.used and abs(one.used_fit.baseline_V) > LARGE_BASELINE * one.used_fit.amplitude_V
    ]
    if large:
        flags.append(
            Flag(
                "baseline",
                f"The decaying baseline is larger than {LARGE_BASELINE:g} amplitudes of the tone "
                f"in {_names(large)}: the field lies near pump and probe.",
                None,
                {"shots": [one.shot.name for one in large]},
            )
        )
    return flags
