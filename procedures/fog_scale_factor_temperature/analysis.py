"""From turns to scale-factor curves: the whole analysis of a gyro over temperature.

Source: fog-scale-factor-temperature document, steps 3 and 4. NumPy and SciPy only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .axis_turns import AxisTurns
from .checks import axis_flags, check_flags, coarse, stated_turn_ppm, two_ways
from .dataset import AXES, Array, FogDataset, Mask, TurnTable
from .driving import evaluate_drive
from .findings import AnalysisSettings, AxisFit, FogAnalysis, PublishedFit, Verified
from .flags import data_flags, drive_flags, fit_flags, verification_flags
from .published import published_fit
from .solution import fit_axis
from .table_checks import heading_resolution_deg, table_flags, unit_of_headings, upright
from .turning import FULL_TURN_DEG, PPM, turn_errors_deg
from .verification import verify_axis

NEIGHBOURS = 9
WILD_DEVIATIONS = 8.0
WILD_TEMPERATURE_DEGC = 5.0
NOT_REJECTED_RESOLUTIONS = 0.6
"""Of one reading of the heading: the robust deviation of coarse data may be nothing."""


def analyse(dataset: FogDataset, settings: AnalysisSettings | None = None) -> FogAnalysis:
    """Return curves, the published ones, verification, vehicle test and flags."""
    settings = settings or AnalysisSettings()
    step_deg = max(dataset.heading_resolution_deg, heading_resolution_deg(dataset.turns))
    floor_ppm = NOT_REJECTED_RESOLUTIONS * step_deg / FULL_TURN_DEG * PPM
    flags = table_flags(dataset)
    tables = axis_tables(dataset, dataset.turns)
    fits: dict[str, AxisFit] = {}
    published: dict[str, PublishedFit] = {}
    for axis, turns in tables.items():
        bias = dataset.gyro_bias_deg_per_h or 0.0
        fits[axis], found = coarse(fit_axis(turns, settings, floor_ppm, bias), dataset.turns)
        fits[axis], further = two_ways(fits[axis], turns)
        flags += found + further
        published[axis] = published_fit(turns, dataset.initial_order)
    verified: dict[str, Verified] = {}
    if dataset.verification is not None:
        for axis, turns in axis_tables(dataset, dataset.verification).items():
            bias = dataset.gyro_bias_deg_per_h or 0.0
            proof = verify_axis(turns, fits[axis], bias) if axis in fits else None
            if proof is not None:
                verified[axis] = proof
                fits[axis] = _held_against(fits[axis], proof)
    curves = {axis: fit.curve for axis, fit in fits.items() if fit.curve is not None}
    driven = evaluate_drive(dataset.drive, curves) if dataset.drive and curves else None
    for axis, fit in fits.items():
        flags += data_flags(tables[axis], fit, settings)
        flags += fit_flags(fit, dataset, settings)
        flags += check_flags(fit, stated_turn_ppm(dataset, tables[axis]), settings)
        flags += axis_flags(tables[axis], fit, dataset)
        flags += verification_flags(verified.get(axis))
    flags += drive_flags(driven, curves, dataset.gyro_bias_deg_per_h)
    return FogAnalysis(fits, published, verified, driven, tuple(flags))


def _held_against(fit: AxisFit, verified: Verified) -> AxisFit:
    """Return the curve of an axis with what its verification does not find in it as uncertainty."""
    if fit.curve is None or verified.beyond_ppm == 0.0:
        return fit
    return replace(fit, curve=fit.curve.checked(verified.beyond_ppm))


def axis_tables(dataset: FogDataset, table: TurnTable) -> dict[str, AxisTurns]:
    """Return the turns of each axis that occurs, in the order x, y, z."""
    error_deg = turn_errors_deg(table, dataset.turn_sense, dataset.full_attitude)
    usable = np.isfinite(error_deg) & (table.duration_s > 0.0) & believable_temperatures(table)
    usable &= upright(table, dataset.full_attitude)
    usable &= unit_of_headings(table, dataset.full_attitude) is None
    found = {}
    for axis in AXES:
        own = table.axis == axis
        if bool(own.any()):
            found[axis] = AxisTurns(
                axis,
                np.flatnonzero(own),
                table.set_number[own],
                table.middle_s[own],
                table.duration_s[own],
                table.commanded_deg[own],
                error_deg[own],
                table.temperature_degC[own],
                usable[own],
            )
    return found


def believable_temperatures(table: TurnTable) -> Mask:
    """Return which rows' temperatures can be, (rows,): a wild one would bend all columns.

    Held against the median of the rows around, and before against after.
    """
    heat = table.temperature_degC
    there = np.isfinite(heat)
    if int(there.sum()) < NEIGHBOURS:
        return there
    off = _off_neighbours(heat[there])
    jump = np.abs(table.temperature_after_degC - table.temperature_before_degC)[there]
    good = (off <= _reach(off)) & (jump <= _reach(jump))
    believable = there.copy()
    believable[there] = good
    return believable


def _off_neighbours(values: Array) -> Array:
    padded = np.pad(values, NEIGHBOURS // 2, mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS)
    return np.abs(values - np.median(windows, axis=1))


def _reach(deviations: Array) -> float:
    usual = 1.4826 * float(np.median(deviations))
    return max(WILD_TEMPERATURE_DEGC, WILD_DEVIATIONS * usual)
