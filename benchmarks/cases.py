"""How a benchmark measures an estimator case by case, and the command line that chooses them."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import numpy as np
from figures import Figures
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from station.findings import Estimate, Published

Array = NDArray[Any]

LARGE_FREEDOM = 1e9
"""Student's quantile of so many degrees of freedom is that of a normal deviate."""


class Named(Protocol):
    """A case; `--case` chooses it by a part of its name."""

    @property
    def name(self) -> str:
        """What stands in front of its figures."""
        ...


C = TypeVar("C", bound=Named)


def print_cases(
    about: str, cases: Iterable[C], measure: Callable[[C, int], dict[str, object]], runs: int = 2000
) -> None:
    """Print what `measure` finds of each chosen case, one JSON object a line."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--runs", type=int, default=runs)
    parser.add_argument("--case", help="only the cases whose name contains this")
    figures = Figures(parser)
    options = figures.parse()
    for case in cases:
        if options.case is None or options.case in case.name:
            figures.line(case.name, **measure(case, options.runs))


@dataclass(frozen=True)
class Scored:
    """A result of one dataset, alike for all its axes (n,): errors in the unit of `bound`.

    `u` is the standard uncertainty and `inside` whether the 95 % interval holds the truth; `bound`
    (n,) is the Cramér-Rao bound, None where there is none. NaN stands for a result without value,
    and for the u of a published rule.
    """

    error: Array
    u: Array
    inside: NDArray[np.bool_]
    bound: Array | None = None


@dataclass(frozen=True)
class Trial:
    """What the analysis of one dataset says: its results by name, the codes of its flags."""

    results: Mapping[str, Scored]
    codes: frozenset[str]


Trials = Mapping[str, Callable[[int], Trial]]
"""Of each case what makes a fresh dataset of a seed and analyses it."""


def scored(
    error: ArrayLike, u: ArrayLike, freedom: ArrayLike = np.inf, bound: ArrayLike | None = None
) -> Scored:
    """Return a result whose interval is Student's, `freedom` (n,) being its degrees of freedom."""
    errors, units = np.atleast_1d(np.asarray(error, float)), np.atleast_1d(np.asarray(u, float))
    factor = stdtrit(np.minimum(np.asarray(freedom, float), LARGE_FREEDOM), 0.975)
    limit = None if bound is None else np.broadcast_to(np.asarray(bound, float), errors.shape)
    return Scored(errors, units, np.abs(errors) <= factor * units, limit)


def of_estimates(
    estimates: Iterable[Estimate],
    truth: Mapping[tuple[str, str | None], float],
    bound: Mapping[str, ArrayLike] = MappingProxyType({}),
) -> dict[str, Scored]:
    """Return the results whose truth is known, all axes of a name together, u as in the estimate.

    One without a value has a NaN; `bound` maps names to those of the axes in their order.
    """
    by_name: dict[str, list[tuple[float, float, float]]] = {}
    for one in estimates:
        if (one.name, one.axis) in truth:
            value = np.nan if one.value is None else one.value - truth[one.name, one.axis]
            u = one.standard_uncertainty
            freedom = np.inf if one.degrees_of_freedom is None else one.degrees_of_freedom
            row = (value, np.nan if u is None else u, freedom)
            by_name.setdefault(one.name, []).append(row)
    found = {}
    for name, rows in by_name.items():
        error, unit, degrees = np.transpose(rows)
        found[name] = scored(error, unit, degrees, bound.get(name))
    return found


def of_published(
    published: Iterable[Published],
    truth: Mapping[tuple[str, str | None], float],
    bound: Mapping[str, ArrayLike],
) -> dict[str, Scored]:
    """Return what the published rules give of the results whose bound is known."""
    by_name: dict[str, list[float]] = {}
    for one in published:
        if (one.name, one.axis) in truth and one.name in bound:
            error = np.nan if one.value is None else one.value - truth[one.name, one.axis]
            by_name.setdefault(one.name, []).append(error)
    return {
        f"{name}, as published": scored(errors, np.full(len(errors), np.nan), bound=bound[name])
        for name, errors in by_name.items()
    }


def summary(trials: Sequence[Trial], name: str) -> dict[str, object]:
    """Return rmse over bound, or over u where there is none, and coverage of a result.

    The standard error of the ratio counts datasets, not axes. The worst axis stands beside where
    there are several. `undetermined` is the share without a value.
    """
    rows = [one.results[name] for one in trials if name in one.results]
    error, u = np.array([one.error for one in rows]), np.array([one.u for one in rows])
    there = np.isfinite(error)
    bounds = [one.bound for one in rows if one.bound is not None]
    line: dict[str, object] = {"runs": len(rows)}
    if not there.any():
        return {**line, "undetermined": 1.0}
    stated = bool(np.isfinite(u).any())
    for key, unit in (("rmse_over_bound", bounds), ("rmse_over_u", u if stated else [])):
        if not len(unit):
            continue
        size = np.array(unit)
        # A bound is a level; a u is each run's own, and its square stands below the error's.
        parts = np.where(there, error, 0.0) / np.where(there, size, 1.0)
        square = (parts**2).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
        square = square[there.any(axis=1)]
        ratio = float(np.sqrt(square.mean()))
        line[key] = round(ratio, 3)
        line[key + "_error"] = round(
            float(square.std() / np.sqrt(len(square)) / max(2.0 * ratio, 1e-12)), 3
        )
        if error.shape[1] > 1:
            of_axes = (parts**2).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
            line[key + "_worst"] = round(float(np.sqrt(of_axes.max())), 3)
    if stated:
        inside = np.array([one.inside for one in rows])
        line["coverage_95"] = round(float(inside[there].mean()), 4)
        line["largest_error_u"] = round(float(np.max(np.abs(error[there] / u[there]))), 1)
    line["undetermined"] = round(1.0 - float(there.mean()), 4)
    return line


def shares(trials: Sequence[Trial]) -> dict[str, float]:
    """Return in which share of the datasets each flag was raised."""
    count = Counter(code for one in trials for code in one.codes)
    return {code: round(count[code] / len(trials), 4) for code in sorted(count)}


def measured(trial: Callable[[int], Trial], runs: int) -> dict[str, object]:
    """Return what the seeds from 0 on give of a case: results by name, shares of the flags."""
    trials = [trial(seed) for seed in range(runs)]
    names = dict.fromkeys(name for one in trials for name in one.results)
    return {
        "runs": runs,
        "results": {name: summary(trials, name) for name in names},
        "flags": shares(trials),
    }
