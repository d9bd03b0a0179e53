"""Whether counted pulses beat with the sampling where it harms a result, and what would help."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procedures.estimation.quantisation import Beat, find_beat
from station.findings import Flag

from .dataset import Segment
from .findings import LineDetail, SegmentDetail
from .frequencies import LARGEST_CYCLES_PER_SAMPLE, allowed_Hz

ROUND_NUMBERS = (1.0, 1.25, 1.6, 2.0, 2.5, 4.0, 5.0, 8.0)
INTERVALS_S = tuple(round(m * 10.0**e, 6) for e in (-2, -1, 0) for m in ROUND_NUMBERS)


@dataclass(frozen=True)
class Advice:
    """What a beat does, in a sentence, and what would help, in words and as plain data."""

    does: str
    helps: str
    details: Mapping[str, object]


def advice(
    rate_deg_per_h: float,
    pulse_arcsec: float,
    interval_s: float,
    walk_deg_per_sqrt_h: float,
    driven_Hz: Sequence[float],
    span_s: float,
) -> Advice | None:
    """Return what to know of a beat of counted pulses, None where none does harm.

    It proposes the nearest frequency and the nearest sample interval at which there is none.
    """

    def found(tau_s: float, lines_Hz: Sequence[float]) -> Beat | None:
        return find_beat(rate_deg_per_h, pulse_arcsec, tau_s, walk_deg_per_sqrt_h, lines_Hz, span_s)

    beat = found(interval_s, driven_Hz)
    if beat is None:
        return None
    offers: list[str] = []
    details: dict[str, object] = {"harmonic": beat.harmonic, "beat_Hz": beat.frequency_Hz}
    does = "stands still and follows the signal"
    if beat.line_Hz is not None:
        near_Hz = beat.line_Hz
        does = f"beats at {beat.frequency_Hz:.4g} Hz with the field"
        clear = [f for f in allowed_Hz(span_s, interval_s) if found(interval_s, [f]) is None]
        if clear:
            best_Hz = min(clear, key=lambda f: abs(f - near_Hz))
            offers.append(f"a frequency of {best_Hz:.3g} Hz")
            details["frequency_Hz"] = best_Hz
    intervals = [
        tau_s
        for tau_s in INTERVALS_S
        if tau_s * max(driven_Hz) <= LARGEST_CYCLES_PER_SAMPLE and found(tau_s, driven_Hz) is None
    ]
    if intervals:
        best_s = min(intervals, key=lambda tau_s: abs(np.log(tau_s / interval_s)))
        offers.append(f"a sample interval of {best_s:g} s")
        details["sample_interval_s"] = best_s
    offers.append("another azimuth of the base")
    pulses = rate_deg_per_h * interval_s / pulse_arcsec
    return Advice(
        f"the output makes {pulses:.4g} pulses an interval: their rounding {does}, which may add "
        f"up to {beat.amplitude_deg_per_h:.2g} deg/h to the line or take it away, uncertainty "
        "aside",
        " or ".join(offers),
        details,
    )


def beat_flags(
    segment: Segment, detail: SegmentDetail, lines: Sequence[LineDetail]
) -> Iterator[Flag]:
    """Yield a flag where the rounding of pulses beats next to a driven line or stands still."""
    if segment.quantum_deg_per_h <= 0.0 or detail.noise is None or not lines:
        return
    interval_s = segment.sample_interval_s
    told = advice(
        float(np.mean(segment.rate_deg_per_h[detail.kept])),
        segment.quantum_deg_per_h * interval_s,
        interval_s,
        detail.noise.angle_random_walk_deg_per_sqrt_h,
        [line.frequency_Hz for line in lines],
        len(segment.time_s) * interval_s,
    )
    if told is not None:
        yield Flag(
            "quantisation-beat",
            f"In the record, {told.does}. Measure again with {told.helps}.",
            detail.axes[0] if len(detail.axes) == 1 else None,
            told.details,
        )
