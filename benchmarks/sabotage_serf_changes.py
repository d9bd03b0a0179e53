"""Shots of cells as datasets, and what a laboratory may do to them: what faults are made of."""

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
from serf_shots import FOUR, FOURTEEN, Cell

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
