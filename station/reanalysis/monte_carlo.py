"""Budgets propagated through the whole analysis: Monte Carlo of GUM Supplement 1 (JCGM 101:2008).

A trial gives the recorded data other noise, lets every stated input deviate as it is distributed,
and analyses them as they were analysed the first time. Each trial has a generator of its own, made
of the seed and of its number, so that the outcome does not depend on who does which trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from station.errors import InputError
from station.findings import Estimate, Findings, InputQuantity, Key, Trials
from station.reanalysis.scheduling import each_done
from station.runner.evaluation import quiet_numbers
from station.uncertainty import MONTE_CARLO, Combined, combine

Array = NDArray[np.float64]
Chunk = tuple[int, Any, BaseException | None]
Ways = Mapping[Key, tuple[str, str]]
"""By result how its value came."""
Passing = Callable[[Iterator[Chunk], int], Iterator[Chunk]]
"""Passes on what is done of so many chunks, and says how far it is."""

COVERAGE = 0.95
CHUNKS = 100
TWO_DIGITS = 200_000
"""Trials from which u is held to two significant digits: 10^4/(1 - p), as JCGM 101, 7.2.2, asks."""
ERRORS = 3.0
"""Standard errors of an end of the trials' interval, by which it may lie farther off."""
END = 2.67
"""Standard error of an end of the interval of normal deviates, times the root of their number."""
FEWEST = 0.9
"""Part of the trials that must give a result, for anything to be said of it."""


@dataclass(frozen=True)
class Deviation:
    """An input that deviates: through the dataset, or else by the results' sensitivities to it."""

    quantity: InputQuantity
    sensitivities: Mapping[Key, float]
    """Of the results that it moves linearly; empty where it acts on the dataset."""

    def drawn(self, random: np.random.Generator) -> float:
        """Return a deviation as the input is distributed (JCGM 101, 6.4)."""
        u, freedom = self.quantity.standard_uncertainty or 0.0, self.quantity.degrees_of_freedom
        if self.quantity.distribution == "uniform":
            return float(random.uniform(-1.0, 1.0) * math.sqrt(3.0) * u)
        if math.isfinite(freedom):
            return float(random.standard_t(freedom) * u)
        return float(random.standard_normal() * u)


def propagated(
    findings: Findings, trials: int, seed: int, scheduler: str | None, passing: Passing
) -> Findings:
    """Return findings whose estimates say what so many trials make of them.

    An estimate that the trials show to be less certain than its linear propagation claims becomes
    theirs. Raises InputError where the procedure has no Monte Carlo.
    """
    again = findings.trials
    if again is None:
        raise InputError(
            "this procedure has no Monte Carlo yet; analyse without --monte-carlo, by the linear "
            "propagation"
        )
    combined = combine(findings.estimates, findings.inputs)
    pairs = zip(findings.estimates, combined, strict=True)
    determined = {(e.name, e.axis): (e, whole) for e, whole in pairs if whole is not None}
    deviations = deviations_of([e for e, _ in determined.values()], findings.inputs, again)
    ways = {key: estimate.way for key, (estimate, _) in determined.items()}
    values = values_of(again, deviations, ways, trials, seed, scheduler, passing)
    judged = {
        key: judge(*determined[key], own, seed, linear_inputs(key, deviations))
        for key, own in zip(determined, values.T, strict=True)
    }
    estimates = [judged.get((e.name, e.axis), e) for e in findings.estimates]
    return replace(findings, estimates=estimates)


def deviations_of(
    estimates: Sequence[Estimate], inputs: Sequence[InputQuantity], again: Trials
) -> list[Deviation]:
    """Return the inputs that are stated and that move a result.

    A result without u of type A, such as a constant, is moved by no data.
    """
    deviations = []
    for quantity in inputs:
        name, served = quantity.name, {*again.perturbed, *again.drawn}
        moved = [e for e in estimates if e.sensitivities.get(name)]
        if quantity.standard_uncertainty and moved:
            linear = {
                (e.name, e.axis): e.sensitivities[name]
                for e in moved
                if name not in served or not e.standard_uncertainty
            }
            deviations.append(Deviation(quantity, linear))
    return deviations


def linear_inputs(key: Key, deviations: Sequence[Deviation]) -> list[str]:
    """Return the inputs that act on a result by its sensitivity, not through the data."""
    return [each.quantity.name for each in deviations if key in each.sensitivities]


def values_of(
    again: Trials,
    deviations: Sequence[Deviation],
    ways: Ways,
    trials: int,
    seed: int,
    scheduler: str | None,
    passing: Passing,
) -> Array:
    """Return what the trials give, (trials, results); NaN where one gives no value in its way."""
    size = math.ceil(trials / CHUNKS)
    chunks = [range(first, min(first + size, trials)) for first in range(0, trials, size)]
    shared = {"again": again, "deviations": deviations, "ways": ways, "seed": seed}
    values = np.full((trials, len(ways)), np.nan)
    done = each_done(values_of_chunk, chunks, scheduler, **shared)
    for number, own, error in passing(done, len(chunks)):
        if error is not None:
            raise InputError(f"no worker lived through the trials: {error}") from error
        values[chunks[number]] = own
    return values


def values_of_chunk(
    numbers: range, again: Trials, deviations: Sequence[Deviation], ways: Ways, seed: int
) -> Array:
    """Return what some trials give, (numbers, results)."""
    return np.array([values_of_trial(n, again, deviations, ways, seed) for n in numbers])


def deviating(
    again: Trials,
    dataset: Any,
    deviations: Sequence[Deviation],
    drawn: Sequence[float],
    random: np.random.Generator,
) -> Any:
    """Return the dataset as it is where each input that acts on it deviates as drawn."""
    for each, deviation in zip(deviations, drawn, strict=True):
        name, u = each.quantity.name, each.quantity.standard_uncertainty
        if name in again.perturbed:
            dataset = again.perturbed[name](dataset, deviation)
        elif name in again.drawn:
            dataset = again.drawn[name](dataset, u or 0.0, random)
    return dataset


def values_of_trial(
    number: int, again: Trials, deviations: Sequence[Deviation], ways: Ways, seed: int
) -> list[float]:
    """Return what a trial gives for each result; NaN where its analysis finds no solution.

    A value that came another way than that of the data says nothing of it, and is none.
    """
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    drawn = [each.drawn(random) for each in deviations]
    try:
        with quiet_numbers():
            dataset = again.noisy(again.dataset, random)
            dataset = deviating(again, dataset, deviations, drawn, random)
            estimates = again.analyse(dataset).estimates
    except (ArithmeticError, ValueError):  # LinAlgError is a ValueError
        return [math.nan] * len(ways)
    values = {
        (e.name, e.axis): e.value
        for e in estimates
        if e.value is not None and e.way == ways.get((e.name, e.axis))
    }

    def linearly(key: Key) -> float:
        moves = zip(deviations, drawn, strict=True)
        return sum(each.sensitivities.get(key, 0.0) * deviation for each, deviation in moves)

    return [values.get(key, math.nan) + linearly(key) for key in ways]


def judge(
    estimate: Estimate, whole: Combined, values: Array, seed: int, linear: Sequence[str]
) -> Estimate:
    """Return the estimate with what its trials say of its linear propagation."""
    known = np.sort(values[np.isfinite(values)])
    entry: dict[str, Any] = {
        "n": len(values),
        "seed": seed,
        "value": None,
        "standard_uncertainty": None,
        "interval": None,
        "agrees": False,
        "linear_value": estimate.value,
        "linear_expanded_uncertainty": whole.expanded_uncertainty,
        "linear_inputs": list(linear),
        "undetermined": len(values) - len(known),
    }
    judged = replace(estimate, extra={**estimate.extra, "monte_carlo": entry})
    value = estimate.value
    if value is None or len(known) < FEWEST * len(values):
        return judged
    ends, errors = interval_of(known)
    reach = whole.expanded_uncertainty
    near = tolerance(whole.standard_uncertainty, len(known)) + ERRORS * errors
    # How far each end of the linear interval lies outside that of the trials.
    beyond = np.array([ends[0] - (value - reach), (value + reach) - ends[1]])
    own, u = float(known.mean()), float(known.std(ddof=1))
    entry |= {
        "value": own,
        "standard_uncertainty": u,
        "interval": ends.tolist(),
        "agrees": bool(np.all(np.abs(beyond) <= near)),
    }
    if bool(np.any(beyond < -near)) and u > 0.0:
        return replace(judged, value=own, method=MONTE_CARLO)
    return judged


def interval_of(values: Array) -> tuple[Array, Array]:
    """Return the symmetric 95 % interval of sorted values (JCGM 101, 7.7), and its ends' errors.

    An end is an order statistic, whose rank is binomially distributed; few trials tell its error
    badly, which is not taken for less than that of normal deviates.
    """
    count = len(values)
    inside = int(COVERAGE * count + 0.5)
    first = (count - inside) // 2
    places = np.array([max(first - 1, 0), min(first - 1 + inside, count - 1)])
    spread = math.ceil(math.sqrt(count * 0.25 * (1.0 - COVERAGE**2)))
    after, before = np.minimum(places + spread, count - 1), np.maximum(places - spread, 0)
    # At the outermost ranks the difference reaches to one side only.
    steps = (after - before) / (2.0 * spread)
    errors = 0.5 * (values[after] - values[before]) / steps
    return values[places], np.maximum(errors, END * values.std(ddof=1) / math.sqrt(count))


def tolerance(u: float, trials: int) -> float:
    """Return the numerical tolerance of u: half a unit of its last significant digit.

    That is its second digit, or its first where there are fewer than 200,000 trials (JCGM 101,
    7.9.2).
    """
    if not u > 0.0:
        return 0.0
    digits = 2 if trials >= TWO_DIGITS else 1
    exponent = int(f"{u:.{digits - 1}e}".partition("e")[2])
    return float(0.5 * 10.0 ** (exponent - digits + 1))
