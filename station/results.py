"""What a procedure found, and the result document that other programs rely on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from station.decision import Decision, Limit, Rule, Verdict, decide, overall
from station.uncertainty import BudgetLine, Combined, InputQuantity, combine

SCHEMA = 1


@dataclass(frozen=True)
class Estimate:
    """A quantity that the data gave, with its type A uncertainty and what else it depends on.

    `sensitivities` maps the name of an input quantity to d value / d input; `extra` goes into the
    result as it is (terms of a combination, a model's coefficients).
    """

    name: str
    axis: str | None
    value: float | None
    unit: str
    standard_uncertainty: float | None
    degrees_of_freedom: float | None
    method: str
    sensitivities: Mapping[str, float] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Published:
    """What the source document's own formula gives on the same data."""

    name: str
    axis: str | None
    value: float | None
    unit: str
    method: str

    def to_data(self) -> dict[str, Any]:
        """Return the entry of `as_published`."""
        return {
            "name": self.name,
            "axis": self.axis,
            "value": finite(self.value),
            "unit": self.unit,
            "method": self.method,
        }


@dataclass(frozen=True)
class Flag:
    """Something the reader must know, with a code that programs rely on."""

    code: str
    message: str
    axis: str | None = None
    details: Mapping[str, Any] = field(default_factory=dict)

    def to_data(self) -> dict[str, Any]:
        """Return the entry of `flags`."""
        data: dict[str, Any] = {"code": self.code, "axis": self.axis, "message": self.message}
        return {**data, **self.details}


@dataclass(frozen=True)
class Findings:
    """All that an analysis says; `detail` is the procedure's own, for its report."""

    estimates: Sequence[Estimate]
    published: Sequence[Published]
    flags: Sequence[Flag]
    inputs: Sequence[InputQuantity]
    detail: Any


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
            "expanded_uncertainty": finite(combined.expanded_uncertainty) if combined else None,
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


def conclude(
    procedure: str,
    findings: Findings,
    limits: Mapping[tuple[str, str | None], Limit],
    rule: Rule,
    *,
    bench_safe: bool = True,
) -> ResultDocument:
    """Combine uncertainties, hold each result against its limit, and give the verdict.

    `limits` is keyed by result name and axis. A bench whose safe state was not verified cannot
    pass: the verdict is then at best inconclusive.
    """
    combined = combine(findings.estimates, findings.inputs)
    results = []
    for estimate, uncertainty in zip(findings.estimates, combined, strict=True):
        limit = limits.get((estimate.name, estimate.axis))
        expanded = uncertainty.expanded_uncertainty if uncertainty else None
        decision = decide(estimate.value, expanded, limit, rule)
        results.append(Result(estimate, uncertainty, limit, decision))
    verdict = overall(result.decision.verdict for result in results)
    if not bench_safe and verdict == "pass":
        verdict = "inconclusive"
    return ResultDocument(procedure, results, findings.published, findings.flags, verdict)


def finite(value: float | None) -> float | None:
    """Return the value, or None where it is no finite number."""
    return float(value) if value is not None and math.isfinite(value) else None
