"""Free precession shots by the equations of a spin in a field, integrated on their own.

dP_perp/dt = -(R/q(|P|) + Gamma_se) P_perp, dP_par/dt = -(R/q) P_par, dphi/dt = gamma B/q(|P|), and
the detector sees (p.n)(s.n) of what is along the field, |s_perp| |p_perp| of what turns about it.
Coil x lies on x of the laboratory, coil y in its plane xy; the pump light comes along the axis z,
the probe along y, each with a lean where wanted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from procedures.serf_nonorthogonality.dataset import SerfDataset, Shot

Array = NDArray[np.float64]

GAMMA = 2.0 * np.pi * 28.02495
FACTORS = {
    1.5: ((6.0, 2.0), (1.0, 1.0)),
    2.5: ((38.0, 52.0, 6.0), (3.0, 10.0, 3.0)),
    3.5: ((22.0, 70.0, 34.0, 2.0), (1.0, 7.0, 7.0, 1.0)),
}
FOUR = ((1, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1))
FOURTEEN = (
    (1, 0, 0),
    *((1, 1, 0), (1, 0, 1), (0, 1, 1)),
    *((1, -1, 0), (1, 0, -1), (0, 1, -1)),
    *((-1, 1, 0), (-1, 0, 1), (0, -1, 1)),
    *((-1, -1, 0), (-1, 0, -1), (0, -1, -1)),
    (-1, 0, 0),
)
GRID = 300


def slowing_down(spin: float, square: Array) -> Array:
    """Return the slowing-down factor at spin temperature of a polarisation squared."""
    above, below = FACTORS[spin]
    up = sum(c * square**k for k, c in enumerate(above))
    down = sum(c * square**k for k, c in enumerate(below))
    return np.asarray(up / down)


@dataclass(frozen=True)
class Cell:
    """A cell, its coils and its light; the defaults are those of the estimator's table."""

    angles_deg: tuple[float, float, float] = (91.2, 88.9, 90.6)
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    residual_nT: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """In the laboratory."""
    field_nT: float = 50.0
    pattern: tuple[tuple[int, int, int], ...] = FOURTEEN
    known: bool = False
    polarisation: float = 0.05
    relaxation: float = 240.0
    exchange: float = 5e5
    pull: bool = True
    spin: float = 1.5
    momentary_broadening: bool = False
    """Whether spin exchange broadens by the slowing-down factor of the moment, not that at rest."""
    noise_V: float = 0.01
    signal_V: float = 1.0
    offset_V: float = 0.0
    mains_V: float = 0.0
    sample_rate_Hz: float = 10_000.0
    duration_s: float = 0.1
    delay_s: float = 0.0
    """By how much a record's time zero is late."""
    pump: tuple[float, float, float] = (0.0, 0.0, 1.0)
    probe: tuple[float, float, float] = (0.0, 1.0, 0.0)

    @property
    def directions(self) -> Array:
        """The unit vectors of the coil axes, one a row."""
        xy, xz, yz = np.cos(np.radians(self.angles_deg))
        return np.linalg.cholesky(np.array([[1, xy, xz], [xy, 1, yz], [xz, yz, 1]]))

    @property
    def commanded_nT(self) -> Array:
        """The commanded fields, shape (shots, 3)."""
        return self.field_nT * np.array(self.pattern, dtype=float)

    @property
    def fields_nT(self) -> Array:
        """The true fields in the laboratory, shape (shots, 3)."""
        coils = (self.commanded_nT * np.array(self.factors)) @ self.directions
        return np.asarray(coils + np.array(self.residual_nT))

    @property
    def residual_on_coils_nT(self) -> Array:
        """The residual field's projections on the coil axes."""
        return np.asarray(self.directions @ np.array(self.residual_nT))

    @property
    def time_s(self) -> Array:
        """The times of the samples."""
        return np.arange(round(self.duration_s * self.sample_rate_Hz)) / self.sample_rate_Hz

    @property
    def factor_at_rest(self) -> float:
        """The slowing-down factor without polarisation."""
        return float(slowing_down(self.spin, np.zeros(1))[0])

    def broadening(self, size_nT: Array, q: float | Array) -> Array:
        """Return Gamma_se in 1/s of fields at a slowing-down factor."""
        n = 2.0 * self.spin + 1.0
        return np.asarray((GAMMA * size_nT / q) ** 2 / self.exchange * (q**2 - n**2) / (2.0 * q))

    def frequency_rad_per_s(self) -> Array:
        """Return the angular frequency of each shot in the end, when the polarisation is gone."""
        q, n = self.factor_at_rest, 2.0 * self.spin + 1.0
        bare = GAMMA * np.linalg.norm(self.fields_nT, axis=1) / q
        pull = n**2 * (q**2 - n**2) / (2.0 * q**2) / self.exchange**2 if self.pull else 0.0
        return np.asarray(bare * (1.0 + pull * bare**2))

    def waves_V(self) -> Array:
        """Return what a shot's signal is a sum of, shape (3, samples, shots).

        The tone's cosine and sine, and what fades without turning; of a detector that sees all.
        """
        return self._waves()[0]

    def clean_V(self) -> Array:
        """Return the voltages without noise, shape (shots, samples)."""
        waves, shares = self._waves()
        mains = self.mains_V * np.sin(2.0 * np.pi * 50.0 * self.time_s + 0.7)
        seen = np.sum(waves * shares[:, None], axis=0)
        return np.asarray((seen + self.offset_V + mains[:, None]).T)

    def _waves(self) -> tuple[Array, Array]:
        """Return the waves and the share (3, shots) of each that the probe sees."""
        fields = self.fields_nT
        size = np.linalg.norm(fields, axis=1)
        n = fields / size[:, None]
        s, p = (np.array(v) / np.linalg.norm(v) for v in (self.pump, self.probe))
        across_s, across_p = s - (n @ s)[:, None] * n, p - (n @ p)[:, None] * n
        turned = np.cross(n, across_s)
        grid = np.linspace(0.0, self.duration_s + self.delay_s, GRID)
        state = np.zeros((GRID, 3, len(n)))
        state[0, 0], state[0, 1] = (
            self.polarisation * (n @ s),
            self.polarisation * np.linalg.norm(across_s, axis=1),
        )
        at_rest = self.broadening(size, self.factor_at_rest)
        omega = self.frequency_rad_per_s() * self.factor_at_rest

        def slopes(y: Array) -> Array:
            q = slowing_down(self.spin, y[0] ** 2 + y[1] ** 2)
            rate = self.relaxation / q
            broad = self.broadening(size, q) if self.momentary_broadening else at_rest
            return np.array([-rate * y[0], -(rate + broad) * y[1], omega / q])

        h = grid[1]
        for k in range(GRID - 1):
            y = state[k]
            a = slopes(y)
            b = slopes(y + 0.5 * h * a)
            c = slopes(y + 0.5 * h * b)
            state[k + 1] = y + h / 6.0 * (a + 2.0 * (b + c) + slopes(y + h * c))
        at = CubicSpline(grid, state)(self.time_s + self.delay_s)
        gain = self.signal_V / self.polarisation
        first = np.linalg.norm(across_s, axis=1)
        even = np.sum(across_s * across_p, axis=1) / np.where(first > 0, first, 1.0)
        odd = np.sum(turned * across_p, axis=1) / np.where(first > 0, first, 1.0)
        waves = [at[:, 1] * np.cos(at[:, 2]), at[:, 1] * np.sin(at[:, 2]), at[:, 0]]
        return gain * np.array(waves), np.array([even, odd, n @ p])

    def dataset(self, seed: int, clean: Array | None = None) -> SerfDataset:
        """Return the shots with their noise; `clean` saves the integration in a long series."""
        volts = self.clean_V() if clean is None else clean
        volts = volts + self.noise_V * np.random.default_rng(seed).standard_normal(volts.shape)
        shots = [
            Shot(f"s{k + 1:02d}", field, self.time_s, volt)
            for k, (field, volt) in enumerate(zip(self.commanded_nT, volts, strict=True))
        ]
        mains_Hz = 50.0 if self.mains_V else None
        return SerfDataset(
            shots, "z", "y", self.spin, self.known, self.sample_rate_Hz, mains_Hz=mains_Hz
        )

    def but(self, **changes: object) -> Cell:
        """Return a cell that differs."""
        return replace(self, **changes)  # type: ignore[arg-type]


def bound_of_frequency(cell: Cell) -> Array:
    """Return the Cramer-Rao bound of each shot's frequency in rad/s, polarisation low.

    Unknown are frequency, decay, phase and amplitude of the tone, amplitude of the baseline and
    offset; the baseline's decay is known.
    """
    fields = cell.fields_nT
    size = np.linalg.norm(fields, axis=1)
    n = fields / size[:, None]
    s, p = np.array(cell.pump), np.array(cell.probe)
    across = np.linalg.norm(s - (n @ s)[:, None] * n, axis=1)
    seen = np.linalg.norm(p - (n @ p)[:, None] * n, axis=1)
    t, slow = cell.time_s, cell.relaxation / cell.factor_at_rest
    found = []
    for k, omega in enumerate(cell.frequency_rad_per_s()):
        size_V = cell.signal_V * across[k] * seen[k]
        fade = np.exp(-(slow + cell.broadening(size, cell.factor_at_rest)[k]) * t)
        even = np.sum((s - (n[k] @ s) * n[k]) * (p - (n[k] @ p) * n[k])) / (across[k] * seen[k])
        phase = omega * t - np.arccos(np.clip(even, -1.0, 1.0))
        c, d = size_V * fade * np.cos(phase), size_V * fade * np.sin(phase)
        columns = [-d * t, c * t, c, d, np.exp(-slow * t), np.ones_like(t)]
        design = np.column_stack(columns)
        scale = np.linalg.norm(design, axis=0)
        inverse = np.linalg.inv((design / scale).T @ (design / scale))
        found.append(cell.noise_V * np.sqrt(inverse[0, 0]) / scale[0])
    return np.array(found)
