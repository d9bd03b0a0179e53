"""Inputs of budgets: what a result depends on has its row, whether somebody states it or not."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from station.findings import InputQuantity

Declared = Mapping[str, tuple[str, str]]
"""What the results of a procedure depend on, by the names of their sensitivities: description and
unit."""


def with_unstated(given: Iterable[InputQuantity], declared: Declared) -> list[InputQuantity]:
    """Return inputs with those declared that nobody states."""
    stated = {quantity.name: quantity for quantity in given}
    unstated = {
        name: InputQuantity.if_stated(name, about, None, unit, "")
        for name, (about, unit) in declared.items()
    }
    return list({**unstated, **stated}.values())


def not_known(given: Iterable[InputQuantity], name: str) -> list[InputQuantity]:
    """Return inputs of which one counts as not stated: what it is about was not measured."""
    return [
        InputQuantity.if_stated(own.name, own.description, None, own.unit, "", value=own.value)
        if own.name == name
        else own
        for own in given
    ]


def cosine_u(angle_u_rad: float | None) -> float | None:
    """Return the relative standard uncertainty of a projection by an angle known to `angle_u_rad`:
    1 - cos of it. None where nobody states the angle.
    """
    return None if angle_u_rad is None else 1.0 - math.cos(angle_u_rad)
