"""What else may have moved the output: a table of causes, each with the columns it would have.

Each is held against what a solution left (`estimation.alternatives`), with drift and without, in
all rows and in those that the solution keeps; the information criterion then says which it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.alternatives import (
    SEARCHED,
    Alternative,
    Score,
    doubt,
    from_each_row,
    gains_of_parts,
    scores,
    strongest_line,
    strongest_step,
    worth_trying,
)
from procedures.estimation.linear import combine
from procedures.estimation.orthogonal import project, thin_qr
from station.findings import Flag

from .dataset import AccelerometerDataset, Rows
from .model import model_columns
from .nuisances import ARCSEC_PER_RAD, ENCODER_JUMP, KO, KP, OFFSET
from .solved import Solution, Solved

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEAR = SEARCHED + 2
"""Gains and the encoder's course go with time, and drift and temperature with all of them."""
WARMING_ROWS = (4.0, 12.0, 36.0)
"""Time constants of a device in a coil, in intervals of the rows."""
OFTEN = 1.5
"""Fields before a field, on average: with fewer, what they leave is a shape over the field."""
TILTED = 2e-3
"""Of Ki: so much of a misalignment that its square, 2 µV at 1 V/g, tells it from a jump between two
planes."""
LEFT_OF_STEP = 0.1
FEWEST_OFF = 2
"""One row that is off is left out as a wild one."""
OWN_PART = 1e-3
"""A jump whose column has less of its own cannot be distinguished from the coefficients."""
HYSTERESIS = Flag(
    "hysteresis",
    "Hysteresis: {what}, by up to {size}; it is fitted and removed. A core or a torquer keeps a "
    "part of its magnetisation, or the field had not settled: degauss before each point, wait "
    "longer, and compare field up with field down.",
)
WARMING = Flag(
    "not-settled",
    "The output follows the square of the field with a delay of about {what} rows, by up to "
    "{size}: the coil warms the device, and no temperature says so; it is fitted and removed. Look "
    "at the thermometer's place, wait longer at each point, and cool the coil.",
)
LAGS = Flag(
    "not-settled",
    "Each output holds {first:.2g} of the one before: it was read before it had settled, or stands "
    "in the wrong row. The solution corrects a small part. Lengthen the dwell, and look at the "
    "filter of the voltmeter and at the rows.",
)
COMMANDED = Flag(
    "field-differs-from-commanded",
    "The output follows the commanded field, not the gaussmeter, by {first:.2f} of their "
    "difference (up to {size}); the solution corrects that. Look at the gaussmeter: its range, "
    "zero, cable and place, and whether its column is shifted.",
)
PERIODIC = Flag(
    "periodic",
    "The output has a line with a period of {what} and a range of {size}, which is fitted and "
    "removed: mains pick-up or another disturbance, aliased by the interval of the rows. Look at "
    "grounding, shields and the integration time of the voltmeter.",
)
DRIFTS = Flag(
    "drift-removed",
    "{what} drifted in the course of the rows (up to {size} of the output), and no temperature "
    "says why; terms of zero mean were fitted and removed. Look at the thermometer's place, and "
    "warm the device up for longer.",
)
SHAPE = Flag(
    "misfit",
    "The output has a shape that the model does not have, by {what} (up to {size}); one term for "
    "it is fitted, and what it leaves is not known. Look for a saturated core, a voltmeter that is "
    "not linear, and an encoder's scale.",
)
STEPS = Flag(
    "output-step",
    "{where} the {what} is {first:+.4g} {unit} more than {than} at the same angle and field; the "
    "solution takes the step for one of the output and removes it, K0 and Ki being the mean. Look "
    "at the voltmeter, its range and input, and the device.",
)
JUMPS = Flag(
    "encoder-jump",
    "{where} the encoder reads {arcsec:.4g} arcsec more than {than} beside the other angles; the "
    "solution corrects it. Look at the stage: it loses counts, or the accelerometer moved on it.",
)
LIKE_HYSTERESIS = Flag(
    "misfit",
    "Each field always comes after the same one, so that what hysteresis leaves is a shape over "
    "the field: a core that saturates, or another shape that the model does not have, may be the "
    "cause as well. Take the fields up and down, or in random order, which distinguishes the two.",
)
BY_WAY = "the output differs by where the field came from"
SCALE_BY_WAY = "the scale factor differs by where the field came from"
LAST_FIELD = "the output still holds a part of the field of the row before"
STEPPED = {"V": "K0", "V/g": "Ki", "V/T": "Km"}
"""By the unit of a step the coefficient that steps."""
STEP_KEYS = {"V": "step_V", "V/g": "step_V_per_g", "V/T": "step_V_per_T"}


def known_causes(rows: Rows, acceleration_g: Array, coefficients: Array) -> list[Alternative]:
    """Return the causes that have a shape of their own.

    `acceleration_g` (rows, 3), `coefficients` (13,) of a first solution.
    """
    data = rows.output_V
    i, o, p = acceleration_g.T
    largest_T = float(np.max(np.abs(rows.field_T))) or 1.0
    b = rows.field_T / largest_T
    time = rows.time_s - rows.time_s.mean()
    time = time / (float(np.max(np.abs(time))) or 1.0)
    square = time**2 - np.mean(time**2)
    up = direction(rows.commanded_T)
    ahead = model_columns(acceleration_g, rows.field_T + largest_T)
    behind = model_columns(acceleration_g, rows.field_T - largest_T)
    by_field = combine(ahead - behind, coefficients) / (2.0 * largest_T)
    last = np.concatenate(([0], np.arange(len(data) - 1)))
    change_T = rows.field_T[last] - rows.field_T
    off_T = rows.commanded_T - rows.field_T
    shapes: list[tuple[Flag, str, str, Array, int]] = [
        (HYSTERESIS, BY_WAY, "V", up, 1),
        (HYSTERESIS, BY_WAY, "V", np.column_stack((up, up * b**2)), 1),
        (HYSTERESIS, SCALE_BY_WAY, "V/g", up * i, 1),
        (HYSTERESIS, LAST_FIELD, "V/T", change_T, 1),
        (HYSTERESIS, LAST_FIELD, "1", change_T * by_field, 1),
        (LAGS, "output", "1", data[last] - data, 1),
        (COMMANDED, "gaussmeter", "1", off_T * by_field, 1),
        (SHAPE, "field", "V", b**3, 1),
        (SHAPE, "field", "V", np.abs(b) * b, 1),
        (SHAPE, "field", "V", b**4, 1),
        (SHAPE, "field", "V", np.column_stack((b**3, b**4)), 1),
        (SHAPE, "field and acceleration", "V/g", i * b**2, 1),
        (SHAPE, "field's sign and acceleration", "V/g", i * np.sign(b), 1),
        (SHAPE, "field's sign and acceleration", "V/g", i * np.abs(b), 1),
        (SHAPE, "acceleration", "V/g", np.abs(i), 1),
        (SHAPE, "acceleration", "V/g^2", np.abs(i) * i, 1),
        (SHAPE, "acceleration", "V/g^4", i**4, 1),
        (SHAPE, "acceleration", "V/g^5", i**5, 1),
        (SHAPE, "acceleration", "V/g^2", o * p, 1),
        (SHAPE, "scale of the encoder", "V/g", rows.slope * rows.theta_rad, DEAR),
        (SHAPE, "drift of the encoder", "V/g", rows.slope * time, DEAR),
        (DRIFTS, "Km", "V", time * b, 1),
    ]
    if tells_history(rows.commanded_T):
        for constant in WARMING_ROWS:
            warm = warmth(rows, constant)
            shapes.append((WARMING, f"{constant:g}", "V", warm, 1))
    if rows.temperature_degC is not None:
        scale = np.column_stack((time * i, square * i))
        shapes += [(DRIFTS, "Ki", "V/g", part, 1) for part in (scale[:, :1], scale)]
    for plane in np.unique(rows.plane):
        if np.count_nonzero(np.diff(rows.plane == plane)) < 2:
            continue  # It begins or ends once, as a step does.
        there = (rows.plane == plane) - float(np.mean(rows.plane == plane))
        shapes += [
            (STEPS, f"output in plane {plane}", "V", there, DEAR),
            (STEPS, f"gain in plane {plane}", "V/g", there * i, DEAR),
        ]
    return [
        Alternative(
            flag.code, what, unit, columns.reshape(len(data), -1), None, places, flag.message
        )
        for flag, what, unit, columns, places in shapes
    ]


def causes_to_try(solved: Solved, rows: Rows, known: list[Alternative]) -> list[Alternative]:
    """Return the causes that explain more than noise does; none where nothing looks like it.

    Drift takes a step's place, so each is looked for with slow terms and without. An encoder that
    jumps is tried beside them.
    """
    causes: dict[bytes, Alternative] = {}
    kept, solution = solved.solution.kept, solved.solution
    masks = (kept,) if kept.all() else (kept, np.ones_like(kept))
    slow = solved.slow.shape[1]
    still = solved.design[:, : solved.design.shape[1] - slow]
    for columns in (solved.design, still)[: 1 + bool(slow)]:
        for inside in masks:
            rated = _scores(columns, solved, rows, known, inside)
            jumps = [score for score in rated if score.alternative.code == ENCODER_JUMP]
            others = [score for score in rated if score.alternative.code != ENCODER_JUMP]
            for cause in (*worth_trying(others), *worth_trying(jumps)):
                causes.setdefault(cause.columns.tobytes(), cause)
    values = dict(zip(solution.names, solution.coefficients, strict=True))
    if max(abs(values.get(name, 0.0)) for name in (KO, KP)) > TILTED * abs(values.get("Ki", 1.0)):
        for row in 1 + np.flatnonzero(rows.plane[1:] != rows.plane[:-1]):
            cause = _jump(np.arange(len(kept)) >= row, int(row))
            causes.setdefault(cause.columns.tobytes(), cause)
    return list(causes.values())


def rests_on_one(solved: Solved) -> bool:
    """Return whether one row alone tells a step from the other terms: a wild one would be it.

    Without that row less than `LEFT_OF_STEP` of the square of the step's column is its own.
    """
    solution, cause = solved.solution, solved.solution.cause
    if cause is None or cause.code != STEPS.code or cause.row is None:
        return False
    place = solution.names.index(cause.names[0])
    columns = (solved.design * solved.root_weight[:, None])[solution.kept]
    others, step = np.delete(columns, place, axis=1), columns[:, place]
    q = thin_qr(others / np.linalg.norm(others, axis=0))[0]
    own = step - combine(q, project(q, step))
    free = np.maximum(1.0 - np.sum(q**2, axis=1), OWN_PART**2)
    square = float(own @ own)
    return square - float(np.max(own**2 / free)) < LEFT_OF_STEP * square


def placed_step(solved: Solved, rows: Rows, outlier: float) -> Alternative | None:
    """Return the step of a solution where the rows that it leaves out count, too, None elsewhere.

    Wild rows beside a step bend the search, and the rows between where it is and where it was
    looked for are left out for it. It belongs where the squares of all rows are smallest, none
    taken for more than that of one `outlier`, in standard deviations. A step of Ki or Km that
    rests on one row is tried as one of the output.
    """
    solution, cause = solved.solution, solved.solution.cause
    if cause is None or cause.code != STEPS.code or cause.row is None:
        return None
    count = len(rows.time_s)
    later = (np.arange(count) >= cause.row).astype(np.float64)
    if rests_on_one(solved):
        columns = (later - later.mean())[:, None]
        output = replace(cause, what="output", unit="V", columns=columns, places=SEARCHED)
        return None if cause.unit == "V" else output
    shape = cause.columns[:, 0] / (later - later.mean())
    step_V = solution.values[cause.names[0]] * shape
    most = (outlier * solution.noise_V) ** 2
    # What a row leaves where the step comes before it, and where it comes after it.
    residual_V = solution.residual_V
    after = np.minimum((residual_V - step_V * (1.0 - later)) ** 2, most)
    before = np.minimum((residual_V + step_V * later) ** 2, most)
    left = np.cumsum(before - after) + float(after.sum())
    row = 1 + int(np.argmin(left[:-1]))
    moved = (np.arange(count) >= row).astype(np.float64)
    columns = (shape * (moved - moved.mean()))[:, None]
    return None if row == cause.row else replace(cause, columns=columns, row=row)


def with_doubt(solved: Solved, rows: Rows, known: list[Alternative]) -> Solved:
    """Return a solution whose uncertainties hold a cause that noise may just imitate.

    Of a step they hold where among wild rows it is.
    """
    kept, solution = solved.solution.kept, solved.solution
    if solution.cause is not None:
        moved = _by_place(solution, solution.cause)
        covariance = solution.covariance + np.outer(moved, moved)
        return replace(solved, solution=replace(solution, covariance=covariance))
    units = np.where(np.array(solution.names) == OFFSET, ARCSEC_PER_RAD, 1.0)
    rated = _scores(solved.design, solved, rows, known, kept)
    rated = [score for score in rated if score.alternative.code != ENCODER_JUMP]
    u = np.sqrt(np.diag(solution.covariance)) / units
    moved = doubt(solved.design, rows.output_V, kept, rated, u) * units
    covariance = solution.covariance + np.outer(moved, moved)
    return replace(solved, solution=replace(solution, covariance=covariance))


def _by_place(solution: Solution, cause: Alternative) -> Array:
    """Return what coefficients change by where a step is among wild rows, which do not say that.

    The mean over all rows holds it.
    """
    moved = np.zeros(len(solution.names))
    name = STEPPED.get(cause.unit)
    if cause.code == STEPS.code and cause.row is not None and name in solution.names:
        first = last = cause.row
        while first > 0 and not solution.kept[first - 1]:
            first -= 1
        while last < len(solution.kept) and not solution.kept[last]:
            last += 1
        rows = (last - first) / len(solution.kept)
        moved[solution.names.index(name)] = solution.values[cause.names[0]] * rows
    return moved


def _scores(
    columns: Array, solved: Solved, rows: Rows, known: list[Alternative], inside: Mask
) -> list[Score]:
    """Return the score of each cause against `columns` (rows, k); only rows `inside` count."""
    anywhere, count = np.ones(len(inside), dtype=bool), len(inside)
    stepping = (
        ("output", "V", np.ones(count), SEARCHED),
        ("gain", "V/g", solved.acceleration_g[:, 0], DEAR),
        ("sensitivity", "V/T", rows.field_T, DEAR),
    )

    def steps(design: Array, left: Array, inside: Mask) -> list[tuple[float, Alternative]]:
        best: list[tuple[float, Alternative]] = []
        for what, unit, shape, places in stepping:
            empty = np.empty((count, 0))
            step = Alternative(STEPS.code, what, unit, empty, None, places, STEPS.message)
            best += strongest_step(shape, design, left, inside, step, anywhere)
        return best

    def lines(design: Array, left: Array, inside: Mask) -> list[tuple[float, Alternative]]:
        rated = strongest_line(rows.time_s, design, left, inside, "V")
        return [(gain, replace(line, sentence=PERIODIC.message)) for gain, line in rated]

    def jumps(design: Array, left: Array, inside: Mask) -> list[tuple[float, Alternative]]:
        slope = solved.slope * inside
        _, angle = np.unique(rows.groups["angle"], return_inverse=True)
        best = []
        for sums, lasts in ((from_each_row, True), (_by_label(angle), False)):
            sizes = sums(inside.astype(np.float64))
            may = (sizes >= FEWEST_OFF) & (sizes <= inside.sum() - FEWEST_OFF)
            gains = np.where(may, gains_of_parts(slope, design, left, sums, OWN_PART), 0.0)
            part = int(np.argmax(gains))
            off = np.arange(count) >= part if lasts else angle == part
            best.append((float(gains[part]), _jump(off, part if lasts else None)))
        return [(gain, cause) for gain, cause in best if gain > 0.0]

    free = OFFSET in solved.solution.names
    return scores(columns, rows.output_V, inside, known, (steps, lines, jumps)[: 2 + free])


def _jump(off: Mask, row: int | None) -> Alternative:
    """Return the encoder off in these rows, from a row on or at one angle."""
    columns = off.astype(np.float64)[:, None]
    return Alternative(JUMPS.code, "encoder", "rad", columns, row, SEARCHED, JUMPS.message)


def _by_label(label: NDArray[np.int64]) -> Callable[[Array], Array]:
    """Return what gives the sums of values (n, ...) over the rows of each label (n,)."""
    order = np.argsort(label, kind="stable")
    begins = np.searchsorted(label[order], np.arange(int(label.max()) + 1))
    return lambda values: np.asarray(np.add.reduceat(values[order], begins, axis=0))


def direction(commanded_T: Array) -> Array:
    """Return +1 where the field has come up last, -1 where it has come down, 0 before it moved."""
    steps = np.sign(np.diff(commanded_T, prepend=commanded_T[:1]))
    moved = np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(steps)), 0))
    return np.asarray(steps[moved])


def warmth(rows: Rows, constant: float) -> Array:
    """Return the square of the field as a body of a time constant follows it, zero mean (rows,).

    `constant` in intervals of the rows. A row is read at the end of its own interval; before the
    first the body has the mean of all rows.
    """
    square = (rows.field_T / (float(np.max(np.abs(rows.field_T))) or 1.0)) ** 2
    steps_s = np.diff(rows.time_s, prepend=rows.time_s[0])
    kept = np.exp(-steps_s / (constant * (float(np.median(steps_s)) or 1.0)))
    followed = np.full(len(square), float(np.mean(square)))
    for row in range(1, len(square)):
        followed[row] = square[row] + kept[row] * (followed[row - 1] - square[row])
    return np.asarray(followed - np.mean(followed))


def tells_history(commanded_T: Array) -> bool:
    """Whether the same fields come after different ones, as they do not in the published order."""
    if len(commanded_T) < 2:
        return False
    pairs = np.unique(np.column_stack((commanded_T[:-1], commanded_T[1:])), axis=0)
    return len(pairs) >= OFTEN * len(np.unique(commanded_T))


def cause_flags(
    solution: Solution, dataset: AccelerometerDataset, usable: NDArray[np.int64]
) -> list[Flag]:
    """Return the flags of what moved the output beside the model; `usable` are its rows.

    `size_V` is the largest change of the output that it makes over the rows.
    """
    cause = solution.cause
    if cause is None:
        return []
    row = None if cause.row is None else int(usable[cause.row])
    where, than = f"From row {row} on, counted from 0,", "before"
    details: dict[str, object] = {"what": cause.what}
    if cause.code == ENCODER_JUMP:
        off = usable[cause.columns[:, 0] > 0.0]
        if row is None:
            where = f"In plane {dataset.plane[off[0]]} at {dataset.theta_deg[off[0]]:.5g} deg"
            than = "it should"
        arcsec = -solution.jump_rad * ARCSEC_PER_RAD
        text = cause.sentence.format(where=where, arcsec=arcsec, than=than)
        details = {"row": int(off[0]), "rows": len(off), "jump_arcsec": arcsec}
        return [Flag(cause.code, text, details=details)]
    terms = solution.coefficients[[solution.names.index(name) for name in cause.names]]
    first, size_V = float(terms[0]), float(np.ptp(combine(cause.columns, terms)))
    if cause.code == "output-step":
        details |= {STEP_KEYS[cause.unit]: first} | ({} if row is None else {"row": row})
        if row is None:
            where, than = "In one plane", "in the others"
    text = cause.sentence.format(
        what=cause.what,
        first=first,
        size=f"{1e6 * size_V:.3g} µV",
        unit=cause.unit,
        where=where,
        than=than,
    )
    if cause.code == "drift-removed":
        details["term"] = cause.what
    flags = [Flag(cause.code, text, details={**details, "size_V": size_V})]
    if cause.code == "hysteresis" and not tells_history(dataset.field_commanded_T[usable]):
        flags.append(LIKE_HYSTERESIS)
    return flags
