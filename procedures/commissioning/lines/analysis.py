"""Latency of a line and the answers that it loses: a pure function of what was asked."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, Flag, undetermined

from .limits import LOST as MAY_BE_LOST
from .limits import NEAR, SLOWEST_MS
from .parameters import JITTER, KEPT, LATENCY, LONGEST, LOST, SLOWEST

Array = NDArray[np.float64]
MEDIAN, P99 = 0.5, 0.99


@dataclass(frozen=True)
class Answers:
    """Answers of one instrument, shape (n,): latency in s (NaN: none came), came, and as before."""

    latency_s: Array
    answered: NDArray[np.bool_]
    same: NDArray[np.bool_]


@dataclass(frozen=True)
class Kept:
    """Errors in an instrument's queue: from before it is asked anything, and since."""

    before: tuple[str, ...]
    since: tuple[str, ...]


@dataclass(frozen=True)
class AnswerTime:
    """How long an answer took, its deadline, and the most that a bench may give it, s."""

    message: str
    took_s: float
    deadline_s: float
    most_s: float

    @property
    def is_near(self) -> bool:
        """Whether the answer came near its deadline."""
        return self.took_s > NEAR * self.deadline_s

    @property
    def longer_s(self) -> float:
        """The deadline to write instead, tenths of a second, twice what the answer took."""
        return min(math.ceil(10.0 * self.took_s / NEAR) / 10.0, self.most_s)


def analyse(
    asked: Mapping[str, Answers],
    returned: Mapping[str, Answers],
    kept: Mapping[str, Kept],
    longest: Mapping[str, AnswerTime] | None = None,
) -> Analysis:
    """Return latency, lost answers and kept errors by instrument, and causes.

    `asked`: answers by instrument; `returned`: those after its cable was pulled and plugged in;
    `kept`: errors of those that have a queue of them; `longest`: the answer of any part of the run
    that took the largest share of its deadline, where that was a tenth or more.
    """
    estimates: list[Estimate] = []
    flags: list[Flag] = []
    longest = longest or {}
    for name, answers in asked.items():
        came_s = answers.latency_s[answers.answered]
        estimates += [
            quantile(LATENCY, name, came_s, MEDIAN),
            quantile(SLOWEST, name, came_s, P99),
            longest_answer(name, came_s, longest.get(name)),
            jitter(name, came_s),
            Estimate(LOST, name, float((~answers.same).sum()), "1", 0.0, None, "answers counted"),
        ]
        flags += _causes(name, answers, estimates[-4].value, longest.get(name))
    for name, errors in kept.items():
        count = float(len(errors.before) + len(errors.since))
        estimates.append(Estimate(KEPT, name, count, "1", 0.0, None, "errors counted"))
        flags += _kept_causes(name, errors)
    for name, answers in returned.items():
        if not answers.same[-1]:
            message = (
                f"{name} does not answer as itself after its cable was pulled and plugged in "
                "again: look at the plug, or switch it off and on; a run that loses it must be "
                "started again."
            )
            flags.append(Flag("line-does-not-return", message, name))
    return Analysis(estimates, (), tuple(flags))


def quantile(name: str, axis: str, latency_s: Array, share: float) -> Estimate:
    """Return a quantile of latencies in ms; its uncertainty is that of its rank, binomial."""
    if not len(latency_s):
        return undetermined(name, axis, "ms", "no answer came")
    rank_u = math.sqrt(share * (1.0 - share) / len(latency_s))
    around = (max(share - rank_u, 0.0), share, min(share + rank_u, 1.0))
    low, value, high = 1e3 * np.quantile(latency_s, around)
    method = f"quantile {share:g} of the latencies"
    return Estimate(name, axis, float(value), "ms", float(high - low) / 2.0, None, method)


def longest_answer(axis: str, latency_s: Array, longest: AnswerTime | None) -> Estimate:
    """Return the largest answer time in ms, of an identity or of what took longer."""
    took_s = [*latency_s, *([longest.took_s] if longest else [])]
    if not took_s:
        return undetermined(LONGEST, axis, "ms", "no answer came")
    return Estimate(LONGEST, axis, 1e3 * float(max(took_s)), "ms", 0.0, None, "largest of the run")


def jitter(axis: str, latency_s: Array) -> Estimate:
    """Return the standard deviation of latencies in ms, with that of normal ones as its own."""
    freedom = len(latency_s) - 1
    if freedom < 1:
        return undetermined(JITTER, axis, "ms", "fewer than two answers came")
    value = 1e3 * float(np.std(latency_s, ddof=1))
    u, method = value / math.sqrt(2.0 * freedom), "standard deviation of the latencies"
    return Estimate(JITTER, axis, value, "ms", u, float(freedom), method)


def _causes(
    name: str, answers: Answers, slowest_ms: float | None, longest: AnswerTime | None
) -> Iterator[Flag]:
    lost, others = int((~answers.answered).sum()), int((answers.answered & ~answers.same).sum())
    if lost > MAY_BE_LOST:
        message = (
            f"{name} leaves {lost} of {len(answers.answered)} questions without a whole answer: "
            "check cable, connectors and bit rate, and that nobody else talks to it."
        )
        yield Flag("line-loses-answers", message, name)
    if others:
        message = (
            f"{name} answers {others} of {len(answers.answered)} questions as another instrument: "
            "two units share its address, or the line is out of step."
        )
        yield Flag("line-identity-changes", message, name)
    if longest is not None and longest.is_near:
        message = (
            f"{name} answers {longest.message} after {longest.took_s:.2f} s, near its deadline of "
            f"{longest.deadline_s:g} s: an answer that comes later ends a run. Look at the "
            "adapter's latency and at what else loads the line; where the instrument itself takes "
            f"so long, write `deadline: {longest.longer_s:g} s` at it in the bench file."
        )
        yield Flag("line-slow", message, name)
    elif slowest_ms is not None and slowest_ms > SLOWEST_MS:
        message = (
            f"The line of {name} takes {slowest_ms:.0f} ms for its slowest answers (99th "
            f"percentile), more than {SLOWEST_MS:.0f} ms: an interlock would look too late. Look "
            "at the adapter's latency and at what else loads the line."
        )
        yield Flag("line-slow", message, name)


def _kept_causes(name: str, errors: Kept) -> Iterator[Flag]:
    if errors.before:
        message = (
            f"{name} keeps {len(errors.before)} errors from before the run, the oldest "
            f"{errors.before[0]}; its queue is empty now. Find out who used it last, and run again."
        )
        yield Flag("error-queue-not-empty", message, name)
    if errors.since:
        message = (
            f"{name} reports {len(errors.since)} errors though it is only asked who it is, the "
            f"oldest {errors.since[0]}: nobody else may talk to it, and its line may not disturb "
            "what is sent."
        )
        yield Flag("error-while-asked", message, name)
