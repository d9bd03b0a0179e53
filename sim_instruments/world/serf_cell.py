"""The alkali vapour of the cell: slowing-down factor, relaxation, spin exchange, Hanle effect.

The electron polarisation P obeys, with B in nT and q(|P|) the slowing-down factor,

    dP/dt = Omega B/|B| x P - (R + R_p)/q P - Gamma_se P_perp + R_p/q s,

P_perp being what of P is across the field and s the direction of the pump light. Omega is
gamma B/q with the pull of spin exchange, Gamma_se its broadening. Both are taken from the
two-level model of spin exchange, which is exact for small P:

    Gamma_se = (w²/R_se) (q² - N²)/(2 q),   Omega = w (1 + N² (q² - N²)/(2 q²) (w/R_se)²),

w = gamma B/q, N = 2 I + 1 (Happer and Tam 1977; Savukov and Romalis 2005). With q at the
polarisation of the moment they vanish for the fully polarised vapour, as they must; in between
this is an assumption. Rates are events per second, gamma is in rad/s/nT.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim_instruments.truth import SimulationError, Truth
from sim_instruments.world.coils import AXES
from sim_instruments.world.piecewise import Array
from sim_instruments.world.serf_oven import Oven

GAMMA_RAD_PER_S_NT = 2.0 * np.pi * 28.02495

DARK_BELOW = 0.02
"""A vapour of less than this of its density at working temperature shows nothing."""
STEADY_ROUNDS = 6
"""How often the steady state is solved anew with the slowing-down factor of the last solution."""


class SlowingDown(NamedTuple):
    """The factor of one nuclear spin, a quotient of polynomials in P², lowest power first."""

    above: tuple[float, ...]
    below: tuple[float, ...]
    levels: int
    """2 I + 1."""


SPINS = {
    "3/2": SlowingDown((6.0, 2.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0), 4),
    "5/2": SlowingDown((38.0, 52.0, 6.0, 0.0), (3.0, 10.0, 3.0, 0.0), 6),
    "7/2": SlowingDown((22.0, 70.0, 34.0, 2.0), (1.0, 7.0, 7.0, 1.0), 8),
}


def slowing_down(spin: str, polarisation_squared: Array) -> Array:
    """Return the slowing-down factor of a nuclear spin such as `3/2` at spin temperature."""
    x, nucleus = polarisation_squared, SPINS[spin]
    return np.asarray(_polynomial(nucleus.above, x) / _polynomial(nucleus.below, x))


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    c0, c1, c2, c3 = coefficients
    return np.asarray(c0 + x * (c1 + x * (c2 + x * c3)))


def axis_of(truth: Truth) -> Array:
    """Return the direction of a beam: `axis` x, y or z, leaning towards the two other axes."""
    axis = truth.text("axis")
    if axis not in AXES:
        raise SimulationError(f"{truth.where}.axis: x, y or z was expected, got {axis!r}")
    lean = truth.section("lean")
    direction = np.array(
        [1.0 if name == axis else np.tan(lean.quantity(f"towards_{name}", "rad")) for name in AXES]
    )
    return np.asarray(direction / np.linalg.norm(direction))


@dataclass(frozen=True)
class Rates:
    """What governs the vapour for a while, in events per second; `scale` multiplies q."""

    relaxation: float
    pumping: float
    exchange: float
    scale: float


class Cell:
    """The vapour and the light on it, true to their description.

    Truth (`simulation.serf.cell`): `nuclear_spin`, `relaxation_rate` of the electrons with the
    pump off, `exchange_rate`, `radius`, and `temperature`: slow `swing` with its `period`, by
    which the slowing-down factor changes (`slowing_down_per_K`) and the density of the vapour
    (`exchange_per_K`). All hold at working temperature; where the `oven` is warmer or colder, the
    density goes as the exponential of that times `exchange_per_K`. `pump`: `axis` with its `lean`,
    `rate` while it shines, the `leak` of it that the closed shutter lets through, `light_shift` as
    a field along the pump while it shines.
    """

    def __init__(self, cell: Truth, pump: Truth, oven: Oven | None = None) -> None:
        self.oven = oven
        spin = cell.text("nuclear_spin")
        if spin not in SPINS:
            known = ", ".join(SPINS)
            raise SimulationError(f"{cell.where}.nuclear_spin: one of {known}, got {spin!r}")
        self.spin = spin
        self.slowing_down = SPINS[spin]
        self.relaxation = _positive(cell, "relaxation_rate", "Hz")
        self.exchange = _positive(cell, "exchange_rate", "Hz")
        self.radius_cm = _positive(cell, "radius", "mm") * 0.1
        temperature = cell.section("temperature")
        self._swing_K = temperature.quantity("swing", "K")
        self._period_s = _positive(temperature, "period", "s")
        self._slowing_down_per_K = temperature.quantity("slowing_down_per_K", "1")
        self._exchange_per_K = temperature.quantity("exchange_per_K", "1")
        self.pump_axis = axis_of(pump)
        self.pumping = pump.quantity("rate", "Hz")
        self.leak = pump.quantity("leak", "1")
        self.light_shift_nT = pump.quantity("light_shift", "nT")

    def density(self, time_s: Array) -> Array:
        """Return the density of the vapour over that at working temperature, as its oven goes."""
        if self.oven is None:
            return np.ones(time_s.size)
        return np.exp(self._exchange_per_K * self.oven.above_working_K(time_s))

    def warmth_K(self, time_s: Array) -> Array:
        """Return by how much the cell swings about the temperature of its oven."""
        return np.asarray(self._swing_K * np.sin(2.0 * np.pi * time_s / self._period_s))

    def light(self, pump_on: bool) -> float:
        """Return which part of the pump light reaches the vapour."""
        return 1.0 if pump_on else self.leak

    def rates(self, time_s: float, light: float, gradient_nT_per_cm: float) -> Rates:
        """Return the rates at a time; a gradient dephases the spins across the cell."""
        now = np.array([time_s])
        warmth_K, density = float(self.warmth_K(now)[0]), float(self.density(now)[0])
        dephasing = GAMMA_RAD_PER_S_NT * abs(gradient_nT_per_cm) * self.radius_cm
        return Rates(
            relaxation=self.relaxation + dephasing,
            pumping=light * self.pumping,
            exchange=self.exchange * density * (1.0 + self._exchange_per_K * warmth_K),
            scale=1.0 + self._slowing_down_per_K * warmth_K,
        )

    def factor(self, polarisation_squared: Array) -> Array:
        """Return the slowing-down factor at working temperature."""
        return slowing_down(self.spin, polarisation_squared)

    def precession(self, q: Array, field_nT: Array, rates: Rates) -> tuple[Array, Array]:
        """Return Omega in rad/s and Gamma_se in 1/s at a factor `q` and the size of a field."""
        bare = GAMMA_RAD_PER_S_NT * field_nT / (rates.scale * q)
        share = bare / rates.exchange
        levels = self.slowing_down.levels**2
        spread = q**2 - levels
        pull = levels * spread / (2.0 * q**2) * share**2
        return np.asarray(bare * (1.0 + pull)), np.asarray(bare * share * spread / (2.0 * q))

    def steady(self, field_nT: Array, rates: Rates) -> Array:
        """Return the polarisation that a steady pump keeps up in each field, both shape (n, 3).

        The Hanle effect: what is along the field stays, what is across it turns and fades.
        """
        size = np.linalg.norm(field_nT, axis=1)
        along = field_nT / np.where(size > 0.0, size, 1.0)[:, None]
        s = self.pump_axis
        in_line = (along @ s)[:, None] * along
        across, turned = s - in_line, np.cross(along, s)
        total = rates.relaxation + rates.pumping
        result = np.zeros_like(field_nT)
        for _ in range(STEADY_ROUNDS if rates.pumping > 0.0 else 0):
            q = self.factor(np.sum(result**2, axis=1))
            omega, broadening = self.precession(q, size, rates)
            decay = (total + rates.scale * q * broadening)[:, None]
            turn = (rates.scale * q * omega)[:, None]
            crosswise = (decay * across + turn * turned) / (decay**2 + turn**2)
            result = rates.pumping * (in_line / total + crosswise)
        return np.asarray(result)


def _positive(truth: Truth, key: str, unit: str) -> float:
    value = truth.quantity(key, unit)
    if value <= 0.0:
        raise SimulationError(f"{truth.where}.{key}: must be positive")
    return value


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
