"""Bounds of what a bench file may say: a value beyond them protects nobody, however it is meant.

The limits of a bench are for its laboratory to choose. What is refused here would undo a promise of
the station: that zero means zero, that a coil is not cut off, that somebody learns in time that the
bench is not at rest, that an interlock can trip before harm is done. Each bound has its reason in
its sentence. Records of earlier runs are read without them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from station.files.faults import Fault
from station.files.yaml.document import Document, Where
from station.roles.role import instances, kind_of, limits, role_of
from station.safety.interlocks.conditions import Condition, Level
from station.safety.interlocks.reading import entries_of, interlocks_in
from station.safety.safe_state import DEFAULT_WITHIN_S
from station.units import UnitError, parse_as

COIL = "coil_supply"
ZERO_SHARE = 0.01
MAX_ZERO_A = 0.1
MIN_RAMP_S = 0.5
"""From the largest current to zero: ten of the steps, 0.05 s each, in which supplies are ramped."""
RAMPS = {
    COIL: ("current", "A", "slew"),
    "turntable": ("rate", "deg/s", "acceleration"),
    "rotary_stage": ("rate", "deg/s", "acceleration"),
}
"""What comes to zero by a ramp: its limit, that one's unit, and the limit of the ramp's slope."""
RAMP_UNITS = {"slew": "A/s", "acceleration": "deg/s^2"}
MAX_WITHIN_S = 600.0
MAX_GRACE_S = 60.0
MAX_PERIOD_S = 60.0
BEYOND_LIMIT = 1.5
BEYOND_TEMPERATURE_K = 25.0
MAX_COIL_DEGC = 200.0
"""Windings are insulated for 130 to 200 degC."""


def bound_faults(document: Document) -> Iterator[Fault]:
    """Yield what a bench file says beyond a bound; what cannot be read is left to other checks."""
    data = document.data
    instruments = mapping(mapping(data).get("instruments"))
    for name, entry in instruments.items():
        if role_of(str(name)) == COIL:
            yield from _coil_faults(document, str(name), mapping(entry))
    yield from _within_faults(document, instruments)
    for number, entry in entries_of(document):
        yield from _time_faults(document, ("interlocks", number), entry)
    conditions = [condition for _, condition in interlocks_in(document)]
    for level in upper_limits(conditions, "any", "all"):
        yield from _threshold_faults(document, level, instruments)
    looks = list(upper_limits(conditions, "any"))
    for name, entry in instruments.items():
        if role_of(str(name)) == COIL and name in instances():
            yield from _unwatched_faults(document, str(name), mapping(entry), looks)


def _coil_faults(document: Document, name: str, entry: Mapping[str, Any]) -> Iterator[Fault]:
    where: Where = ("instruments", name, "limits")
    current_A, zero_A = limit(entry, "current", "A"), limit(entry, "zero_current", "A")
    slew_A_per_s = limit(entry, "slew", "A/s")
    if not current_A:
        return
    most_A = min(ZERO_SHARE * current_A, MAX_ZERO_A)
    if zero_A and zero_A > most_A:
        yield document.fault(
            (*where, "zero_current"),
            f"{zero_A:g} A is too much to count as zero: a coil that carries it would be reported "
            f"as safe; at most {most_A:g} A, which is {ZERO_SHARE:.0%} of current and never above "
            f"{MAX_ZERO_A:g} A",
        )
    if slew_A_per_s and current_A / slew_A_per_s < MIN_RAMP_S:
        yield document.fault(
            (*where, "slew"),
            f"{slew_A_per_s:g} A/s takes {current_A:g} A to zero in "
            f"{current_A / slew_A_per_s:.2g} s, which is no ramp: a coil that is cut off induces a "
            f"high voltage; at most {current_A / MIN_RAMP_S:g} A/s, {MIN_RAMP_S:g} s to zero",
        )


def _within_faults(document: Document, instruments: Mapping[str, Any]) -> Iterator[Fault]:
    steps = [mapping(entry) for entry in listing(mapping(document.data).get("safe_state"))]
    timed: set[str] = set()
    for number, step in enumerate(steps):
        within_s = quantity(step, "within", "s")
        if within_s is None:
            continue
        where: Where = ("safe_state", number, "within")
        if within_s > MAX_WITHIN_S:
            yield document.fault(
                where,
                f"{within_s:g} s is too long: nobody beside the bench would learn in time that it "
                f"is not at rest; at most {MAX_WITHIN_S:g} s",
            )
        wanted = step.get("instrument") or step.get("role")
        for name, entry in instruments.items():
            if name not in timed and wanted in (name, role_of(str(name))):
                timed.add(name)
                ramp_s, slope = ramp_of(str(name), entry)
                if within_s < ramp_s:
                    yield document.fault(
                        where,
                        f"{within_s:g} s is shorter than the ramp of {name} to zero, {ramp_s:g} s: "
                        f"it would never be verified; allow more, or raise its {slope}",
                    )
    for name, entry in instruments.items():
        ramp_s, slope = ramp_of(str(name), entry)
        if name not in timed and ramp_s > DEFAULT_WITHIN_S:
            yield document.fault(
                ("instruments", name, "limits", slope),
                f"the ramp to zero takes {ramp_s:g} s, longer than the {DEFAULT_WITHIN_S:g} s "
                f"that it has; raise the {slope}, or name it in safe_state with a longer within",
            )


def ramp_of(name: str, entry: Any) -> tuple[float, str]:
    """Return how long the ramp from the largest current or rate to zero takes, in s, and its slope.

    0.0 for what has no ramp. The slope is the name of the limit by which it is made shorter.
    """
    top, unit, slope = RAMPS.get(role_of(name), ("", "", ""))
    largest, per_s = limit(entry, top, unit), limit(entry, slope, RAMP_UNITS.get(slope, ""))
    if not largest or not per_s:
        return 0.0, slope
    return largest / per_s, slope


def _time_faults(document: Document, where: Where, entry: Mapping[str, Any]) -> Iterator[Fault]:
    grace_s, period_s = quantity(entry, "grace", "s"), quantity(entry, "period", "s")
    if grace_s is not None and grace_s > MAX_GRACE_S:
        yield document.fault(
            (*where, "grace"),
            f"{grace_s:g} s is too long: for so long the bench would go on with what the interlock "
            f"forbids; at most {MAX_GRACE_S:g} s, or set the level to what may last",
        )
    if period_s is not None and period_s > MAX_PERIOD_S:
        yield document.fault(
            (*where, "period"),
            f"{period_s:g} s is too long: an interlock that is looked at so rarely trips too late; "
            f"at most {MAX_PERIOD_S:g} s",
        )


def upper_limits(conditions: Iterable[Condition], *through: str) -> Iterator[Level]:
    """Yield each level with an upper limit in conditions, `through` these stacks."""
    for condition in conditions:
        for leaf in condition.leaves(*through):
            if isinstance(leaf, Level) and leaf.high != math.inf:
                yield leaf


def _threshold_faults(
    document: Document, level: Level, instruments: Mapping[str, Any]
) -> Iterator[Fault]:
    key, unit, high = kind_of(level.instrument, level.quantity).limit, level.unit, level.high
    allowed = limit(instruments.get(level.instrument), key, unit) if key else None
    if allowed is None:
        return
    most = allowed + BEYOND_TEMPERATURE_K if unit == "degC" else BEYOND_LIMIT * allowed
    if high > most:
        yield document.fault(
            level.place_of_high,
            f"{high:g} {unit} is so far beyond limits.{key} of {level.instrument}, {allowed:g} "
            f"{unit}, that the interlock protects nothing; at most {most:g} {unit}",
        )


def _unwatched_faults(
    document: Document, name: str, entry: Mapping[str, Any], looks: Iterable[Level]
) -> Iterator[Fault]:
    """Yield that no interlock looks at a coil's current, voltage or temperature, or at its field.

    A gaussmeter's look counts up to one and a half times what the coil makes at its limit.
    """
    current_A = limit(entry, "current", "A")
    constant = quantity(mapping(entry.get("settings")), "coil_constant", "mT/A")
    if current_A is None:
        return  # other checks ask for it
    voltage_V = limit(entry, "voltage", "V")
    most_mT = BEYOND_LIMIT * current_A * abs(constant) if constant else math.inf
    most = {
        (name, "current"): BEYOND_LIMIT * current_A,
        (name, "voltage"): BEYOND_LIMIT * voltage_V if voltage_V else math.inf,
        (name, "temperature"): MAX_COIL_DEGC,
        ("gaussmeter", "field"): most_mT,
    }
    if any(look.high <= most.get((look.instrument, look.quantity), -math.inf) for look in looks):
        return
    label = name.replace(f"{COIL}.", "coil-").replace(".", "-").replace("_", "-")
    yield document.fault(
        ("instruments", name),
        "no interlock looks at this coil, so that nothing would end a run which drives it beyond "
        "its limit; add to interlocks, for example, "
        f"{{name: {label}-current, when: {{instrument: {name}, quantity: current, "
        f"above: {1.025 * current_A:g} A}}, grace: 0.4 s}}",
        at_key=True,
    )


def limit(entry: Any, key: str, unit: str) -> float | None:
    """Return a limit of an instrument; None where there is none, or none that could hold.

    Other checks refuse one that is not above zero, and a highest one below the lowest.
    """
    given, declared = mapping(mapping(entry).get("limits")), limits().get(key)
    value, low = quantity(given, key, unit), quantity(given, key.replace("_high", "_low"), unit)
    if value is None or (value <= 0 and not (declared and declared.signed)):
        return None
    return None if key.endswith("_high") and low is not None and value <= low else value


def quantity(data: Mapping[str, Any], key: str, unit: str) -> float | None:
    """Return a quantity of a bench file in `unit`; None where it is missing or cannot be read."""
    if key not in data:
        return None
    try:
        value = parse_as(data[key], unit)
    except UnitError:
        return None
    return value if math.isfinite(value) else None


def mapping(data: Any) -> Mapping[str, Any]:
    """Return what is a mapping, else an empty one."""
    return data if isinstance(data, dict) else {}


def listing(data: Any) -> list[Any]:
    """Return what is a list, else an empty one."""
    return data if isinstance(data, list) else []
