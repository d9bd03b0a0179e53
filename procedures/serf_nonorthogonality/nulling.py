"""Step 2: the residual field is solved from the spins' own precession, and taken off, in a loop.

The source nulls by modulation. That finds the zero only within the width of the magnetometer's
resonance, a nanotesla or two; fields of both senses tell the residual field at any size, on the
scale of the coils themselves. What is left is part of the results.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from procedures.serf_nonorthogonality.cell import Cell, signal_of
from procedures.serf_nonorthogonality.shots import AXES, PAIRS, Wanted, shots_of
from station.errors import ConditionNotReached

if TYPE_CHECKING:
    from procedures.serf_nonorthogonality.parameters import SerfParameters
    from station.runner.run import Run

LEAST_SLACK = 0.1
USUAL_RESIDUAL_NT = 5.0


def fields_lost(field_nT: float) -> float:
    """Return by which part a shield's usual residual field may change a precession."""
    return max(LEAST_SLACK, USUAL_RESIDUAL_NT / field_nT)


def null_residual_field(run: Run, cell: Cell) -> None:
    """Solve the residual field from pairs of every polarity, take it off, and look again.

    Raises ConditionNotReached where a pair shows no precession.
    """
    parameters: SerfParameters = run.parameters
    rule = parameters.nulling
    levels_nT = parameters.field_levels_nT
    every = shots_of("reversal", levels_nT, parameters.pump_axis, parameters.probe_axis)
    pairs = [shot for shot in every if len(shot.coils) == len(PAIRS[0])]
    for number in range(1, rule.rounds + 1):
        said = f"nulling, round {number}"
        squares = fired_squares(run, cell, pairs, said)
        residual_nT = residual_of_pairs_nT(pairs, squares, levels_nT)
        size_nT = math.hypot(*residual_nT.values())
        told = {axis: round(value, 4) for axis, value in residual_nT.items()}
        run.record.event("residual-field", round=number, field_nT=told)
        run.progress.say(f"    residual field {size_nT:.2f} nT in round {number}")
        if size_nT <= rule.tolerance_nT:
            return
        for axis in AXES:
            cell.hold(axis, cell.held_nT[axis] - residual_nT[axis])


def fired_squares(run: Run, cell: Cell, pairs: Sequence[Wanted], said: str) -> dict[str, float]:
    """Fire each shot as a look, not recorded, and return the squares of their frequencies, Hz^2.

    All are fitted with one decay of the baseline: a shot alone may take a baseline for its tone.
    """
    import numpy as np

    from procedures.serf_nonorthogonality.dataset import SerfDataset, Shot
    from procedures.serf_nonorthogonality.findings import AnalysisSettings
    from procedures.serf_nonorthogonality.precession import look_at_all

    parameters: SerfParameters = run.parameters
    looks = []
    for shot in pairs:
        block = cell.fire(dict(zip(AXES, shot.field_nT, strict=True)), f"{said}, {shot.id}")
        time_s, voltage_V = signal_of(block, cell.delay_s)
        field_nT = np.array(shot.field_nT)
        looks.append(Shot(shot.id, field_nT, time_s, voltage_V, parameters.full_scale_V))
    seen = look_at_all(
        SerfDataset(
            looks,
            parameters.pump_axis,
            parameters.probe_axis,
            parameters.nuclear_spin,
            constants_known=False,
            sample_rate_Hz=parameters.sample_rate_Hz,
            mains_Hz=parameters.mains_frequency_Hz,
        ),
        AnalysisSettings(),
    )
    bad = [one for one in seen if not one.used]
    if bad:
        raise ConditionNotReached(
            f"{said}: the shot {bad[0].shot.name} cannot be used ({bad[0].rejected}); look at the "
            "pump light, the probe light, the cell's temperature and the coils' cables"
        )
    return {one.shot.name: one.used_fit.frequency_Hz**2 for one in seen}


def residual_of_pairs_nT(
    pairs: Sequence[Wanted], squares: Mapping[str, float], levels_nT: Mapping[str, float]
) -> dict[str, float]:
    """Return the residual field along each coil axis in nT of that coil.

    The squared frequency of a pair of signs s, t is a^2 + b^2 + r^2 + 2 s t a b cos + 2 s a r_a
    + 2 t b r_b: summed over the four polarities times s, 8 a r_a is left. Each coil stands in two
    pairs, whose results are averaged; their means give the coils' strengths a.
    """
    means: dict[str, float] = {}
    sums: dict[tuple[str, str], float] = {}
    for one, other in PAIRS:
        coils = one + other
        mine = [shot for shot in pairs if shot.coils == coils]
        means[coils] = sum(squares[shot.id] for shot in mine) / len(mine)
        for axis in (one, other):
            place = AXES.index(axis)
            sums[coils, axis] = sum(
                math.copysign(squares[shot.id], shot.field_nT[place]) for shot in mine
            )
    strength = {
        axis: (
            sum(means[coils] for coils in means if axis in coils)
            - sum(means[coils] for coils in means if axis not in coils)
        )
        / 2
        for axis in AXES
    }
    return {
        axis: levels_nT[axis]
        * sum(value for (_, of), value in sums.items() if of == axis)
        / (2 * 8 * strength[axis])
        for axis in AXES
    }
