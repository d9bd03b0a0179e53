"""The finite-memory recursion: exact where the window is sound, silent where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from accelerometer_records import SIX_FIELDS_T, TRUTH, points, record
from numpy.typing import NDArray

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.finite_memory import (
    FiniteMemory,
    column_scale,
    walk,
)
from procedures.accelerometer_magnetic_sensitivity.model import (
    COEFFICIENTS,
    accelerations,
    judge,
    model_columns,
)
from procedures.accelerometer_magnetic_sensitivity.parameters import AnalysisSettings

Array = NDArray[np.float64]


def cycle(planes: tuple[str, ...] = ("io", "ip"), angles: int = 9) -> tuple[Array, Array]:
    """Return the kept columns of a plan and the truth of their combinations."""
    plane, angle_deg, field_T = points(planes, angles, SIX_FIELDS_T)
    found = judge(plane, angle_deg, field_T)
    columns = model_columns(accelerations(plane, np.radians(angle_deg)), field_T)
    truth = [sum(c * TRUTH[n] for n, c in terms.items()) for terms in found.terms.values()]
    return columns[:, [COEFFICIENTS.index(name) for name in found.kept]], np.array(truth)


def window_solution(rows: Array, data: Array) -> Array:
    scale = column_scale(rows)
    q, r = np.linalg.qr(rows / scale)
    exact = np.linalg.solve(r, q.T @ data)
    left = data - rows / scale @ exact
    return np.asarray((exact + np.linalg.solve(r, q.T @ left)) / scale)


def test_a_long_walk_agrees_with_the_qr_solution_of_every_window() -> None:
    columns, truth = cycle()
    rows = np.tile(columns, (60, 1))
    noise = 3e-6 * np.random.default_rng(0).standard_normal(len(rows))
    data = rows @ truth + noise
    window = 2 * len(columns)
    course, memory = walk(rows, data, window)
    # Just before a window is solved anew rounding is largest.
    for end in range(3 * window - 1, len(rows), 3 * window - 1):
        inside = slice(end + 1 - window, end + 1)
        exact = window_solution(rows[inside], data[inside])
        assert course[end] == pytest.approx(exact, rel=1e-9, abs=0.0)
    assert memory.lost == 0


def test_it_begins_exactly_and_forgets_what_it_began_with() -> None:
    columns, truth = cycle()
    data = columns @ truth
    data[:20] += 1e-3
    rows, values = np.tile(columns, (3, 1)), np.concatenate((data, columns @ truth, data))
    course, _ = walk(rows, values, len(columns))
    first = int(np.flatnonzero(np.isfinite(course[:, 0]))[0])
    assert np.isnan(course[:first]).all()
    # A guessed beginning would stay in the estimate for ever.
    assert course[2 * len(columns) - 1] == pytest.approx(truth, rel=1e-9)


def test_a_row_costs_the_same_whatever_the_window() -> None:
    columns, truth = cycle()
    rows = np.tile(columns, (40, 1))
    for window in (len(columns), 10 * len(columns)):
        memory = FiniteMemory(column_scale(columns), window)
        for row in rows:
            memory.push(row, float(row @ truth))
        # Windows are solved by QR once a window's length, so their cost a row is constant too.
        assert memory.resolved <= len(rows) // window + 3


def test_a_window_that_loses_a_column_says_nothing_until_it_has_it_again() -> None:
    columns, truth = cycle()
    one_angle = np.repeat(columns[:1], 150, axis=0)
    rows = np.concatenate((columns, one_angle, columns))
    data = rows @ truth
    course, memory = walk(rows, data, len(columns))
    lost = np.isnan(course[:, 0])
    assert memory.lost == 1
    assert not lost[len(columns)]
    assert lost[2 * len(columns) : 2 * len(columns) + 30].all()
    assert course[-1] == pytest.approx(truth, rel=1e-7)
    known = course[np.isfinite(course[:, 0])]
    assert np.all(np.abs(known[:, 1] - truth[1]) < 1e-4)


def test_a_window_below_the_number_of_columns_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot determine"):
        FiniteMemory(np.ones(9), 8)


def test_the_published_value_is_that_of_the_last_window() -> None:
    dataset = record(0, ("io", "ip", "op"), 24, SIX_FIELDS_T)
    analysis = analyse(dataset)
    path = analysis.path
    assert path is not None
    # Two thirds of the rows end on the planes ip and op, in which Kio has no term.
    assert path.window == 324
    assert np.isfinite(path.estimates[path.window :]).all()
    published = {one.name: one.value for one in analysis.published}
    assert published["Kpp"] is None
    assert [published[name] for name in path.names] == pytest.approx(path.estimates[-1])
    for one in analysis.estimates:
        if one.value is not None and one.standard_uncertainty is not None:
            off = abs((published[one.name] or 0.0) - one.value)
            assert off < 6.0 * one.standard_uncertainty


def test_a_plan_may_give_the_window() -> None:
    dataset = record(1, ("io", "ip"), 24, SIX_FIELDS_T)
    path = analyse(dataset, AnalysisSettings(window=len(dataset))).path
    assert path is not None
    assert path.window == len(dataset)
    short = analyse(dataset, AnalysisSettings(window=20))
    assert all(one.value is None for one in short.published)
