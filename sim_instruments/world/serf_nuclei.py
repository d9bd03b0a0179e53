"""The noble gas in the cell: its polarised nuclei are a field for the electrons.

They turn slowly about the field that the coils make, lose their polarisation in tens of minutes,
and within about a second in a field gradient. What the alkali does to them is left out: within
the time of a calibration they are not pumped anew.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import Truth
from sim_instruments.world.coils import AXES

Array = npt.NDArray[np.float64]

NOTHING_NT = 1e-12
"""Below this the nuclei are taken as depolarised for good."""


class Nuclei:
    """The nuclear field from the beginning of time on.

    Truth (`simulation.serf.noble_gas`): `field` x, y, z at the beginning when the gyro was
    running, `gyromagnetic_ratio` (its sign is the sense of rotation), `lifetime`, and
    `wall_rate`: how often an atom diffuses across the cell, D (pi/radius)², in events per second.
    """

    def __init__(self, truth: Truth, radius_cm: float, was_running: bool) -> None:
        field = np.array(truth.quantities("field", AXES, "nT"))
        self.initial_nT: Array = field if was_running else np.zeros(3)
        self._ratio = 2.0 * np.pi * truth.quantity("gyromagnetic_ratio", "Hz/nT")
        self._decay = 1.0 / truth.quantity("lifetime", "s")
        self._wall_rate = truth.quantity("wall_rate", "Hz")
        self._diffusion_cm2_per_s = self._wall_rate * (radius_cm / np.pi) ** 2

    def decay_per_s(self, field_nT: float, gradient_nT_per_cm: float) -> float:
        """Return the rate at which the polarisation fades in a field and a gradient along z.

        1/T1 = D |grad B_perp|²/B², where a gradient g along z is -g/2 along x and y; never faster
        than atoms diffuse across the cell.
        """
        across2 = 0.5 * gradient_nT_per_cm**2
        driven = self._diffusion_cm2_per_s * across2
        if driven == 0.0:
            return self._decay
        return self._decay + driven * self._wall_rate / (driven + field_nT**2 * self._wall_rate)

    def later(
        self, start_nT: Array, field_nT: Array, gradient_nT_per_cm: float, after_s: Array
    ) -> Array:
        """Return the nuclear field some times after it was `start_nT`, in a steady field, (n, 3).

        `field_nT`: the field of coils and shield, shape (3,).
        """
        size = float(np.linalg.norm(field_nT))
        decay = np.exp(-self.decay_per_s(size, gradient_nT_per_cm) * after_s)[:, None]
        if size == 0.0:
            return np.asarray(start_nT * decay)
        along = field_nT / size
        in_line = (along @ start_nT) * along
        across, turned = start_nT - in_line, np.cross(along, start_nT)
        angle = (self._ratio * size * after_s)[:, None]
        later = decay * (in_line + np.cos(angle) * across + np.sin(angle) * turned)
        return np.asarray(np.where(np.abs(later) > NOTHING_NT, later, 0.0))
