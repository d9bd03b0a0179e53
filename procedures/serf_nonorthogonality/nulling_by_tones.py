"""Step 2 as published, the nulling by modulation: tones sent, answers read, fields taken off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached
from station.method.cell_commands import PumpLight
from station.method.duration import Duration, exactly

from .cell import DIGITIZER, PUMP, USUAL_ROUNDS, Cell, held, nulled_fields, waited_for
from .parameters import SerfParameters
from .shots import AXES

if TYPE_CHECKING:
    from station.method.run import Run
    from station.roles.base import Block

    from .modulation import Reading, Tone

MODULATED = "residual-by-modulation"
"""The event of what the tones of a round told."""
SIDES = (1.0, -1.0)
TONES = len(AXES) * len(SIDES)


def null_by_tones(run: Run, cell: Cell) -> None:
    """Send a tone on each coil in turn, take off the field that the answers tell, and look again.

    It ends with a look at what is left. A dry run goes through one round, which leaves nothing to
    null. Raises ConditionNotReached where the tones tell no field, or none that becomes small.
    """
    parameters: SerfParameters = run.parameters
    rounds = parameters.nulling.rounds
    if not rounds:
        return
    run.apply(PumpLight(PUMP, True, steady=True))
    for number in run.repeats(range(1, rounds + 1), rounds_s(parameters)):
        run.declare(*nulled_fields(parameters))
        doings = [f"nulling, round {number}, tone {place + 1} of {TONES}" for place in range(TONES)]
        answers = [
            cell.tone(coil, dict.fromkeys(AXES, side * parameters.nulling.bias_nT), doing)
            for (coil, side), doing in zip(sent(), doings, strict=True)
        ]
        residual_nT = run.read(
            partial(field_to_take_off, run, answers, number, last=number == rounds)
        )
        for axis in AXES:
            cell.held_nT[axis] -= residual_nT[axis] if residual_nT else 0.0
            run.apply(held(axis, cell.held_nT[axis], "against the residual field: "))
        if residual_nT is None:
            break
    run.apply(PumpLight(PUMP, True))


def sent() -> list[tuple[str, float]]:
    """Return the coil of each tone of a round, and to which side of zero it is."""
    return [(coil, side) for coil in AXES for side in SIDES]


def rounds_s(parameters: SerfParameters) -> Duration:
    """Return how long rounds of tones take whose number the data decide."""
    rounds = parameters.nulling.rounds
    each = exactly(parameters.pump_s) + waited_for(parameters.nulling.record_s)
    return Duration(
        TONES * min(rounds, USUAL_ROUNDS) * each.expected_s,
        TONES * min(rounds, 1) * each.shortest_s,
        TONES * rounds * each.longest_s,
    )


def field_to_take_off(
    run: Run, answers: Sequence[Block], number: int, *, last: bool
) -> dict[str, float] | None:
    """Return the field that the tones of a round tell, None where it is small enough."""
    parameters: SerfParameters = run.parameters
    rule = parameters.nulling
    reading = reading_of(answers, parameters, f"nulling, round {number}")
    run.event(
        MODULATED,
        round=number,
        field_nT=_rounded(reading.residual_nT),
        u_nT=_rounded(reading.u_nT),
        width_nT=round(reading.width_nT, 4),
    )
    size_nT = reading.size_nT
    run.say(f"    residual field {size_nT:.2f} nT by modulation in round {number}")
    if size_nT <= rule.tolerance_nT:
        return None
    if size_nT > rule.at_most_nT:
        raise ConditionNotReached(
            f"nulling, round {number}: the tones tell a residual field of {size_nT:.1f} nT, more "
            f"than nulling.at_most, {rule.at_most_nT:g} nT; see that the nuclei were depolarised "
            "and the shield is closed, or null by precession (nulling.method)"
        )
    if last:
        raise ConditionNotReached(
            f"after {number} rounds of nulling by modulation the tones still tell a residual field "
            f"of {size_nT:.2f} nT, more than nulling.tolerance, {rule.tolerance_nT:g} nT; see that "
            "the field is steady, allow more nulling.rounds, or null by precession (nulling.method)"
        )
    return reading.residual_nT


def reading_of(answers: Sequence[Block], parameters: SerfParameters, doing: str) -> Reading:
    """Return what the tones of a round tell; raises ConditionNotReached where it is nothing.

    The light shift is in the uncertainty along the pump light.
    """
    from .modulation import NotNulled, residual_of

    rule = parameters.nulling
    tones = [
        tone_of(coil, side, block, parameters)
        for (coil, side), block in zip(sent(), answers, strict=True)
    ]
    try:
        reading = residual_of(tones, rule.frequency_Hz, parameters.pump_axis, parameters.probe_axis)
    except NotNulled as error:
        raise ConditionNotReached(
            f"{doing}: {error}; look at the coils' cables and the coil constants of the bench file"
        ) from error
    along = parameters.pump_axis
    reading.u_nT[along] = math.hypot(reading.u_nT[along], rule.light_shift_nT / math.sqrt(3.0))
    return reading


def tone_of(coil: str, side: float, block: Block, parameters: SerfParameters) -> Tone:
    """Return the lines of a record, once the answer is the same in each cycle."""
    import numpy as np

    from .modulation import Tone, demodulated

    rule = parameters.nulling
    time_s, voltage_V = block.columns["time_s"], block.columns["voltage_V"]
    if float(np.abs(voltage_V).max()) >= parameters.full_scale_V:
        raise ConditionNotReached(
            f"{DIGITIZER}: the answer to the tone on coil {coil} reaches the full scale, "
            f"{parameters.full_scale_V:g} V; choose a larger full_scale"
        )
    whole = (time_s >= rule.settling_s) & (time_s < rule.record_s)
    lines_V, u_V = demodulated(
        time_s[whole], voltage_V[whole], rule.frequency_Hz, parameters.mains_frequency_Hz
    )
    return Tone(coil, rule.tone_nT, np.full(len(AXES), side * rule.bias_nT), lines_V, u_V)


def _rounded(by_axis: dict[str, float]) -> dict[str, float]:
    return {axis: round(value, 4) for axis, value in by_axis.items()}
