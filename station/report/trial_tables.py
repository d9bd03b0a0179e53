"""The table of a Monte Carlo in a report: linear intervals beside those of the trials."""

from __future__ import annotations

from collections.abc import Iterator

from station.parts import Table
from station.report.numbers import NOTHING, format_with_uncertainty
from station.results import ResultDocument
from station.uncertainty import MONTE_CARLO

COLUMNS = (
    *("Quantity", "Axis", "Linear", "U", "Trials", "u", "From", "To", "Unit", "Agree"),
    "Only linear",
)


def trial_tables(document: ResultDocument) -> Iterator[Table]:
    """Yield the table where there were trials."""
    rows = [
        (result.estimate, result.estimate.extra["monte_carlo"])
        for result in document.results
        if "monte_carlo" in result.estimate.extra
    ]
    if not rows:
        return
    entry = rows[0][1]
    caption = (
        f"{entry['n']} trials of the whole analysis, seed {entry['seed']}: other noise, and every "
        "stated input as it is distributed. They agree where both ends lie no farther apart than "
        "half a unit of the last significant digit of u, one digit below 200,000 trials and two "
        "above, and three standard errors of the end (JCGM 101, clause 8). Where the interval of "
        "the trials reaches out of the linear one by more, the result is that of the trials; where "
        "it stays within, u holds what trials of the same model cannot show, and the linear result "
        "stays."
    )
    cells = []
    for estimate, own in rows:
        value, reach = format_with_uncertainty(
            own["linear_value"], own["linear_expanded_uncertainty"]
        )
        mean, u = format_with_uncertainty(own["value"], own["standard_uncertainty"])
        ends = own["interval"] or (None, None)
        low, high = (
            NOTHING if end is None else format_with_uncertainty(end, own["standard_uncertainty"])[0]
            for end in ends
        )
        agree = "yes" if own["agrees"] else "no"
        if estimate.method == MONTE_CARLO:
            agree = "no: the trials hold"
        cells.append(
            (
                *(estimate.measures, estimate.axis or "", value, reach, mean, u, low, high),
                *(estimate.unit, agree, ", ".join(own["linear_inputs"])),
            )
        )
    yield Table("Monte Carlo", caption, COLUMNS, cells)
