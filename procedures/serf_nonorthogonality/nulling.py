"""Step 2: the residual field is solved from the spins' own precession, and taken off, in a loop.

The source nulls by modulation. That finds the zero only within the width of the magnetometer's
resonance, a nanotesla or two; fields of both senses tell the residual field at any size, on the
scale of the coils themselves. What is left is part of the results.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached

from .cell import Cell
from .shots import AXES, shots_of

if TYPE_CHECKING:
    from station.runner.run import Run

    from .dataset import Shot
    from .parameters import SerfParameters
    from .precession import Precession

LEAST_SLACK = 0.1
USUAL_RESIDUAL_NT = 5.0


def fields_lost(field_nT: float) -> float:
    """Return by which part a shield's usual residual field may change a precession."""
    return max(LEAST_SLACK, USUAL_RESIDUAL_NT / field_nT)


def null_residual_field(run: Run, cell: Cell) -> None:
    """Solve the residual field from shots of every polarity, take it off, and look again.

    A field that is larger than a shield's, or not steady, is not nulled, and the run goes on: what
    is there is part of the results. Raises ConditionNotReached where hardly a shot can be used.
    """
    parameters: SerfParameters = run.parameters
    rule, levels_nT = parameters.nulling, parameters.field_levels_nT
    shots = shots_of("reversal", levels_nT, parameters.pump_axis, parameters.probe_axis)
    for number in range(1, rule.rounds + 1):
        said = f"nulling, round {number}"
        looks = []
        for place, shot in enumerate(shots, 1):
            looks.append(cell.look(shot, f"{said}, shot {place} of {len(shots)}"))
        seen = look_at_shots(looks, parameters)
        cell.usual = [one.used_fit for one in seen if one.used]
        residual_nT = solved_residual_nT(seen, said)
        run.record.event("residual-field", round=number, field_nT=residual_nT)
        if residual_nT is None:
            run.progress.say("    the residual field is not steady: it is not nulled")
            return
        size_nT = math.hypot(*residual_nT.values())
        run.progress.say(f"    residual field {size_nT:.2f} nT in round {number}")
        if size_nT <= rule.tolerance_nT:
            return
        if size_nT > rule.at_most_nT:
            run.progress.say(
                f"    more than nulling.at_most, {rule.at_most_nT:g} nT: not the shield's, and not "
                "nulled; were the nuclei depolarised?"
            )
            return
        for axis in AXES:
            cell.hold(axis, cell.held_nT[axis] - residual_nT[axis])


def look_at_shots(looks: Sequence[Shot], parameters: SerfParameters) -> list[Precession]:
    """Return the fits of shots, all with one decay of the baseline.

    A shot alone may take a baseline for its tone.
    """
    from .dataset import AnalysisSettings, SerfDataset
    from .precession import look_at_all

    dataset = SerfDataset(
        looks,
        parameters.pump_axis,
        parameters.probe_axis,
        parameters.nuclear_spin,
        constants_known=False,
        sample_rate_Hz=parameters.sample_rate_Hz,
        mains_Hz=parameters.mains_frequency_Hz,
    )
    return look_at_all(dataset, AnalysisSettings())


def solved_residual_nT(seen: Sequence[Precession], said: str) -> dict[str, float] | None:
    """Return the fields of the three coils, in nT commanded, that make up the residual field.

    None where no residual field explains the shots. Raises ConditionNotReached with too few.
    """
    import numpy as np

    from .angles import solve

    used = [one for one in seen if one.used]
    bad = [one for one in seen if not one.used]
    found = None
    if used:
        found = solve(
            np.array([one.shot.field_nT for one in used]),
            np.array([one.used_fit.omega_rad_per_s for one in used]),
            np.diag([one.used_fit.omega_u**2 for one in used]),
            known=False,
        )
    if found is None or (bad and not found.free_of_residual):
        raise ConditionNotReached(
            f"{said}: the shot {bad[0].shot.name} cannot be used ({bad[0].rejected}); look at the "
            "pump light, the probe light, the cell's temperature and the coils' cables"
        )
    if not (found.converged and found.positive_definite):
        return None
    # r holds projections on the axes, which are not quite at right angles.
    along = np.linalg.solve(found.gram, found.residual) / found.scale
    return {axis: round(one, 4) for axis, one in zip(AXES, along.tolist(), strict=True)}
