"""A solution of all rows, and what it is compared by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .jump import Jump
from .nuisances import JUMP

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PLACE = 3
"""As many columns as the rows in which the encoder is off count for beside their angle: among so
many places one always explains something."""


@dataclass(frozen=True)
class Cause:
    """A cause: the code of its flag, what it is, and the columns (rows, m) that it adds, whose
    coefficients have the `unit`.

    `row` is where it begins, None where it lasts. `places` is how many columns it counts for
    beside its own: as many as were tried to find it explain something by themselves.
    """

    code: str
    what: str
    unit: str
    columns: Array
    row: int | None = None
    places: int = 1

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its terms beside the coefficients."""
        count = self.columns.shape[1]
        return tuple(f"{self.code} {n}" if n else self.code for n in range(count))


@dataclass(frozen=True)
class Misfit:
    """Residuals that rows of a group share: groups by `what`, the largest, its mean.

    `ratio` is how many times as large as by chance the squares of what is shared are.
    """

    what: str
    largest: str
    size_V: float
    ratio: float


@dataclass(frozen=True)
class Uneven:
    """Noise that differs by `what`: the group of each row (rows,) and the noise of each group."""

    what: str
    group: NDArray[np.int64]
    noise_V: Array


@dataclass(frozen=True)
class Solution:
    """Coefficients of the kept columns first, then nuisance terms, `names` in that order.

    Offset and jump of the encoder are in arcsec; `jump` says in which rows it is off, `cause` what
    else moved the output. `kept` (rows,) are the rows that count; `covariance` holds the scale of
    the noise. `shares` (names, 13) are what the solution takes of each column of the model.
    """

    names: tuple[str, ...]
    coefficients: Array
    covariance: Array
    kept: Mask
    residual_V: Array
    degrees_of_freedom: int
    noise_V: float
    condition: float
    not_separable: tuple[str, ...]
    jump: Jump | None
    cause: Cause | None = None
    shares: Array | None = None
    misfit: Misfit | None = None
    uneven: Uneven | None = None

    @property
    def sum_of_squares(self) -> float:
        """The weighted squares that the solution left, in V²."""
        return self.degrees_of_freedom * self.noise_V**2

    @property
    def drift_order(self) -> int:
        """The order of the polynomial in time, 0 where there is none."""
        orders = [name.removeprefix("drift ") for name in self.names if name.startswith("drift ")]
        return max(map(int, orders), default=0)

    @property
    def price(self) -> int:
        """For how many columns it counts: each row left out is one that it explains."""
        place = 0 if self.jump is None else PLACE + (JUMP not in self.names)
        place += 0 if self.cause is None else self.cause.places
        return len(self.names) + place + int(np.sum(~self.kept))

    @property
    def lag_one_correlation(self) -> float:
        """The correlation of neighbouring residuals of the rows that count."""
        left = self.residual_V[self.kept]
        square = float(left @ left)
        return float(left[1:] @ left[:-1]) / square if square > 0.0 else 0.0


@dataclass(frozen=True)
class Solved:
    """A solution, its design (rows, k) and the output's derivative by the angle.

    `slow` are the last columns of the design: temperature and drift. `acceleration_g` (rows, 3) is
    at the solved angle, `model_coefficients` (13,) are zero where they are folded.
    """

    solution: Solution
    design: Array
    slope: Array
    slow: Array
    acceleration_g: Array
    model_coefficients: Array
