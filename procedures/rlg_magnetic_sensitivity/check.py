"""Why a plan cannot run on a bench, as far as only this method knows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.rlg_magnetic_sensitivity.measuring import GAUSSMETER
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from station import registry
from station.procedure import Problem

if TYPE_CHECKING:
    from station.bench import Bench

AMPLITUDE = ("parameters", "amplitude")


def check(parameters: RlgParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the gaussmeter cannot see, and what its calibration record leaves out."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    calibration = gaussmeter.calibration if gaussmeter else None
    if calibration and not calibration.covers("field", parameters.amplitude_mT, "mT"):
        yield Problem(
            AMPLITUDE,
            f"the gaussmeter's calibration record states no uncertainty at "
            f"{parameters.amplitude_mT:g} mT",
        )
    if gaussmeter is None or registry.load(registry.DRIVERS, gaussmeter.driver).axes > 1:
        return
    if parameters.excitation == "simultaneous":
        yield Problem(
            ("parameters", "excitation"),
            f"the gaussmeter ({gaussmeter.driver}) measures one axis at a time; with it the coils "
            "are driven one after the other: sequential",
        )
    if calibration is None or not calibration.covers("angle", 0.0, "deg"):
        yield Problem(
            ("procedure",),
            f"the gaussmeter ({gaussmeter.driver}) measures one axis; its calibration record must "
            "state the uncertainty of the angle at which its probe stands",
        )
