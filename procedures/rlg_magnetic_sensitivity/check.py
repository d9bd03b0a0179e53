"""Why a plan cannot run on a bench, as far as only this method knows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.rlg_magnetic_sensitivity.measuring import GAUSSMETER
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from station.procedure import Problem

if TYPE_CHECKING:
    from station.bench import Bench

AMPLITUDE = ("parameters", "amplitude")


def check(parameters: RlgParameters, bench: Bench) -> Iterator[Problem]:
    """Yield that the gaussmeter's calibration does not hold at the amplitude, where it does not."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    calibration = gaussmeter.calibration if gaussmeter else None
    if calibration and not calibration.covers("field", parameters.amplitude_mT, "mT"):
        yield Problem(
            AMPLITUDE,
            f"the gaussmeter's calibration record states no uncertainty at "
            f"{parameters.amplitude_mT:g} mT",
        )
