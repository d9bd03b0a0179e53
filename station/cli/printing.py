"""Results as text for a terminal."""

from __future__ import annotations

from station.report.numbers import format_like, format_with_uncertainty
from station.results import ResultDocument


def print_document(document: ResultDocument) -> None:
    """Print results with expanded uncertainties, the published values, flags and the verdict."""
    published = {(one.name, one.axis): one for one in document.published}
    for result in document.results:
        estimate, combined = result.estimate, result.combined
        expanded = combined.expanded_uncertainty if combined else None
        value, uncertainty = format_with_uncertainty(estimate.value, expanded)
        line = f"{estimate.measures} {estimate.axis or '':<3} {value:>10}"
        if combined:
            line += f" ± {uncertainty} {estimate.unit} (k = {combined.coverage_factor:.2f})"
        if estimate.holds_at:
            line += f" at {estimate.holds_at}"
        other = published.get((estimate.name, estimate.axis))
        if other is not None and other.value is not None:
            line += f"   as published {format_like(other.value, value)}"
        if result.limit is not None:
            line += f"   {result.decision.verdict}"
        print(line)
    for flag in document.flags:
        print(f"{flag.code}{f' {flag.axis}' if flag.axis else ''}: {flag.message}")
    print(f"verdict: {document.verdict}")
