"""Faults of positions of an accelerometer that gravity turns in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from tumble_records import ARCSEC, FOUR, QUARTZ, Stage, changed
from tumble_records import made as readings

from campaigns.planted.judging import (
    REFUSED,
    Array,
    Held,
    Row,
    Sample,
    but,
    by_rows,
    example,
    row,
)
from procedures.accelerometer_tumble.analysis import TumbleAnalysis, analyse
from procedures.accelerometer_tumble.dataset import TumbleDataset

USUAL_FLAGS = frozenset({"not-identifiable"})
Change = Callable[[TumbleDataset, int], TumbleDataset]


def worst(analysis: TumbleAnalysis) -> float:
    """Return the largest error over u of the kept combinations; of a step K0 is left out."""
    off = [0.0]
    stepped = any(flag.code == "output-step" for flag in analysis.flags)
    for name, terms in analysis.terms.items():
        one = analysis.estimate(name)
        if one.value is None or one.standard_uncertainty is None or (stepped and name == "K0"):
            continue
        priors = np.hypot(one.sensitivities["encoder"], one.sensitivities["mounting"])
        truth = sum(share * QUARTZ.get(other, 0.0) for other, share in terms.items())
        off.append(abs(one.value - truth) / np.hypot(one.standard_uncertainty, priors))
    return float(max(off))


def made(stage: Stage, seed: int) -> Held:
    """Return the readings of a test."""
    return Held(readings(np.random.default_rng(seed), stage), analyse, worst)


BASE = partial(made, Stage())
HEAD = tuple((plane, turned, 90.0) for plane, turned, _ in FOUR)
CLEAN: Sequence[Callable[[int], Sample]] = (
    BASE,
    partial(made, Stage(mountings=FOUR[:3], positions=12)),
    partial(made, Stage(mountings=(*FOUR, *HEAD))),
)


def column(name: str, change: Callable[[Array, TumbleDataset], Array]) -> Change:
    """Return the change of a column."""
    return lambda one, _: changed(one, **{name: change(getattr(one, name).copy(), one)})


def with_rows(rows: slice | int, values: Callable[[Array], object]) -> Callable[..., Array]:
    """Return the change of some rows of a column by what the whole column holds."""

    def change(column: Array, _: TumbleDataset) -> Array:
        column[rows] = values(column)
        return column

    return change


def flag_row(name: str, change: Change, codes: str, **more: Any) -> Row:
    """Return the row of a fault of the usual test."""
    return row(name, but(BASE, change), codes, seeds=(3,), clean=BASE, **more)


def reversed_throughout(one: TumbleDataset, _: int) -> TumbleDataset:
    """Return readings whose angles count the other way."""
    return changed(one, encoder_rad=-one.encoder_rad, commanded_rad=-one.commanded_rad)


Cells = list[str]
EXAMPLE = example("accelerometer-tumble")


def refused(said: str, change: Callable[[Cells], Cells]) -> Row:
    """Return the row of the example with each row of its table changed."""
    sample = EXAMPLE.but("positions.csv", by_rows(change))
    return row(f"refused: {said}", lambda _: sample, REFUSED, says=said)


def rad(text: str) -> str:
    return f"{float(text) / 57.29578:.6f}"


# fmt: off
ROWS: Sequence[Row] = (
    row("drift", partial(made, Stage(drift_V_per_h=20e-6)), "drift-removed", below_u=3.5),
    row("warming", partial(made, Stage(warms_K=1.0)), "drift-removed", seeds=(8,), below_u=3.5),
    flag_row("four readings", lambda one, _: one.only(np.arange(len(one.time_s)) % 48 == 0),
        "not-identifiable", null="*"),
    flag_row("an angle half a turn off",
        column("encoder_rad", with_rows(20, lambda x: x[20] + np.pi)),
        "outliers-rejected contradicts-statement", below_u=3.5),
    flag_row("an output of the other sign", column("output_V", with_rows(20, lambda x: -x[20])),
        "outliers-rejected", without="contradicts-statement", below_u=3.5),
    flag_row("a wild angle", column("encoder_rad", with_rows(100, lambda x: x[100] + 30 * ARCSEC)),
        "outliers-rejected", below_u=3.5),
    flag_row("meter frozen for 15 rows",
        column("output_V", with_rows(slice(60, 75), lambda x: x[60])), "frozen",
        details={"count": 15}, below_u=3.5),
    flag_row("a mounting's outputs copied",
        column("output_V", with_rows(slice(48, 96), lambda x: x[:48])), "frozen",
        details={"count": 48}, below_u=3.5),
    flag_row("thermometer frozen",
        column("temperature_degC", lambda x, one: np.where(one.time_s > 1e3, 23.0, x)), "frozen",
        below_u=3.5),
    flag_row("output step of 50 uV",
        column("output_V", with_rows(slice(60, None), lambda x: x[60:] + 50e-6)), "output-step",
        details={"time_s": (1500.0, 0.0), "step_V": (50e-6, 5e-6)}, below_u=4.0),
    flag_row("a mounting called another plane",
        column("plane", lambda x, one: np.where(one.mounting == 1, "ip", x)),
        "contradicts-statement"),
    flag_row("a mounting called reversed",
        column("reverse", lambda x, one: np.where(one.mounting == 1, 1.0, x)), "output-step",
        says="angle of the encoder"),
    row("seven positions", partial(made, Stage(positions=7)), "outside-published-range"),
    row("a noisy accelerometer", partial(made, Stage(noise_V=1e-3)), "not-significant",
        below_u=4.5),
    flag_row("angles of the other sense", reversed_throughout, "contradicts-statement",
        details={"statement": "theta_deg"}),
    flag_row("the encoder's fifth harmonic",
        column("encoder_rad", lambda x, _: x + 5 * ARCSEC * np.cos(5 * x)), "misfit"),
    flag_row("the scale factor warms up",
        column("output_V", lambda x, one: x + 1e-4 * np.exp(-one.time_s / 600.0)
            * np.sin(one.encoder_rad)), "model-too-stiff drift-removed"),
    flag_row("another scale factor below zero",
        column("output_V", lambda x, one: x + 30e-6 * np.abs(np.sin(one.encoder_rad))), "misfit",
        below_u=4.0),
    flag_row("output in mV", column("output_V", lambda x, _: 1e3 * x), "contradicts-statement",
        details={"statement": "output_V"}),
    flag_row("the first mounting but one reads 20 uV more",
        column("output_V", lambda x, one: x + 20e-6 * (one.mounting == 1)), "output-step",
        below_u=4.0),
    refused("in deg", lambda r: [*r[:4], *map(rad, r[4:6]), *r[6:]]),
    refused("of one sense", lambda r: [*r[:5], rad(r[5]), *r[6:]]),
    refused("of one sense", lambda r: [*r[:5], f"{-float(r[5]):.6f}", *r[6:]]),
    refused("in V", lambda r: [*r[:7], f"{1e3 * float(r[7]):.6f}"]),
    refused("there is no plane 'op'", lambda r: [r[0], "op", *r[2:]]),
    refused("turned about IA", lambda r: [*r[:2], "180" if r[2] == "1" else "0", *r[3:]]),
    refused("times must rise", lambda r: ["0", *r[1:]]),
)
# fmt: on
