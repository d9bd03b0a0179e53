"""The weekly check: how far the figures of a bench are from those of its commissioning."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from station.findings import Estimate, Flag, undetermined
from station.instruments.commissioned import Commissioned
from station.safety.drift import DRIFT

from .parts import Part

METHOD = "difference from the commissioning over what is allowed"


def drift_axes(parts: Sequence[Part]) -> tuple[str, ...]:
    """Return the figures that are watched, `coil_constant_ratio x`."""
    return tuple(
        figure_name(name, axis)
        for part in parts
        for name in part.drift
        for axis in part.results[name].axes or (None,)
    )


def figure_name(name: str, axis: str | None) -> str:
    """Return how a figure is called among those that are watched."""
    return name if axis is None else f"{name} {axis}"


def unlike(commissioned: Commissioned, units: Mapping[str, str]) -> Iterator[str]:
    """Yield why figures of a bench file are not those of a check; `units` by result."""
    names = [figure_name(one.name, one.axis) for one in commissioned.figures]
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            yield f"`commissioned` in the bench file states {name} {names.count(name)} times"
    for name, one in zip(names, commissioned.figures, strict=True):
        if one.name in units and one.unit != units[one.name]:
            yield (
                f"`commissioned` in the bench file states {name} in '{one.unit}', and a check "
                f"measures it in '{units[one.name]}'; commission the bench again"
            )


def drifts(
    estimates: Sequence[Estimate], allowed: Mapping[str, float], commissioned: Commissioned
) -> Iterator[Estimate]:
    """Yield the drift of each watched figure; 1 is what is allowed.

    What both measurements share, as the gain of one gaussmeter, is not in the uncertainty.
    """
    for one in estimates:
        if one.name not in allowed:
            continue
        axis, before = figure_name(one.name, one.axis), commissioned.figure(one.name, one.axis)
        if before is None or one.value is None:
            yield undetermined(DRIFT, axis, "1", METHOD)
            continue
        u = math.hypot(one.standard_uncertainty or 0.0, before.standard_uncertainty)
        limit = allowed[one.name]
        drift = (one.value - before.value) / limit
        extra = {"commissioned": before.value, "measured": one.value, "allowed": limit}
        yield Estimate(
            DRIFT, axis, drift, "1", u / limit, one.degrees_of_freedom, METHOD, {}, extra
        )


def flags_of(found: Sequence[Estimate]) -> Iterator[Flag]:
    """Yield what has drifted, and what the commissioning did not measure."""
    for one in found:
        if one.value is None:
            message = f"{one.axis}: the commissioning of this bench has no such figure."
            yield Flag("not-commissioned", message, one.axis)
        elif abs(one.value) > 1.0:
            extra = one.extra
            message = (
                f"{one.axis} has drifted from {extra['commissioned']:.5g} to "
                f"{extra['measured']:.5g}, {abs(one.value):.2g} times what is allowed. Find the "
                "cause, or commission the bench again."
            )
            yield Flag("drifted", message, one.axis)
