"""Faults of records of a gyro on a rate table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from rate_records import CASES, CONDITIONS, Gyro, lines
from rate_records import made as records

from campaigns.planted.judging import (
    REFUSED,
    Held,
    Row,
    Sample,
    Written,
    but,
    by_rows,
    row,
)
from procedures.gyro_rate_table.analysis import RateTableAnalysis, analyse
from procedures.gyro_rate_table.dataset import RateTableDataset, Record

USUAL_FLAGS = frozenset({"not-significant", "not-identifiable", "outside-published-range"})


def made(gyro: Gyro, seed: int) -> Held:
    """Return records of a gyro."""
    case = records(np.random.default_rng(seed), gyro)

    def off_u(analysis: RateTableAnalysis) -> float:
        one = analysis.estimate("scale_factor", "IA")
        if one.value is None or not one.standard_uncertainty:
            return 0.0
        return abs(one.value - case.truth["scale_factor"]) / one.standard_uncertainty

    return Held(case.dataset, analyse, off_u)


WHITE, SETTLING = partial(made, CASES["white"]), partial(made, CASES["settling"])
CLEAN: Sequence[Callable[[int], Sample]] = (WHITE, partial(made, CASES["nonlinear"]))


def late(dataset: RateTableDataset, _: int) -> RateTableDataset:
    """Return records whose outputs come one sample too late."""

    def moved(one: Record) -> Record:
        rates = np.append(one.rate_deg_per_s[:1], one.rate_deg_per_s[:-1])
        return replace(one, rate_deg_per_s=rates)

    return replace(dataset, records=tuple(map(moved, dataset.records)))


def disturbed(dataset: RateTableDataset, _: int) -> RateTableDataset:
    """Return records of which one, at -20 deg/s, is off by 3.6 deg/h."""
    fresh = [
        replace(one, rate_deg_per_s=one.rate_deg_per_s + 1e-3 * (one.commanded_deg_per_s == -20.0))
        for one in dataset.records
    ]
    return replace(dataset, records=tuple(fresh))


Cells = list[str]
SHORT = Gyro(rates=(1.0, 10.0, 50.0), repeats=1)
FILE = Written(
    {
        "dataset.yaml": CONDITIONS,
        "samples.csv": "\n".join(lines(records(np.random.default_rng(7), SHORT))) + "\n",
    },
    {("scale_factor", "IA"): (1.000085, 4e-6), ("bias", "IA"): (0.4, 0.1)},
)
REVERSED = replace(
    FILE, truth={("scale_factor", "IA"): (-1.000085, 1e-6), ("bias", "IA"): (-0.4, 0.1)}
)


def table(name: str, change: Callable[[Cells], Cells | None], codes: str, **more: Any) -> Row:
    """Return the row of a file of which each line is changed or left out."""
    base = more.pop("base", FILE)
    sample = base.but("samples.csv", by_rows(change))
    return row(name, lambda _: sample, codes, below_u=1.0, **more)


def refused(said: str, change: Callable[[Cells], Cells]) -> Row:
    """Return the row of a file whose encoder does not fit the commands."""
    return table(f"refused: {said}", change, REFUSED, says=("encoder_deg", said))


def is_at(cells: Cells, rate: str, every: int) -> bool:
    return cells[1] == rate and int(cells[2]) % every == 0


def clip(cells: Cells) -> Cells:
    return [*cells[:3], f"{np.clip(float(cells[3]), -49.9, 49.9):.7f}", cells[4]]


def angle(change: Callable[[float], float]) -> Callable[[Cells], Cells]:
    """Return the change of a line's angle."""
    return lambda r: [*r[:4], f"{change(float(r[4])) % 360:.7f}"]


# fmt: off
ROWS: Sequence[Row] = (
    row("warm-up of 2 deg/h", partial(made, Gyro(warm_up=2.0)), "drift-removed", seeds=(2,),
        below_u=4.0),
    row("outputs a sample late", but(SETTLING, late), "contradicts-statement unsteady-rate",
        seeds=(4,), details={"samples": (1.0, 0.3)}, below_u=4.0),
    row("a table that settles", SETTLING, "unsteady-rate", seeds=(4,),
        without="contradicts-statement", below_u=4.0),
    row("a record that was disturbed", but(WHITE, disturbed), "bias-wanders",
        says="at 20 deg/s in switch-on 1", seeds=(6,), clean=WHITE),
    row("no records", but(WHITE, lambda one, _: replace(one, records=())), "not-identifiable",
        null="*", seeds=(8,)),
    row("a perfect gyro", WHITE, "not-significant", says="nonlinearity", seeds=(5,), below_u=4.0),
    table("output frozen for a while", lambda r: [*r[:3], "10.0027000", r[4]] if r[1] == "10"
        and int(r[2]) % 40 < 12 else r, "frozen"),
    row("three rates", lambda _: FILE, "outside-published-range not-identifiable not-significant",
        others="", below_u=1.0, null="scale_factor_repeatability"),
    table("wild outputs", lambda r: [*r[:3], "7.5", r[4]] if is_at(r, "10", 9) else r,
        "outliers-rejected"),
    table("wild angles", lambda r: [*r[:4], "123.4"] if is_at(r, "10", 50) else r,
        "outliers-rejected"),
    table("rows lost", lambda r: None if is_at(r, "-10", 7) else r, "gap"),
    table("a record lost", lambda r: None if r[1] == "-10" else r, "one-sense-only"),
    table("output at its limit", clip, "overload"),
    table("less than a turn", lambda r: None if r[1] == "1" and int(r[2]) > 320 else r,
        "part-turns"),
    table("gyro upside down", lambda r: [*r[:3], f"{-float(r[3]):.7f}", r[4]],
        "contradicts-statement", base=REVERSED),
    table("table 2 % off its rates", lambda r: [r[0], f"{float(r[1]) * 1.02:g}", *r[2:]],
        "rate-differs-from-commanded"),
    table("one sense alone", lambda r: None if r[1].startswith("-") else r, "not-identifiable",
        says="scale_factor", null="scale_factor asymmetry", known="bias"),
    table("a table that stands", lambda r: r if r[1] == "0" else None, "not-identifiable",
        null="scale_factor", known="bias"),
    table("a dead output", lambda r: [*r[:3], "0", r[4]], "contradicts-statement not-identifiable",
        null="*"),
    refused("where -1 deg/s were commanded", lambda r: [r[0], str(-float(r[1])), *r[2:]]),
    refused("turns at", lambda r: [*r[:3], r[4], r[3]]),
    refused("in deg and deg/s", angle(np.deg2rad)),
    refused("positive counter-clockwise", angle(lambda one: -one)),
    refused("in deg and deg/s", angle(lambda one: 60.0 * one)),
    refused("where 10 deg/s", lambda r: [r[0], "10" if r[1] == "50" else r[1], *r[2:]]),
)
# fmt: on
