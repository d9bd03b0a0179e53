"""The field of Helmholtz pairs, and that of a device by that of a probe beside it.

Each coil is two equal loops about its axis, whose field is known by complete elliptic integrals
(Biot-Savart; J. D. Jackson, Classical Electrodynamics, 5.5). Lengths are in mm, from the centre of
the coils; fields are over that of the same coil at the centre.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipe, ellipk

from station.findings import InputQuantity

Array = NDArray[np.float64]

AXES = ("x", "y", "z")
NODES = 5
"""Of Gauss's rule along each edge: exact for fields up to the ninth power of the place."""
STEP_U = 1e-2
SOURCE = "bench file, coil_geometry"


def pair_field(
    along: Array, across: Array, radius: Array | float, spacing: Array | float
) -> tuple[Array, Array]:
    """Return a pair's field along its axis and away from it, over that at its centre.

    Lengths in one unit, broadcast; `spacing` is over the radius.
    """

    def loop(z: Array, rho: Array) -> tuple[Array, Array]:
        near, far = (radius - rho) ** 2 + z**2, (radius + rho) ** 2 + z**2
        m = 4.0 * radius * rho / far
        first, second, root = ellipk(m), ellipe(m), np.sqrt(far)
        share = (radius**2 - rho**2 - z**2) / near
        outer = (radius**2 + rho**2 + z**2) / near
        off_axis = np.where(rho > 0.0, rho, np.inf)
        away = z / off_axis * (outer * second - first) / root
        return np.asarray((first + share * second) / root), np.asarray(away)

    half = np.asarray(radius * spacing / 2.0)
    centre = 2.0 * loop(half, np.zeros_like(half))[0]
    (before, before_away), (after, after_away) = (
        loop(along - half, across),
        loop(along + half, across),
    )
    return (before + after) / centre, (before_away + after_away) / centre


def pairs_field(point_mm: Array, pairs: Mapping[str, tuple[float, float]]) -> Array:
    """Return the field of each pair at points (..., 3), by pair in the last place: (..., 3, k).

    `pairs` are radius and spacing by the axis that each stands along.
    """
    fields = []
    for axis, (radius_mm, spacing_mm) in pairs.items():
        own = AXES.index(axis)
        away_mm = point_mm.copy()
        away_mm[..., own] = 0.0
        across_mm = np.linalg.norm(away_mm, axis=-1)
        along, away = pair_field(point_mm[..., own], across_mm, radius_mm, spacing_mm / radius_mm)
        field = away_mm / np.where(across_mm > 0.0, across_mm, np.inf)[..., None] * away[..., None]
        field[..., own] = along
        fields.append(field)
    return np.stack(fields, axis=-1)


def box_nodes(edges_mm: Sequence[float]) -> tuple[Array, Array]:
    """Return places (n, 3) and weights (n,) of the mean over a box about the origin."""
    node, weight = np.polynomial.legendre.leggauss(NODES)
    places = np.stack(np.meshgrid(*3 * [node / 2.0], indexing="ij"), axis=-1).reshape(-1, 3)
    weights = np.einsum("i,j,k->ijk", weight, weight, weight).ravel() / 8.0
    return places * np.asarray(edges_mm), weights


def sphere_nodes(diameter_mm: float) -> tuple[Array, Array]:
    """Return places (n, 3) and weights (n,) of the mean over a sphere about the origin."""
    node, weight = np.polynomial.legendre.leggauss(NODES)
    radius, turn = (node + 1.0) / 2.0, np.arange(2 * NODES) * np.pi / NODES
    r, height, angle = (grid.ravel() for grid in np.meshgrid(radius, node, turn, indexing="ij"))
    weights = np.einsum("i,j,k->ijk", weight * radius**2, weight, np.ones(turn.size)).ravel()
    flat = np.sqrt(1.0 - height**2)
    places = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), height])
    return places * r[:, None] * diameter_mm / 2.0, weights / weights.sum()


@dataclass(frozen=True)
class FieldAtDevice:
    """The mean field over a device's volume by the field at a probe beside it.

    `coils` are the axes of the pairs; `lengths_mm` the radius and spacing of each, and the places
    of probe and device, with their standard uncertainties, by the names of their inputs;
    `nodes_mm` and `weights` the device's volume about its middle.

    A field of `k` coils is a column (k,) along their axes. `matrix` takes that at the probe to the
    device: what one coil makes along the axis of another where the probe stands is taken off.
    """

    coils: tuple[str, ...]
    lengths_mm: Mapping[str, tuple[float, float]]
    nodes_mm: Array
    weights: Array

    def fields(self, lengths_mm: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the fields of the coils at the probe (3, k) and over the device (nodes, 3, k)."""
        pairs = {
            axis: (lengths_mm[f"coil_{axis}_radius_mm"], lengths_mm[f"coil_{axis}_spacing_mm"])
            for axis in self.coils
        }
        probe, device = (
            np.array([lengths_mm[f"{what}_{axis}_mm"] for axis in AXES])
            for what in ("probe", "device")
        )
        return pairs_field(probe, pairs), pairs_field(self.nodes_mm + device, pairs)

    def matrix_of(self, lengths_mm: Mapping[str, float]) -> Array:
        """Return the matrix (k, k) of other lengths."""
        rows = [AXES.index(axis) for axis in self.coils]
        probe, device = self.fields(lengths_mm)
        mean = np.einsum("n,nij->ij", self.weights, device)
        return np.asarray(mean[rows] @ np.linalg.inv(probe[rows]))

    @cached_property
    def stated_mm(self) -> dict[str, float]:
        """The lengths alone."""
        return {name: value for name, (value, _) in self.lengths_mm.items()}

    @cached_property
    def matrix(self) -> Array:
        """The matrix (k, k) that takes the field at the probe to the device."""
        return self.matrix_of(self.stated_mm)

    @cached_property
    def spread(self) -> Mapping[str, float]:
        """The standard deviation of each coil's field over the device, over its mean, by axis."""
        _, device = self.fields(self.stated_mm)
        spread = {}
        for k, axis in enumerate(self.coils):
            own = device[:, AXES.index(axis), k]
            mean = self.weights @ own
            spread[axis] = float(np.sqrt(self.weights @ (own - mean) ** 2) / mean)
        return spread

    def deviating(self, name: str, by: float) -> Array:
        """Return the matrix (k, k) from the field at the device as stated to that where an input
        deviates.
        """
        if name in self.lengths_mm:
            lengths_mm = self.stated_mm | {name: self.stated_mm[name] + by}
            return np.asarray(self.matrix_of(lengths_mm) @ np.linalg.inv(self.matrix))
        own = [1.0 + by * (name == f"device_volume_{axis}") for axis in self.coils]
        return np.diag(own)

    @cached_property
    def slopes(self) -> Mapping[str, Array]:
        """By input the derivative (k, k) of the field at the device, over that field."""
        slopes = {}
        for quantity in self.inputs:
            step = STEP_U * (quantity.standard_uncertainty or 1.0)
            up, down = (self.deviating(quantity.name, by) for by in (step, -step))
            slopes[quantity.name] = (up - down) / (2.0 * step)
        return slopes

    @cached_property
    def inputs(self) -> tuple[InputQuantity, ...]:
        """The inputs of a budget: each coordinate, each coil's geometry, each coil's spread."""
        return tuple(self._inputs())

    def _inputs(self) -> Iterator[InputQuantity]:
        for name, (value, u) in self.lengths_mm.items():
            what, axis, *length = name.removesuffix("_mm").split("_")
            about = f"place of the device along {axis}"
            if length:
                about = f"coil {axis}: {length[0]}"
            elif what == "probe":
                about = f"place of the probe along {axis}"
            yield InputQuantity(name, about, u, "mm", SOURCE, value=value)
        for axis, spread in self.spread.items():
            about = f"field of coil {axis} over the device, which may feel it anywhere in itself"
            name = f"device_volume_{axis}"
            yield InputQuantity(name, about, spread, "1", SOURCE, distribution="uniform")

    def by_input(self, coil: str) -> Mapping[str, Array]:
        """Return the derivatives (k,) of all fields by that of a coil, of the inputs that a coil's
        share has: both places, its own geometry and its own spread.
        """
        k = self.coils.index(coil)
        others = {
            f"{what}_{axis}{end}"
            for axis in self.coils
            if axis != coil
            for what, end in (
                ("coil", "_radius_mm"),
                ("coil", "_spacing_mm"),
                ("device_volume", ""),
            )
        }
        return {name: slope[:, k] for name, slope in self.slopes.items() if name not in others}

    def ratio(self, coil: str) -> tuple[float, float]:
        """Return the device's field along a coil over the probe's, and its standard uncertainty."""
        k = self.coils.index(coil)
        value = float(self.matrix[k, k])
        u = {quantity.name: quantity.standard_uncertainty or 0.0 for quantity in self.inputs}
        own = {name: slope[k] * u[name] for name, slope in self.by_input(coil).items()}
        return value, value * float(np.linalg.norm([*own.values()]))


def carried(field: Array, matrix: Array) -> Array:
    """Return fields (n, k) by a matrix (k, k); a component that was never seen stays zero."""
    seen = field.any(axis=0)
    return np.asarray(np.where(seen, field @ matrix.T, 0.0))
