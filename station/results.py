"""The result document that other programs rely on: findings, held against their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from station.decision import Decision, Limit, Rule, Verdict, decide, overall
from station.findings import Estimate, Findings, Flag, Published, finite
from station.uncertainty import BudgetLine, Combined, combine

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
    said = (
        f"{name}{f' {axis}' if axis else ''} has a limit and no result: the procedure does not "
        "return it. Nothing is held against the limit, and the verdict is inconclusive at best."
    )
    details = {"name": name, "limit": limit.to_data()}
    return Flag(LIMIT_WITHOUT_RESULT, said, axis, details)
