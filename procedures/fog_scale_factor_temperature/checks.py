"""What the data deny: stated noises, the unit of the headings, a curve without a feature."""

from __future__ import annotations

import numpy as np

from station.findings import Flag

from .axis_turns import AxisTurns
from .dataset import FogDataset, TurnTable
from .findings import AnalysisSettings, AxisFit
from .turning import FULL_TURN_DEG, PPM, SECONDS_PER_HOUR

ONE_TURN_RAD = 2.0 * np.pi
ALMOST = 0.9
"""Of a circle: what headings that may be any cover, all but seldom, in some dozens of readings."""
FEWEST_HEADINGS = 20
ASIDE_RAD = 1.2
"""An axis that points up needs a pitch or roll beyond this; in degrees none is as small."""


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


def looks_like_radians(table: TurnTable, full_attitude: bool) -> bool:
    """Whether headings fill 0 to 2 pi, or -pi to pi, and go nowhere beyond: so do no degrees.

    With pitch and roll: whether those of axes that point up lie at pi/2.
    """
    angles = np.concatenate((table.attitude_before_deg, table.attitude_after_deg))
    headings = angles[:, 0][np.isfinite(angles[:, 0])]
    if len(headings) < FEWEST_HEADINGS or float(np.max(np.abs(headings))) > ONE_TURN_RAD + 1e-3:
        return False
    fills = float(np.ptp(headings)) > ALMOST * ONE_TURN_RAD
    if not full_attitude:
        return fills and float(np.ptp(headings)) <= ONE_TURN_RAD + 1e-3
    leaning = np.max(np.abs(table.attitude_before_deg[:, 1:]), axis=1)[table.axis != "z"]
    leaning = leaning[np.isfinite(leaning)]
    return len(leaning) > 0 and ASIDE_RAD < float(np.median(leaning)) < ONE_TURN_RAD


def unit_flags(dataset: FogDataset) -> list[Flag]:
    """Return the flag of attitudes that are not in degrees; nothing is told from them."""
    flags = []
    for name, table in (("turns", dataset.turns), ("verification", dataset.verification)):
        if table is not None and looks_like_radians(table, dataset.full_attitude):
            radians_said = (
                f"The headings of `{name}` look like radians: they fill one turn of 2π and no "
                "more. The columns are in degrees; nothing is told from them."
            )
            details = {"statement": "heading_deg", "file": name}
            flags.append(Flag("contradicts-statement", radians_said, None, details))
    return flags


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
        noise_said = (
            f"The noise of a turn about {fit.axis} is {noise:.3g} ppm; random walk, table and "
            f"heading as stated make {stated_ppm:.2g} ppm. The uncertainty follows the data; look "
            "for what disturbs the turns, or state what is true."
        )
        noisy = {"statement": "angle_random_walk", "noise_ppm": noise, "stated_ppm": stated_ppm}
        flags.append(Flag("contradicts-statement", noise_said, fit.axis, noisy))
    return flags
