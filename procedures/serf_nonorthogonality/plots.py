"""Plots of the shots: signals with their fits, what the fits leave, spectra, the misfit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from station.report.drawing import BLUE, GREEN, GREY, INK, VERMILION, label_above, new_figure

from .dataset import SerfAnalysis, SerfDataset

Array = NDArray[np.float64]

COLUMNS, WIDE_COLUMNS = 4, 2
DECAYS_SHOWN = 3.0
"""1/e times of a signal that are drawn; what comes later is in its residuals."""
MILLI = 1e3
PADDING = 4
NOISE_SPAN = 4.5


@dataclass(frozen=True)
class Drawn:
    """A shot as it is drawn: its samples, those used, and what the fit says at these."""

    name: str
    time_s: Array
    voltage_V: Array
    used_s: Array
    model_V: Array
    residual_V: Array
    noise_V: float
    frequency_Hz: float
    decay_per_s: float


def drawn_shots(analysis: SerfAnalysis, dataset: SerfDataset) -> tuple[Drawn, ...]:
    """Return all shots with a fit; that of the joint fit where there is one."""
    found = []
    for shot, outcome in zip(dataset.shots, analysis.shots, strict=True):
        fit, kept = outcome.fit, outcome.kept
        if fit is None:
            continue
        frequency_Hz = fit.frequency_Hz
        if np.isfinite(outcome.omega_rad_per_s):
            frequency_Hz = outcome.omega_rad_per_s / (2.0 * np.pi)
        found.append(
            Drawn(
                shot.name.replace("-", "−"),
                shot.time_s,
                shot.voltage_V,
                shot.time_s[kept],
                shot.voltage_V[kept] - outcome.residual_V,
                outcome.residual_V,
                float(np.std(outcome.residual_V)),
                frequency_Hz,
                fit.decay_per_s,
            )
        )
    return tuple(found)


def signals(shots: Sequence[Drawn]) -> Figure:
    """Draw each shot's samples and its fit."""
    figure, grid = _panels(len(shots), WIDE_COLUMNS)
    end_s = DECAYS_SHOWN / min(shot.decay_per_s for shot in shots)
    for axes, shot in zip(grid, shots, strict=True):
        seen, fitted = shot.time_s <= end_s, shot.used_s <= end_s
        axes.plot(
            shot.time_s[seen] * MILLI, shot.voltage_V[seen], ".", color=VERMILION, markersize=2.2
        )
        axes.plot(shot.used_s[fitted] * MILLI, shot.model_V[fitted], color=BLUE, linewidth=0.8)
        label_above(axes, f"{shot.name}  {shot.frequency_Hz:.2f} Hz")
    _label(grid, WIDE_COLUMNS, "time, ms", "signal, V")
    return figure


def residuals(shots: Sequence[Drawn]) -> Figure:
    """Draw what the fits leave, each on the scale of its own noise."""
    figure, grid = _panels(len(shots), COLUMNS)
    for axes, shot in zip(grid, shots, strict=True):
        scale = shot.noise_V if shot.noise_V > 0.0 else 1.0
        axes.plot(shot.used_s * MILLI, shot.residual_V / scale, ".", color=BLUE, markersize=1.6)
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.set_ylim(-NOISE_SPAN, NOISE_SPAN)
        label_above(axes, f"{shot.name}  σ = {MILLI * shot.noise_V:.3g} mV")
    _label(grid, COLUMNS, "time, ms", "residual, σ")
    return figure


def spectra(shots: Sequence[Drawn]) -> Figure:
    """Draw the amplitude spectra of signal and residual, the fitted frequency marked."""
    figure, grid = _panels(len(shots), COLUMNS)
    end_Hz = 3.0 * max(shot.frequency_Hz for shot in shots)
    for axes, shot in zip(grid, shots, strict=True):
        frequency_Hz, amplitude = _spectrum(shot.used_s, shot.model_V + shot.residual_V)
        _, left = _spectrum(shot.used_s, shot.residual_V)
        span_s = float(shot.used_s[-1] - shot.used_s[0])
        shown = (frequency_Hz <= end_Hz) & (frequency_Hz >= 1.0 / span_s)
        axes.semilogy(frequency_Hz[shown], amplitude[shown] * MILLI, color=BLUE, linewidth=0.9)
        axes.semilogy(frequency_Hz[shown], left[shown] * MILLI, color=GREEN, linewidth=0.7)
        axes.axvline(shot.frequency_Hz, color=VERMILION, linewidth=0.8, linestyle="--")
        axes.set_xlim(0.0, end_Hz)
        axes.xaxis.set_major_locator(MaxNLocator(3, prune="upper"))
        label_above(axes, shot.name)
    _label(grid, COLUMNS, "frequency, Hz", "mV")
    return figure


def misfit(analysis: SerfAnalysis) -> Figure:
    """Draw how far each shot's frequency is from the solution, in its uncertainty."""
    used = [shot for shot in analysis.shots if shot.used and np.isfinite(shot.misfit)]
    figure = new_figure(2.6)
    axes = figure.add_subplot()
    places = np.arange(len(used))
    axes.plot(places, [shot.misfit for shot in used], "o", color=BLUE, markersize=5)
    axes.axhline(0.0, color=INK, linewidth=0.7)
    for edge in (-2.0, 2.0):
        axes.axhline(edge, color=GREY, linewidth=0.8, linestyle="--")
    axes.set_xticks(
        places, [shot.name.replace("-", "−") for shot in used], rotation=45 if len(used) > 8 else 0
    )
    axes.set_ylabel("misfit, u")
    reach = max(3.0, 1.2 * max((abs(shot.misfit) for shot in used), default=0.0))
    axes.set_ylim(-reach, reach)
    return figure


def _spectrum(time_s: Array, volts: Array) -> tuple[Array, Array]:
    count = len(volts)
    length = PADDING * int(2 ** np.ceil(np.log2(count)))
    interval_s = float(time_s[-1] - time_s[0]) / (count - 1)
    # Falling from the beginning, where the signal is, to the end, which would leak else.
    window = 0.5 + 0.5 * np.cos(np.pi * np.arange(count) / count)
    amplitude = 2.0 / window.sum() * np.abs(np.fft.rfft((volts - volts.mean()) * window, length))
    return np.asarray(np.fft.rfftfreq(length, interval_s)), np.maximum(amplitude, 1e-9)


def _panels(count: int, columns: int) -> tuple[Figure, list[Axes]]:
    rows, columns = -(-count // columns), min(count, columns)
    figure = new_figure(0.5 + 1.45 * rows)
    grid = figure.subplots(rows, columns, sharex=False, sharey=True, squeeze=False)
    figure.subplots_adjust(hspace=0.62, wspace=0.08)
    panels = list(grid.flat)
    for axes in panels[count:]:
        axes.set_visible(False)
    return figure, panels[:count]


def _label(grid: list[Axes], columns: int, below: str, beside: str) -> None:
    for number, axes in enumerate(grid):
        if number % columns == 0:
            axes.set_ylabel(beside)
        if number + columns >= len(grid):
            axes.set_xlabel(below)
        else:
            axes.tick_params(labelbottom=False)
