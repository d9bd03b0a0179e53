"""From turns to scale-factor curves: the whole analysis of a gyro over temperature.

Source: fog-scale-factor-temperature document, steps 3 and 4. NumPy and SciPy only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from procedures.common.constants import FULL_TURN_DEG
from procedures.estimation.channel import smallest_step
from station.findings import Flag

from .checks import (
    believable_temperatures,
    copied_turns,
    heading_resolution_deg,
    table_flags,
    units_of_headings,
    upright,
)
from .curve import CHECKED, Curve, published_curve
from .dataset import AXES, PPM, AxisTurns, FogDataset, TurnTable, turn_errors_deg
from .flags import axis_flags, check_flags, data_flags, drive_flags, fit_flags, stated_turn_ppm
from .navigation import Navigated
from .navigation_checks import navigated
from .parameters import AnalysisSettings
from .solution import AxisFit, fit_axis
from .two_ways import two_ways
from .verification import Driven, Verified, evaluate_drive, verification_flags, verify_axis

NOT_REJECTED_RESOLUTIONS = 0.6
"""Of one reading of the heading: the robust deviation of coarse data may be nothing."""
UNIFORM = 12.0**-0.5
COARSE_DEGC = 0.5
SAME_PLACES = 0.25
"""Of the turns: with fewer different headings at their beginnings, errors of rounding repeat."""


@dataclass(frozen=True)
class FogAnalysis:
    """The whole outcome, axes in the order x, y, z as far as the turns concern them."""

    fits: Mapping[str, AxisFit]
    published: Mapping[str, Curve | None]
    verified: Mapping[str, Verified]
    driven: Driven | None
    navigated: Navigated | None
    flags: tuple[Flag, ...]


def analyse(dataset: FogDataset, settings: AnalysisSettings | None = None) -> FogAnalysis:
    """Return curves, the published ones, verification, vehicle test and flags."""
    settings = settings or AnalysisSettings()
    step_deg = max(dataset.heading_resolution_deg, heading_resolution_deg(dataset.turns))
    floor_ppm = NOT_REJECTED_RESOLUTIONS * step_deg / FULL_TURN_DEG * PPM
    flags = table_flags(dataset)
    tables = axis_tables(dataset, dataset.turns)
    fits: dict[str, AxisFit] = {}
    published: dict[str, Curve | None] = {}
    for axis, turns in tables.items():
        bias = dataset.gyro_bias_deg_per_h or 0.0
        fits[axis], coarse_flags = coarse(fit_axis(turns, settings, floor_ppm, bias), dataset.turns)
        fits[axis], further = two_ways(fits[axis])
        flags += coarse_flags + further
        published[axis] = published_curve(turns, dataset.initial_order)
    verified: dict[str, Verified] = {}
    if dataset.verification is not None:
        proof_turns = dataset.verification.of(~copied_turns(dataset.verification, dataset.turns))
        for axis, turns in axis_tables(dataset, proof_turns).items():
            bias = dataset.gyro_bias_deg_per_h or 0.0
            proof = verify_axis(turns, fits[axis], bias) if axis in fits else None
            if proof is not None:
                verified[axis] = proof
                fits[axis] = _held_against(fits[axis], proof)
    curves = {axis: fit.curve for axis, fit in fits.items() if fit.curve is not None}
    driven = evaluate_drive(dataset.drive, curves) if dataset.drive and curves else None
    for axis, fit in fits.items():
        flags += data_flags(fit, settings)
        flags += fit_flags(fit, dataset, settings)
        flags += check_flags(fit, stated_turn_ppm(dataset, tables[axis]), settings)
        flags += axis_flags(fit, dataset)
        flags += verification_flags(verified.get(axis))
    flags += drive_flags(driven, curves, dataset.gyro_bias_deg_per_h)
    journey, further = navigated(dataset.drive, curves)
    flags += further
    return FogAnalysis(fits, published, verified, driven, journey, tuple(flags))


def _held_against(fit: AxisFit, verified: Verified) -> AxisFit:
    """Return the curve of an axis with what its verification does not find in it as uncertainty."""
    if fit.curve is None or verified.beyond_ppm == 0.0:
        return fit
    return replace(fit, curve=fit.curve.checked(verified.beyond_ppm))


def coarse(fit: AxisFit, table: TurnTable) -> tuple[AxisFit, list[Flag]]:
    """Return an axis with the steps of its readings in its uncertainty, and the flag of them.

    Many readings make up for steps only where they fall anywhere between two of them: headings do
    not where the table begins each turn at the same, and a thermometer is always the same one.
    """
    if fit.curve is None or not fit.noise_ppm:
        return fit, []
    own = table.axis == fit.axis
    grid = fit.curve.temperatures_degC(CHECKED)
    steps = []
    step_deg = heading_resolution_deg(table)
    places = len(np.unique(table.attitude_before_deg[own, 0]))
    added = np.zeros(CHECKED)
    if step_deg and places < SAME_PLACES * int(own.sum()):
        added += step_deg * UNIFORM / FULL_TURN_DEG * PPM
        steps.append(f"headings of {step_deg:g} deg, each turn from the same heading")
    both = np.concatenate((table.temperature_before_degC[own], table.temperature_after_degC[own]))
    step_degC = smallest_step(both[np.isfinite(both)])
    if step_degC >= COARSE_DEGC:
        slope = np.abs(np.gradient(fit.curve.error_ppm(grid), grid))
        added = np.hypot(added, slope * step_degC * UNIFORM)
        steps.append(f"temperatures of {step_degC:g} degC")
    if float(added.max()) <= fit.noise_ppm * UNIFORM:
        return fit, []
    coarse_text = (
        f"The readings of {fit.axis} come in coarse steps: {'; '.join(steps)}. They are in the "
        f"uncertainty by up to {added.max():.2g} ppm; record more digits."
    )
    widened = replace(fit, curve=fit.curve.checked(added))
    return widened, [Flag("coarse-output", coarse_text, fit.axis, {"size_ppm": float(added.max())})]


def axis_tables(dataset: FogDataset, table: TurnTable) -> dict[str, AxisTurns]:
    """Return the turns of each axis that occurs, in the order x, y, z."""
    error_deg = turn_errors_deg(table, dataset.turn_sense, dataset.full_attitude)
    usable = np.isfinite(error_deg) & (table.duration_s > 0.0) & believable_temperatures(table)
    usable &= upright(table, dataset.full_attitude)
    usable &= ~np.isin(table.axis, list(units_of_headings(table, dataset.full_attitude)))
    by_axis = {}
    for axis in AXES:
        own = table.axis == axis
        if bool(own.any()):
            by_axis[axis] = AxisTurns(
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
    return by_axis
