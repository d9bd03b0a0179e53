"""Fields that change between the shots: what an order of shots hides, and what u holds of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from serf_shots import FOURTEEN, Cell, bound_of_frequency

from procedures.serf_nonorthogonality.analysis import analyse
from procedures.serf_nonorthogonality.angles import Solution, solve
from procedures.serf_nonorthogonality.shots import shots_of
from procedures.serf_nonorthogonality.steady import HIDDEN_U, Changes, HiddenStep

Array = NDArray[np.float64]
BLOCKS = (FOURTEEN[0], FOURTEEN[13], *(FOURTEEN[k + 3 * n] for k in (1, 2, 3) for n in range(4)))


def solved(cell: Cell, change_nT: Array | float = 0.0) -> tuple[Solution, Changes]:
    """Return what frequencies without noise say; `change_nT` (shots, 3) changes their fields."""
    still = cell.but(pull=False)
    slowing = still.frequency_rad_per_s() / np.linalg.norm(still.fields_nT, axis=1)
    omega = slowing * np.linalg.norm(still.fields_nT + change_nT, axis=1)
    covariance = np.diag(bound_of_frequency(still) ** 2)
    solution = solve(still.commanded_nT, omega, covariance, known=False)
    return solution, Changes(still.commanded_nT, covariance, solution)


def hidden(cell: Cell) -> HiddenStep | None:
    return solved(cell)[1].hidden_step()


def pull(solution: Solution, cell: Cell) -> float:
    """Return the largest error of a cosine in its standard uncertainties."""
    off = solution.cosine - np.cos(np.radians(cell.angles_deg))
    return float(np.max(np.abs(off) / np.sqrt(np.diag(solution.covariance)[3:6])))


@pytest.mark.parametrize(("pump", "probe"), [("z", "y"), ("z", "x"), ("x", "y")])
def test_the_order_of_a_run_hides_no_step_of_the_residual_field(pump: str, probe: str) -> None:
    shots = shots_of("reversal", dict.fromkeys("xyz", 1.0), pump, probe)
    assert [shot.id for shot in shots[1:5]] == ["+x+y", "-x-y", "-x+y", "+x-y"]
    light = {axis: tuple(np.eye(3)["xyz".index(axis)]) for axis in "xyz"}
    pattern = tuple(tuple(int(one) for one in shot.field_nT) for shot in shots)
    cell = Cell(pattern=pattern, pump=light[pump], probe=light[probe], noise_V=0.003)
    assert hidden(cell) is None
    assert hidden(Cell(pattern=BLOCKS)) is None


def test_the_order_of_polarities_that_hides_a_step_is_flagged_where_it_matters() -> None:
    step = hidden(Cell())
    assert step is not None and step.moves_u > 20.0 and step.place in (7, 8)
    assert hidden(Cell(noise_V=0.2)) is None
    cell, late = Cell(residual_nT=(0.0, 0.0, 0.1)), Cell(residual_nT=(0.0, 0.0, 0.4))
    volts = np.concatenate([cell.clean_V()[:7], late.clean_V()[7:]])
    analysis = analyse(cell.dataset(0, volts))
    angle = analysis.estimate("nonorthogonality_angle", "xz")
    assert angle.value is not None and abs(angle.value - cell.angles_deg[1]) > 0.15
    flag = next(flag for flag in analysis.flags if flag.code == "unseen-step")
    assert flag.details["shots"] in (["s07", "s08"], ["s08", "s09"])
    assert "shots-disagree" not in {flag.code for flag in analysis.flags}


def test_what_a_leak_may_have_moved_is_in_u_where_shots_are_doubtful() -> None:
    cell = Cell(relaxation=900.0, field_nT=38.0, noise_V=0.005)
    for coil, into, least in ((0, 1, 4.0), (1, 2, 2.6)):
        leaks = np.array(cell.pattern)[:, [coil]] > 0
        solution, changes = solved(cell, 0.2 * leaks * np.eye(3)[into])
        assert solution.enlarged and not solution.disagree
        assert pull(solution, cell) > least and pull(changes.widened(), cell) < 1.1
    still, unchanged = solved(cell)
    assert unchanged.widened() is still


def test_steps_and_leaks_that_explain_nothing_widen_nothing() -> None:
    cell = Cell(pattern=BLOCKS)
    solution, _ = solved(cell)
    misfit = solution.misfit_rad_per_s + 8.0 * bound_of_frequency(cell) * np.eye(14)[4]
    wrong = replace(
        solution, misfit_rad_per_s=misfit, chi_square=400.0, degrees_of_freedom=5, enlarged=True
    )
    covariance = np.diag(bound_of_frequency(cell) ** 2)
    assert Changes(cell.commanded_nT, covariance, wrong).widened() is wrong
    assert HIDDEN_U > 4.0
