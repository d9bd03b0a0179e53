"""Whether a plan fits a bench before anything is energised: each set-point against each limit.

What a procedure commands comes from its forecast; what may not be exceeded stands in the bench
file. The same is programmed into the instruments and watched by interlocks later.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from station.method.set_points import checks_of
from station.procedure import Problem
from station.units import parse_as

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.method.dry_run import Forecast
    from station.method.set_points import SetPoint
    from station.procedure import Procedure

RESISTANCE = "coil_resistance"
PARAMETERS = ("parameters",)


def problems_of_plan(procedure: Procedure, parameters: Any, bench: Bench) -> Iterator[Problem]:
    """Yield every reason why a plan cannot run on a bench, each once.

    Instruments that the bench lacks, what the procedure itself finds, and every limit of the bench
    that a set-point would exceed.
    """
    problems = [
        Problem(("procedure",), f"the bench {bench.name!r} has no {name}, which this plan needs")
        for name in procedure.walk(parameters).instruments
        if name not in bench.instruments
    ]
    if not procedure.steps:
        what = "analyses imported data; it has no steps that a bench could do"
        problems.insert(0, Problem(("procedure",), f"{procedure.name} {what}"))
    complete = not problems
    problems += procedure.check(parameters, bench)
    if complete:
        problems += beyond_limits(procedure.forecast(parameters, bench), bench)
    yield from dict.fromkeys(problems)


def beyond_limits(forecast: Forecast, bench: Bench) -> Iterator[Problem]:
    """Yield, for each instrument and each of its limits, the set-point that exceeds it most."""
    by_instrument: dict[str, list[SetPoint]] = {}
    for point in forecast.set_points:
        if point.instrument in bench.instruments:
            by_instrument.setdefault(point.instrument, []).append(point)
    for name, points in by_instrument.items():
        limits = bench.instruments[name].limits
        keys = (point.decided_by for point in points if point.decided_by)
        where = next(keys, PARAMETERS)
        resistance_ohm = coil_resistance_ohm(bench, name)
        for check in checks_of(name):
            allowed = limits.get(check.limit)
            if allowed is None:
                continue
            if check.needs_resistance and resistance_ohm is None:
                if check.limit == "heating" and any(
                    point.current_A is not None for point in points
                ):
                    yield Problem(
                        where,
                        f"the heating of {name}'s coil cannot be held against its limit: give "
                        f"settings.{RESISTANCE} in the bench file",
                    )
                continue
            sized = [
                (value, point)
                for point in points
                if (value := check.value(point, resistance_ohm or 0.0)) is not None
            ]
            if not sized:
                continue
            no_numbers = [pair for pair in sized if math.isnan(pair[0])]
            most = min if check.lowest else max
            worst, point = (no_numbers or [most(sized, key=lambda pair: pair[0])])[0]
            if not (worst >= allowed if check.lowest else worst <= allowed):
                what = point.text if point.field_mT is None else f"{point.field_mT:g} mT"
                yield Problem(point.decided_by or where, check.says(what, worst, name, allowed))


def coil_resistance_ohm(bench: Bench, instrument: str) -> float | None:
    """Return the resistance in ohm that the bench file gives for a supply's coil, or None."""
    given = bench.instruments[instrument].settings.get(RESISTANCE)
    return None if given is None else parse_as(given, "ohm")
