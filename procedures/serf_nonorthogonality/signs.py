"""Whether the tones of all shots begin with the signs that their fields give them.

Right after the light goes off the detector sees, with n along the field, s along the spins and p
along the probe, as shares of the whole signal

    tone  (s_perp.p_perp) - i ((n x s_perp).p),  baseline  (s.n) (p.n).

The sign of the detector's gain, the sense of the precession and a time zero that all records share
are not known; they are those with which most shots agree. A shot that agrees with the others only
with its sign turned was recorded with the output inverted, or with a field of another sign.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from station.findings import Flag, contradiction

from .dataset import Frequencies, SerfDataset
from .shots import MIN_SIGNAL_TO_NOISE
from .spin_motion import NO_LEAN, fields_in_light

Array = NDArray[np.float64]
MIN_SHARE = 0.25
"""Of the whole signal: a tone that should be smaller says nothing of signs."""
CLEAR = 0.8
"""Cosine between what a shot shows and what it should, at which it agrees."""
SAVED = 1.0
"""A wrong sign costs two; what has to be saved before signs count as wrong."""
DELAYS = 181
FEWEST = 3


def sign_flags(dataset: SerfDataset, frequencies: Frequencies | None) -> Iterator[Flag]:
    """Yield a flag that names the shots whose signs contradict those of the others."""
    if frequencies is None or not frequencies.solution.positive_definite:
        return
    fields = fields_in_light(
        frequencies.commanded_nT, frequencies.solution, dataset.pump_axis, dataset.probe_axis
    )
    lean = frequencies.lean or NO_LEAN
    expected = _expected(fields, lean.spins, lean.probe)
    fits = [shot.used_fit for shot in frequencies.used]
    measured = np.array([[fit.cosine_V - 1j * fit.sine_V, fit.baseline_V] for fit in fits])
    clear = np.abs(expected[:, 0]) > MIN_SHARE
    clear &= np.array([fit.signal_to_noise > MIN_SIGNAL_TO_NOISE for fit in fits])
    if int(np.sum(clear)) < FEWEST:
        return
    odd = _odd_ones(expected[clear], measured[clear], frequencies.omega_rad_per_s[clear])
    if odd is None or not np.any(odd):
        return
    turned = [frequencies.used[k].name for k in np.flatnonzero(clear)[odd]]
    yield contradiction(
        "shots",
        f"The tones of {', '.join(turned)} begin with the sign opposite to the one that the "
        "commanded fields give them beside the other shots: the detector's output was inverted "
        "in these shots, or in the others, or a coil's field had the other sign there. Correct the "
        "sign of the output or of the field; how the spins lie to the fields comes from these "
        "signs, and the angles with it.",
        shots=turned,
    )


def _expected(fields: Array, spins: Array, probe: Array) -> NDArray[np.complex128]:
    """Return tone and baseline (shots, 2) of unit fields, for a full signal of one."""
    along_s, along_p = fields @ spins, fields @ probe
    tone = float(spins @ probe) - along_s * along_p
    return np.column_stack([tone - 1j * (np.cross(fields, spins) @ probe), along_s * along_p])


def _odd_ones(
    expected: NDArray[np.complex128], measured: NDArray[np.complex128], omega: Array
) -> NDArray[np.bool_] | None:
    """Return which shots (n,) have the wrong sign; None where another cause explains them."""
    turns = np.linspace(-np.pi, np.pi, DELAYS) / float(np.max(omega))
    size = np.linalg.norm(expected, axis=1) * np.linalg.norm(measured, axis=1)
    best, least, odd = 0.0, 0.0, None
    for sense in (False, True):
        tone = np.conj(expected[:, 0]) if sense else expected[:, 0]
        for late_s in turns:
            along = np.real(np.conj(tone * np.exp(1j * omega * late_s)) * measured[:, 0])
            along = (along + np.real(expected[:, 1]) * np.real(measured[:, 1])) / size
            best = max(best, abs(float(np.sum(along))))
            near = abs(late_s) * float(np.max(omega)) <= 0.5 * np.pi
            if near and float(np.sum(np.abs(along))) > least:
                least = float(np.sum(np.abs(along)))
                wrong = along < 0.0
                fewer = wrong if 2 * int(np.sum(wrong)) <= len(wrong) else ~wrong
                odd = fewer if float(np.min(np.abs(along))) > CLEAR else None
    return odd if least - best > SAVED else None
