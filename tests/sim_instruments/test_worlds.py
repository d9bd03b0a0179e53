"""Simulated worlds are found by entry points, and are asked for what they have."""

from __future__ import annotations

from pathlib import Path

import pytest
from our_drivers import shipped

from sim_instruments.bench import SimulatedBench, installed_worlds, world_of
from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.accelerometer import AccelerometerBench
from sim_instruments.world.base import Room, TriggerLine
from sim_instruments.world.chamber import Chamber
from sim_instruments.world.fog import FogBench
from sim_instruments.world.laser_gyro import LaserGyroBench
from sim_instruments.world.nine_axis import NineAxisBench
from station.clock import VirtualClock

WORLD = '''
"""A bell that is struck by the bench's trigger, in a laboratory's own world."""

from sim_instruments.world.base import TriggerLine, World


class BellWorld(World):
    """A bell with a hammer, which needs a supply."""

    preparations = ("dut-power-on",)

    def __init__(self, truth):
        super().__init__(truth)
        self.trigger = TriggerLine()
        self.trigger.listen(self._strike)
        self.strokes_s = []
        self._powered = False
        self.acts = {
            "hang-bell": (lambda time_s: self._changed(), "The simulated bell hangs."),
            **self.usual_acts("The hammer has current.", "The hammer has no current."),
        }

    @property
    def dut_powered(self):
        """Whether the hammer has current."""
        return self._powered

    def power(self, time_s, on):
        """Give the hammer current, or none."""
        self._powered = on

    def _strike(self, time_s):
        if self._powered:
            self.strokes_s.append(time_s)
'''
BENCH = {
    "instruments": {},
    "simulation": {"seed": 1, "ambient_field": dict.fromkeys("xyz", "0 mT")},
}


@pytest.fixture
def laboratory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package of a laboratory that brings the world of a procedure `bell-pitch`."""
    (tmp_path / "bell_laboratory.py").write_text(WORLD, encoding="utf-8")
    metadata = tmp_path / "bell_laboratory-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: bell-laboratory\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text(
        "[station.worlds]\nbell-pitch = bell_laboratory:BellWorld\n", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.usefixtures("laboratory")
def test_a_laboratory_brings_a_world_of_its_own() -> None:
    assert {"bell-pitch", "nine-axis-calibration"} <= set(installed_worlds())
    clock = VirtualClock()
    bench = SimulatedBench(BENCH, clock, "bell-pitch")
    try:
        assert bench.act("hang-bell") == "The simulated bell hangs."
        bench.make_ready()
        assert bench.simulation_report()["dut_powered"]
        world = bench._world
        trigger = world.find(TriggerLine)
        assert trigger is not None and world.find(Chamber) is None
        trigger.rise(2.0)
        assert world.find(type(world)) is world and vars(world)["strokes_s"] == [2.0]
        with pytest.raises(SimulationError, match="knows: hang-bell, connect-cables, dut-power-on"):
            bench.act("mount")
    finally:
        bench.close()
        clock.stop()


def test_a_procedure_without_a_world_is_refused_with_those_that_have_one() -> None:
    with pytest.raises(SimulationError, match=r"'bell-pitch' \(there is: .*fog-scale-factor-temp"):
        world_of("bell-pitch")


def test_a_room_offers_only_its_public_parts() -> None:
    room = Room()
    room._trigger = TriggerLine()  # type: ignore[attr-defined]
    assert room.find(TriggerLine) is None and room.find(Room) is room


@pytest.mark.parametrize("bench", ["sim", "sim-alternate"])
def test_a_served_commissioning_has_all_devices_switched_on(bench: str) -> None:
    world = world_of("commissioning")(Truth(shipped(bench)["simulation"], "simulation"))
    for time_s, act in enumerate(world.preparations, start=1):
        world.act(act, time_s)
    for kind in (LaserGyroBench, NineAxisBench, FogBench, AccelerometerBench):
        device = world.find(kind)
        assert device is not None and device.dut_powered


def test_in_a_commissioning_the_device_that_is_mounted_has_the_power() -> None:
    world = world_of("commissioning")(Truth(shipped("sim")["simulation"], "simulation"))
    gyro, sensor = world.find(LaserGyroBench), world.find(NineAxisBench)
    assert gyro and sensor
    for time_s, (act, has_power) in enumerate(
        (("mount-table", (False, True)), ("mount", (True, False))), start=1
    ):
        world.act("dut-power-off", time_s)
        assert not world.dut_powered
        world.act(act, time_s)
        world.act("dut-power-on", time_s)
        assert (gyro.dut_powered, sensor.dut_powered) == has_power
