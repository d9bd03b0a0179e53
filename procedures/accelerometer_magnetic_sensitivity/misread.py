"""Columns that mean something else than they say.

Another unit of the angle, another plane, a sign that changes: each mix-up that laboratories make is
tried where the rows do not follow the model at all. One that leaves a small part of what the stated
one leaves is named, and nothing is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.findings import Flag

from .dataset import Rows
from .lost_signs import with_signs
from .model import PLANES, model_columns
from .nuisances import KO, KP, OFFSET
from .solved import Solution

Array = NDArray[np.float64]
Reading = tuple[float, str, dict[str, object]]
"""What a reading of the columns leaves, in V; what it says; its details."""
UNITS_DEG = {"rad": 180.0 / np.pi, "gon": 0.9, "turns": 360.0, "arcmin": 1 / 60, "arcsec": 1 / 3600}
POOR_PART = 1e-3
"""Noise of this part of the output's range is none of a voltmeter or an accelerometer."""
HOPELESS = 20.0
"""Times as much noise as that, and the model explains nothing; below, the device may be noisy."""
POOR_V = 1e-3
"""The same where no input acceleration spreads the output."""
MANY_STRAYS = 0.2
BETTER = 0.1
"""A reading of the columns that leaves so small a part of the rms is the right one."""
TILTED = 0.1
"""Of Ki: no accelerometer is mounted 6 deg off."""
TILTED_V_PER_G = 0.05
"""The same where Ki is not measured; the usual scale factor is 0.1 V/g and more."""
LARGE_OFFSET_DEG = 3.0
SIGNED = {"theta_deg": "theta_rad", "field_T": "field_T", "output_V": "output_V"}
"""Columns, by their name in the file, whose sign may change in the course of the rows."""
PLACES = 9


def misread_flags(rows: Rows, solution: Solution) -> tuple[list[Flag], bool]:
    """Return the flags of columns that do not mean what they say, and whether that is certain.

    Where it is, no coefficient can be reported.
    """
    values = dict(zip(solution.names, solution.coefficients, strict=True))
    poor_V = POOR_PART * float(np.std(rows.output_V)) if "Ki" in values else POOR_V
    noise_V = float(np.sqrt(np.mean(solution.residual_V**2)))
    strays = float(np.mean(~solution.kept))
    offset_deg = values.get(OFFSET, 0.0) / 3600.0
    poor = max(noise_V, solution.noise_V) > poor_V or strays > MANY_STRAYS
    explained = (solution.misfit, solution.cause, solution.jump) != (None, None, None)
    if poor or explained or abs(offset_deg) > LARGE_OFFSET_DEG:
        stated_V = _left(rows)
        tried = [(_left(other), how, details) for other, how, details in _readings(rows)]
        tried += [*_late(rows), *_from_a_row_on(rows)]
        best_V, how, details = min(tried, key=lambda attempt: attempt[0])
        if best_V < BETTER * stated_V:
            if "statement" in details:
                unit_text = (
                    f"The column {details['statement']} {how}; nothing is reported. Correct it."
                )
                return [Flag("contradicts-statement", unit_text, details=details)], True
            plane_text = (
                f"The output fits where {how}, and not as stated; nothing is reported. Look at "
                "the mounting and at the columns plane and theta_deg."
            )
            return [Flag("wrong-position", plane_text, details=details)], True
    tilted = max(abs(values.get(name, 0.0)) for name in (KO, KP))
    if tilted > (TILTED * abs(values["Ki"]) if "Ki" in values else TILTED_V_PER_G):
        tilt_text = (
            f"The output has {tilted:.3g} V/g across the input axis: no mounting is so far off. "
            "Another plane or another zero of the angle was recorded; nothing is reported. Look "
            "at the mounting and at the columns plane and theta_deg."
        )
        details = {"misalignment_V_per_g": tilted}
        return [Flag("wrong-position", tilt_text, details=details)], True
    if abs(offset_deg) > LARGE_OFFSET_DEG:
        zero_text = (
            f"The zero of the encoder is {offset_deg:.4g} deg off, which the solution corrects: "
            "look whether the accelerometer is mounted as stated."
        )
        return [Flag("wrong-position", zero_text, details={"offset_deg": offset_deg})], False
    if solution.noise_V > HOPELESS * poor_V or strays > MANY_STRAYS:
        astray_text = (
            f"The output does not follow angle and field: {100.0 * strays:.2g} % of the rows are "
            f"left out, and the others miss the model by {1e6 * solution.noise_V:.3g} µV. No one "
            "cause explains that. Look at the columns, their units and their order."
        )
        return [Flag("misfit", astray_text, details={"what": "rows", "part": strays})], False
    return [], False


def _readings(rows: Rows) -> Iterator[tuple[Rows, str, dict[str, object]]]:
    """Yield other readings of the rows, each with what it says and its details."""
    for unit, factor in UNITS_DEG.items():
        details: dict[str, object] = {"statement": "theta_deg", "unit": unit}
        yield replace(rows, theta_rad=factor * rows.theta_rad), f"is in {unit}", details
    output_V, late = rows.output_V, "stands one row late"
    details = {"statement": "output_V"}
    yield replace(rows, output_V=np.append(output_V[1:], output_V[-1])), late, details
    early = "stands one row early"
    yield replace(rows, output_V=np.append(output_V[0], output_V[:-1])), early, details
    signed = with_signs(rows)
    if signed is not None:
        lost = "holds the size of the field without its sign, and so does field_commanded_T"
        yield signed, lost, {"statement": "field_T"}
    names = [str(name) for name in np.unique(rows.plane)]
    for name in names:
        there = rows.plane == name
        details = {"plane": name}
        if len(names) > 1:
            other = np.where(there, -rows.theta_rad, rows.theta_rad)
            how = f"plane {name} turns in the other sense"
            yield replace(rows, theta_rad=other), how, details
            other = np.where(there, -rows.field_T, rows.field_T)
            how = f"has the other sign in plane {name}"
            yield replace(rows, field_T=other), how, {"statement": "field_T", "plane": name}
            for deg in (90, 180, 270):
                other = rows.theta_rad + np.radians(deg) * there
                how = f"plane {name} is turned by {deg} deg"
                yield replace(rows, theta_rad=other), how, details
        for new in PLANES:
            if new != name:
                other_plane = np.where(there, new, rows.plane)
                yield replace(rows, plane=other_plane), f"plane {name} is {new}", details
            if new in names and new > name:
                other_plane = np.where(rows.plane == new, name, np.where(there, new, rows.plane))
                how = f"the planes {name} and {new} are exchanged"
                yield replace(rows, plane=other_plane), how, details


def _late(rows: Rows) -> Iterator[Reading]:
    """Yield how an output that holds a large part of the row before would fit."""
    columns = _columns(rows)
    before = np.vstack((columns[:1], columns[:-1]))
    for part in np.linspace(0.1, 0.9, 9):
        left_V = _left_by((1.0 - part) * columns + part * before, rows.output_V)
        how = f"holds about {100.0 * part:.0f} % of the row before"
        yield left_V, how, {"statement": "output_V", "part": float(part)}


def _from_a_row_on(rows: Rows) -> Iterator[Reading]:
    """Yield how columns of the other sign from some row on would fit, the row looked for."""
    count = len(rows.time_s)
    for statement, name in SIGNED.items():
        turned = replace(rows, **{name: -getattr(rows, name)})
        first, last = 1, count - 1
        tried: dict[int, float] = {}
        while last > first:
            places = np.unique(np.linspace(first, last, PLACES).round().astype(int))
            for row in places:
                if row not in tried:
                    after = np.arange(count) >= row
                    mixed = np.where(after, getattr(turned, name), getattr(rows, name))
                    tried[int(row)] = _left(replace(rows, **{name: mixed}))
            place = int(np.argmin([tried[int(row)] for row in places]))
            step = (int(places[max(place - 1, 0)]), int(places[min(place + 1, len(places) - 1)]))
            if step == (first, last):
                break
            first, last = step
        best = min(tried, key=lambda row: tried[row])
        how = f"has the other sign from row {best} of the usable rows on, counted from 0"
        yield tried[best], how, {"statement": statement, "row": best}


def _left(rows: Rows) -> float:
    """Return the rms, in V, that model and misalignment leave of a reading of the rows."""
    return _left_by(_columns(rows), rows.output_V)


def _columns(rows: Rows) -> Array:
    """Return the columns of model, misalignment and the encoder's zero, (rows, 16)."""
    acceleration_g = rows.accelerations()
    return np.column_stack(
        (model_columns(acceleration_g, rows.field_T), acceleration_g[:, 1:], rows.slope)
    )


def _left_by(columns: Array, output_V: Array) -> float:
    """Return the rms, in V, that columns (rows, k) leave of an output (rows,)."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0.0, size, 1.0)
    solved = np.linalg.lstsq(columns, output_V, rcond=1e-9)[0]
    left_V = output_V - np.einsum("ij,j->i", columns, solved)
    return float(np.sqrt(np.mean(left_V**2)))
