"""What the reader must know about turns and curves, one flag a sentence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from procedures.common.constants import FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.estimation.flags import counted, not_identifiable, rows_listed, too_stiff
from station.findings import Flag, contradiction

from .curve import Curve
from .dataset import PPM, AxisTurns, FogDataset, Mask
from .model import stiffness
from .parameters import PUBLISHED_ORDER, AnalysisSettings
from .solution import AxisFit
from .verification import Driven

DRIVE_BEYOND, LARGE_DEG = 5.0, 1.0
"""Standard uncertainties of a drive's error; a heading error that no reference heading has."""
PAIRED_HEAP, SINGLE_HEAP = 3, 4
"""As many neighbouring sets without a good turn are no chance."""
LARGEST_PPM = 10_000.0
BIASES, MIN_BIAS_DEG_PER_H = 10.0, 1.0
"""Gyro biases as specified, and a bias, beyond which the bias in the turns is another one."""
FEW_SETS = 3 * PUBLISHED_ORDER
"""With no more of them, what is called noise may be a curve of a higher order than they carry."""
SMOOTH, FEWEST_SETS = 0.3, 10
"""Of a difference within sets: the square of its steps over its own, 2 for noise."""
MOST, MAX_SIGMA, PLAINLY = 0.85, 1.44, 0.75
"""Of the turns, how far the outermost of them lies in standard deviations, and how much of a noise
beyond the stated one they have to show: what a few turns make alone is no noise."""
WIDE = 2.0
"""Times the threshold of the flag of a gap: from such a width on no value is given within."""
SPEEDS = 1.6
"""Of turns of two commands, one over the other."""


def data_flags(fit: AxisFit, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on the rows of an axis: what was left out, and gaps."""
    flags = []
    turns, rows = fit.turns, fit.rejected_rows
    if rows:
        rejected_text = (
            f"{len(rows)} of {len(turns.rows)} turns about {turns.axis} lie more than "
            f"{settings.outlier:g} standard deviations from what the others say, or have a "
            f"temperature that cannot be, and are left out: {rows_listed(rows)}."
        )
        details = {"count": len(rows), "rows": rows}
        flags.append(Flag("outliers-rejected", rejected_text, turns.axis, details))
    return flags + _heaps(fit) + _gaps(turns, settings)


def _heaps(fit: AxisFit) -> list[Flag]:
    """Return the flag of neighbouring sets that all disagree: wild turns do not come in heaps."""
    if fit.curve is None:
        return []
    turns = fit.turns
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
            heap_text = (
                f"All turns about {turns.axis} in {len(run)} neighbouring sets, {run[0]:.1f} to "
                f"{run[-1]:.1f} degC, disagree with the curve and were left out: rather a feature "
                "of the gyro, narrower than the polynomial can follow, than wild turns."
            )
            details = {"sets": len(run), "between_degC": [run[0], run[-1]]}
            return [Flag("model-too-stiff", heap_text, turns.axis, details)]
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
    lost = f"The turns about {turns.axis} lie far apart in temperature:"
    if gaps:
        lost = (
            f"Sets of turns about {turns.axis} are missing: {counted(gaps, 'interval')} longer "
            f"than {settings.gap:g} times the usual {nominal_s:g} s;"
        )
    gap_text = (
        f"{lost} the widest stretch of temperature without a turn is {widest_degC:.1f} degC. In a "
        f"stretch of more than {settings.temperature_gap_degC:g} degC the curve's uncertainty "
        "holds what higher orders may make; in one of more than "
        f"{WIDE * settings.temperature_gap_degC:g} degC no value is given."
    )
    details = {
        "count": max(gaps, 1),
        "missing_sets": missing,
        "longest_s": float(steps.max()),
        "widest_degC": widest_degC,
    }
    return [Flag("gap", gap_text, turns.axis, details)]


def fit_flags(fit: AxisFit, dataset: FogDataset, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on the model of an axis."""
    if fit.curve is None:
        few_text = (
            f"The turns about {fit.axis} do not determine a curve: too few of them, or at too few "
            "temperatures."
        )
        names = ["scale_factor_error", "largest_scale_factor_error"]
        return [not_identifiable(few_text, names, fit.axis)]
    flags = []
    asked = dataset.reference_temperature_degC
    low, high = fit.curve.domain_degC
    if not fit.curve.holds(asked):
        outside_text = (
            f"The reference temperature of {asked:g} degC lies outside {low:.1f} to {high:.1f} "
            f"degC, where there are turns about {fit.axis}; no value is given."
        )
        flags.append(Flag("extrapolation", outside_text, fit.axis, {"temperature_degC": asked}))
    if fit.in_gap(asked, WIDE * settings.temperature_gap_degC):
        gap_text = (
            f"No turn about {fit.axis} was made within {settings.temperature_gap_degC:g} degC and "
            f"more around the reference temperature of {asked:g} degC: no value is given."
        )
        names = ["scale_factor_error"]
        flags.append(not_identifiable(gap_text, names, fit.axis, temperature_degC=asked))
    lag = fit.lag_one_correlation
    if lag is not None and lag > stiffness(settings, fit.sets):
        follows = f"a polynomial of order {fit.curve.order} does not follow the curve"
        flags.append(too_stiff(lag, f" of axis {fit.axis} by temperature", follows, fit.axis))
    return flags


def drive_flags(
    driven: Driven | None, curves: Mapping[str, Curve], gyro_bias_deg_per_h: float | None
) -> list[Flag]:
    """Return the flags of the vehicle test."""
    if driven is None:
        return []
    flags = []
    if driven.compensated_error_deg is None:
        open_text = (
            "The drive does not end in the heading in which it began, and it has no reference "
            "heading: its heading error cannot be determined."
        )
        names = ["heading_error_uncompensated", "heading_error_compensated"]
        flags.append(not_identifiable(open_text, names))
    raw, better = driven.raw_error_deg, driven.compensated_error_deg
    if raw is not None and better is not None and gyro_bias_deg_per_h is not None:
        by_bias = (driven.duration_h - driven.by_bias_deg) * gyro_bias_deg_per_h
        u = float(np.linalg.norm((driven.noise_u_deg, driven.model_u_deg, by_bias)))
        worse = abs(better) > abs(raw) + DRIVE_BEYOND * u
        if worse or abs(better) > DRIVE_BEYOND * u + LARGE_DEG:
            denied_text = (
                f"The drive contradicts the curves: its heading ends {raw:.3g} deg off without and "
                f"{better:.3g} deg off with compensation, of which {u:.2g} deg are explained. "
                "Check the sense of the turns (`turn_sense`), and latitude, signs and units of the "
                "drive."
            )
            flags.append(contradiction("drive", denied_text, explained_deg=u))
    if driven.outside > 0.0:
        outside_text = (
            f"In {100.0 * driven.outside:.0f} % of the drive the gyro was outside the calibrated "
            "range; there the compensation holds the value at the end of the range."
        )
        flags.append(Flag("extrapolation", outside_text, None, {"share": driven.outside}))
    if "z" not in curves:
        without_text = (
            "There is no curve of the z axis, which senses a vehicle's heading: the drive was "
            "compensated without it."
        )
        flags.append(not_identifiable(without_text, ["heading_error_compensated"]))
    return flags


def stated_turn_ppm(dataset: FogDataset, turns: AxisTurns) -> float | None:
    """Return the noise of a turn that the papers of the instruments state, None without any.

    Random walk over the turn, the table's accuracy, and two readings of the heading.
    """
    walk = dataset.angle_random_walk_deg_per_sqrt_h
    if walk is None:
        return None
    turn_h = float(np.median(turns.duration_s)) / SECONDS_PER_HOUR
    table = (dataset.turntable_accuracy_arcsec or 0.0) / SECONDS_PER_HOUR
    square = walk**2 * turn_h + table**2 + dataset.heading_resolution_deg**2 / 6.0
    return float(np.sqrt(square)) / FULL_TURN_DEG * PPM


def axis_flags(fit: AxisFit, dataset: FogDataset) -> list[Flag]:
    """Return the flags of turns that were not what the column of the commanded angle says."""
    turns = fit.turns
    sensing = turns.usable & turns.sensing
    if fit.curve is None or not bool(sensing.any()):
        return []
    flags = []
    size = float(np.median(np.abs(turns.data_ppm[sensing])))
    if size > LARGEST_PPM:
        large_text = (
            f"Half of the turns about {turns.axis} are more than {size / PPM * FULL_TURN_DEG:.1f} "
            "deg from the commanded angle: no error of a gyro's scale factor. The angle was "
            "another one, or the heading is not that of the turned body."
        )
        flags.append(contradiction("commanded_deg", large_text, turns.axis))
    speed = np.abs(turns.commanded_deg) / turns.duration_s
    own_speeds = [float(np.median(speed[sensing & rows])) for rows in _commands(turns, sensing)]
    if max(own_speeds) > SPEEDS * min(own_speeds):
        fast_text = (
            f"By their times the turns about {turns.axis} of one command are "
            f"{max(own_speeds) / min(own_speeds):.2g} times as fast as those of another: a "
            "commanded angle was another one. Correct the column `commanded_deg`."
        )
        flags.append(contradiction("commanded_deg", fast_text, turns.axis))
    left = turns.data_ppm - turns.turns * fit.curve.error_ppm(turns.temperature_degC)
    apart = []
    for number in turns.sets():
        own = np.flatnonzero(sensing & (turns.set_number == number))
        same = np.abs(turns.commanded_deg[own] - turns.commanded_deg[own[:1]]) < 1.0
        soon = turns.middle_s[own] - turns.middle_s[own[:1]] < turns.set_interval_s
        apart += [float(left[own[0]] - left[n]) for n in own[same & soon][1:2]]
    differences = np.array(apart)
    power = float(differences @ differences)
    if (
        len(differences) >= FEWEST_SETS
        and float(np.sum(np.diff(differences) ** 2)) < SMOOTH * power
    ):
        sign_text = (
            f"Turns about {turns.axis} of the same command in the same set differ by "
            f"{np.sqrt(power / len(differences)):.3g} ppm, set after set alike: one of them was "
            "another turn than its command says, in the other sense, or a wait."
        )
        flags.append(contradiction("commanded_deg", sign_text, turns.axis))
    spec, bias = dataset.gyro_bias_deg_per_h, fit.bias_deg_per_h
    if (
        fit.paired
        and spec
        and bias is not None
        and abs(bias) > max(BIASES * spec, MIN_BIAS_DEG_PER_H)
    ):
        bias_text = (
            f"The bias in the turns about {turns.axis} is {bias:.3g} deg/h, the stated one "
            f"{spec:g} deg/h: a rate of the earth that was not taken off, a commanded angle that "
            "was another one, or another gyro."
        )
        flags.append(contradiction("gyro_bias", bias_text, turns.axis, bias_deg_per_h=bias))
    return flags


def _commands(turns: AxisTurns, sensing: Mask) -> list[Mask]:
    """Return the rows of each commanded angle, those within a degree taken as one."""
    whole = np.rint(turns.commanded_deg)
    return [whole == command for command in np.unique(whole[sensing])]


def _usual_ppm(fit: AxisFit) -> float:
    """Return the noise of a turn by what most turns leave: a few wild ones make none."""
    left = np.abs(fit.residual_ppm[fit.kept & np.isfinite(fit.residual_ppm)])
    return float(np.quantile(left, MOST)) / MAX_SIGMA if len(left) else 0.0


def check_flags(fit: AxisFit, stated_ppm: float | None, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags of a curve that its own turns contradict, and of noise beyond the stated."""
    flags = []
    misfit = fit.misfit
    if misfit is not None and misfit.sure:
        shape = f"a feature some {2.4 * misfit.width_degC:.1f} degC wide"
        if misfit.kink:
            shape = f"a kink of {misfit.slope_ppm_per_degC:+.2g} ppm/degC"
        misfit_text = (
            f"The turns about {fit.axis} show {shape} at {misfit.at_degC:.1f} degC, which the "
            f"polynomial does not follow; it is up to {misfit.size_ppm:.2g} ppm off there, and its "
            "uncertainty holds that."
        )
        details = {
            "at_degC": misfit.at_degC,
            "size_ppm": misfit.size_ppm,
            "shape": "kink" if misfit.kink else "feature",
        }
        flags.append(Flag("misfit", misfit_text, fit.axis, details))
    noise = fit.noise_ppm
    most_ppm = settings.noise_beyond_statement * (stated_ppm or np.inf)
    if noise is not None and noise > most_ppm and _usual_ppm(fit) > PLAINLY * most_ppm:
        few = fit.sets <= FEW_SETS
        look = "look for what disturbs the turns, or state what is true"
        if few:
            look = (
                f"look for what disturbs the turns, measure more sets ({fit.sets} show no curve of "
                "high order), or state what is true"
            )
        noise_text = (
            f"The noise of a turn about {fit.axis} is {noise:.3g} ppm; random walk, table and "
            f"heading as stated make {stated_ppm:.2g} ppm. The uncertainty follows the data; "
            f"{look}."
        )
        noisy = {"noise_ppm": noise, "stated_ppm": stated_ppm}
        flags.append(contradiction("angle_random_walk", noise_text, fit.axis, **noisy))
    return flags
