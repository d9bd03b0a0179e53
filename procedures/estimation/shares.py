"""What each kind of row of a least-squares fit adds to the uncertainty of its solution.

Rows are in units of their standard uncertainties: measurements and priors alike. The solution moves
by the pseudo-inverse of the Jacobian with each of them, and its covariance is the sum of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shares:
    """`by_row` (k, n): by how much each unknown moves with each row, `sources` the kind of each."""

    by_row: Array
    sources: Sequence[str]

    def of(self, slope: Array) -> dict[str, float]:
        """Return the standard uncertainty that each kind of row adds to a result with these
        derivatives (k,) by the unknowns.
        """
        moved = slope @ self.by_row
        kinds = np.array(self.sources)
        return {kind: float(np.linalg.norm(moved[kinds == kind])) for kind in dict.fromkeys(kinds)}
