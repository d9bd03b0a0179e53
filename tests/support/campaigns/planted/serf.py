"""Shots of cells as datasets, what a laboratory may do to them, and the flags that name it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from serf_shots import FOUR, FOURTEEN, Cell

from campaigns.planted.judging import (
    Fault,
    Held,
    Made,
    Row,
    but,
    example,
    of_fault,
    refusals,
    row,
)
from procedures.serf_nonorthogonality.analysis import analyse
from procedures.serf_nonorthogonality.dataset import SerfAnalysis, SerfDataset, Shot
from procedures.serf_nonorthogonality.shots import shots_of

Array = NDArray[Any]
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
    unsteady: bool = False
    """Whether no one residual field is true of all shots."""

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
        truth = truth_of(self.cell)
        if self.unsteady:
            truth = {key: true for key, true in truth.items() if key[0] != "residual_field"}
        return Made(truth, self.write, self.volts.ravel(), model, noise)


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


EXACT: Mapping[str, Any] = {"factors": (1.0, 1.0, 1.0), "known": True}
OPPOSITES = tuple(
    tuple(int(np.sign(one)) for one in shot.field_nT)
    for shot in shots_of("reversal", dict.fromkeys("xyz", 1.0), "z", "y")
)
"""The order of a run."""
BLOCKS = (FOURTEEN[0], FOURTEEN[13], *(FOURTEEN[k + 3 * n] for k in (1, 2, 3) for n in range(4)))
"""Pair after pair, each with its polarities in the order ++ +− −+ −−."""
KINDS: Mapping[str, Callable[[int], Cell]] = {
    "reversal": cell_of,
    "known": partial(cell_of, **EXACT),
    "four": partial(cell_of, **EXACT, residual_nT=(0.0, 0.0, 0.0), pattern=FOUR),
    "strong": partial(cell_of, polarisation=0.5),
    "mains": partial(cell_of, mains_V=0.05),
    "caesium": partial(cell_of, spin=3.5, field_nT=120.0, duration_s=0.3, relaxation=260.0),
    "few cycles": partial(cell_of, relaxation=900.0, field_nT=38.0),
    "noisy": partial(cell_of, noise_V=0.1),
    "opposites": partial(cell_of, pattern=OPPOSITES),
    "blocks": partial(cell_of, pattern=BLOCKS),
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


def stepping(place: int, axis: str, size_nT: float) -> Change:
    """Return the change by a residual field that steps before a shot."""
    step_nT = size_nT * np.eye(3)["xyz".index(axis)]
    change = wandering(lambda k: step_nT * (k >= place), "residual_nT")
    return lambda one, draw: replace(change(one, draw), unsteady=True)


def leaking(coil: str, into: str, size_nT: float) -> Change:
    """Return the change by a coil that, where its field is positive, makes one along another."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        leak_nT = size_nT * np.eye(3)["xyz".index(into)]
        acts = [signs["xyz".index(coil)] > 0 for signs in one.cell.pattern]
        leaky = wandering(lambda k: leak_nT * acts[k], "residual_nT")(one, draw)
        return replace(leaky, unsteady=True)

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


def one_sense(coil: int) -> Change:
    """Return the change by a supply that does not reverse: every shot has the coil's one sense."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        meant = [list(signs) for signs in one.cell.pattern]
        made = [[*s[:coil], abs(s[coil]), *s[coil + 1 :]] for s in meant]
        return columns({k: meant.index(signs) for k, signs in enumerate(made)})(one, draw)

    return change


def read_again(order: Mapping[int, int]) -> Change:
    """Return the change by a recorder that gives one shot's record, noise and all, for another."""

    def change(one: Recorded, draw: np.random.Generator) -> Recorded:
        return replace(one, volts=one.volts[[order.get(k, k) for k in range(len(one.volts))]])

    return change


def begun(time_s: float) -> Change:
    """Return the change of the time stamps by a constant."""
    return lambda one, draw: replace(one, time_s=one.time_s + time_s)


def inverted(shots: Sequence[int]) -> Change:
    """Return the change of the sign of the output of some shots."""
    return volts(lambda v, t, draw: -v, shots)


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
STEP = f"{SHOTS} unseen-step"
SHAPE = "misfit model-too-stiff"
SPOILT = f"{SHAPE} {SHOTS} overload outliers-rejected"
DENIED = "contradicts-statement"
XY, XZ, YZ = (1, 4, 7, 10), (2, 5, 8, 11), (3, 6, 9, 12)
X_TURNED, Y_TURNED, Z_TURNED = (-1, 1, 1), (1, -1, 1), (1, 1, -1)
EXCITATION = "wrong-excitation slowing-down-factor-outside"
FACTOR = "slowing-down-factor-outside contradicts-statement"
LEAK = {"relaxation": 330.0, "residual_nT": (0.0, 0.0, 1.0)}

# fmt: off
FAULTS: Sequence[Fault] = (
    fault("known coils, x off by 0.3 %", DENIED, cells(factors=(1.003, 1, 1)), "known"),
    fault("known coils, z off by 0.05 %", DENIED, cells(factors=(1, 1, 0.9995)), "known"),
    fault("known coils, y off by 0.02 %", DENIED, cells(factors=(1, 1.0002, 1)), "known"),
    fault("known coils, all off by 1 %", FACTOR, cells(factors=(1.01,) * 3), "known"),
    fault("four shots, x off by 1 %", FACTOR, cells(factors=(1.01, 1, 1)), "four"),
    fault("four shots, residual field", FACTOR, cells(residual_nT=(1.0, 0.5, -0.5)), "four"),
    fault("single shots lost", SHOTS, volts(lambda v, t, d: np.clip(v, -0.1, 0.1), (0, 13))),
    fault("single shots lost, fast exchange", SHOTS, volts(lambda v, t, d: 0 * v, (0, 13)),
        "fast exchange"),
    fault("a commanded sign is wrong", SHOTS, stated({5: (1, 1, -1)}), shows=True),
    fault("a commanded field is 1 % off", SHOTS, stated({5: (1.01, 1, 1.01)}), shows=True),
    fault("a commanded field is 0.1 % off", SHOTS, stated({2: (1.001, 1.001, 1)}), shows=True),
    fault("a commanded field is a tenth", SHOTS, stated({8: (1, 1, 0.1)}), shows=True),
    fault("the single field is 0.2 % off", SHOTS, stated({0: (1.002, 1, 1)}), shows=True),
    fault("two polarities exchanged", SHOTS, columns({1: 4, 4: 1})),
    fault("opposite polarities exchanged", SHOTS, columns({1: 10, 10: 1})),
    fault("pairs exchanged", SHOTS, columns({1: 2, 2: 1})),
    fault("all xy and xz exchanged", SHOTS,
        columns({1: 2, 2: 1, 4: 5, 5: 4, 7: 8, 8: 7, 10: 11, 11: 10})),
    fault("a column copied", SHOTS, columns({4: 1})),
    fault("a column copied, like polarity", SHOTS, columns({10: 1})),
    fault("residual field steps", SHOTS,
        wandering(lambda k: (0, 0.03 * (k % 4 > 1), 0), "residual_nT")),
    fault("residual field drifts", SHOTS, wandering(lambda k: (0, 0, 0.005 * k), "residual_nT")),
    fault("all fields drift by 0.1 %", SHOTS,
        wandering(lambda k: (1e-4 * (k % 5),) * 3, "factors")),
    fault("nuclei precess", SHOTS,
        wandering(lambda k: (0.4 * np.cos(k), 0.4 * np.sin(k), 0), "residual_nT")),
    fault("pump leaks in three shots", SHOTS, cells((3, 7, 9), **LEAK)),
    fault("light shift in one shot", SHOTS, cells((3,), residual_nT=(0, 0, 1.0))),
    fault("supplies sag in pairs", SHOTS, cells(range(1, 13), factors=(0.997,) * 3)),
    fault("pick-up 50 Hz not stated", SPOILT, line_V(0.03, 50.0)),
    fault("pick-up 60 Hz stated as 50", SPOILT, line_V(0.03, 60.0), "mains"),
    fault("pick-up beside the tone", SPOILT, line_V(0.02, 210.0)),
    fault("pick-up of a switched supply", SPOILT, line_V(0.05, 1234.0)),
    fault("field has 50 Hz on it", SPOILT, warped(lambda t, b: 3e-5 * np.sin(314.16 * t))),
    fault("coil current rises", SPOILT, warped(lambda t, b: -5e-4 * (1 - np.exp(-t / 5e-4)))),
    fault("coil current rises slowly", SPOILT,
        warped(lambda t, b: -2e-4 * (1 - np.exp(-t / 2e-2)))),
    fault("field droops", SPOILT, warped(lambda t, b: -0.05 * t**2)),
    fault("field droops in one shot", SPOILT, warped(lambda t, b: -0.05 * t**2, (4,))),
    fault("field rises in the end", SPOILT, warped(lambda t, b: 0.05 * t**2)),
    fault("field steps within a shot", SPOILT,
        warped(lambda t, b: 0.004 * np.maximum(t - 0.015, 0), (6,))),
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
    fault("burst of noise", SPOILT,
        volts(lambda v, t, d: v + 0.3 * d.standard_normal(len(v)) * (abs(t - 0.01) < 3e-3))),
    fault("spikes", SPOILT, volts(lambda v, t, d: v + 0.5 * (d.random(len(v)) < 0.03))),
    fault("coupled by a capacitor", SPOILT,
        volts(lambda v, t, d: lfilter([1, -1], [1, -0.995], v))),
    fault("filtered", SPOILT, volts(lambda v, t, d: lfilter(np.ones(8) / 8, 1, v))),
    fault("every second sample made up", SPOILT,
        volts(lambda v, t, d: np.interp(t, t[::2], v[::2]))),
    fault("few bits", SPOILT, volts(lambda v, t, d: np.round(v / 0.125) * 0.125)),
    fault("detector drifts", SPOILT, volts(lambda v, t, d: v + 2.0 * t)),
    fault("detector settles", SPOILT, volts(lambda v, t, d: v + 0.2 * np.exp(-t / 8e-3))),
    fault("another shot shines through", SPOILT,
        lambda one, d: replace(one, volts=one.volts + 0.03 * one.volts[[0]])),
    fault("signal grows weak in mid-shot", SPOILT,
        volts(lambda v, t, d: v * np.where(t > 0.012, 0.8, 1.0))),
    fault("noise alone", SPOILT, volts(lambda v, t, d: 0.01 * d.standard_normal(len(v)), (3,))),
    fault("one recorder's clock is off", SHOTS, warped(lambda t, b: 1e-3 * t, (7,))),
    fault("stamps 0.5 % too fast", DENIED, clock(1.005), "known", True),
    fault("both clocks 0.5 % off", FACTOR, warped(lambda t, b: 5e-3 * t), "known"),
    fault("gyromagnetic ratio off", FACTOR, stated(gyromagnetic_ratio="27.9 Hz/nT"), "known", True),
    fault("wrong isotope", FACTOR, stated(nuclear_spin=2.5), shows=True),
    fault("pump and probe exchanged", FACTOR, stated(pump_axis="y", probe_axis="z"), "strong",
        True),
    fault("a shot pumped less", SPOILT, cells((4,), polarisation=0.45), "strong"),
    fault("pumping wears off", SPOILT, wandering(lambda k: -0.005 * k, "polarisation"), "strong"),
    fault("a record begins late", SPOILT, cells((4, 9), delay_s=8e-4), "strong"),
    fault("output inverted in half the shots", DENIED, inverted(range(0, 14, 2)), "strong"),
    fault("output inverted for the first half", DENIED, inverted(range(7)), "strong"),
    fault("coil x the other way in pairs xy", DENIED, stated(dict.fromkeys(XY, X_TURNED))),
    fault("field droops while it chirps", SPOILT, warped(lambda t, b: -0.05 * t**2), "strong"),
    fault("coil y the other way in pairs xy", DENIED, stated(dict.fromkeys(XY, Y_TURNED))),
    fault("coil z the other way in pairs xz", DENIED, stated(dict.fromkeys(XZ, Z_TURNED))),
    fault("coil z the other way, strong", SHOTS, stated(dict.fromkeys(YZ, Z_TURNED)), "strong"),
    fault("pairs xy taken with the coils xz", DENIED, columns(dict(zip(XY, XZ, strict=True)))),
    fault("pairs xz and yz exchanged", DENIED, columns(dict(zip(XZ + YZ, YZ + XZ, strict=True)))),
    fault("supply x does not reverse", DENIED, one_sense(0)),
    fault("supply z does not reverse", DENIED, one_sense(2)),
    fault("coil y twice its field in pairs xy", SHOTS, stated(dict.fromkeys(XY, (1, 2, 1)))),
    fault("a record read again", SHOTS, read_again({4: 1})),
    fault("a record read again, strong", SHOTS, read_again({5: 4}), "strong"),
    fault("fields in pT", EXCITATION, stated(dict.fromkeys(range(14), (1e3,) * 3)), shows=True),
    fault("fields grow by 0.5 % in mid-course", SHOTS,
        wandering(lambda k: (0.005 * (k > 6),) * 3, "factors")),
    fault("clock of the last seven is off", SHOTS, warped(lambda t, b: 1e-3 * t, range(7, 14))),
    fault("stamps begin at 1 s", DENIED, begun(1.0), shows=True),
    fault("stamps begin at 20 ms", SPOILT, begun(0.02), "strong", True),
    fault("the cell warms", SPOILT, wandering(lambda k: 8.0 * k, "relaxation"), "strong"),
    fault("the vapour grows denser", SPOILT, wandering(lambda k: 2e4 * k, "exchange"), "strong"),
    *(fault(f"residual field steps along {axis} before shot {place}, {kind}", STEP,
        stepping(place, axis, size_nT), kind)
        for kind, size_nT in (("opposites", 0.3), ("blocks", 0.3), ("few cycles", 0.5))
        for place in (4, 7, 8, 10) for axis in "xyz"),
    *(fault("residual field steps in mid-course", STEP, stepping(7, "z", 0.3), kind, True)
        for kind in ("reversal", "known", "strong", "mains")),
    *(fault(f"coil {coil} leaks into {into} in one sense", SHOTS, leaking(coil, into, 0.2), kind)
        for kind in ("reversal", "few cycles", "caesium")
        for coil, into in ("xy", "xz", "yz", "zx")),
)
# fmt: on

CLEAN: Sequence[Callable[[int], Made]] = tuple(partial(clean_of, kind) for kind in KINDS)
USUAL_FLAGS = frozenset(
    {"scale-by-convention", "chirp", "few-cycles", "not-identifiable", "unseen-step"}
)


def shots_from(cell: Cell) -> Callable[[int], Held]:
    """Return the maker of shots in memory; the error is that of the angles."""

    def off_u(analysis: SerfAnalysis) -> float:
        pairs = zip(analysis.estimates[:3], cell.angles_deg, strict=True)
        return max(
            (
                abs(one.value - true) / one.standard_uncertainty
                for one, true in pairs
                if one.value is not None and one.standard_uncertainty
            ),
            default=0.0,
        )

    return lambda seed: Held(cell.dataset(seed), analyse, off_u)


def shot(number: int, change: Callable[[Shot, int], Shot]) -> Callable[..., SerfDataset]:
    """Return the change of one shot."""

    def changed(dataset: SerfDataset, seed: int) -> SerfDataset:
        shots = list(dataset.shots)
        shots[number] = change(shots[number], seed)
        return replace(dataset, shots=shots)

    return changed


def clip(limit: float, full_scale: float | None = None) -> Callable[[Shot, int], Shot]:
    """Return the change of a shot to one at its limits, stated or not."""
    return lambda one, _: replace(
        one, voltage_V=np.clip(one.voltage_V, -limit, limit), full_scale_V=full_scale
    )


def from_cell(cell: Cell, *numbers: int) -> Callable[..., SerfDataset]:
    """Return the change of some shots to those of another cell."""

    def changed(dataset: SerfDataset, seed: int) -> SerfDataset:
        others = cell.dataset(seed).shots
        shots = [others[k] if k in numbers else one for k, one in enumerate(dataset.shots)]
        return replace(dataset, shots=shots)

    return changed


def noise_alone(dataset: SerfDataset, _: int) -> SerfDataset:
    """Return a dataset of one shot that is noise."""
    noise = np.random.default_rng(1).standard_normal(1000)
    return replace(
        dataset, shots=[Shot("noise", np.array([50.0, 0.0, 0.0]), np.arange(1000) / 1e4, noise)]
    )


def spoilt_table(text: str) -> str:
    """Return a table with a spike and ten rows lost."""
    head, *rows = text.splitlines()
    cells = rows[300].split(",")
    rows[300] = ",".join([cells[0], "2.5", *cells[2:]])
    del rows[500:510]
    return "\n".join([head, *rows, ""])


STILL = shots_from(Cell())
RESIDUAL = (1.0, -0.6, 0.8)
REVERSAL, FOUR_SHOTS = example("serf-polarity-reversal"), example("serf-four-shots")
SPOILT_TABLE = REVERSAL.but("shots.csv", spoilt_table)
REJECTED, DISAGREE = "shot-rejected", "shots-disagree"

NAMED: Sequence[tuple[str, int, str]] = (
    ("known coils, all off by 1 %", 0, "slowing-down-factor-outside"),
    ("a commanded sign is wrong", 0, "shot-rejected"),
    ("opposite polarities exchanged", 0, "shots-disagree"),
    ("pick-up 50 Hz not stated", 0, "misfit model-too-stiff"),
    ("field droops", 0, "misfit"),
    ("rows lost unseen, few", 0, "misfit model-too-stiff"),
    ("recorder stands still", 0, "misfit model-too-stiff"),
    ("light goes off late", 0, "misfit model-too-stiff"),
    ("stamps 0.5 % too fast", 0, "contradicts-statement"),
    ("gyromagnetic ratio off", 0, "contradicts-statement slowing-down-factor-outside"),
    ("wrong isotope", 0, "slowing-down-factor-outside"),
    ("pump and probe exchanged", 0, "contradicts-statement"),
    ("stamps begin at 1 s", 0, "contradicts-statement"),
)

# fmt: off
ROWS: Sequence[Row] = (
    *(of_fault(FAULTS, *one) for one in NAMED),
    *(of_fault(FAULTS, name, 1, DENIED, details={"statement": "shots"})
        for name in ("output inverted for the first half", "coil x the other way in pairs xy")),
    *(of_fault(FAULTS, name, 1, f"{DENIED} {DISAGREE}", says=said, details={"statement": "shots"})
        for name, said in (("coil y the other way in pairs xy",
        "coil y was reversed in the shots of xy"),
        ("pairs xy taken with the coils xz", "the shots of xy were taken with the coils xz"))),
    of_fault(FAULTS, "pairs exchanged", 1, DISAGREE),
    of_fault(FAULTS, "nuclei precess", 1, DISAGREE, without=DENIED),
    of_fault(FAULTS, "supplies sag in pairs", 1, DISAGREE, without=DENIED),
    of_fault(FAULTS, "the cell warms", 0, "misfit", says="% faster than that of the first"),
    of_fault(FAULTS, "the vapour grows denser", 0, "misfit",
        says="% more slowly than that of the first"),
    row("a shot of another sign", but(shots_from(Cell(residual_nT=RESIDUAL)),
        shot(5, lambda one, _: replace(one, field_nT=one.field_nT * np.array([1.0, 1.0, -1.0])))),
        REJECTED, says="commanded field is wrong", details={"shot": "s06"}, below_u=4.0),
    *(row(f"output inverted throughout, {late_s:g} s late",
        but(shots_from(Cell(residual_nT=RESIDUAL, polarisation=0.4, delay_s=late_s)),
        lambda one, _: replace(one,
        shots=[replace(s, voltage_V=-s.voltage_V) for s in one.shots])), seeds=(1,),
        without=DENIED) for late_s in (0.0, 6e-4)),
    row("coil constants that are 0.1 % off",
        shots_from(Cell(factors=(1.001, 0.9995, 1.0008), known=True)), DENIED,
        details={"statement": "coil_constants"}, below_u=4.0),
    row("a field that the nuclei left", shots_from(Cell(residual_nT=(0.0, 0.0, 12.0))),
        "residual-field-large", seeds=(5,), says="depolarise the nuclei"),
    row("a residual field of other shots",
        but(STILL, from_cell(Cell(residual_nT=(0.4, 0.3, 0.2)), *range(0, 14, 3))), DISAGREE,
        seeds=(6,), clean=STILL),
    of_fault(FAULTS, "fields in pT", 0, "wrong-excitation"),
    row("fields near pump and probe",
        shots_from(Cell(pattern=((0, 1, 1), *FOURTEEN[1:]), pump=(0.0, 0.7, 0.7))), "baseline"),
    row("few cycles", shots_from(Cell(relaxation=1200.0)), "few-cycles", seeds=(7,)),
    row("less than a cycle", shots_from(Cell(relaxation=1200.0, field_nT=38.0)), REJECTED,
        seeds=(7,), says="nT in x would give 1.5", known="nonorthogonality_angle"),
    *(row(f"a shot at its limits of 0.9 V, {'' if full_scale else 'not '}stated",
        but(STILL, shot(0, clip(0.9, full_scale))), "overload", seeds=(8,), below_u=5.0)
        for full_scale in (None, 0.9)),
    row("a shot at its limits of 0.05 V", but(STILL, shot(0, clip(0.05, 0.05))), REJECTED,
        seeds=(8,), says="saturated"),
    row("pump light in a shot", but(STILL, from_cell(Cell(relaxation=330.0), 5)), REJECTED,
        seeds=(9,), says="pump light leaked", details={"shot": "s06"}, below_u=5.0),
    row("one shot of noise", but(shots_from(Cell(known=True)), noise_alone), "not-identifiable",
        null="nonorthogonality_angle"),
    row("gyromagnetic ratio the other way up",
        but(STILL, lambda one, _: replace(one, gamma_Hz_per_nT=1.0 / 28.02495)),
        "slowing-down-factor-outside", seeds=(10,)),
    row("four shots, known coils", shots_from(Cell(pattern=FOUR, known=True)), "not-identifiable",
        seeds=(4,), others="", null="residual_field", below_u=4.0),
    row("four shots, nominal coils", shots_from(Cell(pattern=FOUR)), "not-identifiable",
        seeds=(4,), says="only with the coil constants known",
        null="nonorthogonality_angle coil_factor residual_field"),
    row("a residual field and coils that differ",
        shots_from(Cell(residual_nT=RESIDUAL, factors=(1.010, 0.995, 1.008))),
        "unseen-step scale-by-convention", seeds=(2,), others="", below_u=4.0),
    row("a strong chirp", shots_from(Cell(polarisation=0.6, residual_nT=RESIDUAL)), "chirp",
        seeds=(1,), says="falls by 21 %", below_u=5.0),
    row("the example with a spike and a gap", lambda _: SPOILT_TABLE,
        "outliers-rejected gap scale-by-convention", others="", details={"missing_samples": 140},
        below_u=1.0),
    *refusals(
        FOUR_SHOTS,
        ("dataset.yaml", "probe_axis: y", "probe_axis: z", "another axis than pump_axis"),
        ("dataset.yaml", "pump_axis: z", "pump_axis: x", "use coil z for a single axis"),
        ("dataset.yaml", "  probe_axis: y\n", "", "probe_axis"),
        ("dataset.yaml", "nuclear_spin: 1.5", "nuclear_spin: 2", "2.5 (Rb-85)"),
        ("dataset.yaml", "28.02495 Hz/nT", "28.02495 nT/Hz", "gyromagnetic_ratio"),
        ("dataset.yaml", "10000 Hz", "1000 Hz", "1000 Hz contradicts the rows"),
        ("dataset.yaml", "known   #", "exact   #", "coil_constants"),
        ("dataset.yaml", "[55 nT, 55 nT, 0 nT]", "[0 nT, 0 nT, 0 nT]", "all fields are zero"),
        ("dataset.yaml", "[55 nT, 55 nT, 0 nT]", "[55 nT, 55 nT]", "field"),
        ("dataset.yaml", "id: s02", "id: s01", "stands twice"),
        ("dataset.yaml", "id: s02", "id: s05", "s05: the column is missing"),
        ("dataset.yaml", "shots: shots.csv", "shot: shots.csv", "shots"),
        ("shots.csv", "\n0.00010,", "\n-0.00010,", "times must rise"),
        ("shots.csv", "\n0.00010,-0.15452", "\n0.00010,wild", "'wild' is not a number"),
    ),
)
# fmt: on
