"""What fields that change between the shots do to the angles, and which of it the shots can show.

Two changes are thought of: the residual field steps once, at any place in the order of the shots,
and a coil in one of its senses leaks into another coil. With M of a change its part of chi-square
for 1 nT and g what it moves, in u of the angle, steps of up to `STEP_NT` within a bound h on
chi-square move the angle by up to

    sqrt(g' (M/h + 1/STEP_NT²)^-1 g).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from station.findings import Flag

from .angles import DOUBTFUL, Solution, slopes_of
from .dataset import Frequencies
from .shots import PAIRS

Array = NDArray[np.float64]

STEP_NT = 0.5
"""By how much a field is thought to change between two shots: the tolerance of nulling."""
HIDDEN_U = 6.0
"""A step that moves an angle by more, and that chi-square does not show, is spoken of."""


def held_to_steady_fields(frequencies: Frequencies) -> tuple[Frequencies, list[Flag]]:
    """Return what is found, widened by what unsteady fields may hide, and a flag on their order.

    The shots stand in the order in which they were taken.
    """
    if not (frequencies.solution.sound and frequencies.solution.free_of_residual):
        return frequencies, []
    used = frequencies.used
    changes = Changes(frequencies.commanded_nT, frequencies.covariance, frequencies.solution)
    flags = []
    if (step := changes.hidden_step()) is not None:
        before, after = used[step.place - 1].name, used[step.place].name
        flags.append(
            Flag(
                "unseen-step",
                f"In this order of the shots a step of the residual field between {before} and "
                f"{after} passes for an angle: one of {STEP_NT:g} nT moves {step.pair} by up to "
                f"{step.moves_deg:.2g} deg ({step.moves_u:.0f} u), and the shots agree as before. "
                "Take each field's opposite right after it, or null and measure again and compare.",
                step.pair,
                {"step_nT": STEP_NT, "moves_deg": step.moves_deg, "shots": [before, after]},
            )
        )
    return replace(frequencies, solution=changes.widened()), flags


@dataclass(frozen=True)
class HiddenStep:
    """The step before the shot `place` that moves an angle furthest and shows least."""

    place: int
    pair: str
    moves_u: float
    moves_deg: float


class Changes:
    """What changes of fields do to a solution; `commanded_nT` (n, 3), `covariance` (n, n)."""

    def __init__(self, commanded_nT: Array, covariance: Array, solution: Solution) -> None:
        self.commanded_nT = commanded_nT
        self.solution = solution
        slopes = slopes_of(commanded_nT, solution.unknowns)
        self._by_nT = slopes[:, 6:] * solution.scale
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        self._left = whiten @ (np.eye(len(slopes)) - slopes @ solution.gain)
        self._misfit = whiten @ solution.misfit_rad_per_s
        self._cosine_u = np.sqrt(np.diag(solution.covariance)[3:6])

    def hidden_step(self) -> HiddenStep | None:
        """Return the step that chi-square shows least, None where none moves an angle by much."""
        bound = self._usual - max(self.solution.degrees_of_freedom, 1)
        worst: HiddenStep | None = None
        for place, change in enumerate(self._steps(), 1):
            moved = (self.solution.gain @ change)[3:6] / self._cosine_u[:, None]
            left = self._left @ change
            inverse = np.linalg.inv(left.T @ left / bound + np.eye(3) / STEP_NT**2)
            sizes = np.sqrt(np.sum((moved @ inverse) * moved, axis=1))
            k = int(np.argmax(sizes))
            if sizes[k] > max(HIDDEN_U, worst.moves_u if worst else 0.0):
                sine = float(np.sqrt(1.0 - self.solution.cosine[k] ** 2))
                moves_deg = float(np.degrees(sizes[k] * self._cosine_u[k] / sine))
                worst = HiddenStep(place, PAIRS[k], float(sizes[k]), moves_deg)
        return worst

    def widened(self) -> Solution:
        """Return the solution with what a change may have moved, where chi-square is doubtful.

        Of the changes that would let the shots agree, those that move each angle furthest.
        """
        solution = self.solution
        if not solution.enlarged:
            return solution
        moves = []
        for change in (*self._steps(), *self._leaks()):
            left = self._left @ change
            normal = left.T @ left + np.eye(len(left.T)) / STEP_NT**2
            found_nT = np.linalg.solve(normal, left.T @ self._misfit)
            if solution.chi_square - found_nT @ left.T @ self._misfit <= self._usual:
                moves.append(solution.gain @ change @ found_nT)
        if not moves:
            return solution
        moved = np.array(moves)
        furthest = moved[np.unique(np.argmax(np.abs(moved[:, 3:6]), axis=0))]
        return replace(solution, covariance=solution.covariance + furthest.T @ furthest)

    @property
    def _usual(self) -> float:
        """The chi-square up to which shots agree without doubt."""
        return float(chdtri(max(self.solution.degrees_of_freedom, 1), DOUBTFUL))

    def _steps(self) -> Iterator[Array]:
        """Yield the derivatives (n, 3) by a step of the residual field before each shot."""
        shots = np.arange(len(self._by_nT))[:, None]
        for place in range(1, len(shots)):
            yield self._by_nT * (shots >= place)

    def _leaks(self) -> Iterator[Array]:
        """Yield the derivatives (n, 2) by what a coil in one sense makes along the others."""
        for coil in range(3):
            others = [k for k in range(3) if k != coil]
            for sense in (1.0, -1.0):
                acts = np.sign(self.commanded_nT[:, [coil]]) == sense
                yield self._by_nT[:, others] * acts
