"""What the calibration records of a bench lack for a plan, and what of them it does not use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from station.files.faults import listed
from station.findings import Flag
from station.results import OUTSIDE_RANGE, UNCALIBRATED
from station.units import format_quantity

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.procedure import Procedure


def record_flags(
    procedure: Procedure,
    parameters: Any,
    bench: Bench,
    measured: Mapping[tuple[str, str], tuple[float, ...]] = MappingProxyType({}),
) -> Iterator[Flag]:
    """Yield what the budget of a plan lacks of calibration records, and what of them is not used.

    Only the instruments that the plan uses count. A record covers what the plan says, and what was
    `measured`, where that is known.
    """
    uses = procedure.records(parameters, bench)
    in_budget = [use for use in uses if use.in_budget]
    stating = [
        use
        for use in in_budget
        if ("uncertainty", use.quantity) in bench.statements(use.instrument)
    ]
    absent = [use for use in in_budget if use.needed and use not in stating]
    outside = []
    for use in stating:
        planned = (use.at,) if use.needed else ()
        values = [*planned, *measured.get((use.instrument, use.quantity), ())]
        beyond = [
            value
            for value in values
            if bench.stated(use.instrument, use.quantity, value, use.unit) is None
        ]
        if beyond:
            outside.append(replace(use, at=max(beyond, key=abs)))
    if absent:
        named = listed(f"{use.instrument} ({use.quantity})" for use in absent)
        yield Flag(
            UNCALIBRATED,
            f"No calibration record states the uncertainty of {named}: u is too small by that "
            "part, and the verdict is at best inconclusive. Have it calibrated, and write what the "
            "certificate states under `calibration` in the bench file.",
            details={"instruments": list(dict.fromkeys(use.instrument for use in absent))},
        )
    for use in outside:
        at = format_quantity(float(f"{use.at:.7g}"), use.unit)
        yield Flag(
            OUTSIDE_RANGE,
            f"The calibration record of {use.instrument} states the uncertainty of {use.quantity} "
            f"over a range that does not hold {at}: u is too small by that part, and the verdict "
            "is at best inconclusive. Measure within the range, or have it calibrated there.",
            details={"instrument": use.instrument, "quantity": use.quantity, "value": at},
        )
    for name in procedure.walk(parameters).used_on(bench):
        unused = [
            f"{kind} of {quantity}"
            for kind, quantity in bench.statements(name)
            if not any(
                use.instrument == name
                and use.quantity == quantity
                and (use.in_budget if kind == "uncertainty" else use.corrected)
                for use in uses
            )
        ]
        if unused:
            yield Flag(
                "calibration-unused",
                f"The calibration record of {name} states the {listed(unused)}, which the "
                "evaluation of this plan does not use: it is neither in the results nor in u. "
                "Where they depend on it, add its part by hand; where another quantity was meant, "
                "correct the bench file.",
                details={"instrument": name, "unused": unused},
            )
