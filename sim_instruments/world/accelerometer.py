"""The linear accelerometer: its output by the full model, its attitude, its temperature.

Model (IEEE Std 836 and 1293 with the magnetic terms of the published procedure): accelerations
A_i A_o A_p in g, field A_m in T, output in V. K_o and K_p are the misalignment of the input axis.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import Truth
from sim_instruments.world.laser_gyro import Heat

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

COEFFICIENTS = {
    "K0": "V",
    "Ki": "V/g",
    "Kii": "V/g^2",
    "Kiii": "V/g^3",
    "Kio": "V/g^2",
    "Kip": "V/g^2",
    "Koo": "V/g^2",
    "Kpp": "V/g^2",
    "Km": "V/T",
    "Kmm": "V/T^2",
    "Kim": "V/g/T",
    "Kom": "V/g/T",
    "Kpm": "V/g/T",
    "Ko": "V/g",
    "Kp": "V/g",
}

PLANES = ("io", "ip", "op", "level")
# The specific force on IA, OA, PA is the sum of these rows times sin, cos and 1.
BY_SINE = np.array([[1.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]])
BY_COSINE = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 0, 0]])
CONSTANT = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 1]])
# And of these times the sine of the tilt of the stage's axis, towards it.
TILT_BY_SINE = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]])
TILT_BY_COSINE = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 1, 0]])
TILT_CONSTANT = np.array([[0.0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, 0]])
# Where IA points: x along the coil, y along the stage's horizontal axis, z up; in the plane
# `level` the axis is vertical.
IA_BY_SINE = np.array([[0.0, 0, 1], [0, 0, 1], [0, 0, 0], [0, 1, 0]])
IA_BY_COSINE = np.array([[1.0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]])
IA_CONSTANT = np.array([[0.0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0]])

# Callendar and Van Dusen, IEC 60751.
PT100 = (3.9083e-3, -5.775e-7, -4.183e-12)


def acceleration_g(plane: Indices, angle_deg: Array, tilt_rad: float = 0.0) -> Array:
    """Return the specific force on IA, OA, PA at angles in planes (numbers in PLANES), (n, 3).

    `tilt_rad` is by how much the stage's axis is not level, or not upright in the plane `level`.
    """
    upright = _turned(plane, angle_deg, BY_SINE, BY_COSINE, CONSTANT)
    if not tilt_rad:
        return upright
    along = _turned(plane, angle_deg, TILT_BY_SINE, TILT_BY_COSINE, TILT_CONSTANT)
    return np.asarray(np.cos(tilt_rad) * upright + np.sin(tilt_rad) * along)


def input_axis(plane: Indices, angle_deg: Array) -> Array:
    """Return the direction of IA in the laboratory, shape (n, 3)."""
    return _turned(plane, angle_deg, IA_BY_SINE, IA_BY_COSINE, IA_CONSTANT)


def _turned(plane: Indices, angle_deg: Array, sine: Array, cosine: Array, one: Array) -> Array:
    angle = np.deg2rad(angle_deg)[:, None]
    return np.asarray(np.sin(angle) * sine[plane] + np.cos(angle) * cosine[plane] + one[plane])


class Accelerometer:
    """A single-axis accelerometer with voltage output, true to its description.

    Truth: see the bench file for every number. `coefficients` hold at `reference_temperature`;
    K0 and Ki change with temperature by `K0_per_K` and `Ki_per_K`. Switched on, the output drifts
    by `drift_in_one_hour` and by what is left of the `warm_up`.
    """

    def __init__(self, truth: Truth) -> None:
        coefficients = truth.section("coefficients")
        self.coefficients = {
            name: coefficients.quantity(name, unit) for name, unit in COEFFICIENTS.items()
        }
        self._K0_per_K = truth.quantity("K0_per_K", "V")
        self._Ki_per_K = truth.quantity("Ki_per_K", "V/g")
        self._reference_degC = truth.quantity("reference_temperature", "degC")
        warm_up = truth.section("warm_up")
        self._warm_up_V = warm_up.quantity("amplitude", "V")
        self.heat = Heat(warm_up.quantity("time_constant", "s"))
        self.self_heating_K = warm_up.quantity("temperature_rise", "K")
        self._drift_V_per_s = truth.quantity("drift_in_one_hour", "V") / 3600.0
        self.noise_V = truth.quantity("noise_in_one_second", "V")
        self._pt100_ohm = truth.quantity("pt100_at_0_degC", "ohm")

    def by_field(self, acceleration: Array, temperature_degC: Array) -> tuple[Array, Array, Array]:
        """Return what of the output goes with the field to the power 0, 1, 2; V, V/T, V/T²."""
        k = self.coefficients
        ai, ao, ap = acceleration.T
        warmer = temperature_degC - self._reference_degC
        constant = (
            k["K0"]
            + self._K0_per_K * warmer
            + (k["Ki"] + self._Ki_per_K * warmer) * ai
            + k["Ko"] * ao
            + k["Kp"] * ap
            + k["Kii"] * ai**2
            + k["Kiii"] * ai**3
            + k["Kio"] * ai * ao
            + k["Kip"] * ai * ap
            + k["Koo"] * ao**2
            + k["Kpp"] * ap**2
        )
        linear = k["Km"] + k["Kim"] * ai + k["Kom"] * ao + k["Kpm"] * ap
        return constant, linear, np.full(ai.shape, k["Kmm"])

    def drift_V(self, time_s: Array) -> Array:
        """Return warm-up and drift at each time."""
        cold = 1.0 - self.heat.warmth(time_s)
        return np.asarray(self._warm_up_V * cold + self._drift_V_per_s * self.heat.on_time(time_s))

    def pt100_ohm(self, temperature_degC: Array) -> Array:
        """Return the resistance of the platinum thermometer in the housing."""
        a, b, c = PT100
        t = temperature_degC
        below = np.where(t < 0.0, c * (t - 100.0) * t**3, 0.0)
        return np.asarray(self._pt100_ohm * (1.0 + a * t + b * t**2 + below))
