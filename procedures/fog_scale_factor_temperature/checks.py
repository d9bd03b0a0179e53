"""What the turns deny: commanded angles, stated noises and biases, a curve without a feature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from station.findings import Flag

from .axis_problem import PUBLISHED_ORDER
from .axis_turns import AxisTurns
from .curve import CHECKED
from .dataset import FogDataset, Mask, TurnTable
from .findings import AnalysisSettings, AxisFit
from .table_checks import heading_resolution_deg, resolution_of
from .turning import FULL_TURN_DEG, PPM, SECONDS_PER_HOUR

LARGEST_PPM = 10_000.0
BIASES, LEAST_BIAS_DEG_PER_H = 10.0, 1.0
"""Gyro biases as specified, and a bias, beyond which the bias in the turns is another one."""
WAY_DEGC = 0.1
"""From set to set: the gyro warms, or cools."""
APART = 5.0
UNIFORM = 12.0**-0.5
COARSE_DEGC = 0.5
SAME_PLACES = 0.25
"""Of the turns: with fewer different headings at their beginnings, errors of rounding repeat."""
FEW_SETS = 3 * PUBLISHED_ORDER
"""With no more of them, what is called noise may be a curve of a higher order than they carry."""
SPEEDS = 1.6
"""Of turns of two commands, one over the other."""
SMOOTH, FEWEST_SETS = 0.3, 10
"""Of a difference within sets: the square of its steps over its own, 2 for noise."""


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


def axis_flags(turns: AxisTurns, fit: AxisFit, dataset: FogDataset) -> list[Flag]:
    """Return the flags of turns that were not what the column of the commanded angle says."""
    sensing = turns.usable & turns.sensing
    if fit.curve is None or not bool(sensing.any()):
        return []
    flags = []
    size = float(np.median(np.abs(turns.data_ppm[sensing])))
    if size > LARGEST_PPM:
        large_said = (
            f"Half of the turns about {turns.axis} are more than {size / PPM * FULL_TURN_DEG:.1f} "
            "deg from the commanded angle: no error of a gyro's scale factor. The angle was "
            "another one, or the heading is not that of the turned body."
        )
        flags.append(
            Flag("contradicts-statement", large_said, turns.axis, {"statement": "commanded_deg"})
        )
    speed = np.abs(turns.commanded_deg) / turns.duration_s
    own_speeds = [float(np.median(speed[sensing & rows])) for rows in _commands(turns, sensing)]
    if max(own_speeds) > SPEEDS * min(own_speeds):
        fast_said = (
            f"By their times the turns about {turns.axis} of one command are "
            f"{max(own_speeds) / min(own_speeds):.2g} times as fast as those of another: a "
            "commanded angle was another one. Correct the column `commanded_deg`."
        )
        flags.append(
            Flag("contradicts-statement", fast_said, turns.axis, {"statement": "commanded_deg"})
        )
    left = turns.data_ppm - turns.turns * fit.curve.error_ppm(turns.temperature_degC)
    apart = []
    for number in turns.sets():
        own = np.flatnonzero(sensing & (turns.set_number == number))
        same = np.abs(turns.commanded_deg[own] - turns.commanded_deg[own[:1]]) < 1.0
        soon = turns.middle_s[own] - turns.middle_s[own[:1]] < turns.set_interval_s
        apart += [float(left[own[0]] - left[n]) for n in own[same & soon][1:2]]
    course = np.array(apart)
    power = float(course @ course)
    if len(course) >= FEWEST_SETS and float(np.sum(np.diff(course) ** 2)) < SMOOTH * power:
        sign_said = (
            f"Turns about {turns.axis} of the same command in the same set differ by "
            f"{np.sqrt(power / len(course)):.3g} ppm, set after set alike: one of them was another "
            "turn than its command says, in the other sense, or a wait."
        )
        flags.append(
            Flag("contradicts-statement", sign_said, turns.axis, {"statement": "commanded_deg"})
        )
    spec, bias = dataset.gyro_bias_deg_per_h, fit.bias_deg_per_h
    if (
        fit.paired
        and spec
        and bias is not None
        and abs(bias) > max(BIASES * spec, LEAST_BIAS_DEG_PER_H)
    ):
        bias_said = (
            f"The bias in the turns about {turns.axis} is {bias:.3g} deg/h, the stated one "
            f"{spec:g} deg/h: a rate of the earth that was not taken off, a commanded angle that "
            "was another one, or another gyro."
        )
        flags.append(
            Flag(
                "contradicts-statement",
                bias_said,
                turns.axis,
                {"statement": "gyro_bias", "bias_deg_per_h": bias},
            )
        )
    return flags


def _commands(turns: AxisTurns, sensing: Mask) -> list[Mask]:
    """Return the rows of each commanded angle, those within a degree taken as one."""
    whole = np.rint(turns.commanded_deg)
    return [whole == one for one in np.unique(whole[sensing])]


def coarse(fit: AxisFit, table: TurnTable) -> tuple[AxisFit, list[Flag]]:
    """Return an axis with the steps of its readings in its uncertainty, and the flag of them.

    Many readings make up for steps only where they fall anywhere between two of them: headings do
    not where the table begins each turn at the same, and a thermometer is always the same one.
    """
    if fit.curve is None or not fit.noise_ppm:
        return fit, []
    own = table.axis == fit.axis
    grid = fit.curve.temperatures_degC(CHECKED)
    said = []
    step_deg = heading_resolution_deg(table)
    places = len(np.unique(table.attitude_before_deg[own, 0]))
    added = np.zeros(CHECKED)
    if step_deg and places < SAME_PLACES * int(own.sum()):
        added += step_deg * UNIFORM / FULL_TURN_DEG * PPM
        said.append(f"headings of {step_deg:g} deg, each turn from the same heading")
    both = np.concatenate((table.temperature_before_degC[own], table.temperature_after_degC[own]))
    step_degC = resolution_of(both)
    if step_degC >= COARSE_DEGC:
        slope = np.abs(np.gradient(fit.curve.error_ppm(grid), grid))
        added = np.hypot(added, slope * step_degC * UNIFORM)
        said.append(f"temperatures of {step_degC:g} degC")
    if float(added.max()) <= fit.noise_ppm * UNIFORM:
        return fit, []
    coarse_said = (
        f"The readings of {fit.axis} come in coarse steps: {'; '.join(said)}. They are in the "
        f"uncertainty by up to {added.max():.2g} ppm; record more digits."
    )
    found = replace(fit, curve=fit.curve.checked(added))
    return found, [Flag("coarse-output", coarse_said, fit.axis, {"size_ppm": float(added.max())})]


def two_ways(fit: AxisFit, turns: AxisTurns) -> tuple[AxisFit, list[Flag]]:
    """Return an axis with what its warming and cooling turns differ by in u, and the flag of it.

    A curve between the two branches of a loop leaves residuals of one sign on each.
    """
    kept = fit.kept & np.isfinite(fit.error_ppm)
    if fit.curve is None or int(kept.sum()) < 2 * FEWEST_SETS:
        return fit, []
    middle, place = np.unique(turns.set_number[kept], return_inverse=True)
    count = np.bincount(place)
    heat = np.bincount(place, turns.temperature_degC[kept]) / count
    left = np.bincount(place, fit.residual_ppm[kept]) / count
    slope = np.gradient(heat) if len(middle) > 1 else np.zeros(1)
    branches = [slope > WAY_DEGC, slope < -WAY_DEGC]
    if min(int(one.sum()) for one in branches) < FEWEST_SETS:
        return fit, []
    shared = max(heat[one].min() for one in branches), min(heat[one].max() for one in branches)
    inside = (heat >= shared[0]) & (heat <= shared[1])
    up, down = (left[one & inside] for one in branches)
    if min(len(up), len(down)) < FEWEST_SETS:
        return fit, []
    apart = float(up.mean() - down.mean())
    u = float(np.sqrt(up.var(ddof=1) / len(up) + down.var(ddof=1) / len(down)))
    if abs(apart) <= APART * u:
        return fit, []
    ways_said = (
        f"The turns about {fit.axis} while the gyro cools differ by {-apart:+.2g} ppm from those "
        "while it warms: hysteresis, or a thermometer that lags. The curve lies between them; half "
        "of it is in the uncertainty."
    )
    found = replace(fit, curve=fit.curve.checked(0.5 * abs(apart)))
    return found, [Flag("hysteresis", ways_said, fit.axis, {"size_ppm": abs(apart)})]


def check_flags(fit: AxisFit, stated_ppm: float | None, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags of a curve that its own turns contradict, and of noise beyond the stated."""
    flags = []
    found = fit.misfit
    if found is not None and found.sure:
        shape = f"a feature some {2.4 * found.width_degC:.1f} degC wide"
        if found.kink:
            shape = f"a kink of {found.slope_ppm_per_degC:+.2g} ppm/degC"
        misfit_said = (
            f"The turns about {fit.axis} show {shape} at {found.at_degC:.1f} degC, which the "
            f"polynomial does not follow; it is up to {found.size_ppm:.2g} ppm off there, and its "
            "uncertainty holds that."
        )
        details = {
            "at_degC": found.at_degC,
            "size_ppm": found.size_ppm,
            "shape": "kink" if found.kink else "feature",
        }
        flags.append(Flag("misfit", misfit_said, fit.axis, details))
    noise = fit.noise_ppm
    if stated_ppm and noise is not None and noise > settings.noise_beyond_statement * stated_ppm:
        few = fit.sets <= FEW_SETS
        more = f"measure more sets ({fit.sets} show no curve of high order), " if few else ""
        noise_said = (
            f"The noise of a turn about {fit.axis} is {noise:.3g} ppm; random walk, table and "
            f"heading as stated make {stated_ppm:.2g} ppm. The uncertainty follows the data; look "
            f"for what disturbs the turns, {more}or state what is true."
        )
        noisy = {"statement": "angle_random_walk", "noise_ppm": noise, "stated_ppm": stated_ppm}
        flags.append(Flag("contradicts-statement", noise_said, fit.axis, noisy))
    return flags
