"""The weekly check: how far the figures of a bench are from those of its commissioning."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from station.findings import Estimate, Flag, undetermined
from station.instruments.commissioned import Commissioned
from station.safety.drift import DRIFT

from .part import Part

METHOD = "difference from the commissioning over what is allowed"


def drift_axes(parts: Sequence[Part], watched: Collection[str]) -> tuple[str, ...]:
    """Return the figures that are watched, `coil_constant_ratio x`."""
    return tuple(
        figure_name(name, axis)
        for part in parts
        for name in part.drift
        if name in watched
        for axis in part.results[name].axes or (None,)
    )


def figure_name(name: str, axis: str | None) -> str:
    """Return how a figure is called among those that are watched."""
    return name if axis is None else f"{name} {axis}"


def unlike(commissioned: Commissioned, units: Mapping[str, str]) -> Iterator[str]:
    """Yield why figures of a bench file are not those of a check; `units` by result."""
    names = [figure_name(figure.name, figure.axis) for figure in commissioned.figures]
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            yield f"`commissioned` in the bench file states {name} {names.count(name)} times"
    for name, figure in zip(names, commissioned.figures, strict=True):
        if figure.name in units and figure.unit != units[figure.name]:
            yield (
                f"`commissioned` in the bench file states {name} in '{figure.unit}', and a check "
                f"measures it in '{units[figure.name]}'; commission the bench again"
            )


def drifts(
    estimates: Sequence[Estimate], allowed: Mapping[str, float], commissioned: Commissioned
) -> Iterator[Estimate]:
    """Yield the drift of each watched figure; 1 is what is allowed.

    What both measurements share, as the gain of one gaussmeter, is not in the uncertainty.
    """
    for estimate in estimates:
        if estimate.name not in allowed:
            continue
        axis, before = (
            figure_name(estimate.name, estimate.axis),
            commissioned.figure(estimate.name, estimate.axis),
        )
        if before is None or estimate.value is None:
            stated = {} if before is None else {"commissioned": before.value}
            yield undetermined(DRIFT, axis, "1", METHOD, stated)
            continue
        u = math.hypot(estimate.standard_uncertainty or 0.0, before.standard_uncertainty)
        limit = allowed[estimate.name]
        drift = (estimate.value - before.value) / limit
        extra = {"commissioned": before.value, "measured": estimate.value, "allowed": limit}
        yield Estimate(
            DRIFT, axis, drift, "1", u / limit, estimate.degrees_of_freedom, METHOD, {}, extra
        )


def flags_of(drifted: Sequence[Estimate]) -> Iterator[Flag]:
    """Yield what has drifted, and what the commissioning, or this check, did not measure."""
    for drift in drifted:
        if drift.value is None and drift.extra:
            message = (
                f"{drift.axis} was {drift.extra['commissioned']:.5g} at the commissioning, and "
                "this check did not measure it: state in the plan what stood in that one's."
            )
            yield Flag("drift-undecided", message, drift.axis)
        elif drift.value is None:
            message = f"{drift.axis}: the commissioning of this bench has no such figure."
            yield Flag("not-commissioned", message, drift.axis)
        elif abs(drift.value) > 1.0:
            extra = drift.extra
            message = (
                f"{drift.axis} has drifted from {extra['commissioned']:.5g} to "
                f"{extra['measured']:.5g}, {abs(drift.value):.2g} times what is allowed. Find the "
                "cause, or commission the bench again."
            )
            yield Flag("drifted", message, drift.axis)
