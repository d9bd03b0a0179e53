"""The sine that one coil is commanded to make."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Drive:
    """Frequency and amplitude (a peak) of one coil axis; an amplitude of zero is a coil at rest."""

    frequency_Hz: float
    amplitude_mT: float
