"""Least squares of a model that is not linear: damped Gauss-Newton (Levenberg, Marquardt)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
T = TypeVar("T")

SINGULAR = 1e12
"""Condition number from which normal equations determine nothing."""
DAMPING, HARDER, EASIER = 1e-3, 8.0, 0.1
TRIES = 12
ENOUGH = 1e-9
"""Of the sum of squares: with a thousand samples a thousandth of an uncertainty."""


@dataclass(frozen=True)
class Place(Generic[T]):
    """The sum of squares at some unknowns (k,), the normal equations there, and `what` else is."""

    cost: float
    normal: Array
    right: Array
    what: T

    @classmethod
    def of(cls, slopes: Array, residual: Array, what: T) -> Place[T]:
        """Return the place with slopes (k, n) and a residual (n,), over their noise or equal."""
        with np.errstate(over="ignore", invalid="ignore"):  # far off; no step goes there
            normal, right = slopes @ slopes.T, slopes @ residual
        return cls(float(residual @ residual), normal, right, what)


def descend(
    evaluate: Callable[[Array], Place[T] | None], start: Array, steps: int, enough: float = ENOUGH
) -> tuple[Array, Place[T]] | None:
    """Return the unknowns (k,) that a start leads to in at most so many steps, and what is there.

    `evaluate` gives None where no solution may be. It ends where a step gains no more than the part
    `enough` of the sum of squares. None where an unknown has no influence.
    """
    unknowns, here, damping = start, evaluate(start), DAMPING
    for _ in range(steps):
        squared = np.diag(here.normal) if here is not None else np.zeros(1)
        if here is None or not bool(np.all(np.isfinite(squared) & (squared > 0.0))):
            return None
        scale = np.sqrt(squared)
        small = here.normal / np.outer(scale, scale)
        for _ in range(TRIES):
            damped = small + damping * np.eye(len(scale))
            moved = unknowns + np.linalg.solve(damped, here.right / scale) / scale
            after = evaluate(moved)
            if after is not None and after.cost <= here.cost:
                break
            damping *= HARDER
        else:
            break
        gained = here.cost - after.cost
        unknowns, here, damping = moved, after, EASIER * damping
        if gained <= enough * here.cost:
            break
    return None if here is None else (unknowns, here)


def inverse_of(normal: Array) -> Array | None:
    """Return the inverse of normal equations (k, k); None where they are singular."""
    scale = np.sqrt(np.diag(normal))
    if not bool(np.all(np.isfinite(normal)) and np.all(scale > 0.0)):
        return None
    size = np.outer(scale, scale)
    if np.linalg.cond(normal / size) > SINGULAR:
        return None
    return np.asarray(np.linalg.inv(normal / size) / size)
