"""A part that lacks records determines none of its figures, and names what it lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from station.findings import Analysis, Flag, undetermined
from station.procedure import ResultKind


def not_measured(part: str, results: Mapping[str, ResultKind], missing: Sequence[str]) -> Analysis:
    """Return the analysis of a part that lacks records: no figure is determined.

    `results`: name to axes and unit of the part's figures; `missing`: units of work.
    """
    estimates = [
        undetermined(name, axis, kind.unit, "")
        for name, kind in results.items()
        for axis in kind.axes or (None,)
    ]
    message = (
        f"Not recorded: {', '.join(missing)}. The figures of the part {part} are determined "
        "together, or not at all."
    )
    details = {
        "units": list(missing),
        "coefficients": [
            f"{estimate.name} {estimate.axis or ''}".strip() for estimate in estimates
        ],
    }
    return Analysis(estimates, (), (Flag("not-measured", message, details=details),))
