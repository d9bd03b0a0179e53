"""Monte Carlo in this process, and the sensitivities of an analysis held against it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import pytest

from station.findings import Findings, InputQuantity, Trials
from station.reanalysis import monte_carlo
from station.reanalysis.monte_carlo import Chunk, propagated

NEAR = 0.02
"""What a declared sensitivity is held to."""
SEEN = 0.01
"""Of an estimate's u of type A: an input that moves it by less may move it otherwise."""


def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the trials be done here, without Dask."""

    def done(function: Any, items: Sequence[Any], scheduler: object, **shared: Any) -> Any:
        for number, item in reversed([*enumerate(items)]):
            yield number, function(item, **shared), None

    monkeypatch.setattr(monte_carlo, "each_done", done)


def tried(findings: Findings, trials: int = 400, seed: int = 1) -> Findings:
    """Return findings with a Monte Carlo that reports nothing."""
    return propagated(findings, trials, seed, None, passed)


def passed(done: Iterator[Chunk], count: int) -> Iterator[Chunk]:
    """Pass on what is done."""
    return done


def trials_in(findings: Findings) -> Trials:
    """Return how findings are tried again."""
    assert findings.trials is not None
    return findings.trials


def wrong_sensitivities(
    findings: Findings, inputs: Sequence[InputQuantity], near: float = NEAR
) -> dict[tuple[str, str, str | None], tuple[float, float]]:
    """Return declared sensitivities, and those that each input's u has through the analysis, where
    they differ: by input, name and axis.

    What an input moves by less than a hundredth of u of type A is not held.
    """
    trials, wrong = trials_in(findings), {}
    for quantity in inputs:
        u, change = quantity.standard_uncertainty or 0.0, trials.perturbed.get(quantity.name)
        if change is None:
            continue
        up, down = (
            {(e.name, e.axis): e.value for e in trials.analyse(data).estimates}
            for data in (change(trials.dataset, u), change(trials.dataset, -u))
        )
        for estimate in findings.estimates:
            key = estimate.name, estimate.axis
            above, below = up[key], down[key]
            if estimate.value is None or above is None or below is None:
                continue
            declared = estimate.sensitivities.get(quantity.name, 0.0)
            seen = (above - below) / (2.0 * u)
            off = abs(seen - declared) * u
            if off > near * abs(declared) * u + SEEN * (estimate.standard_uncertainty or 0.0):
                wrong[quantity.name, *key] = declared, seen
    return wrong


def with_inputs(findings: Findings, **u: float) -> Findings:
    """Return findings whose inputs are stated so."""
    named = {quantity.name: quantity for quantity in findings.inputs}
    stated = [
        replace(named[name], standard_uncertainty=own, distribution="normal", source="the test")
        for name, own in u.items()
    ]
    return replace(findings, inputs=stated)
