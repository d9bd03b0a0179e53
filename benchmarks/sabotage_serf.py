"""Faults of coil-angle datasets: what was recorded of a cell, and what a laboratory does to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from sabotage import Fault, Made
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from serf_shots import FOUR, Cell

Array = NDArray[np.float64]
Change = Callable[["Recorded", np.random.Generator], "Recorded"]

PAIRS = ("xy", "xz", "yz")
NUDGES: Mapping[str, float] = {"polarisation": 1e-3, "relaxation": 0.1, "exchange": 1e3}

known_clean = lru_cache(maxsize=64)(Cell.clean_V)


@dataclass(frozen=True)
class Recorded:
    """What a cell gave and what is stated of it; `volts` (shots, samples)."""

    cell: Cell
    volts: Array
    time_s: Array
    fields_nT: Array
    conditions: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write the dataset's folder."""
        names = [f"s{k + 1:02d}" for k in range(len(self.volts))]
        rows = np.column_stack([self.time_s, self.volts.T])
        text = ",".join(["t_s", *names])
        np.savetxt(folder / "shots.csv", rows, "%.7g", ",", header=text, comments="")
        stated = {
            "sample_rate": f"{self.cell.sample_rate_Hz!r} Hz",
            "nuclear_spin": self.cell.spin,
            "pump_axis": "z",
            "probe_axis": "y",
            "coil_constants": "known" if self.cell.known else "nominal",
            "mains_frequency": "50 Hz" if self.cell.mains_V else None,
            "shots": [
                {"id": name, "field": [f"{float(one)!r} nT" for one in row]}
                for name, row in zip(names, self.fields_nT, strict=True)
            ],
            **self.conditions,
        }
        document = {
            "dataset": 1,
            "procedure": "serf-nonorthogonality",
            "files": {"shots": "shots.csv"},
            "conditions": stated,
        }
        (folder / "dataset.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")

    def made(self, *, with_model: bool) -> Made:
        """Return the dataset for the frame."""
        model = model_of(self.cell) if with_model else np.zeros((0, 0))
        noise = np.full(self.volts.size, self.cell.noise_V)
        return Made(truth_of(self.cell), self.write, self.volts.ravel(), model, noise)


def truth_of(cell: Cell) -> dict[tuple[str, str | None, str | None], float]:
    """Return the true values; those that are one by statement or convention stay out."""
    truth: dict[tuple[str, str | None, str | None], float] = {}
    unit = 1.0 if cell.known else cell.factors[0]
    for pair, angle in zip(PAIRS, cell.angles_deg, strict=True):
        truth["nonorthogonality_angle", pair, None] = float(angle)
    for k, axis in enumerate("xyz"):
        truth["residual_field", axis, None] = float(cell.residual_on_coils_nT[k] / unit)
        if k and not cell.known:
            truth["coil_factor", axis, None] = float(cell.factors[k] / unit)
    truth["slowing_down_factor", None, None] = float(cell.factor_at_rest / unit)
    return truth


@lru_cache(maxsize=64)
def model_of(cell: Cell) -> Array:
    """Return the derivatives of all samples by what is free in a clean dataset.

    Of each shot: tone in and out of phase, baseline, offset and mains; of all: angles, factors or
    their common scale, residual field, polarisation, relaxation and exchange.
    """
    clean = known_clean(cell)
    shots, samples = clean.shape
    columns = []
    own = [*np.moveaxis(cell.waves_V(), 2, 1), np.ones((shots, samples))]
    if cell.mains_V:
        turn = 2.0 * np.pi * 50.0 * cell.time_s
        own += [np.tile(np.cos(turn), (shots, 1)), np.tile(np.sin(turn), (shots, 1))]
    for wave in own:
        for k in range(shots):
            column = np.zeros((shots, samples))
            column[k] = wave[k]
            columns.append(column)
    others = [cell.but(**{name: getattr(cell, name) + h}) for name, h in NUDGES.items()]
    for name, h in (("angles_deg", 1e-3), ("residual_nT", 1e-3), ("factors", 1e-6)):
        value = np.array(getattr(cell, name))
        steps = [np.ones(3)] if cell.known and name == "factors" else list(np.eye(3))
        if name == "residual_nT" and cell.pattern == FOUR:
            steps = []
        others += [cell.but(**{name: tuple(value + h * step)}) for step in steps]
    columns += [known_clean(other) - clean for other in others]
    model = np.array([column.ravel() for column in columns]).T
    return np.asarray(model / np.maximum(np.linalg.norm(model, axis=0), 1e-12))


def cell_of(seed: int, **changes: object) -> Cell:
    """Return a cell with its coils, as laboratories have them."""
    draw = np.random.default_rng(seed + 77)
    cell = Cell(
        angles_deg=tuple(draw.uniform(88.0, 92.0, 3)),
        factors=tuple(draw.uniform(0.99, 1.01, 3)),
        residual_nT=tuple(draw.normal(0.0, 0.3, 3)),
        field_nT=float(draw.choice([45.0, 50.0, 60.0])),
        polarisation=float(draw.uniform(0.02, 0.08)),
        relaxation=float(draw.uniform(200.0, 280.0)),
        noise_V=float(draw.choice([0.005, 0.01, 0.02])),
        offset_V=float(draw.normal(0.0, 0.02)),
        delay_s=float(draw.uniform(0.0, 2e-4)),
    )
    return cell.but(**changes)


EXACT = {"factors": (1.0, 1.0, 1.0), "known": True}
KINDS: Mapping[str, Callable[[int], Cell]] = {
    "reversal": cell_of,
    "known": partial(cell_of, **EXACT),
    "four": partial(cell_of, **EXACT, residual_nT=(0.0, 0.0, 0.0), pattern=FOUR),
    "strong": partial(cell_of, polarisation=0.5),
    "mains": partial(cell_of, mains_V=0.05),
    "caesium": partial(cell_of, spin=3.5, field_nT=120.0, duration_s=0.3, relaxation=260.0),
    "few cycles": partial(cell_of, relaxation=900.0, field_nT=38.0),
    "noisy": partial(cell_of, noise_V=0.1),
    "fast exchange": partial(cell_of, exchange=2e5, field_nT=80.0),
}


def recorded(cell: Cell, seed: int) -> Recorded:
    """Return what a cell gives, with its noise."""
    noise = np.random.default_rng(seed).standard_normal((len(cell.pattern), len(cell.time_s)))
    volts = known_clean(cell) + cell.noise_V * noise
    return Recorded(cell, volts, cell.time_s, cell.commanded_nT)


def clean_of(kind: str, seed: int) -> Made:
    """Return a clean dataset without what only a fault needs."""
    return recorded(KINDS[kind](seed), seed).made(with_model=False)


def fault(
    name: str, flags: str, change: Change, kind: str = "reversal", shows: bool | None = None
) -> Fault:
    """Return the fault that a change plants in datasets of a kind; `shows` where only words do."""

    def clean(seed: int) -> Made:
        return recorded(KINDS[kind](seed), seed).made(with_model=True)

    def planted(seed: int) -> Made:
        one = recorded(KINDS[kind](seed), seed)
        return change(one, np.random.default_rng(seed + 5000)).made(with_model=False)

    return Fault(name, frozenset(flags.split()), clean, planted, shows, {"kind": kind})


def cells(shots: Sequence[int] | None = None, **changes: object) -> Change:
    """Return the change of some shots, or all, into those of a cell that differs; truth stays."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        more = known_clean(one.cell.but(**changes)) - known_clean(one.cell)
        volts = one.volts.copy()
        which = range(len(volts)) if shots is None else shots
        for k in which:
            volts[k] += more[k]
        return replace(one, volts=volts)

    return change


def wandering(path: Callable[[int], object], name: str) -> Change:
    """Return the change of one property of the cell from shot to shot."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        for k in range(len(one.volts)):
            value = np.array(getattr(one.cell, name)) + np.array(path(k))
            moved = tuple(value) if value.ndim else float(value)
            one = cells([k], **{name: moved})(one, draw)
        return one

    return change


def warped(late_s: Callable[[Array, Array], Array], shots: Sequence[int] | None = None) -> Change:
    """Return the change by a clock that is `late_s` ahead at a time, of the signal not the noise.

    It stands for a field that changes during a record, and for rows lost or repeated.
    """

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        t = one.cell.time_s
        clean, volts = known_clean(one.cell), one.volts.copy()
        for k in range(len(volts)) if shots is None else shots:
            at = np.clip(t + late_s(t, one.cell.fields_nT[k]), 0.0, t[-1])
            volts[k] += CubicSpline(t, clean[k])(at) - clean[k]
        return replace(one, volts=volts)

    return change


def volts(
    by: Callable[[Array, Array, np.random.Generator], Array], shots: Sequence[int] | None = None
) -> Change:
    """Return the change of the recorded voltages of single shots, (samples,) with their times."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        changed = one.volts.copy()
        for k in range(len(changed)) if shots is None else shots:
            changed[k] = by(changed[k], one.time_s, draw)
        return replace(one, volts=changed)

    return change


def stated(shots: Mapping[int, Sequence[float]] | None = None, **conditions: object) -> Change:
    """Return the change of what is stated: factors on commanded fields, and conditions."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        fields_nT = one.fields_nT.copy()
        for k, factors in (shots or {}).items():
            fields_nT[k] = fields_nT[k] * np.array(factors)
        return replace(one, fields_nT=fields_nT, conditions={**one.conditions, **conditions})

    return change


def columns(order: Mapping[int, int]) -> Change:
    """Return the change that puts the column of one shot under another's name."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        clean = known_clean(one.cell)
        more = clean[[order.get(k, k) for k in range(len(clean))]] - clean
        return replace(one, volts=one.volts + more)

    return change


def clock(factor: float) -> Change:
    """Return the change of the time stamps by a factor."""
    return lambda one, draw: replace(one, time_s=one.time_s * factor)


def line_V(size_V: float, hertz: float) -> Change:
    """Return the change by a sine of a frequency."""
    return volts(lambda v, t, draw: v + size_V * np.sin(2.0 * np.pi * hertz * t + 0.7))


def held(v: Array, first: int, count: int) -> Array:
    """Return a record that stands still for some samples."""
    return np.concatenate([v[:first], np.full(count, v[first]), v[first + count :]])


def bridged(v: Array, first: int, count: int) -> Array:
    """Return a record with some samples filled by a straight line."""
    line = np.linspace(v[first], v[first + count], count)
    return np.concatenate([v[:first], line, v[first + count :]])


def moved(v: Array, to: int, first: int, count: int) -> Array:
    """Return a record in which a block stands at another place too."""
    return np.concatenate([v[:to], v[first : first + count], v[to + count :]])


SHOTS = "shots-disagree shot-rejected"
SHAPE = "misfit model-too-stiff"
SPOILT = f"{SHAPE} {SHOTS} overload outliers-rejected"
DENIED = "contradicts-statement"
FACTOR = "slowing-down-factor-outside contradicts-statement"
LEAK = {"relaxation": 330.0, "residual_nT": (0.0, 0.0, 1.0)}

FAULTS: Sequence[Fault] = (
    fault("known coils, x off by 0.3 %", DENIED, cells(factors=(1.003, 1, 1)), "known"),
    fault("known coils, z off by 0.05 %", DENIED, cells(factors=(1, 1, 0.9995)), "known"),
    fault("known coils, y off by 0.02 %", DENIED, cells(factors=(1, 1.0002, 1)), "known"),
    fault("known coils, all off by 1 %", FACTOR, cells(factors=(1.01,) * 3), "known"),
    fault("four shots, x off by 1 %", FACTOR, cells(factors=(1.01, 1, 1)), "four"),
    fault("four shots, residual field", FACTOR, cells(residual_nT=(1.0, 0.5, -0.5)), "four"),
    fault("single shots lost", SHOTS, volts(lambda v, t, d: np.clip(v, -0.1, 0.1), (0, 13))),
    fault("single shots lost, fast exchange", SHOTS, volts(lambda v, t, d: 0 * v, (0, 13)), "fast exchange"),
    fault("a commanded sign is wrong", SHOTS, stated({5: (1, 1, -1)}), shows=True),
    fault("a commanded field is 1 % off", SHOTS, stated({5: (1.01, 1, 1.01)}), shows=True),
    fault("a commanded field is 0.1 % off", SHOTS, stated({2: (1.001, 1.001, 1)}), shows=True),
    fault("a commanded field is a tenth", SHOTS, stated({8: (1, 1, 0.1)}), shows=True),
    fault("the single field is 0.2 % off", SHOTS, stated({0: (1.002, 1, 1)}), shows=True),
    fault("two polarities exchanged", SHOTS, columns({1: 4, 4: 1})),
    fault("opposite polarities exchanged", SHOTS, columns({1: 10, 10: 1})),
    fault("pairs exchanged", SHOTS, columns({1: 2, 2: 1})),
    fault("all xy and xz exchanged", SHOTS, columns({1: 2, 2: 1, 4: 5, 5: 4, 7: 8, 8: 7, 10: 11, 11: 10})),
    fault("a column copied", SHOTS, columns({4: 1})),
    fault("a column copied, like polarity", SHOTS, columns({10: 1})),
    fault("residual field steps", SHOTS, wandering(lambda k: (0, 0.03 * (k % 4 > 1), 0), "residual_nT")),
    fault("residual field drifts", SHOTS, wandering(lambda k: (0, 0, 0.005 * k), "residual_nT")),
    fault("all fields drift by 0.1 %", SHOTS, wandering(lambda k: (1e-4 * (k % 5),) * 3, "factors")),
    fault("nuclei precess", SHOTS, wandering(lambda k: (0.4 * np.cos(k), 0.4 * np.sin(k), 0), "residual_nT")),
    fault("pump leaks in three shots", SHOTS, cells((3, 7, 9), **LEAK)),
    fault("light shift in one shot", SHOTS, cells((3,), residual_nT=(0, 0, 1.0))),
    fault("supplies sag in pairs", SHOTS, cells(range(1, 13), factors=(0.997,) * 3)),
    fault("pick-up 50 Hz not stated", SPOILT, line_V(0.03, 50.0)),
    fault("pick-up 60 Hz stated as 50", SPOILT, line_V(0.03, 60.0), "mains"),
    fault("pick-up beside the tone", SPOILT, line_V(0.02, 210.0)),
    fault("pick-up of a switched supply", SPOILT, line_V(0.05, 1234.0)),
    fault("field has 50 Hz on it", SPOILT, warped(lambda t, b: 3e-5 * np.sin(314.16 * t))),
    fault("coil current rises", SPOILT, warped(lambda t, b: -5e-4 * (1 - np.exp(-t / 5e-4)))),
    fault("coil current rises slowly", SPOILT, warped(lambda t, b: -2e-4 * (1 - np.exp(-t / 2e-2)))),
    fault("field droops", SPOILT, warped(lambda t, b: -0.05 * t**2)),
    fault("field droops in one shot", SPOILT, warped(lambda t, b: -0.05 * t**2, (4,))),
    fault("field rises in the end", SPOILT, warped(lambda t, b: 0.05 * t**2)),
    fault("field steps within a shot", SPOILT, warped(lambda t, b: 0.004 * np.maximum(t - 0.015, 0), (6,))),
    fault("light goes off late", SPOILT, volts(lambda v, t, d: v + 0.3 * np.exp(-t / 1.5e-3))),
    fault("rows lost unseen", SPOILT, warped(lambda t, b: 1e-3 * (t > 0.012))),
    fault("rows lost unseen, few", SPOILT, warped(lambda t, b: 2e-4 * (t > 0.012))),
    fault("rows repeated unseen", SPOILT, warped(lambda t, b: -1e-3 * (t > 0.012))),
    fault("rows lost in one shot", SPOILT, warped(lambda t, b: 5e-4 * (t > 0.012), (5,))),
    fault("a block copied", SPOILT, volts(lambda v, t, d: moved(v, 150, 100, 40), (5,))),
    fault("recorder stands still", SPOILT, volts(lambda v, t, d: held(v, 120, 30), (2, 5))),
    fault("gaps filled straight", SPOILT, volts(lambda v, t, d: bridged(v, 130, 40))),
    fault("clipped on one side", SPOILT, volts(lambda v, t, d: np.minimum(v, 0.5))),
    fault("detector compresses", SPOILT, volts(lambda v, t, d: np.tanh(v))),
    fault("detector bends", SPOILT, volts(lambda v, t, d: v + 0.1 * v**2)),
    fault("burst of noise", SPOILT, volts(lambda v, t, d: v + 0.3 * d.standard_normal(len(v)) * (abs(t - 0.01) < 3e-3))),
    fault("spikes", SPOILT, volts(lambda v, t, d: v + 0.5 * (d.random(len(v)) < 0.03))),
    fault("coupled by a capacitor", SPOILT, volts(lambda v, t, d: lfilter([1, -1], [1, -0.995], v))),
    fault("filtered", SPOILT, volts(lambda v, t, d: lfilter(np.ones(8) / 8, 1, v))),
    fault("every second sample made up", SPOILT, volts(lambda v, t, d: np.interp(t, t[::2], v[::2]))),
    fault("few bits", SPOILT, volts(lambda v, t, d: np.round(v / 0.125) * 0.125)),
    fault("detector drifts", SPOILT, volts(lambda v, t, d: v + 2.0 * t)),
    fault("detector settles", SPOILT, volts(lambda v, t, d: v + 0.2 * np.exp(-t / 8e-3))),
    fault("another shot shines through", SPOILT, lambda one, d: replace(one, volts=one.volts + 0.03 * one.volts[[0]])),
    fault("signal grows weak in mid-shot", SPOILT, volts(lambda v, t, d: v * np.where(t > 0.012, 0.8, 1.0))),
    fault("noise alone", SPOILT, volts(lambda v, t, d: 0.01 * d.standard_normal(len(v)), (3,))),
    fault("one recorder's clock is off", SHOTS, warped(lambda t, b: 1e-3 * t, (7,))),
    fault("stamps 0.5 % too fast", DENIED, clock(1.005), "known", True),
    fault("both clocks 0.5 % off", FACTOR, warped(lambda t, b: 5e-3 * t), "known"),
    fault("gyromagnetic ratio off", FACTOR, stated(gyromagnetic_ratio="27.9 Hz/nT"), "known", True),
    fault("wrong isotope", FACTOR, stated(nuclear_spin=2.5), shows=True),
    fault("pump and probe exchanged", FACTOR, stated(pump_axis="y", probe_axis="z"), "strong", True),
    fault("a shot pumped less", SPOILT, cells((4,), polarisation=0.45), "strong"),
    fault("pumping wears off", SPOILT, wandering(lambda k: -0.005 * k, "polarisation"), "strong"),
    fault("a record begins late", SPOILT, cells((4, 9), delay_s=8e-4), "strong"),
    fault("field droops while it chirps", SPOILT, warped(lambda t, b: -0.05 * t**2), "strong"),
)

CLEAN: Sequence[Callable[[int], Made]] = tuple(partial(clean_of, kind) for kind in KINDS)
USUAL_FLAGS = frozenset({"scale-by-convention", "chirp", "few-cycles", "not-identifiable"})
