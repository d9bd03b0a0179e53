"""The result document that other programs rely on: estimates, uncertainty, decision, verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from station.decision import Decision, Limit, Rule, Verdict, conformity, decide, overall
from station.findings import Covariance, Estimate, Findings, Flag, Published, finite
from station.uncertainty import BudgetLine, Combined, combine, covariance_of

SCHEMA = 1
NUMBERS = (
    "standard_uncertainty",
    "degrees_of_freedom",
    "coverage_factor",
    "expanded_uncertainty",
)
LIMIT_WITHOUT_RESULT = "limit-without-result"
WITHOUT_RESULT: Verdict = "inconclusive"
WRONG_EXCITATION = "wrong-excitation"
"""The flag of a field that is not the commanded one: there is no verdict on the device."""
UNCALIBRATED = "uncalibrated"
OUTSIDE_RANGE = "outside-certified-range"
UNSAFE = "safe-state-unverified"
WITHHOLDING = (
    WRONG_EXCITATION,
    UNCALIBRATED,
    OUTSIDE_RANGE,
    UNSAFE,
    "data-damaged",
    "run-goes-on",
)
"""Flags with which no single result counts as within its limit."""


@dataclass(frozen=True)
class Result:
    """An estimate with its combined uncertainty and the decision on it."""

    estimate: Estimate
    combined: Combined | None
    limit: Limit | None
    decision: Decision
    guard_band: float = 0.0
    """By how much the value must be within its limit, in its unit."""
    conformity: float | None = None
    """The probability that the quantity is within its limit; None without one."""

    @property
    def budget(self) -> tuple[BudgetLine, ...]:
        """The contributions to the standard uncertainty, largest first."""
        return self.combined.budget if self.combined else ()

    @property
    def expanded_uncertainty(self) -> float | None:
        """The expanded uncertainty (95 %) in the value's unit; None where nothing is determined."""
        return self.combined.expanded_uncertainty if self.combined else None

    @property
    def by_convention(self) -> bool:
        """Whether the value was set and not measured: it has no uncertainty."""
        return self.combined is not None and self.combined.standard_uncertainty == 0.0

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
        if self.limit is not None:
            data["guard_band"] = finite(self.guard_band)
            data["conformity_probability"] = finite(self.conformity)
        if combined:
            data["budget"] = [line.to_data() for line in combined.budget]
        return {**data, **estimate.extra}

    def withheld(self, flags: Iterable[Flag]) -> Result:
        """Return the result as it counts with these flags: not within its limit where they deny it.

        After a wrong excitation it is not outside either. No probability of conformity is left.
        """
        codes = {flag.code for flag in flags}
        why = next((code for code in WITHHOLDING if code in codes), None)
        if why is None or self.limit is None:
            return self
        decision = self.decision
        if why == WRONG_EXCITATION or decision.verdict == "pass":
            decision = Decision("inconclusive", why)
        return replace(self, decision=decision, conformity=None)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Result:
        """Return the result that `to_data` wrote."""
        rest = dict(data)
        name, axis, value, unit = (rest.pop(key) for key in ("name", "axis", "value", "unit"))
        numbers = [rest.pop(key) for key in NUMBERS]
        method, limit, verdict = (rest.pop(key) for key in ("method", "limit", "verdict"))
        decision = Decision(verdict, rest.pop("decision", None))
        band, likely = rest.pop("guard_band", 0.0), rest.pop("conformity_probability", None)
        budget = tuple(BudgetLine.of(line) for line in rest.pop("budget", ()))
        own = next((line for line in budget if line.kind == "A"), None)
        estimate = Estimate(
            name,
            axis,
            value,
            unit,
            own.standard_uncertainty if own else None,
            finite(own.degrees_of_freedom) if own else None,
            method,
            {line.quantity: line.sensitivity for line in budget if line.kind == "B"},
            rest,
        )
        u, dof, factor, expanded = numbers
        dof = math.inf if dof is None else dof
        combined = None if u is None else Combined(u, dof, factor, expanded, budget)
        return cls(estimate, combined, limit and Limit(**limit), decision, band or 0.0, likely)


@dataclass(frozen=True)
class ResultDocument:
    """The whole of `results.json`."""

    procedure: str
    results: Sequence[Result]
    published: Sequence[Published]
    flags: Sequence[Flag]
    verdict: Verdict
    covariance: Covariance | None = None

    def to_data(self) -> dict[str, Any]:
        """Return the document as plain data."""
        related = {"covariance": self.covariance.to_data()} if self.covariance else {}
        return {
            "schema": SCHEMA,
            "procedure": self.procedure,
            "verdict": self.verdict,
            "results": [result.to_data() for result in self.results],
            "as_published": [published.to_data() for published in self.published],
            "flags": [flag.to_data() for flag in self.flags],
            **related,
        }

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> ResultDocument:
        """Return the document that `to_data` wrote; raises KeyError or TypeError.

        Results of before flags withheld them are withheld.
        """
        flags = [Flag.of(entry) for entry in data["flags"]]
        return cls(
            data["procedure"],
            [Result.of(entry).withheld(flags) for entry in data["results"]],
            [Published(**entry) for entry in data["as_published"]],
            flags,
            data["verdict"],
            Covariance.of(data["covariance"]) if "covariance" in data else None,
        )

    def result(self, name: str, axis: str | None = None) -> Result:
        """Return one result; KeyError where there is none of that name and axis."""
        for result in self.results:
            if (result.estimate.name, result.estimate.axis) == (name, axis):
                return result
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
    measured: Mapping[str, tuple[str, ...]] | None = None,
) -> ResultDocument:
    """Combine uncertainties, hold each result against its limit, and give the verdict.

    `limits` is keyed by result name and axis. `measured` says which axes the plan measures of those
    results of which it leaves some out; limits of the others hold for nothing. With a flag of
    `WITHHOLDING`, and where a limit's result is not there, the verdict is at best inconclusive.
    After a wrong excitation nothing is decided: every verdict is inconclusive.
    """
    codes = {flag.code for flag in findings.flags}
    combined = combine(findings.estimates, findings.inputs)
    results = [
        result_of(
            estimate, uncertainty, limits.get((estimate.name, estimate.axis)), rule, findings.flags
        )
        for estimate, uncertainty in zip(findings.estimates, combined, strict=True)
    ]
    there = {(estimate.name, estimate.axis) for estimate in findings.estimates}
    lacking = [key for key in limits if key not in there and _is_measured(key, measured or {})]
    verdicts = [*(result.decision.verdict for result in results), *(WITHOUT_RESULT,) * len(lacking)]
    verdict = overall(verdicts)
    unasked = verdict == "none" and (WRONG_EXCITATION in codes or bool(limits))
    if unasked and not codes.isdisjoint(WITHHOLDING):
        verdict = "inconclusive"
    flags = [*findings.flags, *(_without_result(*key, limits[key]) for key in lacking)]
    related = covariance_of(findings.estimates, findings.inputs, findings.covariance)
    return ResultDocument(procedure, results, findings.published, flags, verdict, related)


def result_of(
    estimate: Estimate,
    combined: Combined | None,
    limit: Limit | None,
    rule: Rule,
    flags: Iterable[Flag],
) -> Result:
    """Return an estimate held against its limit, as it counts with these flags."""
    expanded = combined.expanded_uncertainty if combined else None
    decision = decide(estimate.value, expanded, limit, rule)
    band = (expanded or 0.0) if rule == "guarded" else 0.0
    likely = None
    if combined:
        u, dof = combined.standard_uncertainty, combined.degrees_of_freedom
        likely = conformity(estimate.value, u, dof, limit)
    return Result(estimate, combined, limit, decision, band, likely).withheld(flags)


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
