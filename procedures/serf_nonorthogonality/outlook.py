"""What `validate` says of a plan that has no fault: what it determines, and how well."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from station.report.numbers import format_number

from .parameters import SerfParameters
from .shots import PAIRS

SIGNAL_TO_NOISE = 100.0
"""Of a single sample of the first shot; what the uncertainties below are told for."""
FULL_RECORD = 3.0
ARCSEC = math.pi / 648000.0
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


def outlook(parameters: SerfParameters) -> tuple[str, ...]:
    """Return in lines what a plan determines, what it does not, and how well."""
    import numpy as np

    from .angles import NAMES, solve

    field = ", ".join(f"{axis} {b:g} nT" for axis, b in parameters.field_levels_nT.items())
    lines = [f"{len(parameters.wanted)} shots, {field}."]
    if parameters.shots == "as_published":
        lines.append(
            "The residual field is taken for zero and the coil constants for exact: at these "
            f"fields 1 nT moves an angle by up to {_by_residual(parameters):.2g} deg, 1 % of a "
            "coil constant by up to 1.2 deg. `shots: reversal` is free of both."
        )
    else:
        lines.append("Angles, residual field and coil factors are determined.")
    expected = expectation(parameters)
    if expected is None:
        lines.append("Give relaxation_rate and exchange_rate for expected uncertainties.")
        return tuple(lines)
    frequency = np.array([expected.frequency_Hz[shot.coils] for shot in parameters.wanted])
    decay = np.array([expected.decay_per_s[shot.coils] for shot in parameters.wanted])
    amplitude = np.array([_amplitude(shot.coils, parameters) for shot in parameters.wanted])
    u = 4.0 * decay**1.5 / (SIGNAL_TO_NOISE * amplitude * math.sqrt(parameters.sample_rate_Hz))
    known = parameters.shots == "as_published" or parameters.coil_constants == "known"
    commanded_nT = np.array([shot.field_nT for shot in parameters.wanted])
    solution = solve(commanded_nT, 2.0 * np.pi * frequency, np.diag(u**2), known=known)
    size = np.sqrt(np.diag(solution.covariance))
    told = ", ".join(
        f"{pair} {format_number(float(size[NAMES.index(pair)]) / ARCSEC, 2)} arcsec"
        for pair in PAIRS
    )
    lines.append(
        f"u from noise, at {SIGNAL_TO_NOISE:g} times the noise of a sample: {told} "
        f"({expected.loss:.2f} times those at the best field, {parameters.best_field_nT:g} nT)."
    )
    slow = min(expected.cycles, key=lambda coils: expected.cycles[coils])
    lines.append(
        f"Precession {min(expected.frequency_Hz.values()):.0f} Hz to "
        f"{max(expected.frequency_Hz.values()):.0f} Hz; at least "
        f"{expected.cycles[slow]:.1f} cycles within the 1/e time ({slow})."
    )
    if expected.record_decays < FULL_RECORD:
        lines.append(
            f"A record holds {expected.record_decays:.1f} 1/e times: "
            f"{FULL_RECORD / expected.record_decays * parameters.record_s:.2g} s would be better."
        )
    return tuple(lines)


def _amplitude(coils: str, parameters: SerfParameters) -> float:
    """Return which part of the largest signal a shot has: sines of field to pump and to probe."""
    share = 1.0 / len(coils)
    beside_pump = 1.0 - (share if parameters.pump_axis in coils else 0.0)
    beside_probe = 1.0 - (share if parameters.probe_axis in coils else 0.0)
    return math.sqrt(beside_pump * beside_probe)


def _by_residual(parameters: SerfParameters) -> float:
    """Return by how many degrees a nanotesla may move an angle of the published shots."""
    return math.degrees(2.0 / min(parameters.field_levels_nT.values()))
