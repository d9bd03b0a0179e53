"""The results of a run as a certificate states them: what is measured, decided, left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from station.report.html import BADGES, counted, verdict_words
from station.report.numbers import NOTHING, format_limit, format_with_uncertainty, typeset
from station.results import LIMIT_WITHOUT_RESULT

if TYPE_CHECKING:
    from station.results import Result, ResultDocument

ASSUMED = (
    "The values hold for the device, the conditions and the time of this measurement; they are no "
    "statement on its stability or on other units of the type.",
)
"""What holds for the results of every procedure."""
NOT_SIGNIFICANT = "not-significant"
NEARLY_CERTAIN = 0.999
"""A probability of conformity beyond it is stated as a bound: no model is better known."""


def measured(document: ResultDocument) -> Iterator[Result]:
    """Yield the results that are stated with an uncertainty."""
    for result in document.results:
        if result.estimate.value is not None and not result.by_convention:
            yield result


def verdict_sentence(document: ResultDocument) -> str:
    """Return the verdict on the whole, and how many results it rests on."""
    words = BADGES[document.verdict][1]
    verdicts = [result.decision.verdict for result in document.results if result.limit]
    lacking = sum(flag.code == LIMIT_WITHOUT_RESULT for flag in document.flags)
    if not verdicts and not lacking:
        return words
    undecided = verdicts.count("inconclusive") + lacking
    return f"{words}. {counted(verdicts.count('pass'), verdicts.count('fail'), undecided)}"


def result_row(result: Result) -> tuple[str, ...]:
    """Return a result as printed: U with two significant digits, the value rounded to it."""
    estimate, combined = result.estimate, result.combined
    value, expanded = format_with_uncertainty(estimate.value, result.expanded_uncertainty)
    at = f" at {typeset(estimate.holds_at)}" if estimate.holds_at else ""
    return (
        f"{name_of(result)}{at}",
        estimate.axis or "",
        value,
        expanded,
        f"{combined.coverage_factor:.2f}" if combined else NOTHING,
        estimate.unit,
        format_limit(result.limit),
        verdict_words(result.decision),
        probability_text(result.conformity),
    )


def convention_row(result: Result) -> tuple[str, ...]:
    """Return name, axis, value and unit of what was set by convention."""
    estimate = result.estimate
    return name_of(result), estimate.axis or "", f"{estimate.value:g}", estimate.unit


def name_of(result: Result) -> str:
    """Return what a result measures, in words, and of how many switch-ons."""
    estimate = result.estimate
    name, switch_ons = estimate.words, estimate.extra.get("switch_ons")
    return f"{name} of these {switch_ons} switch-ons" if switch_ons else name


def probability_text(probability: float | None) -> str:
    """Return a probability of conformity in %, never 0 or 100; nothing where there is none."""
    if probability is None:
        return ""
    if probability > NEARLY_CERTAIN:
        return f"> {100.0 * NEARLY_CERTAIN:g} %"
    if probability < 1.0 - NEARLY_CERTAIN:
        return f"< {100.0 * (1.0 - NEARLY_CERTAIN):.1g} %"
    return f"{100.0 * probability:.1f} %"


def left_out(document: ResultDocument) -> Iterator[str]:
    """Yield a sentence that names what the data do not determine, and one on limits of it."""
    missing = [result for result in document.results if result.estimate.value is None]
    if missing:
        yield f"Not determined by these data, and so not stated: {listed(missing)}."
    limited = [result for result in missing if result.limit is not None]
    if limited:
        yield f"Nothing can be held against the limit of {listed(limited)}."


def upper_limits(document: ResultDocument) -> Iterator[str]:
    """Yield a sentence with the upper limit of each result that a flag says is noise alone."""
    noise = {
        (name, flag.axis)
        for flag in document.flags
        if flag.code == NOT_SIGNIFICANT
        for name in flag.details.get("coefficients", ())
    }
    for result in document.results:
        estimate = result.estimate
        limit = estimate.extra.get("upper_limit")
        if limit is not None and (estimate.name, estimate.axis) in noise:
            shown = format_with_uncertainty(limit, result.expanded_uncertainty)[0]
            stated = shown if estimate.unit == "1" else f"{shown} {estimate.unit}"
            yield f"{listed([result])}: the upper limit (95 %) is {stated}."


def listed(results: Iterable[Result]) -> str:
    """Return the names of results, each with all its axes."""
    axes: dict[str, list[str]] = {}
    for result in results:
        axes.setdefault(name_of(result), []).extend(filter(None, [result.estimate.axis]))
    return "; ".join(
        f"{name} of axes {' '.join(named)}" if named[1:] else f"{name} of axis {named[0]}"
        if named else name
        for name, named in axes.items()
    )  # fmt: skip
