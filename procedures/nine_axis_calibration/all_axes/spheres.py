"""The spheres that accelerometers and magnetometer should read, before and after calibration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from procedures.nine_axis_calibration.dataset import AXES
from station.plots import BLUE, GREY, INK, Axis, Line, Panel, Plot, Points, Rule

from .inertial import Inertial
from .magnetic import Magnetic
from .results import OtherResults
from .stands import Array, OtherAxes

PLANES = ((0, 1), (1, 2), (0, 2))
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 181)


def spheres(others: OtherResults) -> Iterator[Plot]:
    """Yield for each sensor that is calibrated its output as it came, and calibrated."""
    if others.inertial is not None:
        read, corrected = forces(others.inertial)
        size = others.recorded.gravity_g
        if len(read):
            yield _sphere("Accelerometers", "g", 1e3, "mg", read, corrected, size)
    if others.magnetic is not None and others.magnetic.whole:
        read, corrected = fields(others.recorded, others.magnetic)
        size = others.magnetic.field_nT
        if len(read):
            yield _sphere("Magnetometer", "nT", 1.0, "nT", read, corrected, size)


def forces(inertial: Inertial) -> tuple[Array, Array]:
    """Return the mean force of each stand and turn (n, 3) in g, as read and as corrected.

    Of turns, what they read at no rate: the lever arm is not the sensor's.
    """
    read = np.array([orientation.force_g for orientation in inertial.orientations])
    read = read[np.isfinite(read).all(axis=1)]
    return read, inertial.force_in_base(read)


def fields(data: OtherAxes, magnetic: Magnetic) -> tuple[Array, Array]:
    """Return samples (n, 3) of the field in nT, as read and as corrected.

    Those at rest and of each mounting's slowest turns: of fast ones a sample is a mean over a part
    of the turn, and lies within the sphere.
    """
    records = [rest.field_nT for rest in data.rests]
    for mounting in data.mountings:
        slowest = min(abs(record.turn.commanded_deg_per_s) for record in mounting.records)
        records += [
            record.field_nT
            for record in mounting.records
            if abs(record.turn.commanded_deg_per_s) == slowest
        ]
    read = np.vstack([record for record in records if record is not None])
    read = read[np.isfinite(read).all(axis=1)]
    return read, np.asarray(np.linalg.solve(magnetic.gain, (read - magnetic.offset_nT).T).T)


def _sphere(
    name: str, unit: str, factor: float, small: str, read: Array, corrected: Array, size: float
) -> Plot:
    """Return three views of the sphere, and how far the output is from it."""
    panels = []
    for column, (i, j) in enumerate(PLANES):
        before_label, after_label = ("before", "after") if column == 0 else ("", "")
        views = (
            Line(size * np.cos(CIRCLE), size * np.sin(CIRCLE), colour=INK, width=0.6),
            Points(read[:, i], read[:, j], colour=GREY, size=2, label=before_label),
            Points(corrected[:, i], corrected[:, j], colour=BLUE, size=2, label=after_label),
        )
        x, y = (Axis(f"{AXES[n]}, {unit}", most=3) for n in (i, j))
        panels.append(
            Panel(views, x=x, y=y, column=column, legend="above", legend_columns=2, equal=True)
        )
    number = np.arange(1.0, len(read) + 1.0)
    before, after = (
        factor * (np.linalg.norm(values, axis=1) - size) for values in (read, corrected)
    )
    off = (
        Points(number, before, colour=GREY, size=2),
        Points(number, after, colour=BLUE, size=2),
        Rule(y=0.0),
    )
    y = Axis(f"from the sphere, {small}", most=4)
    panels.append(Panel(off, x=Axis("in the order of recording"), y=y, row=1, columns=len(PLANES)))
    rms = [float(np.sqrt(np.mean(values**2))) for values in (before, after)]
    caption = (
        f"Output before and after calibration, seen along each axis; the circle is the sphere of "
        f"{size:.6g} {unit}. Below, how far each is from it: {rms[0]:.3g} {small} rms before, "
        f"{rms[1]:.3g} {small} after."
    )
    return Plot(f"{name} before and after", caption, tuple(panels), 5.0, gap_x=0.35, gap_y=0.35)
