"""Clean logs of turns over temperature, of many kinds, and changes; see `sabotage_fog.py`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fog_records import Curve, record
from numpy.typing import NDArray
from simulated_drive import drive_csv, simulated_drive

from campaigns.planted.judging import Array, Fault, Made
from procedures.fog_scale_factor_temperature.dataset import (
    Drive,
    TurnTable,
    rotation_to_navigation,
    turn_errors_deg,
    wrapped_deg,
)

Values = NDArray[Any]
Shape = Callable[[Values], Any]
Change = Callable[["Log", np.random.Generator], "Log"]

AXES = ("x", "y", "z")
UP_DEG = {"x": (90.0, 0.0), "y": (0.0, -90.0), "z": (0.0, 180.0)}
"""Pitch and roll with that axis up."""
CURVE_PPM = (60.0, 200.0, 140.0, 60.0, 110.0)
FREE_ORDER = 12
PPM_DEG = 360e-6


@dataclass(frozen=True)
class Log:
    """A log and what is true of it; `conditions` are those of the file as text."""

    table: TurnTable
    curves: Mapping[str, Curve]
    conditions: Mapping[str, str]
    noise_ppm: float
    verification: TurnTable | None = None
    drive: Drive | None = None

    @property
    def full(self) -> bool:
        """Whether the navigator gives pitch and roll."""
        return self.conditions["attitude_output"] == "heading-pitch-roll"

    def error_ppm(self, table: TurnTable) -> Array:
        """Return what is measured, shape (rows,)."""
        sense: Any = self.conditions["turn_sense"]
        return turn_errors_deg(table, sense, self.full) / PPM_DEG


def curve_of(seed: int, place: int) -> Curve:
    """Return a quartic of up to some hundred ppm."""
    size = np.random.default_rng([seed, place, 3]).uniform(-1.0, 1.0, 5) * CURVE_PPM
    return lambda heat: np.asarray(
        np.polynomial.polynomial.polyval((heat - 10.0) / 50.0, size), dtype=np.float64
    )


def lifted(table: TurnTable, generator: np.random.Generator) -> TurnTable:
    """Return headings as attitudes about an axis that is nearly up, about-up."""
    heading = table.attitude_before_deg[:, 0]
    error = wrapped_deg(table.attitude_after_deg[:, 0] - heading - table.commanded_deg)
    lean = np.array([UP_DEG[axis] for axis in table.axis])
    lean = lean + generator.normal(0.0, 0.005, lean.shape) - [0.02, 0.0] * (lean > 80.0)
    before = rotation_to_navigation(np.column_stack((heading, lean)))
    turned = np.zeros((len(table), 3))
    turned[:, 0] = -(table.commanded_deg + error)
    after = rotation_to_navigation(turned) @ before

    def angles(c: Array) -> Array:
        heading = np.arctan2(c[:, 1, 0], c[:, 0, 0])
        pitch, roll = -np.arcsin(c[:, 2, 0]), np.arctan2(c[:, 2, 1], c[:, 2, 2])
        return np.asarray(np.round(np.degrees(np.column_stack((heading, pitch, roll))), 6))

    return replace(table, attitude_before_deg=angles(before), attitude_after_deg=angles(after))


def log(
    seed: int,
    turns: Sequence[int] = (360, -360),
    *,
    proved: bool = False,
    driven: bool = False,
    chamber: bool = False,
    stated: bool = False,
    there_and_back: bool = False,
    wild: float = 0.0,
    missing: float = 0.0,
    full: bool = False,
    resolution_deg: float = 1e-4,
    noise: float = 1.0,
    walk: float = 0.05,
    bias: float = 0.02,
    curves: Mapping[str, Curve] | None = None,
    **keys: Any,
) -> Log:
    """Return a clean log of three axes."""
    curves = curves or {axis: curve_of(seed, place) for place, axis in enumerate(AXES)}
    generator = np.random.default_rng([seed, 11])
    single = len(set(turns)) == 1
    keys |= {"walk": 0.0 if single else walk, "noise_deg": noise * PPM_DEG, "curves": curves}
    keys["bias_deg_per_h"] = bias * generator.standard_normal() if single else bias

    def table(seed: int, **more: Any) -> TurnTable:
        made = record(seed, turns, axes=AXES, **keys, **more).turns
        size = (2, len(made))
        heat = np.array([made.temperature_before_degC, made.temperature_after_degC])
        heat = np.round(heat + 0.02 * generator.standard_normal(size), 3)
        made = replace(made, temperature_before_degC=heat[0], temperature_after_degC=heat[1])
        if seed % 3 == 2 and not chamber:
            made = replace(made, chamber_degC=np.full(len(made), np.nan))
        if full:
            return lifted(made, generator)
        one = resolution_deg
        sides = (made.attitude_before_deg, made.attitude_after_deg)
        read = [np.mod(np.round(side / one) * one, 360.0) for side in sides]
        return replace(made, attitude_before_deg=read[0], attitude_after_deg=read[1])

    quantum = np.sqrt(noise**2 + (resolution_deg / PPM_DEG) ** 2 / 6.0)
    conditions = {
        "attitude_output": "heading-pitch-roll" if full else "heading",
        "turn_sense": "about-up" if full else "heading",
        "heading_resolution": f"{1e-6 if full else resolution_deg:g} deg",
        "turntable_accuracy": f"{noise} arcsec",
        "angle_random_walk": f"{0.002 * noise} deg/sqrt(h)",
        "temperature_range": "[-40 degC, 60 degC]",
        "gyro_bias": f"{bias} deg/h",
    }
    # Not every laboratory writes down everything.
    for key in ("turntable_accuracy", "angle_random_walk") if seed % 2 and not stated else ():
        del conditions[key]
    proof = table(seed + 10**6, first_degC=58.0, last_degC=-37.0) if proved else None
    drive = None
    if driven:
        spans: Any = {"laps": 3, "sample_interval_s": 1.0, "temperature_degC": (45.0, 30.0)}
        drive = simulated_drive(
            curves, bias_deg_per_h=bias, random_walk_deg_per_sqrt_h=0.002, seed=seed, **spans
        )
        conditions |= {"latitude": "40 deg", "initial_heading": "25 deg"}
    turns_made = table(seed)
    if there_and_back:
        turns_made = joined(turns_made, table(seed + 2 * 10**6, first_degC=59.0, last_degC=-38.0))
    knocks = (generator.random(len(turns_made)) < wild) * generator.uniform(
        110, 400, len(turns_made)
    )
    turns_made = rows_of(turns_made, generator.random(len(turns_made)) >= missing)
    whole = Log(turns_made, curves, conditions, float(quantum), proof, drive)
    return turned(whole, knocks[: len(turns_made)]) if wild else whole


def rows_of(table: TurnTable, rows: Any) -> TurnTable:
    """Return some rows of a table."""
    return TurnTable(**{name: column[rows] for name, column in vars(table).items()})


def joined(first: TurnTable, then: TurnTable) -> TurnTable:
    """Return the turns of two ramps, one after the other."""
    later_s = float(np.ptp(first.before_s)) + 600.0
    sets = then.set_number + first.set_number.max() + 1
    moved = replace(
        then, set_number=sets, before_s=then.before_s + later_s, after_s=then.after_s + later_s
    )
    names = vars(first)
    return TurnTable(**{one: np.concatenate((names[one], vars(moved)[one])) for one in names})


def csv(table: TurnTable, full: bool) -> str:
    """Return a table of turns as a file."""
    angles = ("heading", "pitch", "roll") if full else ("heading",)
    columns: dict[str, Any] = {
        "set": table.set_number,
        "t_before_s": table.before_s,
        "t_after_s": table.after_s,
        "axis": table.axis,
        "commanded_deg": table.commanded_deg,
        "gyro_temperature_before_degC": table.temperature_before_degC,
        "gyro_temperature_after_degC": table.temperature_after_degC,
    }
    if bool(np.isfinite(table.chamber_degC).all()):
        columns["chamber_temperature_degC"] = table.chamber_degC
    for place, angle in enumerate(angles):
        columns[f"{angle}_before_deg"] = table.attitude_before_deg[:, place]
        columns[f"{angle}_after_deg"] = table.attitude_after_deg[:, place]
    rows = zip(*columns.values(), strict=True)
    cells = [[one if isinstance(one, str) else f"{one:.10g}" for one in row] for row in rows]
    return "\n".join([",".join(columns), *(",".join(row) for row in cells)]) + "\n"


def write(log: Log, folder: Path) -> None:
    """Put a log into a folder."""
    files = {"turns": csv(log.table, log.full)}
    if log.verification is not None:
        files["verification"] = csv(log.verification, log.full)
    if log.drive is not None:
        files["drive"] = drive_csv(log.drive)
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    lines = ["dataset: 1", "procedure: fog-scale-factor-temperature", "files:"]
    lines += [f"  {name}: {name}.csv" for name in files]
    lines += ["conditions:", *(f"  {key}: {said}" for key, said in log.conditions.items())]
    (folder / "dataset.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def free(log: Log) -> Array:
    """Return the columns of what a clean log leaves free: curves, and the bias of each set."""
    table = log.table
    columns = []
    scaled = (table.temperature_degC - 10.0) / 50.0
    polynomials = np.polynomial.chebyshev.chebvander(scaled, FREE_ORDER)
    single = len(set(table.commanded_deg)) == 1
    for axis in AXES:
        own = table.axis == axis
        columns += list((polynomials * (own * table.commanded_deg / 360.0)[:, None]).T)
        if not single:
            columns += [own * (table.set_number == n) * 1.0 for n in np.unique(table.set_number)]
    whole = np.array(columns).T
    if log.verification is None:
        return whole
    scaled = (log.verification.temperature_degC - 10.0) / 50.0
    polynomials = np.polynomial.chebyshev.chebvander(scaled, FREE_ORDER)
    below = np.zeros((len(log.verification), whole.shape[1]))
    for n, axis in enumerate(AXES):
        own = log.verification.axis == axis
        turns = (own * log.verification.commanded_deg / 360.0)[:, None]
        start = n * whole.shape[1] // 3
        below[:, start : start + FREE_ORDER + 1] = polynomials * turns
    return np.vstack((whole, below))


def made(log: Log) -> Made:
    """Return a log as the benchmark needs it."""
    data = log.error_ppm(log.table)
    if log.verification is not None:
        data = np.concatenate((data, log.error_ppm(log.verification)))
    truth: dict[tuple[str, str | None, str | None], float]
    at = np.array([20.0])
    truth = {("scale_factor_error", axis, None): float(log.curves[axis](at)[0]) for axis in AXES}
    if log.drive is not None:
        truth["heading_error_compensated", None, None] = 0.0

    def curves_u(results: Sequence[Mapping[str, Any]]) -> float:
        worst = 0.0
        for one in results:
            band = one.get("band")
            if one["name"] == "scale_factor_error" and one["value"] is not None and band:
                off = band["value"] - log.curves[one["axis"]](np.array(band["temperature_degC"]))
                u = np.maximum(band["standard_uncertainty"], 1e-12)
                worst = max(worst, float(np.max(np.abs(off) / u)))
        return worst

    noise = np.full(len(data), log.noise_ppm)
    return Made(truth, partial(write, log), data, free(log), noise, curves_u)


def part_of(log: Log) -> Values:
    """Return how far into the log each row is, 0 to 1."""
    return np.asarray(log.table.set_number / log.table.set_number.max())


def turned(log: Log, error_ppm: Any) -> Log:
    """Return a log with something added to the errors of its turns, (rows,); headings alone."""
    after = log.table.attitude_after_deg.copy()
    after[:, 0] = np.mod(after[:, 0] + error_ppm * PPM_DEG, 360.0)
    return replace(log, table=replace(log.table, attitude_after_deg=after))


def columns(
    names: str,
    change: Shape,
    first: float = 0.0,
    last: float = 2.0,
    axes: Sequence[str] = AXES,
    table: str = "table",
) -> Change:
    """Return the change of columns whose names begin so, in a part of the log, of some axes."""

    def changed(log: Log, _: np.random.Generator) -> Log:
        old: TurnTable = getattr(log, table)
        part = old.set_number / old.set_number.max()
        inside = (part >= first) & (part < last) & np.isin(old.axis, list(axes))
        new = {}
        for key, value in vars(old).items():
            if key.startswith(tuple(names.split())):
                new[key] = value.copy()
                new[key][inside] = change(value[inside])
        return replace(log, **{table: replace(old, **new)})  # type: ignore[arg-type]

    return changed


def added(error: Callable[[Log, np.random.Generator], Any]) -> Change:
    """Return the change that adds an error in ppm of a turn to each turn, whatever its sense."""
    return lambda log, generator: turned(log, error(log, generator))


def sensed(shape: Shape) -> Change:
    """Return the change that adds an error of the scale factor, over the part of the log."""
    return added(lambda log, _: shape(part_of(log)) * log.table.commanded_deg / 360.0)


def noisy(ppm: Shape) -> Change:
    """Return the change that adds noise, of a size over the part of the log."""
    return added(lambda log, g: ppm(part_of(log)) * g.standard_normal(len(log.table)))


def curved(shape: Shape) -> Change:
    """Return the change to a gyro whose curve has something on it."""

    def with_it(curve: Curve) -> Curve:
        return lambda heat: curve(heat) + shape(np.asarray(heat))

    def changed(log: Log, _: np.random.Generator) -> Log:
        error = shape(log.table.temperature_degC) * log.table.commanded_deg / 360.0
        return replace(turned(log, error), curves={a: with_it(log.curves[a]) for a in AXES})

    return changed


def bump(at: float, width: float, ppm: float) -> Change:
    """Return the change to a curve with a narrow feature."""
    return curved(lambda heat: ppm * np.exp(-0.5 * ((heat - at) / width) ** 2))


def kink(at: float, slope: float) -> Change:
    """Return the change to a curve with a kink."""
    return curved(lambda heat: slope * np.maximum(heat - at, 0.0))


def minutes(angle: Values) -> Values:
    """Return degrees as degrees, minutes and seconds, DD.MMSS."""
    seconds = np.round(angle * 3600.0 * 100.0) / 100.0
    return np.asarray(seconds // 3600 + seconds % 3600 // 60 * 0.01 + seconds % 60 * 1e-4)


def swapped(axis: Values) -> Values:
    """Return the labels x and y exchanged."""
    return np.where(axis == "x", "y", np.where(axis == "y", "x", axis))


Maker = Callable[[int], Log]

STATEMENT = frozenset({"contradicts-statement"})
FROZEN = frozenset({"frozen"})
COARSE = frozenset({"coarse-output"})
NOTHING = frozenset({"not-identifiable"})
SHAPE = frozenset({"misfit", "model-too-stiff"})
LEFT_OUT = SHAPE | {"outliers-rejected"}

PAIRS: Maker = log
SINGLE: Maker = partial(log, turns=(360,))
FULL: Maker = partial(log, full=True)
PROVED: Maker = partial(log, proved=True)
DRIVEN: Maker = partial(log, driven=True)
STATED: Maker = partial(log, stated=True)


def faults(
    flags: frozenset[str],
    *named: tuple[str, Change],
    kind: Maker = PAIRS,
    detectable: bool | None = None,
) -> list[Fault]:
    """Return faults that one of the flags names.

    `detectable` where more than the errors of the turns shows them.
    """

    def one(name: str, change: Change) -> Fault:
        def planted(seed: int) -> Made:
            return made(change(kind(seed), np.random.default_rng([seed, 23])))

        return Fault(name, flags, lambda seed: made(kind(seed)), planted, detectable)

    return [one(name, change) for name, change in named]
