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
    for supply in supplies:
        limited, left = _limited(supply), _left(supply)
        estimates += [limited, left]
        flags += _causes(supply, limited, left)
    return Analysis(estimates, (), flags)


def _limited(supply: SupplyRecord) -> Estimate:
    ratio, u = abs(supply.flows_A) / supply.limit_A, supply.current_u_A / supply.limit_A
    method = "the current that flows over the limit that is programmed"
    return Estimate("own_limit_ratio", supply.coil, ratio, "1", u, None, method)


def _left(supply: SupplyRecord) -> Estimate:
    readings = min(len(supply.before_mT), len(supply.after_mT))
    if readings < 2:
        raise ValueError("a mean of the field needs two readings")
    left_mT = float(supply.after_mT.mean() - supply.before_mT.mean())
    u_mT = math.hypot(
        *(float(np.std(x, ddof=1)) / math.sqrt(len(x)) for x in (supply.before_mT, supply.after_mT))
    )
    freedom = float(len(supply.before_mT) + len(supply.after_mT) - 2)
    by = {GAIN: left_mT}
    method = "after less before"
    return Estimate("field_after_cut", supply.coil, left_mT, "mT", u_mT, freedom, method, by)


def _causes(supply: SupplyRecord, limited: Estimate, left: Estimate) -> Iterator[Flag]:
    if _beyond(limited, OWN_LIMIT):
        message = (
            f"The supply of coil {supply.coil} gives {abs(supply.flows_A):.3g} A at a limit of its "
            f"own of {supply.limit_A:g} A: the limit does not act. Only the station's interlocks "
            "protect the coil; have the supply repaired, or its interface card."
        )
        yield Flag("own-limit-does-not-act", message, supply.coil)
    if _beyond(left, FIELD_AFTER_CUT_MT):
        message = (
            f"Coil {supply.coil} still makes {left.value:.3g} mT after its output is off: current "
            "flows that the supply does not show. Switch it off at the mains; do not use it."
        )
        yield Flag("output-stays-on", message, supply.coil)


def _beyond(estimate: Estimate, limit: float) -> bool:
    assert estimate.value is not None and estimate.standard_uncertainty is not None
    return abs(estimate.value) - COVERAGE * estimate.standard_uncertainty > limit
