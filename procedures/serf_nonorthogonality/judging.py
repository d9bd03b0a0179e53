"""On the bench: what a shot says at first sight, and why it has to be taken again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from procedures.serf_nonorthogonality.precession import fades_unlike
from procedures.serf_nonorthogonality.shots import LEAST_CYCLES, LEAST_SIGNAL_TO_NOISE
from procedures.serf_nonorthogonality.tone import NoTone, ToneFit, fit_tone

if TYPE_CHECKING:
    from procedures.serf_nonorthogonality.dataset import Shot
    from procedures.serf_nonorthogonality.parameters import SerfParameters

SATURATED = 0.999


def fit_of(shot: Shot, mains_Hz: float | None) -> ToneFit | None:
    """Return the fit of a shot on its own, None where it holds no decaying tone."""
    try:
        return fit_tone(shot.time_s, shot.voltage_V, mains_Hz=mains_Hz)
    except NoTone:
        return None


def bad_because(
    shot: Shot, fit: ToneFit | None, others: Sequence[ToneFit], parameters: SerfParameters
) -> str | None:
    """Return why a shot has to be taken again, None where it is good.

    `others` are good shots of the same cell: one that fades faster than its like had pump light.
    """
    if not len(shot.time_s):
        return "the record ends before the field begins"
    largest_V = float(np.max(np.abs(shot.voltage_V)))
    if largest_V >= SATURATED * parameters.full_scale_V:
        return f"saturated: {largest_V:.3g} V of {parameters.full_scale_V:g} V; raise full_scale"
    if fit is None or fit.signal_to_noise < LEAST_SIGNAL_TO_NOISE:
        return "no decaying tone: look at the pump light, the probe light and the coil"
    if fit.cycles < LEAST_CYCLES:
        largest_nT = max(parameters.field_levels_nT.values()) / fit.cycles
        return (
            f"{fit.cycles:.2f} cycles within the 1/e time, fewer than one; a field of about "
            f"{largest_nT:.0f} nT would do"
        )
    return fades_unlike(fit, [*others, fit])
