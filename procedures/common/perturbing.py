"""What trials of an analysis do to data alike: columns and axes moved or scaled, noise drawn.

And what an input moves by its perturbation, where no formula says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from station.findings import Estimate, Trials


def scaled(data: Any, part: float, *, column: str) -> Any:
    """Return a dataclass with a number or array of its own larger by a part."""
    return replace(data, **{column: getattr(data, column) * (1.0 + part)})


def shifted(data: Any, by: Any, *, column: str) -> Any:
    """Return a dataclass with a number or array of its own moved by a number or array."""
    return replace(data, **{column: getattr(data, column) + by})


def drawn_size(degrees_of_freedom: float, random: np.random.Generator) -> float:
    """Return by what a standard deviation known with so many degrees of freedom may be larger."""
    if not math.isfinite(degrees_of_freedom):
        return 1.0
    return math.sqrt(degrees_of_freedom / random.chisquare(degrees_of_freedom))


def of_directions(axes: Iterable[str]) -> dict[str, Callable[[Any, float], Any]]:
    """Return what the angles of the input axes of a dataset do, by their names among the inputs."""
    return {
        f"{angle}_{axis}": partial(_turned, axis=axis, column=f"{angle}_rad")
        for axis in axes
        for angle in ("azimuth", "elevation")
    }


def _turned(dataset: Any, off_rad: float, *, axis: str, column: str) -> Any:
    turned = shifted(dataset.directions[axis], off_rad, column=column)
    return replace(dataset, directions={**dataset.directions, axis: turned})


def with_slopes(
    estimates: Sequence[Estimate], trials: Trials, u: dict[str, float]
) -> Iterator[Estimate]:
    """Yield estimates with their derivatives by inputs, each moved by its `u` up and down."""
    moved = {}
    for name, size in u.items():
        change = trials.perturbed[name]
        moved[name] = [trials.analyse(change(trials.dataset, by)) for by in (size, -size)]
    for place, estimate in enumerate(estimates):
        slopes = dict(estimate.sensitivities)
        for name, size in u.items():
            above, below = (analysis.estimates[place].value for analysis in moved[name])
            if above is not None and below is not None:
                slopes[name] = (above - below) / (2.0 * size)
        yield replace(estimate, sensitivities=slopes)
