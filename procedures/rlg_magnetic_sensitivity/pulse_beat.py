"""Whether counted pulses beat with the sampling where it harms a result, and what would help."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from procedures.estimation.quantisation import Beat, find_beat

from .dataset import Segment
from .findings import Flag, LineDetail, SegmentDetail
from .frequencies import LARGEST_CYCLES_PER_SAMPLE, allowed_Hz

ROUND_NUMBERS = (1.0, 1.25, 1.6, 2.0, 2.5, 4.0, 5.0, 8.0)
INTERVALS_S = tuple(round(m * 10.0**e, 6) for e in (-2, -1, 0) for m in ROUND_NUMBERS)


def beat_flags(
    segment: Segment, detail: SegmentDetail, lines: Sequence[LineDetail]
) -> Iterator[Flag]:
    """Yield a flag where the rounding of pulses beats next to a driven line or stands still.

    It proposes the nearest frequency and the nearest sample interval at which it would not.
    """
    if segment.quantum_deg_per_h <= 0.0 or detail.noise is None or not lines:
        return
    interval_s = segment.sample_interval_s
    pulse_arcsec = segment.quantum_deg_per_h * interval_s
    rate_deg_per_h = float(np.mean(segment.rate_deg_per_h[detail.kept]))
    span_s = len(segment.time_s) * interval_s
    driven_Hz = [line.frequency_Hz for line in lines]

    def found(tau_s: float, lines_Hz: Sequence[float]) -> Beat | None:
        assert detail.noise is not None
        walk = detail.noise.angle_random_walk_deg_per_sqrt_h
        return find_beat(rate_deg_per_h, pulse_arcsec, tau_s, walk, lines_Hz, span_s)

    beat = found(interval_s, driven_Hz)
    if beat is None:
        return
    top_Hz = max(driven_Hz)
    intervals = [
        tau_s
        for tau_s in INTERVALS_S
        if tau_s * top_Hz <= LARGEST_CYCLES_PER_SAMPLE and found(tau_s, driven_Hz) is None
    ]
    offers: list[str] = []
    details: dict[str, object] = {"harmonic": beat.harmonic, "beat_Hz": beat.frequency_Hz}
    if beat.line_Hz is not None:
        near_Hz = beat.line_Hz
        clear = [f for f in allowed_Hz(span_s, interval_s) if found(interval_s, [f]) is None]
        if clear:
            best_Hz = min(clear, key=lambda f: abs(f - near_Hz))
            offers.append(f"a frequency of {best_Hz:.3g} Hz")
            details["frequency_Hz"] = best_Hz
    if intervals:
        best_s = min(intervals, key=lambda tau_s: abs(np.log(tau_s / interval_s)))
        offers.append(f"a sample interval of {best_s:g} s")
        details["sample_interval_s"] = best_s
    offers.append("another azimuth of the base")
    pulses = rate_deg_per_h * interval_s / pulse_arcsec
    does = (
        f"beats at {beat.frequency_Hz:.4g} Hz with the field"
        if beat.line_Hz is not None
        else "stands still and follows the signal"
    )
    yield Flag(
        "quantisation-beat",
        detail.axes[0] if len(detail.axes) == 1 else None,
        f"The output makes {pulses:.4g} pulses an interval: their rounding {does}, which may add "
        f"up to {beat.amplitude_deg_per_h:.2g} deg/h to the line or take it away, uncertainty "
        f"aside. Measure again with {' or '.join(offers)}.",
        details=details,
    )
