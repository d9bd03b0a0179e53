"""Strapdown navigation on the rotating ellipsoid: body rates and specific force to position.

Two speeds: samples are gathered into blocks in the body's own frame, with coning, sculling and the
second integral; navigation takes one step a block, for many variants of a drive at once. Height and
vertical velocity are handed in: free, their errors grow by e every 9.5 min.

Sources: P. G. Savage, Journal of Guidance, Control, and Dynamics 21 (1998) 19 and 208; P. D.
Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems (2013), chapters
2 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EARTH_RATE_RAD_PER_S = 7.292115e-5
EQUATOR_M, FLATTENING = 6378137.0, 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
EQUATOR_G, SOMIGLIANA = 9.7803253359, 0.00193185265241
CENTRIFUGAL = 0.00344978650684
"""Of WGS 84; the last is the centrifugal acceleration over gravity at the equator."""


def gravity_m_per_s2(latitude_rad: Array | float, height_m: Array | float) -> Array:
    """Return gravity, downwards, after Somigliana, and its fall with height."""
    square = np.sin(latitude_rad) ** 2
    surface = EQUATOR_G * (1.0 + SOMIGLIANA * square) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * square)
    part = np.asarray(height_m) / EQUATOR_M
    fall = 2.0 * part * (1.0 + FLATTENING * (1.0 - 2.0 * square) + CENTRIFUGAL) - 3.0 * part**2
    return np.asarray(surface * (1.0 - fall))


def radii_m(latitude_rad: Array | float) -> tuple[Array, Array]:
    """Return the ellipsoid's radii of curvature along the meridian and across it."""
    square = 1.0 - ECCENTRICITY_SQUARED * np.sin(latitude_rad) ** 2
    across = EQUATOR_M / np.sqrt(square)
    return np.asarray(across * (1.0 - ECCENTRICITY_SQUARED) / square), np.asarray(across)


def skew(vector: Array) -> Array:
    """Return the matrices (…, 3, 3) that take the cross product with vectors (…, 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation(vector: Array) -> Array:
    """Return the rotation matrices (…, 3, 3) of rotation vectors (…, 3) in rad."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = skew(vector)
    half = np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross)


@dataclass(frozen=True)
class Blocks:
    """Samples gathered into blocks, for `v` variants, in the body's frame at a block's beginning.

    `time_s` (b + 1,) are the blocks' ends; `turned` (v, b, 3, 3) takes the body's frame at the end
    of a block into that at its beginning; `velocity` and `distance` (v, b, 3) are the first and the
    second integral of the specific force over it, in m/s and m.
    """

    time_s: Array
    turned: Array
    velocity: Array
    distance: Array


def blocks_of(
    time_s: Array, rate_rad_per_s: Array, force_m_per_s2: Array, per_block: int
) -> Blocks:
    """Return the blocks of rates (v, n, 3) and specific force (n, 3), `per_block` intervals each.

    Both are smooth between samples (trapezoids, corrected by the slopes at their ends); coning and
    sculling to the second order of an interval.
    """
    count = -(-(len(time_s) - 1) // per_block)
    spare = count * per_block - (len(time_s) - 1)
    steps = np.diff(time_s)[:, None]
    before, after = rate_rad_per_s[:, :-1], rate_rad_per_s[:, 1:]
    early, late = force_m_per_s2[:-1], force_m_per_s2[1:]
    bend = -np.diff(np.gradient(rate_rad_per_s, time_s, axis=1), axis=1) * steps**2 / 12.0
    plain = 0.5 * (before + after) * steps + bend
    bend = -np.diff(np.gradient(force_m_per_s2, time_s, axis=0), axis=0) * steps**2 / 12.0
    push = 0.5 * (early + late) * steps + bend
    angle = plain + np.cross(before, after) * steps**2 / 12.0
    sculling = (np.cross(before, late) + np.cross(early, after)) * steps**2 / 12.0
    aside = np.cross(plain, push)
    velocity = push + 0.5 * aside + np.cross(plain, aside) / 6.0 + sculling
    distance = (early / 3.0 + late / 6.0) * steps**2 + aside * steps / 6.0

    def gathered(values: Array) -> Array:
        padded = np.pad(values, [(0, 0), (0, spare), (0, 0)])
        return padded.reshape(len(values), count, per_block, values.shape[-1])

    angle, velocity, distance = gathered(angle), gathered(velocity), gathered(distance)
    spans = gathered(steps[None])
    turned = np.broadcast_to(np.eye(3), (len(angle), count, 3, 3)).copy()
    whole, far = (np.zeros((len(angle), count, 3)) for _ in range(2))
    for n in range(per_block):
        far += whole * spans[:, :, n] + np.einsum("vbij,vbj->vbi", turned, distance[:, :, n])
        whole += np.einsum("vbij,vbj->vbi", turned, velocity[:, :, n])
        turned = turned @ rotation(angle[:, :, n])
    ends = np.minimum(np.arange(count + 1) * per_block, len(time_s) - 1)
    return Blocks(time_s[ends], turned, whole, far)


@dataclass(frozen=True)
class State:
    """Where `k` variants are: latitude and longitude in rad, velocity north, east (k, 2) in m/s.

    `attitude` (k, 3, 3) takes the body's frame into north, east, down.
    """

    latitude_rad: Array
    longitude_rad: Array
    velocity_m_per_s: Array
    attitude: Array


@dataclass(frozen=True)
class Track:
    """Where variants were at the end of each block, (b + 1, k), velocity north, east (b + 1, k, 2).

    `attitude` (b + 1, 3, 3) is that of the first variant.
    """

    latitude_rad: Array
    longitude_rad: Array
    velocity_m_per_s: Array
    attitude: Array


def navigate(
    blocks: Blocks,
    start: State,
    height_m: Array,
    down_m_per_s: Array,
    of: NDArray[np.int64],
    turned_rad: Array | float = 0.0,
    pushed_m_per_s: Array | float = 0.0,
) -> Track:
    """Return the tracks of `k` variants; `of` (k,) names the variant of the blocks that each takes.

    `turned_rad` and `pushed_m_per_s` (k, b, 3) are small rotations and velocities that a variant
    has more in each block; height and vertical velocity (b + 1,) hold for all.
    """
    count = len(blocks.time_s) - 1
    shape = (len(of), count, 3)
    turned = np.broadcast_to(np.asarray(turned_rad, dtype=np.float64), shape)
    pushed = np.broadcast_to(np.asarray(pushed_m_per_s, dtype=np.float64), shape)
    latitude, longitude = start.latitude_rad, start.longitude_rad
    velocity, attitude = start.velocity_m_per_s, start.attitude
    at, east, moved, first = [latitude], [longitude], [velocity], [attitude[0]]
    for n, span in enumerate(np.diff(blocks.time_s).tolist()):
        height = 0.5 * float(height_m[n] + height_m[n + 1])
        down = 0.5 * float(down_m_per_s[n] + down_m_per_s[n + 1])
        earth = EARTH_RATE_RAD_PER_S * np.stack(
            (np.cos(latitude), np.zeros_like(latitude), -np.sin(latitude)), axis=-1
        )
        frame = _transport(latitude, velocity, height)
        push = blocks.velocity[of, n] + pushed[:, n]
        far = blocks.distance[of, n] + 0.5 * span * pushed[:, n]
        push = np.einsum("kij,kj->ki", attitude, push)
        far = np.einsum("kij,kj->ki", attitude, far)
        drift = (earth + frame) * span
        push -= 0.5 * np.cross(drift, push)
        far -= np.cross(drift, far) / 3.0
        middle = np.column_stack((velocity + 0.5 * push[:, :2], np.full(len(of), down)))
        coriolis = -np.cross(2.0 * earth + frame, middle)[:, :2]
        step = velocity * span + far[:, :2] + 0.5 * coriolis * span**2
        velocity = velocity + push[:, :2] + coriolis * span
        along, _ = radii_m(latitude)
        halfway = latitude + 0.5 * step[:, 0] / (along + height)
        along, across = radii_m(halfway)
        latitude = latitude + step[:, 0] / (along + height)
        longitude = longitude + step[:, 1] / ((across + height) * np.cos(halfway))
        back = skew((earth + _transport(halfway, step / span, height)) * span)
        attitude = attitude @ blocks.turned[of, n] @ (np.eye(3) + skew(turned[:, n]))
        attitude = attitude - back @ attitude + 0.5 * back @ (back @ attitude)
        at.append(latitude)
        east.append(longitude)
        moved.append(velocity)
        first.append(attitude[0])
    return Track(np.array(at), np.array(east), np.array(moved), np.array(first))


def _transport(latitude_rad: Array, velocity_m_per_s: Array, height_m: float) -> Array:
    """Return the rate at which north, east, down turn over the earth, (k, 3) in rad/s."""
    along, across = radii_m(latitude_rad)
    eastward = velocity_m_per_s[:, 1] / (across + height_m)
    northward = velocity_m_per_s[:, 0] / (along + height_m)
    return np.stack((eastward, -northward, -eastward * np.tan(latitude_rad)), axis=-1)
