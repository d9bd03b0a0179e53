"""The oven of the simulated vapour cell: its heat, and what a cold cell shows."""

from __future__ import annotations

import numpy as np
import pytest
from cell_fixture import Fixture

from sim_instruments.truth import Truth
from sim_instruments.world.serf_oven import Oven

TRUTH = {
    "working_temperature": "185 degC",
    "room": "25 degC",
    "rise_at_10_W": "80 K",
    "time_constant": "10 min",
}


def oven() -> Oven:
    return Oven(Truth(TRUTH, "oven"))


def test_it_warms_and_cools_with_its_time_constant_to_what_its_power_gives() -> None:
    warm = oven()
    warm.heat(0.0, 20.0)
    warm.heat(600.0, 0.0)
    seen = warm.temperature_degC(np.array([-5.0, 0.0, 600.0, 1200.0, 1e5]))
    top = 25 + 160 * (1 - np.exp(-1))
    np.testing.assert_allclose(seen, [25, 25, top, 25 + (top - 25) * np.exp(-1), 25], rtol=1e-12)


def test_the_same_power_again_changes_nothing_and_a_held_cell_stays_until_it_is_driven() -> None:
    warm = oven()
    warm.hold(10.0)
    warm.heat(20.0, 20.0)  # 160 K above the room: just what keeps it
    np.testing.assert_allclose(warm.above_working_K(np.array([15.0, 900.0])), 0.0, atol=1e-12)
    warm.heat(1000.0, 0.0)
    assert warm.temperature_degC(np.array([1600.0]))[0] == pytest.approx(25 + 160 * np.exp(-1))


def test_changes_are_told_two_kelvin_apart() -> None:
    warm = oven()
    for second in range(600):
        warm.heat(float(second), 20.0 + 1e-6 * second)
    marks = warm.temperature_degC(warm.changes(600.0))
    assert np.all(np.diff(marks) >= 2.0) and np.all(np.diff(marks) < 2.3)


def driven(power_W: float) -> Fixture:
    """Return a cell whose heater somebody drives with a power, from -1e5 s on."""
    fixture = Fixture(powered_at_start=False, pump=False)
    heat = fixture.world.oven
    assert heat is not None
    heat.drive(lambda time_s: None)
    heat.heat(-1e5, power_W)
    fixture.world.act("gyro-at-rest", 0.0)
    fixture.world.pump(1.0, True)
    return fixture


def test_the_signal_goes_as_the_density_of_the_vapour_and_a_cold_cell_has_none() -> None:
    working_W = (185.0 - 22.5) / 8.0
    full = driven(working_W)
    size = {}
    for colder_K in (0.0, 10.0, 50.0, 100.0, 162.5):
        fixture = driven(working_W - colder_K / 8.0)
        fixture.shoot(5.0, (50.0, 0.0, 0.0))
        size[colder_K] = float(np.ptp(fixture.seen(5.0005 + np.arange(400) * 1e-4)))
    assert full.world.dut_powered
    assert size[0.0] > 0.15
    assert size[10.0] / size[0.0] == pytest.approx(np.exp(-0.6), rel=0.05)
    assert 0.0 < size[50.0] < 0.06 * size[0.0]
    assert size[100.0] == size[162.5] == 0.0


def test_a_person_who_heats_a_cell_without_a_driven_heater_has_it_at_working_temperature() -> None:
    fixture = Fixture(powered_at_start=False, pump=False)
    fixture.world.act("heat-cell", 1.0)
    assert fixture.world.cell.density(np.array([2.0, 5000.0])).tolist() == [1.0, 1.0]
