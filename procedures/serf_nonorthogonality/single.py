"""A quick judgement of one shot on the bench: its frequency, and whether it is any good."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.serf_nonorthogonality.cell import signal_of
from procedures.serf_nonorthogonality.tone import NoTone, ToneFit, fit_tone

if TYPE_CHECKING:
    from procedures.serf_nonorthogonality.parameters import SerfParameters

Array = NDArray[np.float64]

SATURATED = 0.999
LEAST_CYCLES = 1.0
LEAST_SIGNAL_TO_NOISE = 3.0


def frequency_Hz(time_s: Array, voltage_V: Array, mains_Hz: float | None) -> float | None:
    """Return a record's frequency in Hz, None where it holds no decaying tone."""
    fit = fit_of(time_s, voltage_V, mains_Hz)
    return None if fit is None else fit.frequency_Hz


def fit_of(time_s: Array, voltage_V: Array, mains_Hz: float | None) -> ToneFit | None:
    """Return the fit of a record, None where it holds no decaying tone."""
    try:
        return fit_tone(time_s, voltage_V, mains_Hz=mains_Hz)
    except NoTone:
        return None


def bad_because(block: Any, delay_s: float, parameters: SerfParameters) -> str | None:
    """Return why a shot has to be taken again, None where it is good."""
    time_s, voltage_V = signal_of(block, delay_s)
    if not len(time_s):
        return "the record ends before the field begins"
    largest_V = float(np.max(np.abs(block.columns["voltage_V"])))
    if largest_V >= SATURATED * parameters.full_scale_V:
        return f"saturated: {largest_V:.3g} V of {parameters.full_scale_V:g} V; raise full_scale"
    fit = fit_of(time_s, voltage_V, parameters.mains_frequency_Hz)
    if fit is None or fit.signal_to_noise < LEAST_SIGNAL_TO_NOISE:
        return "no decaying tone: look at the pump light, the probe light and the coil"
    if fit.cycles < LEAST_CYCLES:
        largest_nT = max(parameters.field_levels_nT.values()) / fit.cycles
        return (
            f"{fit.cycles:.2f} cycles within the 1/e time, fewer than one; a field of about "
            f"{largest_nT:.0f} nT would do"
        )
    return None
