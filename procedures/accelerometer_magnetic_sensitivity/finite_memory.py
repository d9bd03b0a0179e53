"""Least squares with a finite memory: the recursion of the published step (8), made sound.

The newest row is added and the oldest dropped:

    K = P f / (1 + f'P f);  b += K (y - f'b);  P -= K f'P
    K = P f / (1 - f'P f);  b -= K (y - f'b);  P += K f'P

As published it forgets neither a guessed P at the start nor the rounding of every step, and where
the window loses rank it goes on with numbers that mean nothing. Here it begins with the exact
solution of the first window that determines all columns; columns are scaled; it refuses to drop a
row when 1 - f'Pf comes near zero and solves the window by QR instead; it says nothing while the
window does not determine the columns; and once a window's length it solves by QR in any case, so
that rounding never adds up. The cost of a row does not depend on the window's length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.linear import combine, cross_products
from procedures.estimation.orthogonal import project, solve_square, thin_qr
from station.findings import Published

from .dataset import Path
from .model import COEFFICIENTS, UNITS

Array = NDArray[np.float64]
SMALLEST_REMAINDER = 1e-6
SMALLEST_SINGULAR = 1e-6
"""Of the largest singular value: below it a window of scaled columns has lost its rank."""
WINDOW_PARTS = (2 / 3, 3 / 4, 5 / 6, 11 / 12, 1.0)


class FiniteMemory:
    """The solution of the last `window` rows, row by row.

    `scale` (k,) is what columns are divided by inside; estimates come out in the columns' own
    units.
    """

    def __init__(self, scale: Array, window: int) -> None:
        count = len(scale)
        if window < count:
            raise ValueError(f"a window of {window} rows cannot determine {count} columns")
        self.window = window
        self.resolved = 0
        """How often a window was solved by QR."""
        self.lost = 0
        """How often a window that had determined the columns ceased to."""
        self._scale = scale
        self._rows = np.zeros((window, count))
        self._values = np.zeros(window)
        self._filled = 0
        self._next = 0
        self._since = 0
        self._solved = False
        self._normal = np.zeros((count, count))
        self._inverse = np.zeros((count, count))
        self._scaled = np.zeros(count)

    @property
    def estimate(self) -> Array | None:
        """The coefficients (k,) of the window, None while it does not determine them."""
        return self._scaled / self._scale if self._solved else None

    def push(self, row: Array, value: float) -> None:
        """Take in a row (k,) and its datum; the row that is `window` rows older is forgotten."""
        new = row / self._scale
        full = self._filled == self.window
        old, old_value = self._rows[self._next].copy(), float(self._values[self._next])
        self._rows[self._next], self._values[self._next] = new, value
        self._next = (self._next + 1) % self.window
        self._filled = min(self._filled + 1, self.window)
        self._since += 1
        if not self._solved:
            self._normal += np.outer(new, new)
            if full:
                self._normal -= np.outer(old, old)
            if self._filled >= len(self._scale) and self._promising():
                self._solve_window()
            return
        self._add(new, value, 1.0)
        sound = not full or self._add(old, old_value, -1.0)
        if not sound or self._since >= self.window:
            self._solve_window()

    def _add(self, row: Array, value: float, sign: float) -> bool:
        """Add (sign 1) or drop (sign -1) a row; False where that cannot be done soundly."""
        along = self._inverse @ row
        remainder = 1.0 + sign * float(row @ along)
        if remainder < SMALLEST_REMAINDER:
            return False
        gain = along * (sign / remainder)
        self._scaled += gain * (value - float(row @ self._scaled))
        self._inverse -= np.outer(gain, along)
        return True

    def _promising(self) -> bool:
        """Whether the sums of the window look as if they had full rank; costs no look at rows."""
        values = np.linalg.eigvalsh(self._normal)
        return bool(values[0] > SMALLEST_SINGULAR**2 * values[-1] and values[0] > 0.0)

    def _solve_window(self) -> None:
        """Solve the window exactly; note where it does not determine the columns."""
        rows, values = self._rows[: self._filled], self._values[: self._filled]
        q, r = thin_qr(rows)
        self._since = 0
        self.resolved += 1
        singular = np.linalg.svd(r, compute_uv=False)
        if singular[-1] <= SMALLEST_SINGULAR * singular[0]:
            self.lost += self._solved
            self._solved = False
            self._normal = cross_products(rows)
            return
        self._scaled = solve_square(r, project(q, values))
        self._scaled += solve_square(r, project(q, values - combine(rows, self._scaled)))
        inverse = solve_square(r, np.eye(len(self._scale)))
        self._inverse = inverse @ inverse.T
        self._solved = True


def column_scale(columns: Array) -> Array:
    """Return the rms of each column (n, k), 1 where a column is zero."""
    rms = np.sqrt(np.mean(columns**2, axis=0))
    return np.asarray(np.where(rms > 0.0, rms, 1.0))


def walk(columns: Array, data: Array, window: int) -> tuple[Array, FiniteMemory]:
    """Push all rows (n, k); return the estimates after each (n, k), NaN where there are none."""
    memory = FiniteMemory(column_scale(columns), window)
    estimates = np.full(columns.shape, np.nan)
    for n in range(len(data)):
        memory.push(columns[n], float(data[n]))
        estimate = memory.estimate
        if estimate is not None:
            estimates[n] = estimate
    return estimates, memory


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
        estimates, memory = walk(columns, data, min(max(size, len(names)), count))
        if not memory.lost:
            break
    return _path(estimates, memory, names, rows)


def _path(
    estimates: Array, memory: FiniteMemory, names: tuple[str, ...], rows: NDArray[np.int64]
) -> Path:
    return Path(names, rows, estimates, memory.window, memory.resolved)


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
