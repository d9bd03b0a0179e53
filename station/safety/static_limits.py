"""Whether a plan fits a bench before anything is energised: each set-point against each limit.

What a procedure commands comes from its forecast; what may not be exceeded stands in the bench
file. The same is programmed into the instruments and watched by interlocks later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from station.procedure import Problem
from station.roles.role import Limit, role, role_of
from station.units import parse_as

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.method.set_points import SetPoint
    from station.method.work import Forecast
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
        for name in procedure.instruments(parameters)
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
        for check in (*CHECKS, *checks_of_role(name)):
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
            worst, point = (min if check.lowest else max)(sized, key=lambda pair: pair[0])
            if worst < allowed if check.lowest else worst > allowed:
                what = point.text if point.field_mT is None else f"{point.field_mT:g} mT"
                yield Problem(point.decided_by or where, check.says(what, worst, name, allowed))


def coil_resistance_ohm(bench: Bench, instrument: str) -> float | None:
    """Return the resistance in ohm that the bench file gives for a supply's coil, or None."""
    given = bench.instruments[instrument].settings.get(RESISTANCE)
    return None if given is None else parse_as(given, "ohm")


@dataclass(frozen=True)
class Check:
    """A limit of the bench file, what a set-point has of it, and the sentence beyond it.

    `value(point, resistance_ohm)` is None where the set-point does not concern it; `sentence` is
    filled with what is commanded, the value, the instrument and what is allowed. `lowest`: the
    limit is a lower one.
    """

    limit: str
    value: Callable[[SetPoint, float], float | None]
    sentence: str
    lowest: bool = False
    needs_resistance: bool = False

    def says(self, what: str, value: float, name: str, allowed: float) -> str:
        """Return the sentence."""
        return self.sentence.format(what=what, value=value, name=name, allowed=allowed)


def magnitude(attribute: str) -> Callable[[SetPoint, float], float | None]:
    """Return what reads the magnitude of an attribute of a set-point."""

    def value(point: SetPoint, resistance_ohm: float) -> float | None:
        given = getattr(point, attribute)
        return None if given is None else abs(float(given))

    return value


def signed(attribute: str) -> Callable[[SetPoint, float], float | None]:
    """Return what reads an attribute of a set-point with its sign."""

    def value(point: SetPoint, resistance_ohm: float) -> float | None:
        given = getattr(point, attribute)
        return None if given is None else float(given)

    return value


def rms_current_A(point: SetPoint, resistance_ohm: float = 0.0) -> float | None:
    """Return the effective current of a set-point over its duty, in A; None without a current."""
    given = point.current_A if point.rms_current_A is None else point.rms_current_A
    return (
        None if given is None else abs(given) * (1.0 if point.duty is None else point.duty) ** 0.5
    )


def heating_W(point: SetPoint, resistance_ohm: float) -> float | None:
    """Return the power that a set-point turns into heat in a coil, in W: I²R times its duty."""
    current_A = rms_current_A(point)
    return None if current_A is None else current_A**2 * resistance_ohm


def coil_voltage_V(point: SetPoint, resistance_ohm: float) -> float | None:
    """Return the voltage in V that a set-point's current needs at a coil, inductance aside."""
    return None if point.current_A is None else abs(point.current_A) * resistance_ohm


def too_much(unit: str) -> str:
    """Return the sentence of a set-point whose words hold no field."""
    more = f"is more than the {{allowed:g}} {unit} that the bench allows for {{name}}"
    return f"{{what}}: {{value:.4g}} {unit} {more}"


def too_little(unit: str) -> str:
    """Return the sentence of a set-point below a lower limit."""
    return too_much(unit).replace("more than", "less than")


CHECKS = (
    Check(
        "current",
        magnitude("current_A"),
        "{what} needs {value:.3g} A from {name}, the bench allows {allowed:g} A",
    ),
    Check(
        "rms_current",
        rms_current_A,
        "{what} needs an effective current of {value:.3g} A from {name}, the bench allows "
        "{allowed:g} A",
    ),
    Check(
        "voltage",
        coil_voltage_V,
        "{what} needs {value:.3g} V at {name}'s coil, the bench allows {allowed:g} V",
        needs_resistance=True,
    ),
    Check(
        "heating",
        heating_W,
        "{what} heats {name}'s coil with {value:.3g} W, the bench allows {allowed:g} W",
        needs_resistance=True,
    ),
    Check(
        "field",
        magnitude("field_mT"),
        "{value:g} mT is more than the {allowed:g} mT that the bench allows for {name}",
    ),
    Check("voltage", magnitude("voltage_V"), too_much("V")),
    Check("rate", magnitude("rate_deg_per_s"), too_much("deg/s")),
    Check("acceleration", magnitude("acceleration_deg_per_s2"), too_much("deg/s^2")),
    Check("angle_high", signed("angle_deg"), too_much("deg")),
    Check("angle_low", signed("angle_deg"), too_little("deg"), lowest=True),
    Check("temperature_high", signed("temperature_degC"), too_much("degC")),
    Check("temperature_low", signed("temperature_degC"), too_little("degC"), lowest=True),
    Check("temperature_slew", magnitude("temperature_slew_degC_per_min"), too_much("degC/min")),
)
"""The limits of the station's own roles; `slew` and `zero_current` bind drivers."""


def checks_of_role(instrument: str) -> Iterator[Check]:
    """Yield the checks of an instrument's further limits, those of a laboratory's own role."""
    declared = role(role_of(instrument))
    known = {check.limit for check in CHECKS}
    for name, limit in declared.limits.items() if declared else ():
        if name not in known:
            lowest = name.endswith("_low")
            sentence = (too_little if lowest else too_much)(limit.unit)
            yield Check(name, limited(name, limit), sentence, lowest)


def limited(name: str, limit: Limit) -> Callable[[SetPoint, float], float | None]:
    """Return what reads the value of a set-point that a role's limit bounds."""

    def value(point: SetPoint, resistance_ohm: float) -> float | None:
        given = (point.limited or {}).get(name)
        return given if given is None or limit.signed else abs(given)

    return value
