"""Which shots a plan takes, in which order, which of them carry a signal, and the cell's alkali."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")
PAIRS = ("xy", "xz", "yz")
REPEATED = "shot-repeated"
"""The event of a shot that is taken again."""
MIN_CYCLES = 1.0
"""Within the 1/e time of a shot; with fewer it says nothing."""
MIN_SIGNAL_TO_NOISE = 3.0
"""Of the tone of a shot; below it there is none."""
OPPOSITES = ((1, 1), (-1, -1), (-1, 1), (1, -1))
"""The polarities of a pair: opposites side by side, so that a step of the residual field between
other shots moves no angle that the shots do not contradict."""


@dataclass(frozen=True)
class Wanted:
    """One shot of a plan: its name, and the field in nT commanded of each coil."""

    id: str
    field_nT: tuple[float, float, float]

    @property
    def coils(self) -> str:
        """The coils that carry a field, such as `xy`."""
        return "".join(axis for axis, field in zip(AXES, self.field_nT, strict=True) if field)

    @property
    def by_coil_nT(self) -> dict[str, float]:
        """The field of each coil."""
        return dict(zip(AXES, self.field_nT, strict=True))


def single_axis(pump_axis: str, probe_axis: str) -> Axis:
    """Return the coil whose field alone lets the spins precess before the detector.

    A field along the pump axis turns no spin, and one along the probe axis turns none towards it:
    the third axis is left.
    """
    return next(axis for axis in AXES if axis not in (pump_axis, probe_axis))


def why_without_signal(coils: str, pump_axis: str | None, probe_axis: str | None) -> str | None:
    """Return why a field of these coils lets nothing be seen to precess, None where it does."""
    if coils not in (pump_axis, probe_axis) or pump_axis is None or probe_axis is None:
        return None
    light = "pump light" if coils == pump_axis else "probe light"
    return (
        f"a field along {coils}, the {light}, lets nothing be seen to precess; use coil "
        f"{single_axis(pump_axis, probe_axis)} for a single axis"
    )


def shots_of(
    kind: str, fields_nT: dict[str, float], pump_axis: str, probe_axis: str
) -> tuple[Wanted, ...]:
    """Return the shots of a plan in the order in which they are taken.

    `as_published`: the single axis and the three pairs, all positive. `reversal`: the single axis
    of either sign, first and last, and the four polarities of each pair.
    """
    alone = single_axis(pump_axis, probe_axis)
    wishes: list[dict[str, int]]
    if kind == "as_published":
        wishes = [{alone: 1}, *(dict.fromkeys(pair, 1) for pair in PAIRS)]
    else:
        pairs = [{pair[0]: a, pair[1]: b} for pair in PAIRS for a, b in OPPOSITES]
        wishes = [{alone: 1}, *pairs, {alone: -1}]
    return tuple(
        Wanted(
            name_of(wish),
            (
                fields_nT["x"] * wish.get("x", 0),
                fields_nT["y"] * wish.get("y", 0),
                fields_nT["z"] * wish.get("z", 0),
            ),
        )
        for wish in wishes
    )


def name_of(wish: dict[str, int]) -> str:
    """Return a shot's name, such as `+x-z`."""
    return "".join(f"{'+' if sign > 0 else '-'}{axis}" for axis, sign in wish.items())


# The alkali of the cell: how its nuclear spin slows precession down, by polarisation.


GAMMA_HZ_PER_NT = 28.02495
"""Gyromagnetic ratio of the free electron; the source's 28 nT/Hz is its reciprocal misprinted."""


@dataclass(frozen=True)
class SlowingDown:
    """The factor of a nuclear spin as a quotient of polynomials in P², lowest power first.

    At spin temperature, Appelt et al. 1998; spin exchange in the limit of small P, Happer and Tam
    1977.
    """

    above: tuple[float, ...]
    below: tuple[float, ...]
    levels: int
    """2 I + 1."""

    def at(self, square: Array) -> Array:
        """Return the factor at polarisations squared, any shape."""
        return _polynomial(self.above, square) / _polynomial(self.below, square)

    @property
    def at_rest(self) -> float:
        """The factor without polarisation, the largest."""
        return self.above[0] / self.below[0]

    @property
    def polarised(self) -> float:
        """The factor of the fully polarised vapour, the smallest."""
        return sum(self.above) / sum(self.below)

    @property
    def broadening(self) -> float:
        """Gamma_se R_se / w², with w the angular frequency at small polarisation."""
        return (self.at_rest**2 - self.levels**2) / (2.0 * self.at_rest)

    def pull(self, beta_s: float, omega_rad_per_s: Array) -> Array:
        """Return by which share spin exchange speeds tones up, from how it broadens them."""
        spread = self.at_rest**2 - self.levels**2
        return 2.0 * self.levels**2 / spread * (max(beta_s, 0.0) * omega_rad_per_s) ** 2


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    total = coefficients[-1] * x + coefficients[-2]
    for coefficient in coefficients[-3::-1]:
        total = total * x + coefficient
    return total


SPINS = {
    1.5: SlowingDown((6.0, 2.0), (1.0, 1.0), 4),
    2.5: SlowingDown((38.0, 52.0, 6.0), (3.0, 10.0, 3.0), 6),
    3.5: SlowingDown((22.0, 70.0, 34.0, 2.0), (1.0, 7.0, 7.0, 1.0), 8),
}
"""By nuclear spin: potassium and rubidium-87, rubidium-85, caesium."""


def known_spin(nuclear_spin: float) -> float:
    """Return a nuclear spin whose slowing-down factor is known; ValueError for another."""
    if nuclear_spin not in SPINS:
        raise ValueError("must be 1.5 (K, Rb-87, Na), 2.5 (Rb-85) or 3.5 (Cs)")
    return nuclear_spin
