"""Mistakes of laboratories in logs of turns: each is named, or within the uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sabotage_fog
from fog_logs import log
from fog_records import Array, knocked, quartic, record
from sabotage import judged

from procedures.fog_scale_factor_temperature.analysis import FogAnalysis, analyse
from procedures.fog_scale_factor_temperature.curve import Band
from procedures.fog_scale_factor_temperature.dataset import FogDataset

PLANTED = {one.name: one for one in sabotage_fog.FAULTS}


def said(analysis: FogAnalysis) -> set[str]:
    return {str(flag.details.get("statement", flag.code)) for flag in analysis.flags}


@pytest.mark.parametrize(
    "name",
    [
        "headings of x in radians",
        "thermometers that lag by 0.5 degC while warming",
        "a third of the rows twice, as new sets",
        "clock begins again in the middle",
        "another gyro for the last sixth",
    ],
)
def test_a_mistake_of_a_laboratory_is_named(name: str) -> None:
    found = judged(PLANTED[name], 0)
    assert found["named"], found
    assert not found["broken"]


def test_of_an_axis_with_headings_in_radians_nothing_is_reported_and_of_the_others_all() -> None:
    made = record(4, axes=("x", "y", "z"))
    own = (made.turns.axis == "x")[:, None]
    sides = (made.turns.attitude_before_deg, made.turns.attitude_after_deg)
    before, after = (np.where(own, np.radians(side), side) for side in sides)
    turns = replace(made.turns, attitude_before_deg=before, attitude_after_deg=after)
    analysis = analyse(replace(made, turns=turns))
    (flag,) = [one for one in analysis.flags if one.details.get("statement") == "heading_deg"]
    assert flag.details["axes"] == ["x"]
    assert analysis.fits["x"].curve is None
    assert analysis.fits["y"].curve is not None
    assert analysis.fits["z"].curve is not None


def test_turns_of_the_calibrating_ramp_are_no_proof() -> None:
    made = record(5)
    analysis = analyse(replace(made, verification=made.turns))
    assert "verification" in said(analysis)
    assert not analysis.verified
    other = record(6, first_degC=58.0, last_degC=-37.0).turns
    proved = analyse(replace(made, verification=other))
    assert "verification" not in said(proved)
    assert len(proved.verified["x"].after_ppm) == len(other)


def test_a_lag_whose_sign_changes_over_the_range_is_hysteresis() -> None:
    """Half a degree, and a curve that falls as much as it rises: on the average it is nothing."""

    def valley(heat: Array) -> Array:
        return np.asarray(150.0 * ((heat - 10.5) / 48.5) ** 2)

    table = log(3, there_and_back=True, curves=dict.fromkeys("xyz", valley)).table
    table = table.of(table.axis == "x")
    late = 0.25 * (np.arange(len(table)) < len(table) // 2)
    moved = replace(
        table,
        temperature_before_degC=table.temperature_before_degC - late,
        temperature_after_degC=table.temperature_after_degC - late,
    )
    clean, lagging = (
        analyse(FogDataset(one, "heading", full_attitude=False)) for one in (table, moved)
    )
    assert "hysteresis" not in said(clean)
    assert "hysteresis" in said(lagging)
    curve = lagging.fits["x"].curve
    assert curve is not None
    assert float(curve.check_ppm(np.array([50.0]))[0]) > 0.3
    assert float(curve.check_ppm(np.array([50.0]))[0]) < 1.5


@pytest.mark.parametrize("seed", [0, 6, 9])
def test_knocks_in_the_first_sets_do_not_bend_the_end_of_the_curve(seed: int) -> None:
    made = record(seed, (360, 0), walk=0.05)
    for row, ppm in ((0, 15.0), (1, -180.0), (2, -190.0), (6, -34.0)):
        made = knocked(made, [row], ppm * 360e-6)
    curve = analyse(made).fits["x"].curve
    assert curve is not None
    grid = curve.temperatures_degC(50)
    off = np.abs(curve.error_ppm(grid) - quartic(grid))
    assert float(np.max(off / Band(curve).standard_ppm(grid))) < 4.0
