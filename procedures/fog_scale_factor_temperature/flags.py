"""What the reader must know about turns and curves, one flag a sentence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from station.findings import Flag

from .axis_problem import stiffness
from .axis_turns import AxisTurns
from .curve import Curve
from .dataset import FogDataset
from .findings import AnalysisSettings, AxisFit, Driven, Verified
from .gaps import WIDE, within

MOST_LISTED = 12
DRIVE_BEYOND, LARGE_DEG = 5.0, 1.0
"""Standard uncertainties of a drive's error; a heading error that no reference heading has."""
PAIRED_HEAP, SINGLE_HEAP = 3, 4
"""As many neighbouring sets without a good turn are no chance."""


def rejected_rows(fit: AxisFit) -> list[int]:
    """Return the rows of the turn table that the model leaves out as wrong, 0-based.

    Waits among turns of one sense are no wrong rows: they tell that model nothing.
    """
    meant = np.isfinite(fit.error_ppm) | fit.paired
    return [int(row) for row in fit.rows[meant & ~fit.kept]]


def data_flags(turns: AxisTurns, fit: AxisFit, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on the rows of an axis: what was left out, and gaps."""
    flags = []
    rows = rejected_rows(fit) if fit.curve is not None else []
    if rows:
        shown = ", ".join(str(row) for row in rows[:MOST_LISTED])
        more = " and more" if len(rows) > MOST_LISTED else ""
        flags.append(
            Flag(
                "outliers-rejected",
                f"{len(rows)} of {len(turns.rows)} turns about {turns.axis} lie more than "
                f"{settings.outlier:g} standard deviations from what the others say, or have a "
                f"temperature that cannot be, and are left out: rows {shown}{more}, counted from "
                "0.",
                turns.axis,
                {"count": len(rows), "rows": rows},
            )
        )
    return flags + _heaps(turns, fit) + _gaps(turns, settings)


def _heaps(turns: AxisTurns, fit: AxisFit) -> list[Flag]:
    """Return the flag of neighbouring sets that all disagree: wild turns do not come in heaps."""
    if fit.curve is None:
        return []
    sensing = turns.usable & turns.sensing
    numbers = turns.sets()
    whole = [n for n in numbers if bool((sensing & (turns.set_number == n)).any())]
    heat = [float(turns.temperature_degC[sensing & (turns.set_number == n)].mean()) for n in whole]
    order = np.argsort(heat, kind="stable")
    most = PAIRED_HEAP if fit.paired else SINGLE_HEAP
    run: list[float] = []
    for place in (*order, None):
        rows = sensing & (turns.set_number == whole[place]) if place is not None else None
        if rows is not None and place is not None and not bool(fit.kept[rows].any()):
            run.append(heat[place])
        elif len(run) >= most:
            return [
                Flag(
                    "model-too-stiff",
                    f"All turns about {turns.axis} in {len(run)} neighbouring sets, {run[0]:.1f} "
                    f"to {run[-1]:.1f} degC, disagree with the curve and were left out: rather a "
                    "feature of the gyro, narrower than the polynomial can follow, than wild "
                    "turns.",
                    turns.axis,
                    {"sets": len(run), "between_degC": [run[0], run[-1]]},
                )
            ]
        else:
            run = []
    return []


def _gaps(turns: AxisTurns, settings: AnalysisSettings) -> list[Flag]:
    sensing = turns.usable & turns.sensing
    number = turns.set_number[sensing]
    if len(np.unique(number)) < 3:
        return []
    starts = np.sort([turns.middle_s[sensing][number == n].min() for n in np.unique(number)])
    steps = np.diff(starts)
    nominal_s = float(np.median(steps))
    # Within a set the first turn alone may be missing, which moves its start by a turn.
    gaps = int(np.sum(steps > settings.gap * nominal_s))
    heat = np.sort(turns.temperature_degC[sensing])
    widest_degC = float(np.max(np.diff(heat)))
    if not gaps and widest_degC <= settings.temperature_gap_degC:
        return []
    missing = int(np.sum(np.rint(steps / nominal_s) - 1.0))
    lost = (
        f"Sets of turns about {turns.axis} are missing: {gaps} interval{'s' if gaps > 1 else ''} "
        f"longer than {settings.gap:g} times the usual {nominal_s:g} s; the"
        if gaps
        else f"The turns about {turns.axis} lie far apart in temperature: the"
    )
    return [
        Flag(
            "gap",
            f"{lost} widest stretch of temperature "
            f"without a turn is {widest_degC:.1f} degC. In a stretch of more than "
            f"{settings.temperature_gap_degC:g} degC the curve's uncertainty holds what higher "
            f"orders may make; in one of more than {WIDE * settings.temperature_gap_degC:g} degC "
            "no value is given.",
            turns.axis,
            {
                "count": max(gaps, 1),
                "missing_sets": missing,
                "longest_s": float(steps.max()),
                "widest_degC": widest_degC,
            },
        )
    ]


def fit_flags(fit: AxisFit, dataset: FogDataset, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on the model of an axis."""
    if fit.curve is None:
        return [
            Flag(
                "not-identifiable",
                f"The turns about {fit.axis} do not determine a curve: too few of them, or at too "
                "few temperatures.",
                fit.axis,
                {"coefficients": ["scale_factor_error", "largest_scale_factor_error"]},
            )
        ]
    flags = []
    asked = dataset.reference_temperature_degC
    low, high = fit.curve.domain_degC
    if not fit.curve.holds(asked):
        flags.append(
            Flag(
                "extrapolation",
                f"The reference temperature of {asked:g} degC lies outside {low:.1f} to "
                f"{high:.1f} degC, where there are turns about {fit.axis}; no value is given.",
                fit.axis,
                {"temperature_degC": asked},
            )
        )
    if within(fit.gaps_degC, asked, WIDE * settings.temperature_gap_degC):
        gap_said = (
            f"No turn about {fit.axis} was made within {settings.temperature_gap_degC:g} degC and "
            f"more around the reference temperature of {asked:g} degC: no value is given."
        )
        details = {"coefficients": ["scale_factor_error"], "temperature_degC": asked}
        flags.append(Flag("not-identifiable", gap_said, fit.axis, details))
    lag = fit.lag_one_correlation
    if lag is not None and lag > stiffness(settings, fit.sets):
        flags.append(
            Flag(
                "model-too-stiff",
                f"Residuals of axis {fit.axis} at neighbouring temperatures are correlated by "
                f"{lag:.2f}: a polynomial of order {fit.curve.order} does not follow the curve.",
                fit.axis,
                {"lag_one_correlation": lag},
            )
        )
    return flags


def verification_flags(verified: Verified | None) -> list[Flag]:
    """Return the flags of a verification ramp that denies the curve, or went beyond its range."""
    if verified is None:
        return []
    flags = []
    if verified.beyond_ppm > 0.0:
        rms = float(np.sqrt(np.mean(verified.after_ppm**2)))
        denied_said = (
            f"The verification ramp contradicts the curve of {verified.axis}: after compensation "
            f"its turns are {rms:.3g} ppm rms off, of which {verified.beyond_ppm:.3g} ppm are no "
            "noise. The curve's uncertainty holds that; hysteresis, a thermometer that lags, or a "
            "gyro that changed."
        )
        details: dict[str, object] = {"statement": "verification", "rms_ppm": rms}
        flags.append(Flag("contradicts-statement", denied_said, verified.axis, details))
    if not verified.outside:
        return flags
    return [
        *flags,
        Flag(
            "extrapolation",
            f"{verified.outside} verification turns about {verified.axis} were made outside the "
            "calibrated range; there the compensation holds the value at the end of the range.",
            verified.axis,
            {"count": verified.outside},
        ),
    ]


def drive_flags(
    driven: Driven | None, curves: Mapping[str, Curve], gyro_bias_deg_per_h: float | None
) -> list[Flag]:
    """Return the flags of the vehicle test."""
    if driven is None:
        return []
    flags = []
    if driven.compensated_error_deg is None:
        flags.append(
            Flag(
                "not-identifiable",
                "The drive does not end in the heading in which it began, and it has no reference "
                "heading: its heading error cannot be told.",
                None,
                {"coefficients": ["heading_error_uncompensated", "heading_error_compensated"]},
            )
        )
    raw, better = driven.raw_error_deg, driven.compensated_error_deg
    if raw is not None and better is not None and gyro_bias_deg_per_h is not None:
        by_bias = (driven.duration_h - driven.by_bias_deg) * gyro_bias_deg_per_h
        u = float(np.linalg.norm((driven.noise_u_deg, driven.model_u_deg, by_bias)))
        worse = abs(better) > abs(raw) + DRIVE_BEYOND * u
        if worse or abs(better) > DRIVE_BEYOND * u + LARGE_DEG:
            denied_said = (
                f"The drive contradicts the curves: its heading ends {raw:.3g} deg off without and "
                f"{better:.3g} deg off with compensation, of which {u:.2g} deg are explained. "
                "Check the sense of the turns (`turn_sense`), and latitude, signs and units of the "
                "drive."
            )
            details = {"statement": "drive", "explained_deg": u}
            flags.append(Flag("contradicts-statement", denied_said, None, details))
    if driven.outside > 0.0:
        flags.append(
            Flag(
                "extrapolation",
                f"In {100.0 * driven.outside:.0f} % of the drive the gyro was outside the "
                "calibrated range; there the compensation holds the value at the end of the range.",
                None,
                {"share": driven.outside},
            )
        )
    if "z" not in curves:
        flags.append(
            Flag(
                "not-identifiable",
                "There is no curve of the z axis, which senses a vehicle's heading: the drive was "
                "compensated without it.",
                None,
                {"coefficients": ["heading_error_compensated"]},
            )
        )
    return flags
