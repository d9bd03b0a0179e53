"""Faults of records of a gyro at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from static_records import DEVICES, records

from campaigns.planted.judging import REFUSED, Held, Row, Sample, Written, but, row
from procedures.gyro_static_noise.analysis import StaticAnalysis, analyse
from procedures.gyro_static_noise.dataset import Array, StaticDataset

SAMPLES = 3600
USUAL_FLAGS = frozenset({"not-significant", "short-record", "not-identifiable"})
"""Of one switch-on the repeatability is not identifiable."""


def made(device: str, counts: Sequence[int], seed: int, **changes: float) -> Held:
    """Return switch-ons of a device."""
    gyro = {**DEVICES[device], **changes}

    def off_u(analysis: StaticAnalysis) -> float:
        truth = {
            "quantisation_noise": float(np.hypot(gyro["Q"], gyro["pulse"] / np.sqrt(12.0))),
            "angle_random_walk": gyro["N"],
            "bias_instability": gyro["B"],
            "rate_random_walk": gyro["K"],
        }
        return max(
            (
                abs(one.value - truth[one.name]) / one.standard_uncertainty
                for one in analysis.estimates
                if one.name in truth and one.value is not None and one.standard_uncertainty
            ),
            default=0.0,
        )

    return Held(records(np.random.default_rng(seed), gyro, counts), analyse, off_u)


FOG = partial(made, "FOG", (SAMPLES, 600, 600))
ALONE = partial(made, "FOG", (SAMPLES,))
RLG = partial(made, "RLG", (SAMPLES,))
COARSE = partial(made, "RLG-coarse", (SAMPLES,))
QUIET = partial(made, "FOG", (SAMPLES,), B=0.0, K=0.0)
CLEAN: Sequence[Callable[[int], Sample]] = (FOG, RLG)


def rates(change: Callable[[Array, Array], Any]) -> Callable[[StaticDataset, int], StaticDataset]:
    """Return the change of the first record's rates (n, 1), given its times (n, 1)."""

    def changed(dataset: StaticDataset, _: int) -> StaticDataset:
        first, *rest = dataset.records
        fresh = change(first.rate_deg_per_h.copy(), first.time_s[:, None])
        return replace(dataset, records=(replace(first, rate_deg_per_h=fresh), *rest))

    return changed


def wild_and_lost(dataset: StaticDataset, seed: int) -> StaticDataset:
    """Return a dataset with wild samples, single ones lost, and forty in a row."""
    rng = np.random.default_rng(8)
    first, *rest = dataset.records
    rate = first.rate_deg_per_h.copy()
    rate[rng.integers(0, SAMPLES, 20)] += 40.0
    kept = np.ones(SAMPLES, dtype=bool)
    kept[rng.integers(0, SAMPLES, 30)] = False
    kept[1000:1040] = False
    spoilt = replace(first, time_s=first.time_s[kept], rate_deg_per_h=rate[kept])
    return replace(dataset, records=(spoilt, *rest))


def stuck_and_limited(rate: Array, _: Array) -> Array:
    """Return rates that stand still for a while, and are at their limit for another."""
    rate[500:550] = rate[500]
    rate[2000:2040] = 400.0
    return rate


def coarse(rate: Array, _: Array) -> Array:
    """Return rates in steps of 3 deg/h, of which chance moves half by one."""
    moved = np.random.default_rng(0).random(rate.shape) < 0.5
    return np.asarray(3.0 * (np.round(rate / 3.0) + moved))


def filtered(dataset: StaticDataset, seed: int) -> StaticDataset:
    """Return a dataset behind a filter that is stated."""
    mean = rates(lambda x, _: np.convolve(x[:, 0], np.full(3, 1 / 3), "same")[:, None])
    return replace(mean(dataset, seed), output_bandwidth_Hz=0.15)


UP = "  input_axis:\n    IA: {azimuth: 0 deg, elevation: 90 deg}\n"
RATE, COUNTS = "switch_on,t_s,rate_deg_per_h", "switch_on,t_s,counts"


def written(conditions: str, header: str, *lines: str) -> Written:
    """Return a dataset folder with the usual conditions and these beside them."""
    usual = (
        "dataset: 1\nprocedure: gyro-static-noise\nfiles: {samples: samples.csv}\nconditions:\n"
        "  sample_interval: 1 s\n  timestamp: interval-end\n  latitude: 39.9 deg\n"
    )
    table = "\n".join([header, *lines, ""])
    return Written({"dataset.yaml": usual + conditions, "samples.csv": table})


def refused(said: str, conditions: str, header: str, *lines: str) -> Row:
    """Return the row of a dataset that is refused."""
    sample = written(conditions, header, *lines)
    return row(f"refused: {said}", lambda _: sample, REFUSED, says=said)


COUNTED = "  gyro_output: counts\n"
OF_RATE = "  gyro_output: rate\n"
FEW = written(OF_RATE + UP, RATE, *(f"1,{n},{9.6 + 0.1 * (n % 3)}" for n in range(1, 6)))

# fmt: off
ROWS: Sequence[Row] = (
    row("a ramp of 1 deg/h an hour", but(FOG, rates(lambda rate, t: rate + t / 3600.0)),
        "drift-removed", details={"ramp_deg_per_h2": (1.0, 0.1)}, seeds=(3,), clean=FOG,
        below_u=4.0, others=USUAL_FLAGS),
    row("a line of 0.1 deg/h and 300 s",
        but(FOG, rates(lambda rate, t: rate + 0.1 * np.sin(2.0 * np.pi * t / 300.0))), "periodic",
        details={"period_s": (300.0, 3.0), "amplitude_deg_per_h": (0.1, 0.02)}, seeds=(3,),
        clean=FOG, below_u=4.0, others=USUAL_FLAGS),
    *(row(f"wild and lost samples, {name}", but(kind, wild_and_lost), "outliers-rejected gap",
        seeds=seeds, clean=kind, below_u=4.0, others=USUAL_FLAGS)
        for name, kind, seeds in (("FOG", FOG, (3,)), ("RLG", RLG, (5,)))),
    row("stuck for a while, at a limit for another", but(FOG, rates(stuck_and_limited)),
        "frozen saturated", seeds=(3,), clean=FOG, below_u=4.0),
    row("output that never changes", but(ALONE, rates(lambda rate, _: np.full_like(rate, 9.6))),
        "not-identifiable", null="*", seeds=(3,)),
    row("counts too coarse for their noise", COARSE, "coarse-output", seeds=(2,), below_u=4.0),
    row("rates in steps of 3 deg/h", but(ALONE, rates(coarse)), "coarse-output", seeds=(3,)),
    row("behind a filter", but(ALONE, filtered), "not-identifiable", null="quantisation_noise",
        seeds=(3,), below_u=4.0),
    row("white noise alone", QUIET, "short-record not-significant", seeds=(1,),
        details={"tau_s": (400.0, 0.1)}),
    row("five samples", lambda _: FEW, "not-identifiable", null="*", others=""),
    refused("rate_deg_per_h", OF_RATE + UP, COUNTS, "1,1,2"),
    refused("pulse_weight", COUNTED + UP, COUNTS, "1,1,2"),
    refused("samples.csv:4:1: t_s: 2 is not after 3 of the row above; times must rise",
        OF_RATE + UP, RATE, *("1,1,2", "1,3,2", "1,2,2")),
    refused("samples.csv:4:1: switch_on: switch-on 1 returns; keep its rows together",
        OF_RATE + UP, RATE, *("1,1,2", "2,1,2", "1,2,2")),
    refused("rows are 0.1 s apart, the sample interval is 1 s", OF_RATE + UP, RATE,
        *("1,1,2", "1,1.1,2", "1,1.2,3")),
    refused("an output in counts has the input axis IA",
        COUNTED + "  pulse_weight: 1 arcsec\n" + UP.replace("IA:", "X:"), COUNTS, "1,1,2"),
    refused("give IA alone for one gyro, or X, Y, Z for a triad",
        OF_RATE + UP + "    X: {azimuth: 0 deg, elevation: 90 deg}\n", RATE, "1,1,2"),
)
# fmt: on
