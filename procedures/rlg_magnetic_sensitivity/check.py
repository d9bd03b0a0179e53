"""Why a plan cannot run on a bench, as far as only this method knows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.rlg_magnetic_sensitivity.measuring import GAUSSMETER
from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from station import registry
from station.procedure import Problem

if TYPE_CHECKING:
    from station.instruments.bench import Bench

AMPLITUDE = ("parameters", "amplitude")


def sees_one_axis(bench: Bench) -> bool:
    """Whether the bench's gaussmeter sees the field along one axis alone."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    return gaussmeter is not None and registry.load(registry.DRIVERS, gaussmeter.driver).axes == 1


def check(parameters: RlgParameters, bench: Bench) -> Iterator[Problem]:
    """Yield what the gaussmeter cannot see, and what its calibration record leaves out."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    states = ("uncertainty", "field") in bench.statements(GAUSSMETER)
    if states and bench.stated(GAUSSMETER, "field", parameters.amplitude_mT, "mT") is None:
        yield Problem(
            AMPLITUDE,
            f"the gaussmeter's calibration record states no uncertainty at "
            f"{parameters.amplitude_mT:g} mT",
        )
    if gaussmeter is None or not sees_one_axis(bench):
        return
    if parameters.excitation == "simultaneous":
        yield Problem(
            ("parameters", "excitation"),
            f"the gaussmeter ({gaussmeter.driver}) measures one axis at a time; with it the coils "
            "are driven one after the other: sequential",
        )
    if bench.stated(GAUSSMETER, "angle", 0.0, "deg") is None:
        yield Problem(
            ("procedure",),
            f"the gaussmeter ({gaussmeter.driver}) measures one axis; its calibration record must "
            "state the uncertainty of the angle at which its probe stands",
        )
