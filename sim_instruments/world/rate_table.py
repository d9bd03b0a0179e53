"""The world of the rate table: laser gyro, navigator and sensor, each with its axis up on it."""

from __future__ import annotations

import numpy as np

from sim_instruments.truth import Truth
from sim_instruments.world.base import World
from sim_instruments.world.fog import FogBench
from sim_instruments.world.laser_gyro import EARTH_RATE_DEG_PER_H
from sim_instruments.world.nine_axis import NineAxisBench
from sim_instruments.world.noise import generator
from sim_instruments.world.piecewise import Array
from sim_instruments.world.static_gyro import StaticLaserGyro
from sim_instruments.world.table import Table
from sim_instruments.world.together import WorldsTogether

ARCSEC = 3600.0


class TurningLaserGyro(StaticLaserGyro):
    """A gyro that feels the turns of the table that carries it.

    Truth below `simulation.rate_table`: `scale_factor_error`, and `switch_on_scatter`, its standard
    deviation from one switch-on to the next; `asymmetry` of the positive sense over the negative
    one; `ripple` (`amplitude` and `period` of what the scale factor changes with the rate); `lean`
    of the input axis from the table's, where the table stands at zero towards north. The table is
    that of `simulation.fog`. `drawn_scale` has what was drawn for each switch-on.
    """

    preparations: tuple[str, ...] = ("mount-gyro-on-table", "connect-cables", "dut-power-on")
    on_table = True

    def __init__(self, truth: Truth, table: Table | None = None) -> None:
        own = truth.section("rate_table")
        self._error = own.quantity("scale_factor_error", "1")
        self._scatter_of_scale = own.quantity("switch_on_scatter", "1")
        self._asymmetry = own.quantity("asymmetry", "1")
        ripple = own.section("ripple")
        self._ripple = ripple.quantity("amplitude", "1")
        self._per_rate = 2.0 * np.pi / ripple.quantity("period", "deg/s")
        self._lean = own.quantity("lean", "rad")
        latitude = truth.section("gyro").quantity("latitude", "rad")
        self._level_deg_per_h = EARTH_RATE_DEG_PER_H * float(np.cos(latitude))
        self._rng_of_scale = generator(truth.integer("seed", 0), "scale factor")
        self.drawn_scale: list[float] = []
        outer = truth.section("fog").section("table").section("outer")
        self._outer = outer.integer("axis", 1)
        self.table = table or Table.of_bench(truth, self.table_changed)
        super().__init__(truth)
        self.acts["mount-gyro-on-table"] = (
            self._mount,
            "The simulated gyro is mounted on the turntable, its input axis up.",
        )

    def power(self, time_s: float, on: bool) -> None:
        """Switch the gyro on, with a scale factor of its own, or off."""
        if on and not self.dut_powered:
            self.drawn_scale.append(
                self._scatter_of_scale * float(self._rng_of_scale.standard_normal())
            )
        super().power(time_s, on)

    def scale_factor(self, rate_deg_per_s: Array) -> Array:
        """Return measured over true rate, bias aside, at true rates, positive about up."""
        drawn = self.drawn_scale[-1] if self.drawn_scale else 0.0
        ripple = self._ripple * np.sin(self._per_rate * np.abs(rate_deg_per_s))
        sense = 0.5 * self._asymmetry * np.sign(rate_deg_per_s)
        return np.asarray((1.0 + self._error + drawn) * (1.0 + ripple + sense))

    def gyro_angle_arcsec(self, edges_s: Array) -> Array:
        """Return the angle, noise aside, that the gyro turns between neighbouring times."""
        still = super().gyro_angle_arcsec(edges_s)
        heading_deg = self.table.axis(self._outer).angle_deg(edges_s)
        # The outer axis turns clockwise seen from above, the gyro feels it about up.
        turned_deg = -np.diff(heading_deg)
        time_s = np.diff(edges_s)
        angle = self.scale_factor(turned_deg / time_s) * turned_deg * ARCSEC
        middle = np.radians(0.5 * (heading_deg[1:] + heading_deg[:-1]))
        level = self._level_deg_per_h * np.sin(self._lean) * np.cos(middle)
        angle += level * np.sinc(turned_deg / 360.0) * time_s
        on_s = np.diff(self.gyro.heat.on_time(edges_s))
        return np.asarray(still + angle * on_s / time_s)


SECTIONS: dict[str, type[World]] = {
    "gyro": TurningLaserGyro,
    "nine_axis": NineAxisBench,
    "fog": FogBench,
}


class RateTableBench(WorldsTogether):
    """The gyros that a bench describes, on its turntable."""

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth, SECTIONS)
