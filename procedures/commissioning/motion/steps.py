"""Steps M1 to M3 of a commissioning: senses, whole turns, levels by reversal."""

from __future__ import annotations

from collections.abc import Sequence

from station.method.commands import Power
from station.method.run import Run
from station.procedure import Step
from station.roles import Driver

from .measuring import record_level, record_turn
from .parameters import HALF_TURNS, HOME, TURNED_UNIT, MotionParameters, TableTurn, level_unit
from .placing import POWER, TableState, go_to, make_ready, moves, turn_device


def senses(run: Run) -> None:
    """M1: each axis by a small slow turn there and back; the outer one with the plate upright."""
    walk_turns(run, run.parameters.motion.small_turns)


def whole_turns(run: Run) -> None:
    """M2: each axis by a whole turn there and back."""
    parameters: MotionParameters = run.parameters.motion
    walk_turns(run, parameters.turns[len(parameters.small_turns) :])


def levels(run: Run) -> None:
    """M3: the sensor's level with every axis at 0 and 180 deg; then with the sensor turned."""
    for angles_deg in run.unfinished(HALF_TURNS, level_unit):
        make_ready(run)
        go_to(run, moves(angles_deg, level_unit(angles_deg)))
        record_level(run, level_unit(angles_deg))
    for unit in run.unfinished([TURNED_UNIT]):
        make_ready(run)
        go_to(run, moves(HOME, "all axes to zero"))
        turn_device(run)
        record_level(run, unit)
    if run.state(TableState).is_ready:
        # Switched off it could not be asked for what it keeps.
        run.role(run.parameters.motion.device, Driver).kept.put_back()
        run.apply(Power(POWER, False))


def walk_turns(run: Run, turns: Sequence[TableTurn]) -> None:
    """Measure turns that no earlier process of the run has finished."""
    for turn in run.unfinished(turns, lambda turn: turn.unit):
        make_ready(run)
        record_turn(run, turn)


STEPS = (
    Step("M1", "Table: sense of each axis by small slow turns", senses),
    Step("M2", "Table: whole turns against the sensor's gyros, rate read-back", whole_turns),
    Step("M3", "Table: encoder zeros and axes, by reversal against gravity", levels),
)
