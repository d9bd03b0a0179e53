"""The field of the three-axis Helmholtz coil, from its geometry.

Each axis is a pair of circular windings, ideally one radius apart and with their common normal
along x, y or z of the coil frame. Spacing and normals are off by what the truth says. The field
per ampere is taken once, at the points of interest; it is linear in the current.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from sim_instruments.truth import SimulationError, Truth

AXES = ("x", "y", "z")
Array = npt.NDArray[np.float64]


def direction_near(axis: str, lean: Truth) -> Array:
    """Return the unit vector near an axis that leans `towards_…` the two others, shape (3,)."""
    direction = np.zeros(3)
    for k, other in enumerate(AXES):
        towards = 0.0 if other == axis else lean.quantity(f"towards_{other}", "rad")
        direction[k] = 1.0 if other == axis else np.tan(towards)
    return np.asarray(direction / np.linalg.norm(direction))


class HelmholtzPair:
    """Two equal circular windings about a common normal through the origin.

    Truth: `radius`, `turns` of each winding, `spacing_error` of the distance relative to the
    radius, `normal`: the angles by which the normal leans towards the two other axes.
    """

    def __init__(self, axis: str, truth: Truth) -> None:
        self.radius_m = truth.quantity("radius", "mm") * 1e-3
        self.turns = truth.integer("turns", 1)
        self.spacing_m = self.radius_m * (1.0 + truth.quantity("spacing_error", "1"))
        if self.radius_m <= 0 or self.spacing_m <= 0:
            raise SimulationError(f"{truth.where}: radius and spacing must be positive")
        self.normal = direction_near(axis, truth.section("normal"))

    def field_mT_per_A(self, point_m: Array) -> Array:
        """Return the field of one ampere at a point of the coil frame, shape (3,), in mT."""
        import magpylib  # where it is used: only some worlds have coils, and it takes its time

        z = np.array([0.0, 0.0, 1.0])
        turn, _ = Rotation.align_vectors([self.normal], [z])
        field = np.zeros(3)
        for side in (-0.5, 0.5):
            loop = magpylib.current.Circle(
                current=float(self.turns),
                diameter=2.0 * self.radius_m,
                position=side * self.spacing_m * self.normal,
                orientation=turn,
            )
            field = field + np.asarray(loop.getB(point_m), dtype=float)
        return field * 1e3


def field_matrix_mT_per_A(pairs: list[HelmholtzPair], point_m: Array) -> Array:
    """Return the field at a point per ampere in each pair, shape (3, 3): field by coil, in mT/A."""
    return np.column_stack([pair.field_mT_per_A(point_m) for pair in pairs])


def small_rotation(truth: Truth, key: str) -> Array:
    """Return the rotation matrix that takes coil-frame vectors into a slightly turned frame.

    Truth: below `key` the angles `about_x`, `about_y`, `about_z` of that frame in the coil frame.
    """
    angles = truth.quantities(key, ["about_x", "about_y", "about_z"], "rad")
    return np.asarray(Rotation.from_rotvec(angles).as_matrix(), dtype=float).T
