"""What a plan will determine and how well, before anything is switched on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .parameters import SerfParameters

LEAST_LOSS_SHARE = 0.5
"""Broadening over width at which angles are told best."""


@dataclass(frozen=True)
class Expectation:
    """What the cell's rates and the plan's fields lead to.

    `frequency_Hz`, `decay_per_s` and `cycles` within the 1/e time by shot (coils driven);
    `broadening_share` is the largest broadening over the width without a field, `loss` by how much
    the uncertainty of an angle is larger than at the best field, `record_decays` how many 1/e times
    of the slowest line the record holds.
    """

    frequency_Hz: Mapping[str, float]
    decay_per_s: Mapping[str, float]
    cycles: Mapping[str, float]
    broadening_share: float
    loss: float
    record_decays: float


def expectation(parameters: SerfParameters) -> Expectation | None:
    """Return what a plan leads to, None where it does not give the cell's rates."""
    relaxation, exchange = parameters.relaxation_rate_Hz, parameters.exchange_rate_Hz
    if relaxation is None or exchange is None:
        return None
    q = parameters.slowing_down.at_rest
    width = relaxation / q
    beta = parameters.slowing_down.broadening / exchange
    frequency, decay, cycles = {}, {}, {}
    for shot in parameters.wanted:
        hertz = parameters.gyromagnetic_ratio_Hz_per_nT * math.hypot(*shot.field_nT) / q
        frequency[shot.coils] = hertz
        decay[shot.coils] = width + beta * (2.0 * math.pi * hertz) ** 2
        cycles[shot.coils] = hertz / decay[shot.coils]
    fastest = 2.0 * math.pi * max(frequency.values())
    share = beta * fastest**2 / width
    return Expectation(
        frequency,
        decay,
        cycles,
        share,
        _relative_u(share) / _relative_u(LEAST_LOSS_SHARE),
        parameters.record_s * min(decay.values()),
    )


def _relative_u(share: float) -> float:
    """Return the uncertainty of a frequency over it, on a scale, from broadening over width.

    It goes as decay^1.5 / w, as of any damped tone in white noise.
    """
    return math.sqrt((1.0 + share) ** 3 / share)
