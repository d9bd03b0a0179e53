"""Datasets of one table, and what may be wrong with a column of any of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular, toeplitz

from campaigns.planted.judging import Array, Fault, Key, Made
from procedures.estimation.rate_spectrum import covariances

Change = Callable[["Log", np.random.Generator], "Log"]
OfColumn = Callable[[Array, np.random.Generator], Array]

FREE_LEVEL = 1e4
"""How much larger than the noise's variance that of a level is which may be anything."""
SEED_OF_FAULT = 7000
"""What a fault draws is not what its dataset drew."""


@dataclass(frozen=True)
class Log:
    """A dataset of one table: columns (n,) in the file's order, conditions, what is true of it.

    `digits` are the decimals of a column, `turns` the columns that the file holds modulo 360.
    """

    procedure: str
    file: str
    columns: Mapping[str, NDArray[Any]]
    conditions: Mapping[str, Any]
    truth: Mapping[Key, float]
    digits: Mapping[str, int] = field(default_factory=dict)
    turns: frozenset[str] = frozenset()
    further_error_u: Callable[[Sequence[Mapping[str, Any]]], float] | None = None

    def write(self, folder: Path) -> None:
        """Write the dataset's folder."""
        texts = [self._texts(name) for name in self.columns]
        rows = [",".join(self.columns), *map(",".join, zip(*texts, strict=True))]
        (folder / f"{self.file}.csv").write_text("\n".join([*rows, ""]), encoding="utf-8")
        header = {
            "dataset": 1,
            "procedure": self.procedure,
            "files": {self.file: f"{self.file}.csv"},
            "conditions": dict(self.conditions),
        }
        (folder / "dataset.yaml").write_text(yaml.safe_dump(header), encoding="utf-8")

    def _texts(self, name: str) -> list[str]:
        column = self.columns[name]
        if column.dtype.kind in "US":
            return [str(one) for one in column]
        if name in self.turns:
            column = np.mod(column, 360.0)
        digits = self.digits.get(name)
        return [f"{one:.10g}" if digits is None else f"{one:.{digits}f}" for one in column.tolist()]

    def but(self, **columns: NDArray[Any]) -> Log:
        """Return it with some columns changed."""
        return replace(self, columns={**self.columns, **columns})

    def rows(self, kept: NDArray[Any]) -> Log:
        """Return it with some rows only, or in another order."""
        return replace(self, columns={name: one[kept] for name, one in self.columns.items()})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


@dataclass(frozen=True)
class Kind:
    """Datasets of one kind: what makes one of a seed, and what a test sees of one.

    `readings` returns the readings (m,) of a log in units of their noise, white; `free` what it is
    that a clean one leaves free, the readings' derivatives (m, p) in the same units.
    """

    make: Callable[[int], Log]
    readings: Callable[[Log], Array]
    free: Callable[[int], Array]

    def made(self, log: Log, seed: int | None = None) -> Made:
        """Return a log for the judge, with what a clean one of a seed leaves free."""
        data = self.readings(log)
        model = np.zeros((0, 0)) if seed is None else self.free(seed)
        return Made(log.truth, log.write, data, model, np.ones(len(data)), log.further_error_u)

    def clean(self, seed: int) -> Made:
        """Return a dataset without a fault; what it leaves free is not worked out."""
        return self.made(self.make(seed))


def fault(
    name: str, kind: Kind, change: Change, usual: frozenset[str], shows: bool | None = None
) -> Fault:
    """Return the fault that a change plants; any flag that a clean dataset lacks names it.

    `shows` says whether the data show what leaves no reading to compare: rows that are lost,
    statements that are wrong.
    """

    def planted(seed: int) -> Made:
        log = change(kind.make(seed), np.random.default_rng((seed, SEED_OF_FAULT)))
        if shows is not None:
            return Made(log.truth, log.write, *(np.zeros(0),) * 3, log.further_error_u)
        return kind.made(log)

    def clean(seed: int) -> Made:
        return kind.made(kind.make(seed), seed)

    return Fault(name, frozenset(), clean, planted, shows, usual=usual)


def faults(usual: frozenset[str], *rows: tuple[Any, ...]) -> tuple[Fault, ...]:
    """Return a table of faults, each row being name, kind, change and perhaps `shows`."""
    return tuple(fault(name, kind, change, usual, *shows) for name, kind, change, *shows in rows)


def column(name: str, change: OfColumn) -> Change:
    """Return the change of a column."""
    return lambda log, rng: log.but(**{name: change(log.columns[name].copy(), rng)})


def by_log(name: str, change: Callable[[Array, Log], Array]) -> Change:
    """Return the change of a column by what the other columns hold."""
    return lambda log, _: log.but(**{name: change(log.columns[name].copy(), log)})


def stated(**conditions: object) -> Change:
    """Return the change of conditions; the table stays."""
    return lambda log, _: replace(log, conditions={**log.conditions, **conditions})


def exchanged(first: str, second: str) -> Change:
    """Return the change of two columns for one another."""
    return lambda log, _: log.but(**{first: log.columns[second], second: log.columns[first]})


def lost(share: float, *, in_one: bool) -> Change:
    """Return the loss of a share of the rows, here and there or in one block."""

    def change(log: Log, rng: np.random.Generator) -> Log:
        kept = rng.random(len(log)) >= share
        if in_one:
            kept[:] = True
            begin = int(0.4 * len(log))
            kept[begin : begin + int(share * len(log))] = False
        kept[[0, -1]] = True
        return log.rows(np.flatnonzero(kept))

    return change


def together(*changes: Change) -> Change:
    """Return the change that makes others one after another."""

    def change(log: Log, rng: np.random.Generator) -> Log:
        for one in changes:
            log = one(log, rng)
        return log

    return change


def wild(size: float, count: int = 1) -> OfColumn:
    """Return single values that are off by a size."""

    def change(x: Array, rng: np.random.Generator) -> Array:
        rows = rng.choice(np.arange(len(x) // 10, len(x)), count, replace=False)
        x[rows] += size * rng.choice((-1.0, 1.0), count)
        return x

    return change


def set_at(value: float, share: float = 0.0) -> OfColumn:
    """Return one value, or a share of them in a block, that stands at a value."""

    def change(x: Array, rng: np.random.Generator) -> Array:
        begin = int(0.55 * len(x))
        x[begin : begin + max(1, int(share * len(x)))] = value
        return x

    return change


def block(share: float, change: Callable[[Array, Array], Array]) -> OfColumn:
    """Return the change of a block, given it and the whole column."""

    def changed(x: Array, _: np.random.Generator) -> Array:
        begin = int(0.55 * len(x))
        part = slice(begin, begin + max(2, int(share * len(x))))
        x[part] = change(x[part], x)
        return x

    return changed


def frozen(share: float) -> OfColumn:
    """Return values that stand for a share of the rows."""
    return block(share, lambda part, _: np.full_like(part, part[0]))


def copied(share: float) -> OfColumn:
    """Return values of which a block comes twice."""
    return block(share, lambda part, x: x[len(x) // 10 : len(x) // 10 + len(part)])


def offset(share: float, size: float) -> OfColumn:
    """Return values of which a block is off by a size."""
    return block(share, lambda part, _: part + size)


def noisy(share: float, size: float) -> OfColumn:
    """Return values of which a block has noise of a size."""
    draw = np.random.default_rng(SEED_OF_FAULT)
    return block(share, lambda part, _: part + size * draw.standard_normal(len(part)))


def spikes(share: float, size: float) -> OfColumn:
    """Return values of which a share, anywhere, is too high."""
    return lambda x, rng: np.asarray(x + size * (rng.random(len(x)) < share))


def limited(share: float) -> OfColumn:
    """Return values of which the highest and lowest share stand at limits."""
    return lambda x, _: np.clip(x, *np.quantile(x, (share, 1.0 - share)))


def in_steps(step: float) -> OfColumn:
    """Return values in steps."""
    return lambda x, _: np.asarray(step * np.round(x / step))


def stepped(size: float, at: float = 0.5) -> OfColumn:
    """Return values with a step, their mean what it was."""

    def change(x: Array, _: np.random.Generator) -> Array:
        after = (np.arange(len(x)) >= at * len(x)).astype(float)
        return np.asarray(x + size * (after - after.mean()))

    return change


def ramped(size: float, power: int = 1) -> OfColumn:
    """Return values that drift by a size from end to end, their mean what it was."""

    def change(x: Array, _: np.random.Generator) -> Array:
        part = np.linspace(0.0, 1.0, len(x)) ** power
        return np.asarray(x + size * (part - part.mean()))

    return change


def settling(size: float, share: float) -> OfColumn:
    """Return values with a decay over a share of the rows at their beginning."""
    return lambda x, _: np.asarray(x + size * np.exp(-np.arange(len(x)) / (share * len(x))))


def waved(size: float, rows: float) -> OfColumn:
    """Return values with a line of a period in rows."""
    return lambda x, _: np.asarray(x + size * np.sin(2.0 * np.pi * np.arange(len(x)) / rows))


def times(factor: float, more: float = 0.0) -> OfColumn:
    """Return values in another unit."""
    return lambda x, _: np.asarray(factor * x + more)


def shifted(rows: int) -> OfColumn:
    """Return values that come rows too late; early ones are negative."""

    def change(x: Array, _: np.random.Generator) -> Array:
        moved = np.roll(x, rows)
        moved[slice(None, rows) if rows > 0 else slice(rows, None)] = x[0 if rows > 0 else -1]
        return moved

    return change


def averaged(rows: int) -> OfColumn:
    """Return running means."""
    return lambda x, _: np.convolve(np.pad(x, rows, "edge"), np.ones(rows) / rows, "same")[
        rows:-rows
    ]


@cache
def _factor(theta: tuple[float, ...], count: int, interval_s: float) -> Array:
    """Return the lower triangle whose product is the covariance of a record's noise."""
    own = np.array(theta) @ covariances(count, interval_s)
    whole = toeplitz(own)
    level = FREE_LEVEL * float(np.abs(whole).max())
    return np.asarray(cholesky(whole + level, lower=True))


def whitened(rates: Array, theta: Array, interval_s: float) -> Array:
    """Return rates (n,) or (n, p) of one record in units of their noise, white.

    The noise is Q², N², B², K² in deg/h with N in deg/h sqrt(s) and K in deg/h/sqrt(s); a level may
    be anything.
    """
    lower = _factor(tuple(map(float, theta)), len(rates), interval_s)
    return np.asarray(solve_triangular(lower, rates, lower=True))


def derivatives(make: Callable[[Mapping[str, float]], Array], steps: Mapping[str, float]) -> Array:
    """Return the derivatives (m, p) of readings by parameters, each moved by its step."""
    base = make({})
    return np.column_stack([(make({name: step}) - base) / step for name, step in steps.items()])
