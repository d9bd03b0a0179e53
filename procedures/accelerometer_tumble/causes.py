"""What else may have moved the output: alternatives to the model of a tumble test, as declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from procedures.estimation.alternatives import (
    SEARCHED,
    Alternative,
    Score,
    scores,
    strongest_line,
    strongest_step,
)

from .dataset import Mask, TumbleDataset
from .model import Array

FINER = 21
"""Periods of a line that are tried beside the best one: positions repeat, and a line beside their
period moves coefficients."""
HARMONICS = (3, 4, 5, 6)
"""The encoder's first and second have priors of their own."""
SHAPE = (
    "The output has a shape that the model does not have, {what} (up to {size:.2g} V); one term "
    "for it is solved for, and what it leaves is not known. Look at the ranges of the multimeter "
    "and at the encoder."
)
DRIFT = (
    "{what} drifts in the course of the readings, by up to {size:.2g} V of the output; a term of "
    "zero mean is solved for. Warm up for longer, and look at the thermometer's place."
)
STEP = (
    "{what} steps by {first:.3g} {unit}; the step is solved for, and the result is the mean of "
    "both sides. Look at the mounting, the supply and the range of the multimeter."
)
LAG = (
    "Each output holds {first:.2g} of the one before it: it was read before it had settled. Wait "
    "longer in each position."
)
TURNING = (
    "The output differs by {size:.2g} V with the sense in which the stage came to the position; "
    "the mean of both is reported. Look for backlash of the stage and for what hangs on the cables."
)
ANGLES = (
    "The encoder is off by up to {size:.2g} V of the output: {what}. The term is solved for. Look "
    "at the encoder and at the seat of the fixture."
)
PERIODIC = (
    "The output has a line with a period of {what} (up to {size:.2g} V), which is solved for. Look "
    "for mains pick-up and for what switches in the room."
)


def alternatives_of(dataset: TumbleDataset, scale: float) -> list[Alternative]:
    """Return what may have moved the output, for a scale factor in V/g; columns (n, m)."""
    theta = dataset.theta_rad
    i, c = dataset.gravity_g * np.sin(theta), dataset.gravity_g * np.cos(theta)
    time = dataset.time_s - dataset.time_s.mean()
    time = time / (float(np.max(np.abs(time))) or 1.0)
    square = time**2 - np.mean(time**2)
    output, encoder = dataset.output_V, np.unwrap(dataset.encoder_rad)
    last = np.concatenate(([0], np.arange(len(output) - 1)))
    before = np.column_stack((output[last] - output, output[last[last]] - output[last]))
    sense = np.sign(encoder - encoder[last])
    slope = scale * c
    shapes: list[tuple[str, str, str, Array, str, int]] = [
        ("drift-removed", "Ki", "V/g", time * i, DRIFT, 1),
        ("drift-removed", "Ki", "V/g", np.column_stack((time * i, square * i)), DRIFT, 1),
        ("not-settled", "output", "1", output[last] - output, LAG, 1),
        ("not-settled", "two outputs", "1", before, LAG, 1),
        ("hysteresis", "sense of rotation", "V", sense - sense.mean(), TURNING, 1),
        ("hysteresis", "backlash of the encoder", "rad", slope * sense, ANGLES, 1),
        ("misfit", "another scale factor below zero", "V/g", np.abs(i), SHAPE, 1),
        ("misfit", "the fourth power of the acceleration", "V/g^4", i**4, SHAPE, 1),
        ("misfit", "the fifth power of the acceleration", "V/g^5", i**5, SHAPE, 1),
        ("misfit", "the square along IA times the acceleration across", "V", i**2 * c, SHAPE, 1),
        ("misfit", "it drifts", "rad", slope * time, ANGLES, 1),
        ("misfit", "its scale", "rad", slope * encoder, ANGLES, 1),
    ]
    for n in HARMONICS:
        waves = np.column_stack([wave(n * dataset.encoder_rad) for wave in (np.cos, np.sin)])
        shapes.append(("misfit", f"harmonic {n}", "rad", slope[:, None] * waves, ANGLES, 1))
    for number in range(1, int(dataset.mounting[-1])):
        there = (dataset.mounting == number) - float(np.mean(dataset.mounting == number))
        what = f"K0 in mounting {number + 1}"
        shapes.append(("output-step", what, "V", there, STEP, SEARCHED))
    return [
        Alternative(code, what, unit, columns.reshape(len(output), -1), None, places, sentence)
        for code, what, unit, columns, sentence, places in shapes
    ]


def scores_of(
    dataset: TumbleDataset,
    design: Array,
    data: Array,
    inside: Mask,
    known: list[Alternative],
    scale: float,
) -> list[Score]:
    """Return how well each alternative explains what is left.

    `design` (n + m, k) and `data` (n + m,) have the readings, of which those `inside` (n + m,)
    count, and then what is known beforehand, over the same noise.
    """
    theta = dataset.theta_rad
    slope = scale * dataset.gravity_g * np.cos(theta)
    anywhere = np.ones(len(theta), dtype=bool)
    # A mounting that is off by an angle is held against its own prior.
    within = np.append(True, np.diff(dataset.mounting) == 0)
    stepping = (
        ("The output", "V", np.ones(len(theta)), anywhere),
        ("The scale factor", "V/g", dataset.gravity_g * np.sin(theta), anywhere),
        ("The angle of the encoder", "rad", slope, within),
    )

    def steps(design: Array, left: Array, inside: Mask) -> list[tuple[float, Alternative]]:
        best: list[tuple[float, Alternative]] = []
        for what, unit, shape, may in stepping:
            empty = np.empty((len(shape), 0))
            step = Alternative("output-step", what, unit, empty, None, SEARCHED, STEP)
            best += strongest_step(shape, design, left, inside, step, may)
        return best

    def lines(design: Array, left: Array, inside: Mask) -> list[tuple[float, Alternative]]:
        rated = strongest_line(dataset.time_s, design, left, inside, "V", FINER)
        return [(gain, replace(line, sentence=PERIODIC)) for gain, line in rated]

    return scores(design, data, inside, known, (steps, lines))
