"""Every shot on its own: which samples count, the fit, and whether the shot can be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procedures.common.frozen import equal_runs

from .dataset import Precession, SerfDataset, Shot
from .parameters import AnalysisSettings
from .shots import MIN_CYCLES, MIN_SIGNAL_TO_NOISE
from .spin_motion import DecayLine, decay_line
from .tone import NoTone, ToneFit, fit_tone

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
AT_THE_END = 0.9995
"""Part of full scale from which a sample counts as saturated."""
CLIPPED = 4
"""Equal extreme values in a row that nobody knows another reason for."""
STEPS, TOP = 4.5, 0.62
"""Within so many steps of a coarse recorder below its crest, a tone has the uppermost value in
fewer than half of the samples, a clipped one in nearly all."""
MAX_SATURATED = 0.1
ALIKE = 0.1
MIN_ALIKE = 4
MAX_ROUNDS = 5
SAME = 0.1
"""Of its u: a change of the baselines' decay that needs no other round."""
UNLIKE = 0.1
UNLIKE_U = 5.0
"""By how much, relative and in uncertainties, a decay may be faster than that of the others."""
SATURATED = 0.999


def saturated_samples(shot: Shot) -> Mask:
    """Return which samples (n,) the recorder could not follow."""
    volts = shot.voltage_V
    if shot.full_scale_V is not None:
        return np.asarray(np.abs(volts) >= AT_THE_END * shot.full_scale_V)
    saturated = np.zeros(len(volts), dtype=bool)
    levels = np.unique(volts)
    step_V = float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0
    starts, lengths = equal_runs(volts)
    for end in (float(np.max(volts)), float(np.min(volts))):
        near = np.abs(volts - end) <= STEPS * step_V
        here = (volts[starts] == end) & (lengths >= CLIPPED)
        for first, length in zip(starts[here], lengths[here], strict=True):
            last = first + length
            crest = length + _run(near[:first][::-1]) + _run(near[last:])
            if length >= TOP * crest:
                saturated[first:last] = True
    return saturated


def _run(marked: Mask) -> int:
    """Return how many elements are marked before the first that is not."""
    return int(np.argmin(np.append(marked, False)))


def look_at(shot: Shot, settings: AnalysisSettings, mains_Hz: float | None = None) -> Precession:
    """Fit a shot on its own, baseline as fast as the tone, and judge it."""
    saturated = saturated_samples(shot)
    usable = ~saturated & (shot.time_s >= settings.skip_s)
    count = int(saturated.sum())
    if count > MAX_SATURATED * len(saturated):
        text = f"{count} of {len(saturated)} samples are saturated"
        return Precession(shot, None, count, text, usable)
    try:
        fit = fit_tone(shot.time_s, shot.voltage_V, usable, mains_Hz=mains_Hz)
    except NoTone as error:
        return Precession(shot, None, count, str(error), usable)
    return Precession(shot, fit, count, _too_few(shot, fit, settings), usable)


def _too_few(shot: Shot, fit: ToneFit, settings: AnalysisSettings) -> str | None:
    if fit.cycles >= MIN_CYCLES:
        return None
    # Decay by spin exchange left aside, cycles grow with the field.
    field_nT = float(np.linalg.norm(shot.field_nT))
    wanted_nT = field_nT * settings.few_cycles / fit.cycles
    share = wanted_nT / field_nT
    each = ", ".join(
        f"{abs(component_nT) * share:.0f} nT in {axis}"
        for axis, component_nT in zip("xyz", shot.field_nT, strict=True)
        if component_nT
    )
    return f"{fit.cycles:.2f} cycles pass within the 1/e time; {each} would give 1.5"


def look_at_all(dataset: SerfDataset, settings: AnalysisSettings) -> list[Precession]:
    """Fit all shots, the baseline decaying as they say together, and judge them.

    Where all frequencies are alike only the baselines tell their decay from that of the tones.
    """
    seen = [look_at(shot, settings, dataset.mains_Hz) for shot in dataset.shots]
    rate = None
    for _ in range(MAX_ROUNDS):
        line = common_decay([precession.used_fit for precession in seen if precession.used])
        if line is None or (rate is not None and abs(line.rate_per_s - rate) < SAME * line.rate_u):
            break
        rate = line.rate_per_s
        seen = [_again(precession, dataset, settings, rate) for precession in seen]
    return _unlike_the_others(seen)


def common_decay(fits: Sequence[ToneFit]) -> DecayLine | None:
    """Return how the tones fade, and the baselines of all shots alike; None with too few of them.

    The baselines have no spin exchange: they are the line's point at no frequency. Their u is
    enlarged where they do not agree.
    """
    if len(fits) < 3:
        return None
    omega, decay, decay_u = decays(fits)
    own = np.array([fit.rate_per_s.value for fit in fits])
    weight = np.array([fit.rate_per_s.u for fit in fits]) ** -2.0
    if float(weight.sum()) > 0.0:
        mean = float(weight @ own / weight.sum())
        scatter = float(weight @ (own - mean) ** 2) / (len(fits) - 1)
        omega, decay = np.append(omega, 0.0), np.append(decay, mean)
        decay_u = np.append(decay_u, np.sqrt(max(scatter, 1.0) / weight.sum()))
    return decay_line(omega, decay, decay_u)


def decays(fits: Sequence[ToneFit]) -> tuple[Array, Array, Array]:
    """Return frequencies in rad/s, decays in 1/s and the decays' u of shots, each (shots,)."""
    return (
        np.array([fit.omega_rad_per_s for fit in fits]),
        np.array([fit.decay_per_s for fit in fits]),
        np.array([fit.decay_u for fit in fits]),
    )


def _again(
    precession: Precession, dataset: SerfDataset, settings: AnalysisSettings, rate: float
) -> Precession:
    if not precession.used or precession.fit is None:
        return precession
    start = (precession.fit.omega_rad_per_s, precession.fit.decay_per_s)
    shot = precession.shot
    try:
        fit = fit_tone(
            shot.time_s, shot.voltage_V, precession.usable, rate, dataset.mains_Hz, start
        )
    except NoTone:
        return precession
    return replace(precession, fit=fit, rejected=_too_few(shot, fit, settings))


def _unlike_the_others(seen: list[Precession]) -> list[Precession]:
    """Reject shots that fade much faster than the others."""
    fits = [precession.used_fit for precession in seen if precession.used]
    return [
        replace(precession, rejected=fades_unlike(precession.used_fit, fits))
        if precession.used
        else precession
        for precession in seen
    ]


def fades_unlike(fit: ToneFit, fits: Sequence[ToneFit]) -> str | None:
    """Return how much faster a shot fades than others, where that is beyond doubt; else None.

    Its like among `fits`, itself included, are those of about its frequency: spin exchange makes
    pairs fade faster than single coils.
    """
    omega, decay, _ = decays(fits)
    alike = decay[np.abs(omega / fit.omega_rad_per_s - 1.0) < ALIKE]
    if len(alike) < MIN_ALIKE:
        return None
    usual = float(np.median(alike))
    spread = 1.4826 * float(np.median(np.abs(alike - usual)))
    # A chirp makes decays unlike that are not.
    share = UNLIKE + abs(fit.chirp.value)
    limit = max(share * usual, UNLIKE_U * float(np.hypot(fit.decay_u, spread)))
    if fit.decay_per_s - usual <= limit:
        return None
    return (
        f"it fades at {fit.decay_per_s:.3g} /s where others fade at {usual:.3g} /s: pump light "
        "leaked, or the field was not steady"
    )


def fit_of(shot: Shot, mains_Hz: float | None) -> ToneFit | None:
    """Return the fit of a shot on its own, None where it holds no decaying tone."""
    try:
        return fit_tone(shot.time_s, shot.voltage_V, mains_Hz=mains_Hz)
    except NoTone:
        return None


def bad_because(
    shot: Shot, fit: ToneFit | None, others: Sequence[ToneFit], largest_nT: float
) -> str | None:
    """Return why a shot has to be taken again, None where it is good.

    `others` are good shots of the same cell: one that fades faster than its like had pump light.
    `largest_nT` is the largest field of a coil in the plan.
    """
    if not len(shot.time_s):
        return "the record ends before the field begins"
    largest_V = float(np.max(np.abs(shot.voltage_V)))
    if shot.full_scale_V is not None and largest_V >= SATURATED * shot.full_scale_V:
        return f"saturated: {largest_V:.3g} V of {shot.full_scale_V:g} V; raise full_scale"
    if fit is None or fit.signal_to_noise < MIN_SIGNAL_TO_NOISE:
        return "no decaying tone: look at the pump light, the probe light and the coil"
    if fit.cycles < MIN_CYCLES:
        return (
            f"{fit.cycles:.2f} cycles within the 1/e time, fewer than one; a field of about "
            f"{largest_nT / fit.cycles:.0f} nT would do"
        )
    return fades_unlike(fit, [*others, fit])
