"""The sensor in the three-axis coil, the gaussmeter's probe beside it: one steady field at a time.

The coils are driven one after the other; one that is not is off. What counts is the field that the
gaussmeter reads, so a coil constant is asked for a level only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from station.method.commands import CoilOff, CoilOn, FieldRange, SteadyField
from station.method.duration import on_the_way
from station.method.verbs import require_off
from station.procedure import Prompt
from station.roles import DirectCurrentSupply, Gaussmeter

from .measuring import LATE_OUTPUTS_S, Sensing, need_sensor_well
from .parameters import InCoil, Level, NineAxisParameters
from .placing import ask_to_put

if TYPE_CHECKING:
    from station.method.run import Run

GAUSSMETER = "gaussmeter"
LEVELS = ("parameters", "magnetometer_in_coil", "levels")
RANGE_HEADROOM, AMBIENT_MT = 1.5, 0.07
"""The earth's field, with which a level adds up."""
RAMP_S = 0.5
MOUNT = Prompt(
    "mount-in-coil",
    "Put the sensor, its cable connected, in the middle of the three-axis coil, X, Y and Z along "
    "the normals of coils x, y and z, and the gaussmeter's probe beside it, its axes along them.",
    checklist=("No tool and no loose iron is in the coils.",),
    then="the coils are driven one after the other",
)


def coil_supply(coil: str) -> str:
    """Return the supply of a coil."""
    return f"coil_supply.{coil}"


def measure_in_coil(run: Run) -> None:
    """Measure each field that is not finished, coil by coil; then the coil is off."""
    parameters: NineAxisParameters = run.parameters
    rule, levels = parameters.magnetometer_in_coil, parameters.coil_fields
    if rule is None or all(run.is_finished(level.unit) for level in levels):
        return
    ask_to_put(run, MOUNT)
    need_sensor_well(run)
    largest_mT = max(rule.levels_mT)
    run.apply(FieldRange(GAUSSMETER, RANGE_HEADROOM * (largest_mT + AMBIENT_MT)))
    for coil in dict.fromkeys(level.coil for level in levels):
        own = [level for level in levels if level.coil == coil and not run.is_finished(level.unit)]
        if not own:
            continue
        supply = coil_supply(coil)
        run.role(supply, DirectCurrentSupply).programme_limits()
        run.apply(CoilOn(supply))
        run.event("field-on", instrument=supply, largest_field_mT=largest_mT, durable=True)
        for level in run.unfinished(own, lambda level: level.unit):
            doing = f"field {levels.index(level) + 1} of {len(levels)}, {level.unit}"
            measure_level(run, rule, level, doing)
        run.apply(CoilOff(supply), takes=on_the_way(RAMP_S))
        run.event("field-off", instrument=supply)
        require_off(run, supply)


def measure_level(run: Run, rule: InCoil, level: Level, doing: str) -> None:
    """Record sensor and gaussmeter in one steady field."""
    command = SteadyField(coil_supply(level.coil), level.field_mT, decided_by=LEVELS)
    run.apply(command, takes=on_the_way(RAMP_S))
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    with run.unit(level.unit, coil=level.coil, field_mT=level.field_mT) as facts:
        gaussmeter.drain()
        sensing = Sensing(run, level.unit, {GAUSSMETER: None})
        sensing.follow_to(run.now_s + rule.settle_s, f"{doing}, the field settles")
        from_s = run.now_s
        sensing.follow_to(from_s + rule.record_s, doing)
        facts.update(from_s=from_s, until_s=run.now_s)
        sensing.follow_to(run.now_s + LATE_OUTPUTS_S, doing)
        sensing.stop()
