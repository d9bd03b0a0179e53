"""Where a bench's coils, its field probe and the device stand, as the laboratory measured it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from station.fields import StrictModel, Unit

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")
Length = Annotated[float, Unit("mm"), Field(gt=0, le=5000)]
Coordinate = Annotated[float, Unit("mm"), Field(ge=-5000, le=5000)]
Uncertainty = Annotated[float, Unit("mm"), Field(gt=0, le=100)]
NARROWEST, WIDEST = 0.6, 1.6
"""Spacings over the radius that may be those of a Helmholtz pair, which has one radius."""
ROUGHEST = 0.01
"""Of the radius: with lengths known less well their squares count, which the budget leaves out."""


class PairGeometry(StrictModel):
    """Two equal windings about one axis: `radius`, and `spacing` from middle to middle."""

    radius_mm: Length
    radius_uncertainty_mm: Uncertainty
    spacing_mm: Length
    spacing_uncertainty_mm: Uncertainty

    @field_validator("spacing_mm")
    @classmethod
    def about_the_radius(cls, spacing_mm: float, info: ValidationInfo) -> float:
        """Refuse a spacing that no Helmholtz pair has, such as one beside a diameter."""
        radius_mm = info.data.get("radius_mm")
        if radius_mm and not NARROWEST <= spacing_mm / radius_mm <= WIDEST:
            raise ValueError(
                f"is {spacing_mm / radius_mm:.2g} times the radius; that of a Helmholtz pair is "
                "about the radius: give the radius, not the diameter, and the distance between the "
                "middles of the two windings"
            )
        return spacing_mm

    @field_validator("radius_uncertainty_mm", "spacing_uncertainty_mm")
    @classmethod
    def well_known(cls, uncertainty_mm: float, info: ValidationInfo) -> float:
        """Refuse an uncertainty whose square would count."""
        radius_mm = info.data.get("radius_mm")
        if radius_mm and uncertainty_mm > ROUGHEST * radius_mm:
            raise ValueError(
                f"is {100.0 * uncertainty_mm / radius_mm:.2g} % of the radius; at most 1 % will "
                "do: measure the coil anew, or leave coil_geometry out"
            )
        return uncertainty_mm

    def holds(self, along_mm: float, across_mm: float) -> bool:
        """Tell whether a place lies between the windings and within their circle."""
        return along_mm < self.spacing_mm / 2.0 and across_mm < self.radius_mm


def split(point_mm: tuple[float, ...], axis: Axis) -> tuple[float, float]:
    """Return the distances of a place from the centre along an axis and across it."""
    along_mm = abs(point_mm[AXES.index(axis)])
    return along_mm, math.sqrt(max(sum(part**2 for part in point_mm) - along_mm**2, 0.0))


class Position(StrictModel):
    """A place from the centre of the coils along their axes; each coordinate is that uncertain."""

    x_mm: Coordinate
    y_mm: Coordinate
    z_mm: Coordinate
    uncertainty_mm: Uncertainty

    @property
    def point_mm(self) -> tuple[float, float, float]:
        """The place as coordinates."""
        return self.x_mm, self.y_mm, self.z_mm

    def reach_mm(self, axis: Axis) -> tuple[float, float]:
        """Return how far it lies along an axis, of either sense, and across it."""
        return split(self.point_mm, axis)


class Box(StrictModel):
    """Edges of a box along the axes of the coils."""

    x_mm: Length
    y_mm: Length
    z_mm: Length

    @property
    def edges_mm(self) -> tuple[float, float, float]:
        """The edges along x, y, z."""
        return self.x_mm, self.y_mm, self.z_mm


class DevicePosition(Position):
    """Where the middle of a device is, and its size: a `box`, or a `sphere` by its diameter."""

    box: Box | None = None
    sphere_mm: Length | None = Field(default=None, validate_default=True)

    @field_validator("sphere_mm")
    @classmethod
    def either_size(cls, sphere_mm: float | None, info: ValidationInfo) -> float | None:
        """Refuse a device without a size, and with two."""
        if "box" in info.data and (sphere_mm is None) == (info.data["box"] is None):
            raise ValueError("give the size of the device once: `box` or `sphere`")
        return sphere_mm

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """The edges of the box, or those of the cube about the sphere."""
        return self.box.edges_mm if self.box is not None else 3 * (self.sphere_mm or 0.0,)

    def reach_mm(self, axis: Axis) -> tuple[float, float]:
        """Return how far the device reaches along an axis, of either sense, and across it."""
        if self.box is None:
            along, across = split(self.point_mm, axis)
            return along + (self.sphere_mm or 0.0) / 2.0, across + (self.sphere_mm or 0.0) / 2.0
        edges = zip(self.point_mm, self.size_mm, strict=True)
        return split(tuple(abs(middle) + edge / 2.0 for middle, edge in edges), axis)


class CoilSystem(StrictModel):
    """Helmholtz pairs about one centre, by the axis that each stands along."""

    pairs: Annotated[dict[Axis, PairGeometry], Field(min_length=1)]
    probe: Position
    device: DevicePosition

    @field_validator("probe")
    @classmethod
    def probe_within(cls, probe: Position, info: ValidationInfo) -> Position:
        """Refuse a probe outside of a coil."""
        for axis, pair in info.data.get("pairs", {}).items():
            if not pair.holds(*probe.reach_mm(axis)):
                raise ValueError(
                    f"lies outside coil {axis}; give its place from the centre of the coils, "
                    "between their windings"
                )
        return probe

    @field_validator("device")
    @classmethod
    def device_within(cls, device: DevicePosition, info: ValidationInfo) -> DevicePosition:
        """Refuse a device that reaches out of a coil."""
        for axis, pair in info.data.get("pairs", {}).items():
            if not pair.holds(*device.reach_mm(axis)):
                raise ValueError(
                    f"reaches out of coil {axis}; give the place of its middle from the centre of "
                    "the coils, and its size"
                )
        return device


class CoilGeometry(StrictModel):
    """The three-axis coil, and the strong coil, whose axis is x of the probe."""

    three_axis: CoilSystem | None = None
    dc: CoilSystem | None = None

    @field_validator("three_axis", "dc")
    @classmethod
    def with_its_pairs(cls, system: CoilSystem | None, info: ValidationInfo) -> CoilSystem | None:
        """Refuse another number of pairs than the coil has."""
        if system is None:
            return None
        needed = PAIRS[str(info.field_name)]
        if {*system.pairs} != {*needed}:
            raise ValueError(f"must give the pairs {', '.join(needed)}, and no other")
        return system


PAIRS: Mapping[str, tuple[Axis, ...]] = {"three_axis": AXES, "dc": ("x",)}
"""The axes of the pairs of each coil."""
