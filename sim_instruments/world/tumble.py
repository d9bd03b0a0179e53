"""The world of the tumble test: the accelerometer in a fixture on the rotary stage."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np

from sim_instruments.truth import Truth
from sim_instruments.world.accelerometer import MOUNTINGS, AccelerometerBench
from sim_instruments.world.noise import generator
from sim_instruments.world.piecewise import Array

REVERSED = {"": 1.0, "-reversed": -1.0}
HEADS_DEG = (0, 90, 180, 270)
HARMONICS = (1, 2)


class TumbleBench(AccelerometerBench):
    """An accelerometer that a person mounts in four ways, on a fixture that turns on the head.

    Truth below `simulation.tumble`: `local_gravity`; `fixture_error`, by how much the fixture
    stands further than the stage; and standard deviations of what is drawn by the seed:
    `mounting_scatter` of the angle of each mounting, `graduation` of the sine and the cosine of the
    encoder's first and second harmonics. `drawn_deg` has what was drawn for each mounting, by the
    name of its act; one that is asked for again stands as it did.
    """

    preparations: tuple[str, ...] = ("mount-io", "connect-cables", "dut-power-on")

    def __init__(self, truth: Truth) -> None:
        own, seed = truth.section("tumble"), truth.integer("seed", 0)
        super().__init__(truth)
        self._gravity_g = own.quantity("local_gravity", "g")
        self.angle_offset_deg = own.quantity("fixture_error", "deg")
        scatter_deg = own.quantity("mounting_scatter", "deg")
        graduation_deg = own.quantity("graduation", "deg")
        for other in ("mount-op", "mount-level"):
            del self.acts[other]
        rng = generator(seed, "graduation")
        self.graduation_deg = graduation_deg * rng.standard_normal((len(HARMONICS), 2))
        self.drawn_deg: dict[str, float] = {}
        # Of each mounting: the sense of OA and PA, and how much further the device is turned.
        self._senses, self._turned_deg = [1.0], [0.0]
        for head_deg, plane, (suffix, sense) in product(HEADS_DEG, ("io", "ip"), REVERSED.items()):
            name = f"mount-{plane}{suffix}" + (f"-head-{head_deg}" if head_deg else "")
            drawn = scatter_deg * float(generator(seed, name).standard_normal())
            self.drawn_deg[name] = drawn
            turned = " and turned about its input axis" if suffix else ""
            self.acts[name] = (
                partial(self._mount_so, plane, sense, head_deg + drawn),
                f"The simulated accelerometer was mounted with {MOUNTINGS[plane]}{turned}, the "
                f"fixture at {head_deg} deg.",
            )

    def _mount_so(self, plane: str, sense: float, turned_deg: float, time_s: float) -> None:
        self._senses.append(sense)
        self._turned_deg.append(turned_deg)
        self._mount(plane, time_s)

    def _acceleration(self, time_s: Array) -> Array:
        sense = np.array(self._senses)[self._mounting(time_s)]
        along = np.column_stack((np.ones(len(sense)), sense, sense))
        return np.asarray(self._gravity_g * along * super()._acceleration(time_s))

    def _device_angle(self, time_s: Array) -> Array:
        angle_deg = super()._device_angle(time_s)
        stage = np.radians(self.rotation.angle_deg(time_s))
        for n, (cosine, sine) in zip(HARMONICS, self.graduation_deg, strict=True):
            angle_deg = angle_deg + cosine * np.cos(n * stage) + sine * np.sin(n * stage)
        return np.asarray(angle_deg + np.array(self._turned_deg)[self._mounting(time_s)])
