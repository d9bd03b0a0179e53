"""The limits of a plan: for a result as a whole, or for each of its axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from station.files.faults import Fault, listed, nearest
from station.files.yaml.reading import Document
from station.results import Limit
from station.units import UnitError, parse_as

BOUNDS = ("min", "max", "max_abs")

LimitsByAxis = dict[tuple[str, str | None], Limit]
Where = tuple[str | int, ...]


class LimitedResult(Protocol):
    """What is known of a result before it is measured."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Its axes; none for a result without axes."""
        ...

    @property
    def unit(self) -> str:
        """Its unit."""
        ...


def read_limits(
    document: Document, results: Mapping[str, LimitedResult]
) -> tuple[LimitsByAxis, list[Fault]]:
    """Return the limits of a plan by (result, axis), in the unit of each result, and the faults.

    `{magnetic_sensitivity: {max_abs: 0.1 deg/h/mT}}` holds for every axis,
    `{magnetic_sensitivity: {IA: {min: …, max: …}}}` for one. The axis of a result without axes is
    None.
    """
    limits: LimitsByAxis = {}
    faults: list[Fault] = []
    given = document.data.get("limits")
    for name, entry in given.items() if isinstance(given, dict) else ():
        where: Where = ("limits", name)
        if name not in results:
            hint = nearest(name, results)
            what = "is no result of this procedure"
            if not hint:
                what += f"; its results are {listed(results)}"
            faults.append(document.fault(where, what, hint and f"'{hint}'", at_key=True))
            continue
        kind = results[name]
        for axes, place, bounds in _bounds(entry, where, kind, document, faults):
            limit = _limit(bounds, place, kind.unit, document, faults)
            if limit is not None:
                limits.update({(name, axis): limit for axis in axes})
    return limits, faults


def _bounds(
    entry: Any, where: Where, kind: LimitedResult, document: Document, faults: list[Fault]
) -> Iterator[tuple[tuple[str | None, ...], Where, Any]]:
    """Yield the axes that bounds hold for, the place of the bounds in the plan, and the bounds."""
    if not isinstance(entry, dict) or not entry:
        what = f"must be a mapping of {listed(BOUNDS)}"
        faults.append(document.fault(where, what + (", or of axes" if kind.axes else "")))
        return
    axes = [key for key in entry if key in kind.axes]
    if axes:
        known: tuple[str, ...] = kind.axes
        for axis in axes:
            yield (axis,), (*where, axis), entry[axis]
    else:
        known = (*BOUNDS, *kind.axes)
        whole = {key: value for key, value in entry.items() if key in BOUNDS}
        if whole:
            yield kind.axes or (None,), where, whole
    for key in entry:
        if key in known:
            continue
        if axes and key in BOUNDS:
            what = "stands beside axes; give bounds to the whole result or to each axis"
            faults.append(document.fault((*where, key), what, at_key=True))
            continue
        hint = nearest(key, known)
        what = "is not known here" + ("" if hint else f"; known are {listed(known)}")
        faults.append(document.fault((*where, key), what, hint and f"'{hint}'", at_key=True))


def _limit(
    bounds: Any, where: Where, unit: str, document: Document, faults: list[Fault]
) -> Limit | None:
    before = len(faults)
    if not isinstance(bounds, dict) or not bounds:
        faults.append(document.fault(where, f"must be a mapping of {listed(BOUNDS)}"))
        return None
    numbers: dict[str, float] = {}
    for name, text in bounds.items():
        here = (*where, name)
        if name not in BOUNDS:
            hint = nearest(name, BOUNDS)
            what = "is not known here" + ("" if hint else f"; known are {listed(BOUNDS)}")
            faults.append(document.fault(here, what, hint and f"'{hint}'", at_key=True))
            continue
        try:
            numbers[name] = parse_as(text, unit)
        except UnitError as error:
            faults.append(document.fault(here, error.what, error.hint))
    if "max_abs" in numbers and ("min" in bounds or "max" in bounds):
        what = "limits the magnitude; give it alone, or min and max"
        faults.append(document.fault((*where, "max_abs"), what, at_key=True))
    if numbers.get("max_abs", 0.0) < 0:
        faults.append(document.fault((*where, "max_abs"), "a magnitude cannot be below zero"))
    if "min" in numbers and "max" in numbers and numbers["min"] > numbers["max"]:
        what = f"is above max ({bounds['max']}); exchange them"
        faults.append(document.fault((*where, "min"), what))
    return None if len(faults) > before else Limit(**numbers)
