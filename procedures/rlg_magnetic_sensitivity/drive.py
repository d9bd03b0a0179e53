"""The sine that one coil is commanded to make."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Drive:
    """Frequency and amplitude (a peak) of one coil axis; an amplitude of zero is a coil at rest."""

    frequency_Hz: float
    amplitude_mT: float


LARGEST_UNDRIVEN = 3.0
"""deg/h/mT: what an axis that is not driven may have where nothing is stated. Published values of
two-frequency gyros end there; those of four-frequency ones reach 100."""
