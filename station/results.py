"""The result document that other programs rely on: uncertainty, decision, verdict.

The uncertainty budget of type A and type B contributions follows the GUM (computed with GTC).
The decision rule is the plan's: `simple` compares the value alone (JCGM 106, simple acceptance);
`guarded` keeps the expanded uncertainty as guard band, so that a pass and a fail are each right
with the stated coverage.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from station.findings import Estimate, Findings, Flag, InputQuantity, Published, finite

COVERAGE_PERCENT = 95
TYPE_A = "repeatability (from the data)"


@dataclass(frozen=True)
class BudgetLine:
    """One contribution to a standard uncertainty, in the result's unit."""

    description: str
    kind: Literal["A", "B"]
    contribution: float
    source: str

    def to_data(self) -> dict[str, Any]:
        """Return the line as in `results.json`."""
        return {
            "description": self.description,
            "type": self.kind,
            "contribution": self.contribution,
            "source": self.source,
        }


@dataclass(frozen=True)
class Combined:
    """A combined standard uncertainty with its coverage at 95 % and the budget behind it."""

    standard_uncertainty: float
    degrees_of_freedom: float
    coverage_factor: float
    expanded_uncertainty: float
    budget: tuple[BudgetLine, ...]


def combine(
    estimates: Sequence[Estimate], inputs: Sequence[InputQuantity]
) -> list[Combined | None]:
    """Return each estimate's combined uncertainty, None where it has no value.

    Effective degrees of freedom by Welch-Satterthwaite, coverage by Student's t (GUM annex G).
    """
    import GTC

    known = {
        quantity.name: (
            quantity,
            GTC.ureal(0.0, quantity.standard_uncertainty, quantity.degrees_of_freedom),
        )
        for quantity in inputs
        if quantity.standard_uncertainty > 0
    }
    combined: list[Combined | None] = []
    for estimate in estimates:
        if estimate.value is None or estimate.standard_uncertainty is None:
            combined.append(None)
            continue
        dof = estimate.degrees_of_freedom if estimate.degrees_of_freedom is not None else math.inf
        total = GTC.ureal(estimate.value, estimate.standard_uncertainty, dof)
        lines = [BudgetLine(TYPE_A, "A", estimate.standard_uncertainty, "this measurement")]
        for name, sensitivity in estimate.sensitivities.items():
            if name not in known:
                continue
            quantity, uncertain = known[name]
            total = total + sensitivity * uncertain
            contribution = abs(sensitivity) * quantity.standard_uncertainty
            lines.append(BudgetLine(quantity.description, "B", contribution, quantity.source))
        lines.sort(key=lambda line: -line.contribution)
        effective_dof = float(total.df)
        factor = float(GTC.rp.k_factor(effective_dof, COVERAGE_PERCENT))
        standard = float(total.u)
        combined.append(Combined(standard, effective_dof, factor, factor * standard, tuple(lines)))
    return combined


Verdict = Literal["pass", "fail", "inconclusive", "none"]
Rule = Literal["simple", "guarded"]


@dataclass(frozen=True)
class Limit:
    """What a result is held against, in the result's own unit; None does not limit."""

    min: float | None = None
    max: float | None = None
    max_abs: float | None = None

    def to_data(self) -> dict[str, float]:
        """Return the limit as in `results.json`."""
        named = {"min": self.min, "max": self.max, "max_abs": self.max_abs}
        return {name: value for name, value in named.items() if value is not None}

    def interval(self) -> tuple[float, float]:
        """Return the lowest and the highest value that are within the limit."""
        lows = [value for value in (self.min, self.max_abs and -self.max_abs) if value is not None]
        highs = [value for value in (self.max, self.max_abs) if value is not None]
        return max(lows, default=float("-inf")), min(highs, default=float("inf"))


@dataclass(frozen=True)
class Decision:
    """A verdict and, where it is inconclusive, why."""

    verdict: Verdict
    detail: str | None = None


def decide(
    value: float | None, expanded_uncertainty: float | None, limit: Limit | None, rule: Rule
) -> Decision:
    """Return the decision on a value with its expanded uncertainty, both in the limit's unit."""
    if limit is None:
        return Decision("none")
    if value is None or expanded_uncertainty is None:
        return Decision("inconclusive", "undetermined")
    low, high = limit.interval()
    inside = low <= value <= high
    if rule == "simple":
        return Decision("pass" if inside else "fail")
    clearly_inside = low + expanded_uncertainty <= value <= high - expanded_uncertainty
    clearly_outside = value < low - expanded_uncertainty or value > high + expanded_uncertainty
    if clearly_inside:
        return Decision("pass")
    if clearly_outside:
        return Decision("fail")
    return Decision("inconclusive", "conditional-pass" if inside else "conditional-fail")


def overall(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict of a whole: the worst of those that were asked for."""
    asked = set(verdicts)
    for verdict in ("fail", "inconclusive", "pass"):
        if verdict in asked:
            return verdict
    return "none"


SCHEMA = 1
LIMIT_WITHOUT_RESULT = "limit-without-result"
WITHOUT_RESULT: Verdict = "inconclusive"
WRONG_EXCITATION = "wrong-excitation"
"""The flag of a field that is not the commanded one: there is no verdict on the device."""


@dataclass(frozen=True)
class Result:
    """An estimate with its combined uncertainty and the decision on it."""

    estimate: Estimate
    combined: Combined | None
    limit: Limit | None
    decision: Decision

    @property
    def budget(self) -> tuple[BudgetLine, ...]:
        """The contributions to the standard uncertainty, largest first."""
        return self.combined.budget if self.combined else ()

    @property
    def expanded_uncertainty(self) -> float | None:
        """The expanded uncertainty (95 %) in the value's unit; None where nothing is determined."""
        return self.combined.expanded_uncertainty if self.combined else None

    def to_data(self) -> dict[str, Any]:
        """Return the entry of `results`; every number is finite or null."""
        estimate, combined = self.estimate, self.combined
        data: dict[str, Any] = {
            "name": estimate.name,
            "axis": estimate.axis,
            "value": finite(estimate.value),
            "unit": estimate.unit,
            "standard_uncertainty": finite(combined.standard_uncertainty) if combined else None,
            "degrees_of_freedom": finite(combined.degrees_of_freedom) if combined else None,
            "coverage_factor": finite(combined.coverage_factor) if combined else None,
            "expanded_uncertainty": finite(self.expanded_uncertainty),
            "method": estimate.method,
            "limit": self.limit.to_data() if self.limit else None,
            "verdict": self.decision.verdict,
        }
        if self.decision.detail is not None:
            data["decision"] = self.decision.detail
        if combined:
            data["budget"] = [line.to_data() for line in combined.budget]
        return {**data, **estimate.extra}


@dataclass(frozen=True)
class ResultDocument:
    """The whole of `results.json`."""

    procedure: str
    results: Sequence[Result]
    published: Sequence[Published]
    flags: Sequence[Flag]
    verdict: Verdict

    def to_data(self) -> dict[str, Any]:
        """Return the document as plain data."""
        return {
            "schema": SCHEMA,
            "procedure": self.procedure,
            "verdict": self.verdict,
            "results": [result.to_data() for result in self.results],
            "as_published": [published.to_data() for published in self.published],
            "flags": [flag.to_data() for flag in self.flags],
        }

    def result(self, name: str, axis: str | None = None) -> Result:
        """Return one result; KeyError where there is none of that name and axis."""
        for one in self.results:
            if (one.estimate.name, one.estimate.axis) == (name, axis):
                return one
        raise KeyError((name, axis))

    @property
    def excited(self) -> bool:
        """Whether the device was exposed to what was commanded, as far as that was measured."""
        return all(flag.code != WRONG_EXCITATION for flag in self.flags)


def conclude(
    procedure: str,
    findings: Findings,
    limits: Mapping[tuple[str, str | None], Limit],
    rule: Rule,
    *,
    bench_safe: bool = True,
    data_whole: bool = True,
    calibrated: bool = True,
    measured: Mapping[str, tuple[str, ...]] | None = None,
) -> ResultDocument:
    """Combine uncertainties, hold each result against its limit, and give the verdict.

    `limits` is keyed by result name and axis. `measured` says which axes the plan measures of those
    results of which it leaves some out; limits of the others hold for nothing. A bench whose safe
    state was not verified, data of which a part is damaged, a calibration record that is not there
    and a limit whose result is not there cannot pass: the verdict is then at best inconclusive.
    After a wrong excitation nothing is decided: every verdict is inconclusive.
    """
    wrong = any(flag.code == WRONG_EXCITATION for flag in findings.flags)
    combined = combine(findings.estimates, findings.inputs)
    results = []
    for estimate, uncertainty in zip(findings.estimates, combined, strict=True):
        limit = limits.get((estimate.name, estimate.axis))
        expanded = uncertainty.expanded_uncertainty if uncertainty else None
        decision = decide(estimate.value, expanded, limit, rule)
        if wrong and limit is not None:
            decision = Decision("inconclusive", WRONG_EXCITATION)
        results.append(Result(estimate, uncertainty, limit, decision))
    there = {(one.name, one.axis) for one in findings.estimates}
    lacking = [key for key in limits if key not in there and _is_measured(key, measured or {})]
    verdicts = [*(result.decision.verdict for result in results), *(WITHOUT_RESULT,) * len(lacking)]
    verdict = overall(verdicts)
    decided = verdict == "pass" or (verdict == "none" and bool(limits))
    if wrong or (not (bench_safe and data_whole and calibrated) and decided):
        verdict = "inconclusive"
    flags = [*findings.flags, *(_without_result(*key, limits[key]) for key in lacking)]
    return ResultDocument(procedure, results, findings.published, flags, verdict)


def _is_measured(key: tuple[str, str | None], measured: Mapping[str, tuple[str, ...]]) -> bool:
    name, axis = key
    return name not in measured or axis in measured[name]


def _without_result(name: str, axis: str | None, limit: Limit) -> Flag:
    """Return the flag on a limit that nothing can be held against."""
    text = (
        f"{name}{f' {axis}' if axis else ''} has a limit and no result: the procedure does not "
        "return it. Nothing is held against the limit, and the verdict is inconclusive at best."
    )
    details = {"name": name, "limit": limit.to_data()}
    return Flag(LIMIT_WITHOUT_RESULT, text, axis, details)
