"""No U below the laboratory's calibration and measurement capability (CMC) is stated."""

from __future__ import annotations

from dataclasses import replace
from decimal import ROUND_CEILING, Decimal
from typing import TYPE_CHECKING

from station.decision import overall
from station.errors import InputError
from station.report.certificate_results import listed
from station.results import result_of
from station.units import UnitError

if TYPE_CHECKING:
    from station.decision import Rule
    from station.instruments.laboratory import Laboratory
    from station.results import Result, ResultDocument


def not_below_cmc(
    document: ResultDocument, laboratory: Laboratory | None, rule: Rule
) -> tuple[ResultDocument, tuple[str, ...]]:
    """Return the results with every U at least the CMC, and a sentence that names those raised.

    What is decided on them is decided again, with the larger U. Raises InputError for a CMC in
    another dimension than the result.
    """
    if laboratory is None or not laboratory.cmc:
        return document, ()
    results, raised = [], []
    for result in document.results:
        smallest = smallest_printed(cmc_of(laboratory, result))
        combined = None if result.by_convention else result.combined
        if smallest is None or combined is None or combined.expanded_uncertainty >= smallest:
            results.append(result)
            continue
        # At the measurement's own coverage factor.
        combined = replace(
            combined,
            standard_uncertainty=smallest / combined.coverage_factor,
            expanded_uncertainty=smallest,
        )
        results.append(result_of(result.estimate, combined, result.limit, rule, document.flags))
        raised.append(result)
    if not raised:
        return document, ()
    verdict = document.verdict
    if verdict in ("pass", "fail"):
        verdict = overall(result.decision.verdict for result in results)
    sentence = (
        f"U is the laboratory's calibration and measurement capability (CMC), and not the smaller "
        f"one of this measurement, for: {listed(raised)}."
    )
    return replace(document, results=results, verdict=verdict), (sentence,)


def smallest_printed(cmc: float | None) -> float | None:
    """Return the smallest U of two significant digits that is not below a CMC."""
    if not cmc:
        return cmc
    exact = Decimal(f"{cmc:.12g}")  # a conversion of its unit leaves its last digits
    return float(exact.quantize(Decimal(1).scaleb(exact.adjusted() - 1), ROUND_CEILING))


def cmc_of(laboratory: Laboratory | None, result: Result) -> float | None:
    """Return the smallest U of a result that its laboratory may state; None without one."""
    estimate = result.estimate
    if laboratory is None:
        return None
    try:
        return laboratory.smallest_expanded(estimate.name, estimate.unit)
    except UnitError as error:
        raise InputError(f"`laboratory.cmc.{estimate.name}` of the bench file: {error}") from error
