"""Why a plan cannot run on a bench; nothing is energised to find out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.rlg_magnetic_sensitivity.parameters import RlgParameters
from procedures.rlg_magnetic_sensitivity.steps import GAUSSMETER, coil_supply, instruments
from station.procedure import Problem
from station.units import parse_as

if TYPE_CHECKING:
    from station.bench import Bench

AMPLITUDE = ("parameters", "amplitude")


def check(parameters: RlgParameters, bench: Bench) -> Iterator[Problem]:
    """Yield every instrument the bench lacks and every limit the plan would exceed."""
    for name in instruments(parameters):
        if name not in bench.instruments:
            yield Problem(
                ("procedure",), f"the bench {bench.name!r} has no {name}, which this plan needs"
            )
    gaussmeter = bench.instruments.get(GAUSSMETER)
    calibration = gaussmeter.calibration if gaussmeter else None
    if calibration and not calibration.covers("field", parameters.amplitude_mT, "mT"):
        yield Problem(
            AMPLITUDE,
            f"the gaussmeter's calibration record states no uncertainty at "
            f"{parameters.amplitude_mT:g} mT",
        )
    for axis in parameters.axes:
        name = coil_supply(axis)
        if name not in bench.instruments:
            continue
        entry = bench.instruments[name]
        current_A = parameters.amplitude_mT / parse_as(str(entry.settings["coil_constant"]), "mT/A")
        allowed_A = entry.limits["current"]
        if current_A > allowed_A:
            yield Problem(
                AMPLITUDE,
                f"{parameters.amplitude_mT:g} mT needs {current_A:.3g} A from {name}, "
                f"the bench allows {allowed_A:g} A",
            )
        resistance = entry.settings.get("coil_resistance")
        if resistance is not None:
            needed_V = current_A * parse_as(str(resistance), "ohm")
            allowed_V = entry.limits["voltage"]
            if needed_V > allowed_V:
                yield Problem(
                    AMPLITUDE,
                    f"{parameters.amplitude_mT:g} mT needs {needed_V:.3g} V at {name}'s coil, "
                    f"the bench allows {allowed_V:g} V",
                )
        allowed_mT = entry.limits.get("field")
        if allowed_mT is not None and parameters.amplitude_mT > allowed_mT:
            yield Problem(
                AMPLITUDE,
                f"{parameters.amplitude_mT:g} mT is more than the {allowed_mT:g} mT that the "
                f"bench allows for {name}",
            )
