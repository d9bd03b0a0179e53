"""The world of the gyro at rest: the laser gyro, whose bias is another after each switch-on."""

from __future__ import annotations

from sim_instruments.truth import Truth
from sim_instruments.world.laser_gyro import LaserGyroBench
from sim_instruments.world.noise import generator


class StaticGyroBench(LaserGyroBench):
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
