"""What the reader must know about a dataset and its analysis, one flag a sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence

from procedures.estimation.flags import excitation_flags, not_identifiable
from station.findings import Estimate, Flag

from .dataset import AXES, UNDRIVEN, Segment
from .fitted import FittedRecord, LineDetail
from .parameters import AnalysisSettings

MATTERS = 0.5
"""Of u: what an axis that was not driven may add before it is flagged."""


def field_flags(record: FittedRecord) -> list[Flag]:
    """Return the flags of coils whose measured field is not the commanded one.

    What the gaussmeter did not see is zero throughout, and says nothing.
    """
    flags: list[Flag] = []
    segment = record.segment
    seen = [bool(component.any()) for component in segment.field_mT.T]
    for line in (line for line in record.field.lines if line.measured):
        for axis in line.axes:
            commanded_mT = segment.drive[axis].amplitude_mT
            if commanded_mT > 0.0:
                shares = {
                    other: abs(complex(line.phasor_mT[k])) / commanded_mT
                    for k, other in enumerate(AXES)
                    if other == axis or (seen[k] and other not in line.axes)
                }
                flags += excitation_flags(axis, axis, shares, (commanded_mT, "mT"), axis)
    return flags


def drive_flags(
    segment: Segment, lines: Sequence[LineDetail], settings: AnalysisSettings
) -> list[Flag]:
    """Return the flags on the commanded drive: cycles in the record, field made of it."""
    flags: list[Flag] = []
    if len(segment.time_s):
        span_s = segment.recorded_span_s
        for axis, drive in segment.drive.items():
            cycles = drive.frequency_Hz * span_s
            if abs(cycles - round(cycles)) > settings.non_integer_cycles:
                non_text = (
                    f"The record holds {cycles:.4g} cycles of {drive.frequency_Hz:g} Hz on "
                    f"{axis}, not a whole number: the published formula reads low by up to "
                    "36 %, the fit does not."
                )
                flags.append(Flag("non-integer-cycles", non_text, axis, {"cycles": cycles}))
    for line in lines:
        drive = segment.drive[line.axis]
        if drive.amplitude_mT <= 0.0:
            continue
        off = abs(line.own_field_mT) / drive.amplitude_mT - 1.0
        if abs(off) > settings.field_differs_from_commanded:
            field_text = (
                f"The measured field on {line.axis} has an amplitude of "
                f"{abs(line.own_field_mT):.5g} mT, {100.0 * off:+.3g} % from the commanded "
                f"{drive.amplitude_mT:g} mT; the result uses the measured field. Check coil and "
                "supply, the unit of the field, and that the stated amplitude is the peak."
            )
            flags.append(
                Flag(
                    "field-differs-from-commanded",
                    field_text,
                    line.axis,
                    {"relative_difference": off},
                )
            )
    return flags


def cross_axis_flags(estimates: Sequence[Estimate], settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on results in which an axis that was not driven may stand."""
    flags: list[Flag] = []
    for estimate in estimates:
        shares = {
            name.removeprefix(UNDRIVEN): abs(share)
            for name, share in estimate.sensitivities.items()
            if name.startswith(UNDRIVEN)
        }
        small = MATTERS * (estimate.standard_uncertainty or math.inf)
        large = {a: share for a, share in shares.items() if share * settings.undriven_u > small}
        if large:
            text = " and ".join(f"{100.0 * share:.2g} % of {axis}" for axis, share in large.items())
            cross_text = (
                f"The field of {estimate.axis} leans towards axes that were not driven: their "
                f"sensitivities stand in that of {estimate.axis} with {text}. u holds up "
                f"to {settings.undriven_sensitivity:g} deg/h/mT of each "
                "(`undriven_sensitivity`). Drive all three axes, align the coil, or state what "
                "is known of the gyro."
            )
            flags.append(Flag("cross-axis", cross_text, estimate.axis, {"undriven": list(large)}))
    return flags


def result_flags(
    estimates: Sequence[Estimate],
    lines: Sequence[LineDetail],
    reasons: dict[str, str],
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the estimates: significance, quadrature, what cannot be known."""
    flags: list[Flag] = []
    for estimate in estimates:
        value, u = estimate.value, estimate.standard_uncertainty
        if value is None or u is None:
            reason = reasons.get(estimate.axis or "", "the record does not determine it")
            text = f"The magnetic sensitivity of {estimate.axis} is undetermined: {reason}."
            flags.append(not_identifiable(text, [estimate.axis or ""], estimate.axis))
        elif abs(value) < settings.not_significant * u:
            bound = max(x.upper_bound or 0.0 for x in lines if x.axis == estimate.axis)
            not_text = (
                f"The magnetic sensitivity of {estimate.axis} is not distinguished from zero: "
                f"{value:.2g} with a standard uncertainty of {u:.2g} deg/h/mT; its magnitude "
                f"is below {bound:.2g} deg/h/mT with 95 % confidence."
            )
            flags.append(Flag("not-significant", not_text, estimate.axis, {"upper_bound": bound}))
    for line in lines:
        q, u = line.quadrature, line.quadrature_uncertainty
        if q is not None and u is not None and abs(q) > settings.quadrature_significant * u > 0.0:
            quadrature_text = (
                f"The output at {line.frequency_Hz:.4g} Hz has a part of {q:.3g} deg/h/mT in "
                f"quadrature to the field on {line.axis} ({abs(q) / u:.1f} u): a delay, eddy "
                "currents or pickup."
            )
            flags.append(
                Flag(
                    "quadrature-significant",
                    quadrature_text,
                    line.axis,
                    {"quadrature": q, "standard_uncertainty": u},
                )
            )
    return flags
