"""Faults of records of a gyro at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from static_records import DEVICES, LATITUDE_RAD, records, stability_deg_per_h, true_squares

from campaigns.planted.judging import REFUSED, Fault, Held, Key, Row, Sample, Written, but, row
from campaigns.planted.logs import (
    Change,
    Kind,
    Log,
    averaged,
    column,
    copied,
    exchanged,
    faults,
    frozen,
    in_steps,
    limited,
    lost,
    noisy,
    offset,
    ramped,
    set_at,
    settling,
    shifted,
    spikes,
    stated,
    stepped,
    times,
    together,
    waved,
    whitened,
    wild,
)
from procedures.estimation.direction import Direction
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


def shocked(rate: Array, _: Array) -> Array:
    """Return rates that are 1 deg/h higher for 36 s, 1 % of the record."""
    rate[1500:1536] += 1.0
    return rate


def noisy_for_a_minute(rate: Array, _: Array) -> Array:
    """Return rates with five times the noise for 60 s."""
    rate[1500:1560, 0] += 1.5 * np.random.default_rng(0).standard_normal(60)
    return rate


def in_every_record(factor: float) -> Callable[[StaticDataset, int], StaticDataset]:
    """Return the change of all rates by a factor, but for the mean's bias of 0.35 deg/h."""

    def changed(dataset: StaticDataset, _: int) -> StaticDataset:
        return replace(
            dataset,
            records=tuple(
                replace(one, rate_deg_per_h=factor * (one.rate_deg_per_h - 0.3))
                for one in dataset.records
            ),
        )

    return changed


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
    row("a shock of half a minute", but(FOG, rates(shocked)), "misfit", seeds=(3,),
        says="beside the rest", clean=FOG, below_u=4.0),
    row("noisy for a minute", but(FOG, rates(noisy_for_a_minute)), "misfit outliers-rejected",
        seeds=(3,), says="as much as the rest", clean=FOG, below_u=4.0),
    row("rates in deg/s", but(FOG, in_every_record(1.0 / 3600.0)), "contradicts-statement",
        seeds=(3,), says="if the output is in deg/s", details={"statement": "input_axis"}),
    row("an output of the other sign", but(FOG, in_every_record(-1.0)), "contradicts-statement",
        seeds=(3,), says="its sign is the other one", details={"statement": "input_axis"}),
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

AXES = {"X": (0.0, 0.0), "Y": (90.0, 0.0), "Z": (0.0, 90.0)}
"""Azimuth and elevation of the axes of a triad, deg."""
RATE_COLUMN = "rate_deg_per_h"


def log(device: str, counts: Sequence[int], axes: Sequence[str], seed: int) -> Log:
    """Return switch-ons of a device, or of a triad of them; of one the drawn bias is the true."""
    gyro = DEVICES[device]
    directions = {one: AXES.get(one, (0.0, 90.0)) for one in axes}
    columns: dict[str, NDArray[Any]] = {}
    truth: dict[Key, float] = {}
    pulse = gyro["pulse"]
    for number, axis in enumerate(axes):
        azimuth, elevation = np.radians(directions[axis])
        rng = np.random.default_rng((seed, number))
        bias = 0.35 + gyro["switch_on"] * np.random.default_rng((seed, number)).standard_normal()
        dataset = records(rng, gyro, counts)
        rates = np.concatenate([one.rate_deg_per_h[:, 0] for one in dataset.records])
        if axes[0] != "IA":  # records are made with the axis up
            earth = Direction(azimuth, elevation).earth_deg_per_h(LATITUDE_RAD)
            rates += earth - dataset.directions["IA"].earth_deg_per_h(LATITUDE_RAD)
        name = f"g{axis.lower()}_deg_per_h" if axes[0] != "IA" else RATE_COLUMN
        times_s = [one.time_s + 0.5 for one in dataset.records]
        numbers = np.repeat(np.arange(1, len(counts) + 1), [len(one) for one in times_s])
        columns |= {} if columns else {"switch_on": numbers, "t_s": np.concatenate(times_s)}
        columns["counts" if pulse else name] = np.round(rates / pulse) if pulse else rates
        squares = true_squares(gyro)
        known = {
            "quantisation_noise": squares[0] ** 0.5,
            "angle_random_walk": gyro["N"],
            "bias_instability": gyro["B"],
            "rate_random_walk": gyro["K"],
            "rate_ramp": 0.0,
            "bias_stability": stability_deg_per_h(gyro, counts[0], 0.0),
            "bias": bias if len(counts) == 1 else 0.35,
        }
        truth |= {(key, axis, None): value for key, value in known.items()}
    conditions = {
        "sample_interval": "1 s",
        "timestamp": "interval-end",
        "latitude": f"{np.degrees(LATITUDE_RAD):.10g} deg",
        "gyro_output": "counts" if pulse else "rate",
        **({"pulse_weight": f"{pulse:g} arcsec"} if pulse else {}),
        "input_axis": {
            axis: {"azimuth": f"{azimuth:g} deg", "elevation": f"{elevation:g} deg"}
            for axis, (azimuth, elevation) in directions.items()
        },
    }
    digits = {name: 0 if pulse else 4 for name in columns if name not in ("switch_on", "t_s")}
    return Log("gyro-static-noise", "samples", columns, conditions, truth, digits)


def readings(device: str, one: Log) -> Array:
    """Return the outputs of a log, white; of each switch-on and axis the level may be anything."""
    names = [name for name in one.columns if name not in ("switch_on", "t_s")]
    scale = DEVICES[device]["pulse"] or 1.0
    numbers = one.columns["switch_on"]
    parts = [
        whitened(scale * one.columns[name][numbers == number], true_squares(DEVICES[device]), 1.0)
        for name in names
        for number in np.unique(numbers)
    ]
    return np.concatenate(parts)


def kind(device: str, counts: Sequence[int], axes: Sequence[str] = ("IA",)) -> Kind:
    """Return the datasets of a device; ramps and the size of all noise are free."""
    make = partial(log, device, counts, axes)

    def free(seed: int) -> Array:
        base = make(seed)
        names = [name for name in base.columns if name not in ("switch_on", "t_s")]
        held = {name: base.columns[name] for name in names}
        moved = []
        for name in names:
            for number in range(1, len(counts) + 1):
                own = base.columns["switch_on"] == number
                hours = np.where(own, base.columns["t_s"] / 3600.0, 0.0)
                noise = np.where(own, held[name] - held[name][own].mean(), 0.0)
                moved += [base.but(**{name: held[name] + x}) for x in (hours, noise)]
        start = readings(device, base)
        return np.column_stack([readings(device, one) - start for one in moved])

    return Kind(make, partial(readings, device), free)


LONE = kind("FOG", (SAMPLES,))
SEVERAL = kind("FOG", (SAMPLES, 600, 600, 600))
COUNTER = kind("RLG", (SAMPLES,))
TRIAD = kind("FOG", (SAMPLES,), ("X", "Y", "Z"))
MEMS = kind("MEMS", (SAMPLES,))
WHITE = DEVICES["FOG"]["N"] * 60.0
"""Deg/h in a sample of a second."""


def of(change: Callable[..., Any], name: str = RATE_COLUMN) -> Change:
    """Return the change of the output."""
    return column(name, change)


def first_alone(change: Change) -> Change:
    """Return a change of the first switch-on alone."""

    def changed(one: Log, rng: np.random.Generator) -> Log:
        first = one.columns["switch_on"] == 1
        spoilt = change(one.rows(np.flatnonzero(first)), rng)
        return one.but(
            **{
                name: np.concatenate((spoilt.columns[name], whole[~first]))
                for name, whole in one.columns.items()
            }
        )

    return changed


def off_in_last(size: float) -> Change:
    """Return the change of the last switch-on's level."""

    def change(one: Log, _: np.random.Generator) -> Log:
        numbers = one.columns["switch_on"]
        return one.but(**{RATE_COLUMN: one.columns[RATE_COLUMN] + size * (numbers == numbers[-1])})

    return change


def axis(azimuth: float, elevation: float) -> Change:
    """Return the change of the stated input axis."""
    return stated(input_axis={"IA": {"azimuth": f"{azimuth} deg", "elevation": f"{elevation} deg"}})


# fmt: off
FAULTS: Sequence[Fault] = faults(
    USUAL_FLAGS,
    ("a wild sample", LONE, of(wild(20.0))),
    ("a wild sample of 6 sigma", LONE, of(wild(6 * WHITE))),
    ("thirty wild samples", LONE, of(wild(5.0, 30))),
    ("a wild block", LONE, of(offset(0.003, 5.0))),
    ("frozen for 5 %", LONE, of(frozen(0.05))),
    ("frozen for 10 %", LONE, of(frozen(0.1))),
    ("frozen for 20 %", LONE, of(frozen(0.2))),
    ("frozen for 10 %, counts", COUNTER, of(frozen(0.1), "counts")),
    ("a block of 10 % copied", LONE, of(copied(0.1))),
    ("zero for 1 %", LONE, of(set_at(0.0, 0.01))),
    ("saturated, 5 % at each end", LONE, of(limited(0.05))),
    ("steps of 1 deg/h", LONE, of(in_steps(1.0))),
    ("steps of 0.2 deg/h", LONE, of(in_steps(0.2))),
    ("5 % of the rows missing", LONE, lost(0.05, in_one=False), True),
    ("10 % of the rows missing in one block", LONE, lost(0.1, in_one=True), True),
    ("a step of 0.1 deg/h", LONE, of(stepped(0.1))),
    ("a step of 1 deg/h", LONE, of(stepped(1.0))),
    ("a step of 0.1 deg/h, counts", COUNTER, of(stepped(2.0), "counts")),
    ("spikes of 2 deg/h in 1 %", LONE, of(spikes(0.01, 2.0))),
    ("a burst of 1 %, five times the noise", LONE, of(noisy(0.01, 5 * WHITE))),
    ("a burst of 5 %, twice the noise", LONE, of(noisy(0.05, 2 * WHITE))),
    ("1 % off by 0.5 deg/h", LONE, of(offset(0.01, 0.5))),
    ("output in deg/s", LONE, of(times(1.0 / 3600.0)), True),
    ("output in rad/h", LONE, of(times(np.pi / 180.0)), False),
    ("output in arcmin/h", LONE, of(times(60.0)), False),
    ("sign reversed", LONE, of(times(-1.0)), True),
    ("sign reversed, counts", COUNTER, of(times(-1.0), "counts"), True),
    ("axes X and Z exchanged", TRIAD, exchanged("gx_deg_per_h", "gz_deg_per_h"), True),
    ("axes X and Y exchanged", TRIAD, exchanged("gx_deg_per_h", "gy_deg_per_h"), True),
    ("axis Z reversed", TRIAD, of(times(-1.0), "gz_deg_per_h"), True),
    ("X is Y's copy", TRIAD, lambda one, _: one.but(gx_deg_per_h=one.columns["gy_deg_per_h"]),
        True),
    ("stated down, mounted up", LONE, axis(0.0, -90.0), True),
    ("stated north, mounted up", LONE, axis(0.0, 0.0), False),
    ("latitude of the other hemisphere", LONE, stated(latitude="-39.9 deg"), True),
    ("latitude off by 2 deg", LONE, stated(latitude="41.9 deg"), False),
    ("latitude off by 2 deg, triad", TRIAD, stated(latitude="41.9 deg"), False),
    ("pulse weight twice as large", COUNTER, stated(pulse_weight="0.125 arcsec"), False),
    ("pulse weight in arcmin", COUNTER, stated(pulse_weight="0.0625 arcmin"), False),
    ("a sample interval of 0.5 s", COUNTER, together(stated(sample_interval="0.5 s"),
        column("t_s", lambda t, _: 1800.0 + 0.5 * (t - 1800.0))), False),
    ("a ramp of 1 deg/h/h", LONE, of(ramped(1.0))),
    ("a bent drift of 0.3 deg/h", LONE, of(ramped(0.3, 2))),
    ("a tail of the warm-up of 0.3 deg/h", LONE, of(settling(0.3, 0.1))),
    ("a tail of the warm-up in the first switch-on", SEVERAL,
        first_alone(of(settling(0.3, 0.1)))),
    ("a line of 0.1 deg/h and 300 s", LONE, of(waved(0.1, 300.0))),
    ("a line of 0.05 deg/h and 20 s", LONE, of(waved(0.05, 20.0))),
    ("a line of 0.3 deg/h over the record", LONE, of(waved(0.3, SAMPLES))),
    ("line and ramp", LONE, together(of(waved(0.1, 600.0)), of(ramped(0.5)))),
    ("the room warms and cools", LONE, of(lambda x, _: x + 0.2 * np.sin(np.linspace(0, 7, len(x))
        ) ** 3)),
    ("behind a filter that is not stated", LONE, of(averaged(5))),
    ("every second sample repeats", LONE, of(lambda x, _: np.repeat(x[::2], 2)[:len(x)])),
    ("sampled, not averaged", LONE, of(lambda x, rng: x + 3 * WHITE * rng.standard_normal(len(x))),
        False),
    ("rows in another order", LONE, of(shifted(700))),
    ("one switch-on off by 1 deg/h", SEVERAL, off_in_last(1.0), False),
    ("a step of 10 deg/h", MEMS, of(stepped(10.0))),
    ("a burst of 1 %, five times the noise, MEMS", MEMS, of(noisy(0.01, 45.0))),
)
# fmt: on
