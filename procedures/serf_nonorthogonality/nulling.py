"""Step 2: the residual field is solved from the spins' own precession, and taken off, in a loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.serf_nonorthogonality.cell import Cell
from procedures.serf_nonorthogonality.shots import shots_of

if TYPE_CHECKING:
    from procedures.serf_nonorthogonality.parameters import SerfParameters
    from station.runner.run import Run

LEAST_SLACK = 0.1
USUAL_RESIDUAL_NT = 5.0


def fields_lost(field_nT: float) -> float:
    """Return by which part a shield's usual residual field may change a precession."""
    return max(LEAST_SLACK, USUAL_RESIDUAL_NT / field_nT)


def null_residual_field(run: Run, cell: Cell) -> None:
    """Solve the residual field from shots of every polarity, take it off, and look again.

    The source nulls by modulation, which finds the zero only within the width of the magnetometer's
    resonance (a nanotesla or two); fields of both senses tell the residual field at any size, on
    the scale of the coils themselves. What is left is part of the results.
    """
    import numpy as np

    parameters: SerfParameters = run.parameters
    rule = parameters.null
    looks = shots_of(
        "reversal", parameters.field_levels_nT, parameters.pump_axis, parameters.probe_axis
    )
    for number in range(1, rule.rounds + 1):
        found = solved_residual_nT(run, cell, looks, f"nulling, round {number}")
        if found is None:
            run.progress.say("    the residual field cannot be told from these shots")
            return
        residual_nT, correction_nT = found
        size_nT = float(np.linalg.norm(residual_nT))
        run.record.event(
            "residual-field", round=number, field_nT=[round(float(x), 4) for x in residual_nT]
        )
        run.progress.say(f"    residual field {size_nT:.2f} nT in round {number}")
        if size_nT <= rule.tolerance_nT:
            return
        for axis, change_nT in zip("xyz", correction_nT, strict=True):
            cell.hold(axis, cell.held_nT[axis] + float(change_nT))
