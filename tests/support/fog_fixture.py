"""A simulated navigator on its table, without its flaws, for tests of its world."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import numpy.typing as npt
from places import SIM
from quick_yaml import load_yaml
from scipy.spatial.transform import Rotation

from sim_instruments.truth import Truth
from sim_instruments.world.fog import FogBench

Array = npt.NDArray[np.float64]

BENCH: dict[str, Any] = load_yaml(SIM.read_text(encoding="utf-8"))
LATITUDE_DEG = 39.9
EARTH_DEG_PER_S = 15.041067 / 3600
AXES = ("x", "y", "z")
UP = {"x": (90.0, 0.0), "y": (0.0, -90.0), "z": (0.0, 180.0)}
"""Angles of the middle and the inner axis at which an axis points up."""
OUTER, MIDDLE, INNER = 1, 2, 3
RATE, ACCELERATION = 10.0, 10.0
TURN_S = 37.0

IDEAL: dict[str, Any] = {
    "powered_at_start": True,
    **{
        f"table__{ring}__lean": dict.fromkeys((f"towards_{one}" for one in others), "0 deg")
        for ring, others in (("outer", "xy"), ("middle", "xz"), ("inner", "yz"))
    },
    "table__wander": "0 deg",
    "chamber__cycling__amplitude": "0 K",
    **{f"gyros__{axis}__bias": "0 deg/h" for axis in AXES},
    **{f"gyros__{axis}__bias_per_degC": "0 deg/h/degC" for axis in AXES},
    "gyros__shupe_at_1_degC_per_min": "0 deg/h",
    "gyros__bias_walk": "0 deg/h/sqrt(h)",
    "gyros__angle_random_walk": "0 deg/sqrt(h)",
    "gyros__sensor_offset": dict.fromkeys(AXES, "0 K"),
    "gyros__sensor_noise": "0 K",
    "navigator__mounting_error": dict.fromkeys(("about_x", "about_y", "about_z"), "0 deg"),
    "navigator__alignment__heading_error": "0 deg",
    "navigator__alignment__level_error": "0 deg",
    "navigator__heading_noise": "0 deg",
    "navigator__level_noise": "0 deg",
}


def fog_world(ideal: bool = True, **changes: Any) -> FogBench:
    """Return the world of the simulated bench, with changes by path, such as `gyros__x__lag`."""
    data = copy.deepcopy(BENCH["simulation"])
    for path, value in ((IDEAL if ideal else {}) | changes).items():
        *sections, key = path.split("__")
        place = data["fog"]
        for section in sections:
            place = place[section]
        place[key] = value
    return FogBench(Truth(data, "simulation"))


def aligned_world(ideal: bool = True, **changes: Any) -> FogBench:
    """Return a world whose navigator was aligned, at a latitude that is right, 300 s ago."""
    world = fog_world(ideal, **changes)
    world.power(0.0, True)
    world.align(0.0, LATITUDE_DEG)
    return world


def point_up(world: FogBench, time_s: float, axis: str) -> None:
    """Let an axis of the navigator go up; it stands there after half a minute."""
    middle, inner = UP[axis]
    world.table.axis(MIDDLE).move_to(time_s, middle, RATE, ACCELERATION)
    world.table.axis(INNER).move_to(time_s, inner, RATE, ACCELERATION)


def turn(world: FogBench, time_s: float, sense: int) -> None:
    """Turn the outer axis by 360 deg, clockwise for a sense of 1; it takes 37 s."""
    outer = world.table.axis(OUTER)
    outer.turn_at(time_s, sense * RATE, ACCELERATION)
    outer.stop(time_s + 36.0, ACCELERATION)


def attitude(world: FogBench, time_s: float) -> Array:
    """Return the navigator's C_b^n at a time."""
    angles = world.navigator_attitude(np.array([time_s]))[0]
    return np.asarray(Rotation.from_euler("ZYX", angles, degrees=True).as_matrix())


def turned_deg(world: FogBench, before_s: float, after_s: float) -> float:
    """Return by how much the navigator thinks that it turned clockwise, whole turns left out."""
    between = attitude(world, after_s) @ attitude(world, before_s).T
    return float(
        np.degrees(np.arctan2(between[1, 0] - between[0, 1], between[0, 0] + between[1, 1]))
    )


def delta_ppm(world: FogBench, axis: str, time_s: float) -> float:
    """Return an axis' true scale factor error at a time."""
    temperature = world.gyros.temperature_degC(np.array([time_s]))
    return 1e6 * float(world.gyros.scale_factor_error(temperature)[0, AXES.index(axis)])
