"""Why a plan cannot run on a bench; nothing is energised to find out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from procedures.accelerometer_magnetic_sensitivity.parameters import AccelerometerParameters
from station.procedure import Problem
from station.units import UnitError, parse_as

if TYPE_CHECKING:
    from station.bench import Bench, Instrument

SUPPLY = "coil_supply.dc"
GAUSSMETER = "gaussmeter"
MULTIMETER = "multimeter"
THERMOMETER = "thermometer"
STAGE = "rotary_stage"
POWER = "dut_power"
LARGEST_FIELD = ("parameters", "largest_field")
ANGLES = ("parameters", "angles")


def instruments(parameters: AccelerometerParameters) -> tuple[str, ...]:
    """Return the bench instances that a plan needs, in the order in which they are opened."""
    needed = (SUPPLY, GAUSSMETER, MULTIMETER, STAGE, POWER)
    return (*needed, THERMOMETER) if parameters.temperature else needed


def check(parameters: AccelerometerParameters, bench: Bench) -> Iterator[Problem]:
    """Yield every instrument the bench lacks and every limit the plan would exceed."""
    for name in instruments(parameters):
        if name not in bench.instruments:
            yield Problem(
                ("procedure",), f"the bench {bench.name!r} has no {name}, which this plan needs"
            )
    supply = bench.instruments.get(SUPPLY)
    if supply is not None:
        yield from _coil(parameters, supply)
    gaussmeter = bench.instruments.get(GAUSSMETER)
    record = gaussmeter.calibration if gaussmeter else None
    for field_mT in parameters.field_levels_mT:
        if record is not None and not record.covers("field", field_mT, "mT"):
            yield Problem(
                LARGEST_FIELD,
                f"the gaussmeter's calibration record states no uncertainty at {field_mT:g} mT",
            )
    stage = bench.instruments.get(STAGE)
    if stage is not None:
        low = stage.limits.get("angle_low", float("-inf"))
        high = stage.limits.get("angle_high", float("inf"))
        beyond = [angle for angle in parameters.angle_levels_deg if not low <= angle <= high]
        if beyond:
            yield Problem(
                ANGLES,
                f"{beyond[0]:g} deg is outside the {low:g} deg to {high:g} deg that the bench "
                f"allows for {STAGE}",
            )


def _coil(parameters: AccelerometerParameters, supply: Instrument) -> Iterator[Problem]:
    """Yield what of the supply's limits the largest field would exceed: A, V, W, mT."""
    field_mT = parameters.largest_field_mT
    current_A = field_mT / parse_as(str(supply.settings["coil_constant"]), "mT/A")
    needs: dict[str, tuple[float, str]] = {"current": (current_A, "A"), "field": (field_mT, "mT")}
    try:
        resistance_ohm = parse_as(str(supply.settings["coil_resistance"]), "ohm")
    except (KeyError, UnitError):
        resistance_ohm = 0.0
    if resistance_ohm:
        needs["voltage"] = (current_A * resistance_ohm, "V")
        levels = parameters.field_levels_mT
        squares = sum((level / field_mT) ** 2 for level in levels) / len(levels)
        needs["heating"] = (squares * current_A**2 * resistance_ohm, "W")
    for name, (needed, unit) in needs.items():
        allowed = supply.limits.get(name)
        if allowed is not None and needed > allowed:
            on_average = " on average" if name == "heating" else ""
            yield Problem(
                LARGEST_FIELD,
                f"{field_mT:g} mT needs {needed:.3g} {unit} of {name}{on_average} from {SUPPLY}, "
                f"the bench allows {allowed:g} {unit}",
            )
