"""The source document's own estimator, step (8): finite-memory least squares on the model alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from station.findings import Published

from .findings import Path
from .finite_memory import FiniteMemory, walk
from .model import COEFFICIENTS, UNITS

Array = NDArray[np.float64]

WINDOW_PARTS = (2 / 3, 3 / 4, 5 / 6, 11 / 12, 1.0)


def finite_memory_path(
    columns: Array, data: Array, names: tuple[str, ...], rows: NDArray[np.int64], window: int | None
) -> Path | None:
    """Walk the rows with a finite memory; None where they are fewer than the columns.

    `columns` (n, k) are the kept columns of the model alone: no nuisance terms, no row left out for
    its residual. The text names no window; unless one is given it is two thirds of the rows, or
    longer where a shorter window would lose sight of a coefficient on its way.
    """
    count = len(data)
    if not names or count < len(names):
        return None
    sizes = [window] if window else [max(len(names), round(part * count)) for part in WINDOW_PARTS]
    for size in sizes:
        course, memory = walk(columns, data, min(max(size, len(names)), count))
        if not memory.lost:
            break
    return _path(course, memory, names, rows)


def _path(
    course: Array, memory: FiniteMemory, names: tuple[str, ...], rows: NDArray[np.int64]
) -> Path:
    return Path(names, rows, course, memory.window, memory.resolved)


def published_values(path: Path | None) -> tuple[Published, ...]:
    """Return the last window's value of each of the thirteen coefficients, None where it has none.

    The recursion on all thirteen columns does not fail where a plan cannot tell them apart: it
    returns numbers. So it is run on the columns that the plan tells apart.
    """
    last: dict[str, float] = {}
    if path is not None and len(path.estimates):
        ends = zip(path.names, path.estimates[-1], strict=True)
        last = {name: float(value) for name, value in ends if np.isfinite(value)}
    return tuple(
        Published(name, None, last.get(name), UNITS[name], "finite-memory") for name in COEFFICIENTS
    )
