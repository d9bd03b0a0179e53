"""The world of gyros at rest: a laser gyro, whose bias is another after each switch-on, a navigator
and a nine-axis sensor, each on a plate that nothing moves.
"""

from __future__ import annotations

from functools import partial

from sim_instruments.truth import Truth
from sim_instruments.world.base import World
from sim_instruments.world.fog import FogBench
from sim_instruments.world.laser_gyro import LaserGyroBench
from sim_instruments.world.nine_axis import POSES, NineAxisBench
from sim_instruments.world.noise import generator
from sim_instruments.world.table import Table
from sim_instruments.world.together import WorldsTogether


class StaticLaserGyro(LaserGyroBench):
    """The laser gyro on a plate, in the ambient field.

    Truth: `switch_on_scatter` of the gyro, the standard deviation of its bias from one switch-on to
    the next; `drawn_deg_per_h` has what was drawn for each.
    """

    def __init__(self, truth: Truth) -> None:
        self.drawn_deg_per_h: list[float] = []
        self._rng = generator(truth.integer("seed", 0), "switch-on")
        self._scatter = truth.section("gyro").quantity("switch_on_scatter", "deg/h", 0.005)
        super().__init__(truth)
        self._mean_bias = self.gyro.bias_deg_per_h

    def power(self, time_s: float, on: bool) -> None:
        """Switch the gyro on, with a bias of its own, or off."""
        if on and not self.dut_powered:
            self.drawn_deg_per_h.append(self._scatter * float(self._rng.standard_normal()))
            self.gyro.bias_deg_per_h = self._mean_bias + self.drawn_deg_per_h[-1]
        super().power(time_s, on)


class StillNavigator(FogBench):
    """The navigator on a plate as the table at zero is, without the wander of a table's axes."""

    on_table = False

    def __init__(self, truth: Truth) -> None:
        still = {**truth.section("fog").raw("table"), "wander": "0 arcsec"}
        rng = generator(truth.integer("seed", 0), "table")
        super().__init__(truth, Table(Truth(still, "fog.table"), rng, self.table_changed))


class StillSensor(NineAxisBench):
    """The nine-axis sensor on the north-referenced plate: X east, Y north, Z up."""

    on_table = False

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.acts["mount"] = (
            partial(self._mount, "mount", POSES["1"]),
            "The simulated sensor stands on the plate, X east, Y north, Z up.",
        )


SECTIONS: dict[str, type[World]] = {
    "gyro": StaticLaserGyro,
    "nine_axis": StillSensor,
    "fog": StillNavigator,
}


class StaticGyroBench(WorldsTogether):
    """The gyros that a bench describes, at rest."""

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth, SECTIONS)
