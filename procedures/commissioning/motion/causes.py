"""The likely cause of what a table and the sensor on it show, named as far as the data decide.

Gyros and accelerometers are both asked: what both feel reversed is the table's, what the gyros
alone do is theirs. Gravity does not feel a turn about the vertical: the outer axis is judged with
the plate upright by a gyro that the other axes have proven.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Flag

from .limits import (
    AXIS_LEAN_DEG,
    COVERAGE,
    ENCODER_ZERO_DEG,
    FOLLOWS,
    OFF_SQUARE_DEG,
    RATE_RATIO,
    TURN_RATIO,
)

Array = NDArray[np.float64]
SENSOR = ("X", "Y", "Z")
LEVEL = {"middle": (1, -1.0), "inner": (0, 1.0)}
"""The sensor's axis, and its sense, along each axis of the table whose turns gravity feels."""
TILTED = {"middle": "X", "inner": "Y"}
"""The accelerometer that feels the tilt of a turn about each."""


@dataclass(frozen=True)
class Turned:
    """A turn over the encoder's angle: by gyro (3,), by gravity (3,); down at its beginning."""

    by_gyro: Array
    by_gravity: Array
    down: Array


@dataclass(frozen=True)
class Figure:
    """A figure with its combined standard uncertainty."""

    value: float
    u: float

    def is_off(self, nominal: float, limit: float) -> bool:
        """Whether it is off by more than a limit, whatever its uncertainty makes of it."""
        return abs(self.value - nominal) - COVERAGE * self.u > limit


Figures = Mapping[tuple[str, str], Figure]


def causes_of(turned: Mapping[str, Turned], upright: Turned, figures: Figures) -> list[Flag]:
    """Return a flag for each cause."""
    flags = list(_senses(turned, upright))
    if not flags:
        flags += _figures(figures, "turn_ratio")
    return [*flags, *_rates(figures), *_zeros(figures), *_leans(figures)]


def _senses(turned: Mapping[str, Turned], upright: Turned) -> Iterator[Flag]:
    if turned["outer"].down[2] > FOLLOWS:
        message = (
            "At the axes' zeros the sensor feels itself upside down: it is mounted so, the zero of "
            "the middle or inner axis is off by half a turn, or its accelerometer Z is reversed."
        )
        yield Flag("sensor-upside-down", message)
        return
    still = [axis for axis, turn in turned.items() if np.abs(turn.by_gyro).max() < FOLLOWS]
    felt = {axis: sense * float(turned[axis].by_gravity[k]) for axis, (k, sense) in LEVEL.items()}
    if still or any(abs(share) < FOLLOWS for share in felt.values()):
        yield _otherwise(still, felt)
        return
    senses = {axis: float(np.sign(value)) for axis, value in felt.items()}
    gyros = np.zeros((3, 3))
    """Columns: what the three gyros read of a turn about the sensor's X, Y, Z."""
    for axis, (k, sense) in LEVEL.items():
        gyros[:, k] = senses[axis] * sense * turned[axis].by_gyro
    proven = gyros[:, :2] @ upright.down[:2]
    agreement = float(upright.by_gyro @ proven)
    if abs(agreement) < FOLLOWS:
        yield _otherwise(["outer"], felt)
        return
    senses["outer"] = float(np.sign(agreement))
    gyros[:, 2] = -senses["outer"] * turned["outer"].by_gyro
    yield from _named(senses, gyros)


def _otherwise(still: list[str], felt: Mapping[str, float]) -> Flag:
    axes = still or [axis for axis, value in felt.items() if abs(value) < FOLLOWS]
    message = (
        f"Turns of the {' and '.join(axes)} axis are not felt where they should be: the sensor "
        "is mounted otherwise than asked, or the bench file numbers the table's axes otherwise "
        "(outer_axis, middle_axis, inner_axis)."
    )
    return Flag("table-axes-otherwise", message, details={"axes": axes})


def _named(senses: dict[str, float], gyros: Array) -> Iterator[Flag]:
    """Yield what is reversed and exchanged, `senses` by axis and `gyros` as they read."""
    reads = np.abs(gyros).argmax(axis=0)
    signs = np.sign(gyros[reads, range(3)])
    if senses["middle"] < 0.0 and senses["inner"] < 0.0 < senses["outer"] and (signs > 0.0).all():
        message = (
            "The middle and the inner axis turn against their sense, or the sensor stands turned "
            "by half a turn about Z: look how it is mounted."
        )
        yield Flag("sensor-turned", message)
        return
    for axis, (k, _) in LEVEL.items():
        if senses[axis] < 0.0 and signs[k] < 0.0:
            # Gyro and encoder agree, gravity does not: two reversed parts are less likely than one.
            senses[axis], signs[k] = 1.0, 1.0
            name = TILTED[axis]
            message = (
                f"Accelerometer {name} of the sensor reads the tilt of the {axis} axis reversed, "
                "its gyro does not: its channel is reversed."
            )
            yield Flag("accelerometer-reversed", message, name)
    for axis, sense in senses.items():
        if sense < 0.0:
            message = (
                f"The {axis} axis of the table turns against its sense: gyros and gravity both "
                "show it. Reverse it in its controller, or its motor and its encoder."
            )
            yield Flag("table-sense-reversed", message, axis)
    moved = [k for k in range(3) if reads[k] != k]
    if moved:
        where = ", ".join(f"{SENSOR[k]} on {SENSOR[reads[k]]}" for k in moved)
        message = (
            f"Gyro channels of the sensor are swapped (turns about {where}), its accelerometers "
            "are not: look at its cable, or its configuration of axes."
        )
        yield Flag("gyro-channels-swapped", message)
    for k in range(3):
        if signs[k] < 0.0:
            name = SENSOR[reads[k]]
            message = f"Gyro {name} of the sensor reads turns reversed: its channel is reversed."
            yield Flag("gyro-channel-reversed", message, name)


def _figures(figures: Figures, name: str) -> Iterator[Flag]:
    for (what, axis), figure in figures.items():
        if what == name and figure.is_off(1.0, TURN_RATIO):
            off_by = 100.0 * (figure.value - 1.0)
            message = (
                f"Turns of the {axis} axis are {off_by:+.2g} % by the sensor's gyro against the "
                "encoder: its counts per turn, or the gyro's scale factor."
            )
            yield Flag("turn-not-whole", message, axis)


def _rates(figures: Figures) -> Iterator[Flag]:
    for (what, axis), figure in figures.items():
        if what == "rate_ratio" and figure.is_off(1.0, RATE_RATIO):
            off_by = 100.0 * (figure.value - 1.0)
            message = (
                f"The rate of the {axis} axis reads back {off_by:+.2g} % off its set-point: look "
                "at its controller's units and scale."
            )
            yield Flag("table-rate-off", message, axis)


def _zeros(figures: Figures) -> Iterator[Flag]:
    for (what, axis), figure in figures.items():
        if what == "encoder_zero" and figure.is_off(0.0, ENCODER_ZERO_DEG):
            message = (
                f"At zero of the {axis} axis' encoder the plate is {figure.value:+.2g} deg off the "
                "level: set the encoder's zero anew."
            )
            yield Flag("table-zero-off", message, axis)


def _leans(figures: Figures) -> Iterator[Flag]:
    out_of = {
        "outer": "the vertical: level the table",
        "middle": "the level: the yoke is out of true",
        "inner": "its plate: the plate is out of true",
    }
    for (what, axis), figure in figures.items():
        if what == "axis_lean" and figure.is_off(0.0, AXIS_LEAN_DEG):
            message = (
                f"The {axis} axis of the table leans by {figure.value:.2g} deg out of "
                f"{out_of[axis]}."
            )
            yield Flag("table-axis-leans", message, axis)
    square = figures.get(("axes_off_square", ""))
    if square is not None and square.is_off(0.0, OFF_SQUARE_DEG):
        message = (
            f"Middle and inner axis of the table are {square.value:+.2g} deg off square: one of "
            "them leans within the plate's plane, or the gyros of the sensor are askew."
        )
        yield Flag("table-axes-not-square", message)
