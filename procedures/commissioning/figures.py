"""What a commissioning adds to the report: what failed, and a checklist to sign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from station.findings import NOT_TRIED, Findings
from station.parts import Part as ReportPart
from station.parts import Table
from station.report.numbers import format_limit, format_result
from station.results import Result, ResultDocument

from . import PARTS
from .part import CAUSES, NOT_MEASURED, UNDECIDED, Part

OUTCOME = {True: "answered", False: "REFUSED"}
PASSED, FAILED, OPEN = "passed", "FAILED", "not decided"


def draw_parts(findings: Findings, document: ResultDocument) -> tuple[ReportPart, ...]:
    """Return what failed, what was not tried or written, and the checklist to sign."""
    failed = list(_failed(findings, document))
    nothing = [("–", "–", "nothing failed of what was tried", "–")]
    untried = [flag for flag in findings.flags if flag.code == NOT_TRIED]
    checks = [check for flag in untried for check in flag.details["checks"]]
    withheld, commissioned = findings.detail.withheld, findings.detail.commissioned
    parts: list[ReportPart] = [
        Table(
            "What failed",
            "Named causes first, then figures outside their limits, then what is not decided. Mend "
            "each, and commission the bench again before a method relies on it.",
            ("check", "axis", "what", "limit"),
            failed or nothing,
        ),
    ]
    left_out = [(part.replace("_", " "), "left out") for part in sorted(findings.detail.left_out)]
    if checks or left_out:
        parts.append(
            Table(
                "What was not tried",
                "Nothing is known of it. `station commission` ends with 3 where a part that was "
                "chosen has a check that was not tried.",
                ("check", "why"),
                [*(check.partition(", ")[::2] for check in checks), *left_out],
            )
        )
    if withheld:
        parts.append(
            Table(
                "What was not written",
                "Figures that a cause touches are written into no bench file while it is open.",
                ("figures of", "open causes"),
                [(part.part.replace("_", " "), ", ".join(part.causes)) for part in withheld],
            )
        )
    if commissioned is not None and commissioned.tried:
        parts.append(
            Table(
                "What was tried of what no document confirms",
                "Questions of the drivers' command tables that do no harm. One that is refused is "
                "a row of the table that does not hold for this unit.",
                ("instrument", "asked", "answer", "outcome"),
                [
                    (each.instrument, each.command, each.answer, OUTCOME[each.confirmed])
                    for each in commissioned.tried
                ],
            )
        )
    parts.append(
        Table(
            "Checklist",
            "To be signed by who commissioned the bench. `station sign` signs the whole run folder "
            "with the laboratory's key; `station verify` shows by whom and when.",
            ("check", "what was done", "figures", "outcome", "name, date, signature"),
            [line for part in PARTS if (line := _line(part, document, checks)) is not None],
        )
    )
    return tuple(parts)


def _failed(findings: Findings, document: ResultDocument) -> Iterator[tuple[str, ...]]:
    named: Sequence[str] = next(
        (result.estimate.extra.get("codes", ()) for result in _of(document, (CAUSES,))), ()
    )
    for flag in findings.flags:
        if flag.code in named:
            yield flag.code, flag.axis or "", flag.message, ""
    outside = [result for result in document.results if result.decision.verdict == "fail"]
    for result in outside:
        if result.estimate.name != CAUSES:
            value, unit = format_result(result)[0], result.estimate.unit
            name = result.estimate.name.replace("_", " ")
            axis = result.estimate.axis or ""
            yield name, axis, f"{value} {unit}", format_limit(result.limit)
    for flag in findings.flags:
        if flag.code.endswith(UNDECIDED) or flag.code == NOT_MEASURED:
            yield flag.code, flag.axis or "", flag.message, ""


def _line(part: Part, document: ResultDocument, untried: Sequence[str]) -> tuple[str, ...] | None:
    """Return a part's line of the checklist; None where nothing of it was done."""
    results = list(_of(document, tuple(part.results)))
    decided = [result.decision.verdict for result in results if result.limit is not None]
    known = [result for result in results if result.estimate.value is not None]
    if not known:
        return None
    if "fail" in decided:
        outcome = FAILED
    elif "inconclusive" in decided or len(known) < len(results):
        outcome = OPEN
    else:
        outcome = PASSED
    left_out = {check.partition(", ")[0] for check in untried}
    done = "; ".join(step.title for step in part.steps if step.number not in left_out)
    return part.name.replace("_", " "), done, f"{len(known)} of {len(results)}", outcome, ""


def _of(document: ResultDocument, names: tuple[str, ...]) -> Iterator[Result]:
    return (result for result in document.results if result.estimate.name in names)
