"""A drive with specific force and the trajectory that it truly took, by equations of its own.

In an inertial frame, where the station navigates in north, east, down: velocities and attitudes are
differentiated numerically, earth and gravity are this file's own. Laps of a yard, on ground that is
not quite level, from rest to rest; rates and specific force are values at their times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

EARTH = 7.292115e-5
MAJOR, MINOR = 6378137.0, 6356752.314245
SQUARE = 1.0 - (MINOR / MAJOR) ** 2
STEP_S = 0.01
STENCIL = ((-2, 1.0 / 12.0), (-1, -8.0 / 12.0), (1, 8.0 / 12.0), (2, -1.0 / 12.0))
STOP_S, STRAIGHT_S, CORNER_S, START_S = 20.0, 30.0, 8.0, 12.0
SPEED_M_PER_S = 8.0
TILT_DEG, TILT_PERIOD_S = 0.6, 37.0
COOLING_S = 1500.0


@dataclass(frozen=True)
class Journey:
    """A drive: columns as the import has them, and the truth. Angles in deg, rates in deg/s."""

    time_s: Array
    rate_deg_per_s: Array
    force_m_per_s2: Array
    temperature_degC: Array
    latitude_deg: Array
    longitude_deg: Array
    height_m: Array
    velocity_m_per_s: Array
    attitude_deg: Array


def normal_gravity(latitude: Array, height: float) -> Array:
    """Return gravity by the ellipsoid's closed formula, its fall with height to first order."""
    pole, equator = 9.8321849379, 9.7803253359
    cosine, sine = np.cos(latitude) ** 2, np.sin(latitude) ** 2
    surface = (MAJOR * equator * cosine + MINOR * pole * sine) / np.sqrt(
        MAJOR**2 * cosine + MINOR**2 * sine
    )
    return np.asarray(surface - 3.0877e-6 * (1.0 - 0.00142 * sine) * height)


def simulated_journey(
    error_ppm: Mapping[str, Callable[[Array], Array]] | None = None,
    *,
    laps: int = 4,
    interval_s: float = 0.1,
    latitude_deg: float = 40.0,
    heading_deg: float = 25.0,
    height_m: float = 50.0,
    temperature_degC: tuple[float, float] = (45.0, 20.0),
    gyro_bias_deg_per_h: tuple[float, float, float] = (0.0, 0.0, 0.0),
    accelerometer_bias_m_per_s2: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gyro_noise_deg_per_s: float = 0.0,
    accelerometer_noise_m_per_s2: float = 0.0,
    climb_m: float = 0.0,
    seed: int = 0,
) -> Journey:
    """Return a journey of `laps` times four corners to the right; `climb_m` up a hill and down."""
    side = STRAIGHT_S + CORNER_S
    end = 2.0 * STOP_S + 4.0 * laps * side

    def turned(t: Array) -> Array:
        since = np.clip(t - STOP_S, 0.0, 4.0 * laps * side)
        corner = np.clip(since % side - STRAIGHT_S, 0.0, CORNER_S) / CORNER_S
        part = corner - np.sin(2.0 * np.pi * corner) / (2.0 * np.pi)
        return np.radians(heading_deg) + 0.5 * np.pi * (np.floor(since / side) + part)

    def speed(t: Array) -> Array:
        def ramp(x: Array) -> Array:
            x = np.clip(x, 0.0, 1.0)
            return x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi)

        return SPEED_M_PER_S * (ramp((t - STOP_S) / START_S) * ramp((end - STOP_S - t) / START_S))

    def height(t: Array) -> Array:
        return height_m + climb_m * np.sin(np.pi * np.clip(t / end, 0.0, 1.0)) ** 2

    def down(t: Array) -> Array:
        inside = (t > 0.0) & (t < end)
        return -climb_m * np.pi / end * np.sin(2.0 * np.pi * t / end) * inside

    def over_earth(t: Array, at: Array) -> Array:
        radius = MAJOR / np.sqrt(1.0 - SQUARE * np.sin(at[0]) ** 2)
        along = radius**3 * (1.0 - SQUARE) / MAJOR**2
        return np.array(
            [
                speed(t) * np.cos(turned(t)) / (along + height(t)),
                speed(t) * np.sin(turned(t)) / ((radius + height(t)) * np.cos(at[0])),
            ]
        )

    time = np.arange(0.0, end + 0.5 * interval_s, interval_s)
    solved = solve_ivp(
        over_earth,
        (-3.0 * STEP_S, time[-1] + 3.0 * STEP_S),
        [np.radians(latitude_deg), np.radians(10.0)],
        method="DOP853",
        rtol=1e-12,
        atol=1e-15,
        dense_output=True,
        max_step=2.0,
    )

    def frames(t: Array) -> tuple[Array, Array, Array, Array]:
        """Return position, velocity, body's and north-east-down axes in the inertial frame."""
        latitude, longitude = solved.sol(t)
        angle = longitude + EARTH * t
        sine, cosine, s, c = np.sin(latitude), np.cos(latitude), np.sin(angle), np.cos(angle)
        zero = np.zeros_like(t)
        axes = np.moveaxis(
            np.array(
                [[-sine * c, -s, -cosine * c], [-sine * s, c, -cosine * s], [cosine, zero, -sine]]
            ),
            2,
            0,
        )
        radius = MAJOR / np.sqrt(1.0 - SQUARE * sine**2)
        far = (radius + height(t)) * cosine
        place = np.column_stack((far * c, far * s, (radius * (1.0 - SQUARE) + height(t)) * sine))
        ned = np.column_stack((speed(t) * np.cos(turned(t)), speed(t) * np.sin(turned(t)), down(t)))
        moved = np.einsum("nij,nj->ni", axes, ned) + np.cross([0.0, 0.0, EARTH], place)
        body = axes @ Rotation.from_euler("ZYX", attitude(t)).as_matrix()
        return place, moved, body, axes

    def attitude(t: Array) -> Array:
        share = np.sin(np.pi * t / end) ** 2 * np.radians(TILT_DEG)
        pitch = share * np.sin(2.0 * np.pi * t / (1.3 * TILT_PERIOD_S) + 1.0)
        return np.column_stack((turned(t), pitch, share * np.sin(2.0 * np.pi * t / TILT_PERIOD_S)))

    place, _, body, axes = frames(time)
    beside = {n: frames(time + n * STEP_S) for n, _ in STENCIL}
    acceleration = sum(weight * beside[n][1] for n, weight in STENCIL) / STEP_S
    change = sum(weight * beside[n][2] for n, weight in STENCIL) / STEP_S
    spin = np.swapaxes(body, 1, 2) @ change
    rate = np.degrees(np.column_stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0])))
    latitude, longitude = solved.sol(time)
    pull = axes[:, :, 2] * normal_gravity(latitude, height(time))[:, None]
    pull += EARTH**2 * -place * [1.0, 1.0, 0.0]
    force = np.einsum("nji,nj->ni", body, acceleration - pull)
    warm, cool = temperature_degC
    heat = cool + (warm - cool) * np.exp(-time / COOLING_S)
    generator = np.random.default_rng(seed)
    if error_ppm is not None:
        rate = rate * (1.0 + 1e-6 * np.column_stack([error_ppm[axis](heat) for axis in "xyz"]))
    rate = rate + np.array(gyro_bias_deg_per_h) / 3600.0
    rate = rate + gyro_noise_deg_per_s * generator.standard_normal(rate.shape)
    force = force + np.array(accelerometer_bias_m_per_s2)
    force = force + accelerometer_noise_m_per_s2 * generator.standard_normal(force.shape)
    ned = (speed(time) * np.cos(turned(time)), speed(time) * np.sin(turned(time)), down(time))
    return Journey(
        time,
        rate,
        force,
        np.column_stack([heat] * 3),
        np.degrees(latitude),
        np.degrees(longitude),
        height(time),
        np.column_stack(ned),
        np.degrees(attitude(time)),
    )
