"""What a supply's own limit holds, and what is left of a field that was cut off."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, Flag

from .limits import COVERAGE, FIELD_AFTER_CUT_MT, OWN_LIMIT

Array = NDArray[np.float64]
GAIN = "field_gain_of_cut"


@dataclass(frozen=True)
class SupplyRecord:
    """One coil's supply: the current in A that flowed beyond a limit, fields in mT (n,) of a cut.

    `current_u_A` is the standard uncertainty of the read-back near zero. `before_mT` and
    `after_mT` lie along the coil.
    """

    coil: str
    limit_A: float
    flows_A: float
    current_u_A: float
    before_mT: Array
    after_mT: Array


def analyse(supplies: Sequence[SupplyRecord]) -> Analysis:
    """Return what the limits hold, the fields after a cut, and causes; ValueError for no record."""
    estimates, flags = list[Estimate](), list[Flag]()
    for one in supplies:
        limited, left = _limited(one), _left(one)
        estimates += [limited, left]
        flags += _causes(one, limited, left)
    return Analysis(estimates, (), flags)


def _limited(one: SupplyRecord) -> Estimate:
    ratio, u = abs(one.flows_A) / one.limit_A, one.current_u_A / one.limit_A
    method = "the current that flows over the limit that is programmed"
    return Estimate("own_limit_ratio", one.coil, ratio, "1", u, None, method)


def _left(one: SupplyRecord) -> Estimate:
    readings = min(len(one.before_mT), len(one.after_mT))
    if readings < 2:
        raise ValueError("a mean of the field needs two readings")
    left_mT = float(one.after_mT.mean() - one.before_mT.mean())
    u_mT = math.hypot(
        *(float(np.std(x, ddof=1)) / math.sqrt(len(x)) for x in (one.before_mT, one.after_mT))
    )
    freedom = float(len(one.before_mT) + len(one.after_mT) - 2)
    by = {GAIN: left_mT}
    method = "after less before"
    return Estimate("field_after_cut", one.coil, left_mT, "mT", u_mT, freedom, method, by)


def _causes(one: SupplyRecord, limited: Estimate, left: Estimate) -> Iterator[Flag]:
    if _beyond(limited, OWN_LIMIT):
        message = (
            f"The supply of coil {one.coil} gives {abs(one.flows_A):.3g} A at a limit of its own "
            f"of {one.limit_A:g} A: the limit does not act. Only the station's interlocks protect "
            "the coil; have the supply repaired, or its interface card."
        )
        yield Flag("own-limit-does-not-act", message, one.coil)
    if _beyond(left, FIELD_AFTER_CUT_MT):
        message = (
            f"Coil {one.coil} still makes {left.value:.3g} mT after its output is off: current "
            "flows that the supply does not show. Switch it off at the mains; do not use it."
        )
        yield Flag("output-stays-on", message, one.coil)


def _beyond(one: Estimate, limit: float) -> bool:
    assert one.value is not None and one.standard_uncertainty is not None
    return abs(one.value) - COVERAGE * one.standard_uncertainty > limit
