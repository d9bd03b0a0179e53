"""The world of the linear accelerometer: a strong coil, a rotary stage, gravity, the device.

Model (IEEE Std 836 and 1293 with the magnetic terms of the published procedure): accelerations
A_i A_o A_p in g, field A_m in T, output in V. K_o and K_p are the misalignment of the input axis.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from sim_instruments.truth import Truth
from sim_instruments.world.base import CHAMBER, DEVICE, STRONG_COIL, World
from sim_instruments.world.coils import AXES, CoilHeat, HelmholtzPair, mean_current_and_square
from sim_instruments.world.laser_gyro import Heat
from sim_instruments.world.noise import WhiteNoise, generator
from sim_instruments.world.piecewise import Array, Indices, Nodes, Pieces, lengths_of, nodes_within
from sim_instruments.world.platinum import platinum_ohm
from sim_instruments.world.rotation import RotationHistory

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


def _turned(plane: Indices, angle_deg: Array, sine: Array, cosine: Array, constant: Array) -> Array:
    angle = np.deg2rad(angle_deg)[:, None]
    return np.asarray(np.sin(angle) * sine[plane] + np.cos(angle) * cosine[plane] + constant[plane])


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
        return platinum_ohm(self._pt100_ohm, temperature_degC)


SLOW_PANEL_S, SLOW_ORDER = 5.0, 3
"""Temperatures and drifts take minutes."""
FAST_PANEL_S, FAST_ORDER = 0.05, 6
"""The coil's current takes its time constant, and the stage turns a few degrees meanwhile."""

MOUNTINGS = {
    "io": "its pendulous axis along the horizontal axis of the stage",
    "ip": "its output axis along the horizontal axis of the stage",
    "op": "its input axis along the horizontal axis of the stage",
    "level": "its pendulous axis up, along the vertical axis of the stage",
}


class AccelerometerBench(World):
    """The current in the strong coil, the field it makes, gravity, and the accelerometer.

    The coil's axis is x of the gaussmeter's probe; the accelerometer, in its centre, feels the
    field along that axis. `rotation` is where the stage truly stands, whatever its encoder says;
    the device stands `angle_offset` further, in every plane, and turns against the stage's sense
    where it is `reversed`. The stage's axis may be off level by
    `axis_tilt`, and `soft_iron` near the device may add its share to the field that it feels.
    """

    preparations: tuple[str, ...] = ("mount-io", "connect-cables", "dut-power-on")

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self._powered = False
        self.rotation = RotationHistory(changed=self._changed)
        # Before anybody mounts it, the device lies on the bench.
        self._planes = [PLANES.index("level")]
        self._mounted_s: list[float] = []
        self._switched_s: list[float] = []
        strong = truth.section("dc_coil")
        self._current = self.coil(STRONG_COIL)
        self._heat = CoilHeat(strong.section("heating"), self._current)
        pair = HelmholtzPair("x", strong)
        # Soft iron near the device, none at the probe.
        iron_T_per_mT = (1.0 + truth.section("accelerometer").error("soft_iron", "1")) * 1e-3
        centre_mT_per_A = float(pair.field_mT_per_A(np.zeros(3)) @ pair.normal)
        self.device_T_per_A = centre_mT_per_A * iron_T_per_mT
        self.device_ambient_T = float(self.ambient_mT @ pair.normal) * iron_T_per_mT
        probe_m = np.array(strong.quantities("probe_position", AXES, "mm")) * 1e-3
        self._probe_mT_per_A = pair.field_mT_per_A(probe_m)
        room = truth.section("room")
        self._room_degC = room.quantity("temperature", "degC")
        self._swing_K = room.quantity("swing", "K")
        self._swing_s = room.quantity("period", "s")
        device = truth.section("accelerometer")
        self.accelerometer = Accelerometer(device)
        self.angle_offset_deg = device.quantity("angle_offset", "deg")
        self._sense = -1.0 if device.switch("reversed") else 1.0
        self._tilt_rad = device.error("axis_tilt", "rad")
        self._share_of_coil = device.quantity("share_of_coil_heating", "1")
        self._magnet_mT = _dipole(probe_m, device.quantity("magnet_at_probe", "mT"))
        rng = generator(truth.integer("seed", 0), "accelerometer")
        self._noise = WhiteNoise(self.accelerometer.noise_V, rng)
        if device.switch("powered_at_start"):
            self.power(0.0, True)
        self.temperatures = {DEVICE: self.dut_temperature_degC, CHAMBER: self._room}
        self.acts = {
            **{
                f"mount-{plane}": (
                    partial(self._mount, plane),
                    f"The simulated accelerometer was mounted with {MOUNTINGS[plane]}.",
                )
                for plane in PLANES
            },
            **self.usual_acts(
                "The simulated accelerometer was switched on and warms up.",
                "The simulated accelerometer was switched off.",
            ),
        }

    @property
    def dut_powered(self) -> bool:
        """Whether the accelerometer is switched on."""
        return self._powered

    def power(self, time_s: float, on: bool) -> None:
        """Switch the accelerometer on, which starts its warm-up, or off."""
        self._powered = on
        self._switched_s.append(time_s)
        self.accelerometer.heat.switch(time_s, on)
        self._changed()

    def coil_temperature_degC(self, time_s: Array) -> Array:
        """Return the temperature of the strong coil's winding at each time."""
        return np.asarray(self._room(time_s) + self._heat.rise_K(time_s))

    def dut_temperature_degC(self, time_s: Array) -> Array:
        """Return the accelerometer's temperature: the room, its own heat, a share of the coil's."""
        own_K = self.accelerometer.self_heating_K * self.accelerometer.heat.warmth(time_s)
        coil_K = self._share_of_coil * self._heat.rise_K(time_s)
        return np.asarray(self._room(time_s) + own_K + coil_K)

    def mean_output_V(self, edges_s: Array) -> Array:
        """Return the accelerometer's mean output between neighbouring times, shape (intervals,).

        Zero while it is switched off, and over an empty interval. Exact while the stage rests,
        whatever the current does.
        """
        pieces = Pieces(edges_s, self._kinks(edges_s))
        turning = self._turns(pieces)
        slow = nodes_within(pieces.starts_s, pieces.ends_s, SLOW_PANEL_S, SLOW_ORDER)
        temperature = slow.mean(self.dut_temperature_degC(slow.time_s))
        parts = self.accelerometer.by_field(self._acceleration(pieces.middles_s), temperature)
        field, squared = self._mean_field(pieces.edges_s)
        means = parts[0] + parts[1] * field + parts[2] * squared
        if turning.any():
            starts_s, ends_s = pieces.starts_s[turning], pieces.ends_s[turning]
            means[turning] = self._mean_while_turning(
                nodes_within(starts_s, ends_s, FAST_PANEL_S, FAST_ORDER)
            )
        means += slow.mean(self.accelerometer.drift_V(slow.time_s))
        on = np.diff(self.accelerometer.heat.on_time(pieces.edges_s)) > 0.0
        powered = np.diff(self.accelerometer.heat.on_time(edges_s)) / lengths_of(edges_s)
        return pieces.together(np.where(on, means, 0.0)) + powered * self._noise.mean(edges_s)

    def mean_pt100_ohm(self, edges_s: Array) -> Array:
        """Return the mean resistance of the Pt100 in the accelerometer, shape (intervals,)."""
        nodes = nodes_within(edges_s[:-1], edges_s[1:], SLOW_PANEL_S, SLOW_ORDER)
        temperature = self.dut_temperature_degC(nodes.time_s)
        return nodes.mean(self.accelerometer.pt100_ohm(temperature))

    def mean_probe_field_mT(self, edges_s: Array) -> Array:
        """Return the mean field at the probe between neighbouring times, shape (intervals, 3)."""
        mean_A = self._current.mean_current(edges_s)
        kinks = [self.rotation.breakpoints(edges_s[0], edges_s[-1]), np.array(self._mounted_s)]
        pieces = Pieces(edges_s, kinks)
        direction = input_axis(self._plane(pieces.middles_s), self._device_angle(pieces.middles_s))
        turning = self._turns(pieces)
        if turning.any():
            starts_s, ends_s = pieces.starts_s[turning], pieces.ends_s[turning]
            nodes = nodes_within(starts_s, ends_s, FAST_PANEL_S, FAST_ORDER)
            angle, plane = self._device_angle(nodes.time_s), self._plane(nodes.time_s)
            direction[turning] = nodes.mean(input_axis(plane, angle))
        magnet = pieces.together(direction) @ self._magnet_mT.T
        coil = mean_A[:, None] * self._probe_mT_per_A
        return np.asarray(self.ambient_mT + coil + magnet)

    def _mount(self, plane: str, time_s: float) -> None:
        self._mounted_s.append(time_s)
        self._planes.append(PLANES.index(plane))
        self._changed()

    def _mean_while_turning(self, nodes: Nodes) -> Array:
        times = nodes.time_s
        field = self.device_ambient_T + self.device_T_per_A * self._current.current(times)
        temperature = self.dut_temperature_degC(times)
        parts = self.accelerometer.by_field(self._acceleration(times), temperature)
        return nodes.mean(parts[0] + parts[1] * field + parts[2] * field**2)

    def _mean_field(self, edges_s: Array) -> tuple[Array, Array]:
        """Return the means of the field at the device in T and of its square, exactly."""
        mean_A, mean_A2 = mean_current_and_square(self._current, edges_s)
        ambient, constant = self.device_ambient_T, self.device_T_per_A
        field = ambient + constant * mean_A
        return field, ambient**2 + 2 * ambient * constant * mean_A + constant**2 * mean_A2

    def _kinks(self, edges_s: Array) -> list[Array]:
        first_s, last_s = edges_s[0], edges_s[-1]
        return [
            self._current.breakpoints(first_s, last_s),
            self.rotation.breakpoints(first_s, last_s),
            np.array(self._mounted_s),
            np.array(self._switched_s),
        ]

    def _turns(self, pieces: Pieces) -> npt.NDArray[np.bool_]:
        """Return in which pieces, none of which holds a change of acceleration, the stage turns."""
        begin, middle, end = (
            self.rotation.angle_deg(times)
            for times in (pieces.starts_s, pieces.middles_s, pieces.ends_s)
        )
        return np.asarray((begin != middle) | (middle != end))

    def _acceleration(self, time_s: Array) -> Array:
        """Return the specific force on IA, OA, PA in g, shape (n, 3)."""
        return acceleration_g(self._plane(time_s), self._device_angle(time_s), self._tilt_rad)

    def _device_angle(self, time_s: Array) -> Array:
        return self._sense * self.rotation.angle_deg(time_s) + self.angle_offset_deg

    def _plane(self, time_s: Array) -> Indices:
        return np.array(self._planes)[self._mounting(time_s)]

    def _mounting(self, time_s: Array) -> Indices:
        """Return how often the device had been mounted by each time."""
        return np.searchsorted(self._mounted_s, time_s, side="right")

    def _room(self, time_s: Array) -> Array:
        swing = np.sin(2.0 * np.pi * time_s / self._swing_s)
        return np.asarray(self._room_degC + self._swing_K * swing)


def _dipole(probe_m: Array, strongest_mT: float) -> Array:
    """Return the matrix from the direction of a magnet in the centre to its field at the probe.

    In mT, shape (3, 3); `strongest_mT` is what the probe feels when the magnet points at it.
    """
    towards = probe_m / np.linalg.norm(probe_m)
    return np.asarray(strongest_mT / 2.0 * (3.0 * np.outer(towards, towards) - np.eye(3)))
