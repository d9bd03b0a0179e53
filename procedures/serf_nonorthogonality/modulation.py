"""Step 2 as published: what a small tone on each coil in turn tells of the residual field.

While the pump light shines, the spins obey Bloch's equation, with s along it and b the field,

    dP/dt = rate (s - P) + rate (b / width) x P,

and the detector sees gain p.P. The tone is a square wave, so that b takes two values in turn and
P(t) is exact: no smallness is assumed. Its lines are demodulated, and the model that gives all of
them has the residual field among its unknowns. To first order the line of a tone on y is as large
as the field along z, that on z as the field along y, and the second line as that along x, with pump
z and probe y. Each tone is sent about a field to one side and about its opposite, which tells how
large an answer is, and whether a coil answers at all, wherever the zero lies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.descent import Place, descend, inverse_of
from procedures.estimation.linear import least_squares
from procedures.estimation.sine import line_columns, phasors

from .shots import AXES

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LINES = 3
"""Of each tone that are used."""
LINES_BESIDE = 12
"""Of each tone that are fitted."""
MODEL_SHARE = 0.01
"""Of the largest line: what lines may differ by from the model, as coils and light are not quite
at right angles."""
SILENT_SHARE, SILENT_U = 1e-3, 8.0
"""Of the strongest answer, and of its noise: below either a coil does not answer."""
SAME_WITHIN = 2.0
"""Two coils' answers, one over the other, where both make what their constants say."""
MISFIT = 9.0
"""Chi-square over degrees of freedom from which the model does not explain the lines."""
GOOD = 2.0
WIDTHS_NT = (1.5, 4.0)
STARTS = (
    (0.0, 0.0, 0.0),
    *((x, y, z) for x in (2.0, -2.0) for y in (2.0, -2.0) for z in (2.0, -2.0)),
)
"""Residual fields to begin with, in widths."""
STEPS, TINY = 40, 1e-5


class NotNulled(ValueError):
    """Tones that tell no residual field; the message names the coil, or says what they tell."""


@dataclass(frozen=True)
class Tone:
    """The lines of a record: the tone of `amplitude_nT` on `coil`, all coils about `middle_nT`.

    `middle_nT` (3,) is commanded beside what is held; `lines_V` (LINES,) are phasors at multiples
    of the tone's frequency, time zero at a rise, `u_V` the standard uncertainty of their parts.
    """

    coil: str
    amplitude_nT: float
    middle_nT: Array
    lines_V: Complex
    u_V: float

    @property
    def levels_nT(self) -> Array:
        """The fields of the three coils in the first and the second half of a cycle, (2, 3)."""
        swing = self.amplitude_nT * (np.array(AXES) == self.coil)
        return np.array([self.middle_nT + swing, self.middle_nT - swing])


@dataclass(frozen=True)
class Reading:
    """The residual field, in nT commanded of each coil, and the width of the resonance."""

    residual_nT: dict[str, float]
    u_nT: dict[str, float]
    width_nT: float
    chi_square: float

    @property
    def size_nT(self) -> float:
        """The magnitude."""
        return math.hypot(*self.residual_nT.values())


def demodulated(
    time_s: Array, voltage_V: Array, frequency_Hz: float, mains_Hz: float | None
) -> tuple[Complex, float]:
    """Return the phasors (LINES,) at multiples of a frequency, and the u of their parts."""
    beside = [] if mains_Hz is None else [mains_Hz]
    lines = [frequency_Hz * k for k in range(1, LINES_BESIDE + 1)]
    columns = np.column_stack([line_columns(time_s, lines + beside), np.ones(len(time_s))])
    fit = least_squares(columns, voltage_V)
    freedom = max(len(time_s) - columns.shape[1], 1)
    u = math.sqrt(fit.sum_of_squares / freedom * float(fit.inverse_normal[0, 0]))
    return phasors(fit.coefficients[: 2 * LINES]), u


def answer(levels: Array, half_s: float, rate: float, pump: Array, probe: Array) -> Complex:
    """Return the phasors (m, LINES) of a square wave between two fields, for a gain of one.

    `levels` (m, 2, 3) are fields in widths, each for `half_s`.
    """
    unit = np.eye(3)
    turn = np.cross(levels[..., None, :], unit).swapaxes(-1, -2)
    size = np.linalg.norm(levels, axis=-1)[..., None, None]
    angle = rate * half_s * size
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = np.where(size > 0.0, np.sin(angle) / size, rate * half_s)
        cosine = np.where(size > 0.0, (1.0 - np.cos(angle)) / size**2, 0.0)
    later = math.exp(-rate * half_s) * (unit + sine * turn + cosine * turn @ turn)
    steady = np.linalg.solve(unit - turn, np.broadcast_to(pump[:, None], (*turn.shape[:-1], 1)))
    (high, low), (on, off) = steady.swapaxes(0, 1), later.swapaxes(0, 1)
    begin = np.linalg.solve(unit - off @ on, low + off @ (high - on @ high - low))
    middle = high + on @ (begin - high)
    result = np.empty((len(levels), LINES), dtype=np.complex128)
    for k in range(1, LINES + 1):
        turns = 1j * math.pi * k / half_s
        flip = (-1.0) ** k
        constant = (high - low) * (1.0 - flip) / turns
        fading = np.linalg.solve(
            (turns + rate) * unit - rate * turn,
            np.stack(
                [begin - high - flip * (middle - high), flip * (middle - low) - (begin - low)], 1
            ),
        )
        whole = constant + fading.sum(axis=1)
        result[:, k - 1] = (whole[..., 0] @ probe) / half_s
    return result


def residual_of(
    tones: Sequence[Tone], frequency_Hz: float, pump_axis: str, probe_axis: str
) -> Reading:
    """Return the residual field that tones tell; raises NotNulled where they tell none."""
    named_where_silent(tones)
    model = _Model(tones, 0.5 / frequency_Hz, pump_axis, probe_axis)
    best = model.solved()
    if best is None:
        raise NotNulled("no residual field explains what the tones are answered by")
    unknowns, place = best
    inverse = inverse_of(place.normal)
    chi_square = place.cost / model.freedom
    gains = dict(zip(AXES, (1.0, float(unknowns[5]), float(unknowns[6])), strict=True))
    if gains["x"] * gains["y"] * gains["z"] < 0.0:
        raise NotNulled(
            "the answers are those of a left-handed triad: one of the coils x, y, z is connected "
            "the wrong way round, or all three are; which of them no tone tells"
        )
    if chi_square > MISFIT or inverse is None:
        raise NotNulled(
            "no residual field explains what the tones are answered by (chi-square "
            f"{chi_square:.3g} times its degrees of freedom)"
        )
    typical = float(np.median(np.abs(list(gains.values()))))
    for axis, gain in gains.items():
        if not 1.0 / SAME_WITHIN < abs(gain) / typical < SAME_WITHIN:
            raise NotNulled(
                f"coil {axis} makes {abs(gain) / typical:.2g} times the field that its constant "
                "says, beside the two other coils"
            )
    u = np.sqrt(np.diag(inverse)[2:5] * max(chi_square, 1.0))
    return Reading(
        dict(zip(AXES, unknowns[2:5].tolist(), strict=True)),
        dict(zip(AXES, u.tolist(), strict=True)),
        math.exp(float(unknowns[0])),
        chi_square,
    )


def named_where_silent(tones: Sequence[Tone]) -> None:
    """Raise NotNulled for a coil whose tones nothing answers."""
    strengths = {
        coil: max(float(np.abs(tone.lines_V).max()) for tone in tones if tone.coil == coil)
        for coil in AXES
    }
    noise_V = max(tone.u_V for tone in tones)
    least_V = max(SILENT_U * noise_V, SILENT_SHARE * max(strengths.values()))
    silent = [coil for coil, strength_V in strengths.items() if strength_V < least_V]
    if len(silent) == len(AXES):
        raise NotNulled("no tone is answered; is the cell warm, and does pump and probe light pass")
    if silent:
        raise NotNulled(
            f"nothing answers the tone on coil {' and '.join(silent)}: it carries no current"
        )


class _Model:
    """Lines of tones, by width, rate, residual field, and the gains of y and z beside x's."""

    def __init__(
        self, tones: Sequence[Tone], half_s: float, pump_axis: str, probe_axis: str
    ) -> None:
        self._levels_nT = np.array([tone.levels_nT for tone in tones])
        self._half_s = half_s
        self._pump, self._probe = (np.eye(3)[AXES.index(axis)] for axis in (pump_axis, probe_axis))
        lines = np.array([tone.lines_V for tone in tones])
        share = MODEL_SHARE * float(np.abs(lines).max())
        self._u = np.hypot([tone.u_V for tone in tones], share)[:, None]
        self._seen = self._flat(lines)
        self.freedom = len(self._seen) - 8

    def solved(self) -> tuple[Array, Place[None]] | None:
        """Return the unknowns that explain the lines best, either handedness tried."""
        best: tuple[Array, Place[None]] | None = None
        rate = math.pi / self._half_s
        for place in STARTS:
            for width_nT in WIDTHS_NT:
                for hand in (1.0, -1.0):
                    residual = width_nT * np.array(place) * (1.0, hand, 1.0)
                    start = np.array([math.log(width_nT), math.log(rate), *residual, hand, 1.0])
                    ended = descend(self._at, start, STEPS)
                    if ended and (best is None or ended[1].cost < best[1].cost):
                        best = ended
            if best is not None and best[1].cost < GOOD * self.freedom:
                break
        return best

    def _at(self, unknowns: Array) -> Place[None] | None:
        if not bool(np.all(np.abs(unknowns[:2]) < 12.0)):
            return None
        left = self._left(unknowns)
        moves = TINY * np.eye(len(unknowns))
        slopes = np.array([(left - self._left(unknowns + move)) / TINY for move in moves])
        return Place.of(slopes, left, None)

    def _left(self, unknowns: Array) -> Array:
        """Return what the lines differ by from the model at the best gain of the detector."""
        width_nT, rate = np.exp(unknowns[:2])
        gains = np.array([1.0, unknowns[5], unknowns[6]])
        levels = gains * (self._levels_nT + unknowns[2:5]) / width_nT
        shape = self._flat(answer(levels, self._half_s, float(rate), self._pump, self._probe))
        square = float(shape @ shape)
        gain = float(shape @ self._seen) / square if square > 0.0 else 0.0
        return np.asarray(self._seen - gain * shape)

    def _flat(self, lines: Complex) -> Array:
        return np.asarray(np.concatenate([(lines / self._u).real, (lines / self._u).imag], None))
