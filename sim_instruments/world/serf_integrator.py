"""The polarisation after a change, integrated step by step as far as somebody looks.

Within a step the field is its mean. The polarisation is split into u along the field
and w across it, a complex number in the frame that turns with the spins, so that what is left to
integrate is smooth: u and w fade, the angle grows. One Runge-Kutta step of fourth order each; in
between a cubic through values and slopes at both ends. The steps depend on what is integrated
alone, never on who looks when, and neither does the result.
"""

from __future__ import annotations

from cmath import exp as complex_exp
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from sim_instruments.world.piecewise import Array
from sim_instruments.world.serf_cell import GAMMA_RAD_PER_S_NT, Cell, Rates

Field = Callable[[Array], Array]
State = tuple[float, complex, float]

BLOCK = 128
SHARE_OF_DECAY = 0.01
"""Steps per decay time when the pump is off: the frequency is then right to 1e-9."""
SHARE_WHILE_PUMPED = 0.04
SHARE_OF_TURN = 0.5
"""In rad, while the pump drives the spins."""
WEAK_LIGHT = 1e-3
GROWTH = 0.08
"""Of the time since the coils were switched, as long as their current changes."""


class Pace(NamedTuple):
    """How long steps may be, in s: in the end, at first, and by the coil's time constant."""

    longest_s: float
    fastest_s: float
    share: float
    coil_s: float

    def next_s(self, since_start_s: float, since_switched_s: float) -> float:
        """Return the length of a step that begins some time after start and last switching."""
        smooth = min(self.longest_s, self.share * (self.fastest_s + since_start_s))
        return min(smooth, max(0.125 * self.coil_s, GROWTH * since_switched_s))


class Integrator:
    """One stretch of time with constant rates, from `start_s` with a polarisation to begin with.

    `mean_field_nT(edges)` gives the mean field between neighbouring times, shape (n, 3), with the
    currents in the coils on their way since `switched_s`; `strongest_nT` bounds its size.
    """

    def __init__(
        self,
        cell: Cell,
        rates: Rates,
        mean_field_nT: Field,
        strongest_nT: float,
        start_s: float,
        switched_s: float,
        coil_s: float,
        polarisation: Array,
    ) -> None:
        self._cell, self._rates, self._field = cell, rates, mean_field_nT
        self._start_s, self._switched_s = start_s, switched_s
        self._total = rates.relaxation + rates.pumping
        largest = max(float(polarisation @ polarisation), (rates.pumping / self._total) ** 2)
        self._pace = self._choose_pace(largest, strongest_nT, coil_s)
        self._source: list[float] = (rates.pumping * cell.pump_axis).tolist()
        self._edges = [start_s]
        self._state = polarisation.tolist()
        self._blocks: list[Array] = []
        self._all: tuple[Array, Array] | None = None

    @property
    def steps(self) -> int:
        """How many steps have been taken."""
        return len(self._edges) - 1

    def polarisation(self, time_s: Array) -> Array:
        """Return the polarisation at times since the start and not after it settled, (n, 3)."""
        while self._edges[-1] <= time_s.max():
            self._advance()
        if self._all is None:
            self._all = np.array(self._edges), np.concatenate(self._blocks)
        edges, steps = self._all
        k = np.clip(np.searchsorted(edges, time_s, side="right") - 1, 0, len(edges) - 2)
        axes, state = steps[k, :9].reshape(-1, 3, 3), steps[k, 9:]
        begin, begin_slope, end, end_slope = np.moveaxis(state.reshape(-1, 4, 4), 1, 0)
        length = (edges[k + 1] - edges[k])[:, None]
        x = (time_s - edges[k])[:, None] / length
        later = x * x * (3.0 - 2.0 * x)
        bent = x * (1.0 - x) * length
        state = begin + later * (end - begin)
        state += bent * ((1.0 - x) * begin_slope - x * end_slope)
        u, w, phi = state[:, 0], state[:, 1] + 1j * state[:, 2], state[:, 3]
        across = w * np.exp(1j * phi)
        parts = np.column_stack([u, across.real, across.imag])
        return np.asarray(np.einsum("ni,nij->nj", parts, axes))

    def _choose_pace(self, largest: float, strongest_nT: float, coil_s: float) -> Pace:
        rates = self._rates
        # Between the largest polarisation squared there will be and none.
        q = self._cell.factor(np.array([min(largest, 1.0), 0.0]))
        omega, broadening = self._cell.precession(q, np.full(2, strongest_nT), rates)
        fade = self._total / (rates.scale * float(q[0]))
        fastest_s = 1.0 / (fade + float(broadening.max()))
        pumped = rates.pumping > WEAK_LIGHT * rates.relaxation
        share = SHARE_WHILE_PUMPED if pumped else SHARE_OF_DECAY
        longest_s = min(share / fade, fastest_s)
        if pumped and omega[0] > 0.0:
            longest_s = min(longest_s, SHARE_OF_TURN / float(omega[0]))
        return Pace(longest_s, fastest_s, share, coil_s)

    def _advance(self) -> None:
        edges = [self._edges[-1]]
        for _ in range(BLOCK):
            now_s = edges[-1]
            edges.append(now_s + self._pace.next_s(now_s - self._start_s, now_s - self._switched_s))
        spans = np.array(edges)
        fields = self._field(spans).tolist()
        numbers: list[float] = []
        for field, length in zip(fields, np.diff(spans).tolist(), strict=True):
            self._step(field, length, numbers)
        self._blocks.append(np.array(numbers).reshape(BLOCK, -1))
        self._edges += edges[1:]
        self._all = None

    def _step(self, field: list[float], h: float, numbers: list[float]) -> None:
        """Take one step in a steady field; adds its axes, values and slopes to the numbers."""
        along, across, turned = _axes(field, self._state)
        size = _dot(along, field)
        u = _dot(self._state, along)
        w = complex(_dot(self._state, across), _dot(self._state, turned))
        in_line = _dot(self._source, along)
        beside = complex(_dot(self._source, across), _dot(self._source, turned))
        slopes = partial(self._slopes, size, in_line, beside)
        half = 0.5 * h
        a = slopes(u, w, 0.0)
        b = slopes(u + half * a[0], w + half * a[1], half * a[2])
        c = slopes(u + half * b[0], w + half * b[1], half * b[2])
        d = slopes(u + h * c[0], w + h * c[1], h * c[2])
        sixth = h / 6.0
        end_u = u + sixth * (a[0] + 2.0 * (b[0] + c[0]) + d[0])
        end_w = w + sixth * (a[1] + 2.0 * (b[1] + c[1]) + d[1])
        end_phi = sixth * (a[2] + 2.0 * (b[2] + c[2]) + d[2])
        last = slopes(end_u, end_w, end_phi)
        for axis in (along, across, turned):
            numbers += axis
        for node in ((u, w, 0.0), a, (end_u, end_w, end_phi), last):
            numbers += (node[0], node[1].real, node[1].imag, node[2])
        seen = end_w * complex_exp(1j * end_phi)
        self._state = [
            end_u * along[k] + seen.real * across[k] + seen.imag * turned[k] for k in range(3)
        ]

    def _slopes(
        self, size: float, in_line: float, beside: complex, u: float, w: complex, phi: float
    ) -> State:
        """Return the slopes of u, w and phi; see `Cell` for the law."""
        rates, (above, below, n) = self._rates, self._cell.slowing_down
        x = u * u + w.real * w.real + w.imag * w.imag
        q = (above[0] + x * (above[1] + x * (above[2] + x * above[3]))) / (
            below[0] + x * (below[1] + x * (below[2] + x * below[3]))
        )
        scaled = rates.scale * q
        fade = self._total / scaled
        bare = GAMMA_RAD_PER_S_NT * size / scaled
        share = bare / rates.exchange
        excess = (q * q - n * n) / (2.0 * q)
        across = fade + bare * share * excess
        omega = bare * (1.0 + n * n * excess / q * share * share)
        if rates.pumping == 0.0:
            return -fade * u, -across * w, omega
        shone = beside / scaled * complex_exp(-1j * phi)
        return in_line / scaled - fade * u, shone - across * w, omega


def _dot(a: list[float], b: list[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _axes(field: list[float], state: list[float]) -> tuple[list[float], list[float], list[float]]:
    """Return the field's direction and two across it, in the sense in which the spins turn."""
    size = _dot(field, field) ** 0.5
    along = [component / size for component in field] if size > 0.0 else [0.0, 0.0, 1.0]
    share = _dot(state, along)
    across = [component - share * other for component, other in zip(state, along, strict=True)]
    length = _dot(across, across) ** 0.5
    if length < 1e-9 * (1e-30 + abs(share)):
        # Nothing is across yet: any direction does.
        k = min(range(3), key=lambda i: abs(along[i]))
        across = [(1.0 if i == k else 0.0) - along[k] * along[i] for i in range(3)]
        length = _dot(across, across) ** 0.5
    across = [component / length for component in across]
    turned = [
        along[1] * across[2] - along[2] * across[1],
        along[2] * across[0] - along[0] * across[2],
        along[0] * across[1] - along[1] * across[0],
    ]
    return along, across, turned
