"""Faults planted in datasets of the nine-axis calibration: what goes wrong on plate and table.

The clean datasets are those of `nine_axis_estimator.py`. Seeds go through three kinds of them in
turn: part turns with the turned gyro alone, all gyros in six positions on a bent sensor, and an
efficient dwell of whole turns. The mishaps themselves are in `nine_axis_mishaps.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from nine_axis_estimator import POSITIONS, Case, Truth, simulate
from nine_axis_records import Setting, off_in_u, record
from nine_axis_stands import Bench as Stands
from numpy.typing import NDArray

from campaigns.planted.judging import (
    REFUSED,
    Fault,
    Held,
    Made,
    Row,
    but,
    by_rows,
    example,
    of_fault,
    refusals,
    row,
)
from campaigns.planted.nine_axis_mishaps import STATIC_FAULTS, TURNING_FAULTS, Plant, rounded
from campaigns.planted.nine_axis_others import CLEAN as OTHERS_CLEAN
from campaigns.planted.nine_axis_others import FAULTS as OTHERS
from procedures.nine_axis_calibration.all_axes.results import results_of
from procedures.nine_axis_calibration.all_axes.stands import OtherAxes
from procedures.nine_axis_calibration.analysis import analyse
from procedures.nine_axis_calibration.dataset import AXES, NineAxisDataset, Prior, TurnRecord

Array = NDArray[Any]
Block = tuple[Array, Array, Array]
"""Some of the readings (n,), their derivatives (n, p), their standard deviations (n,)."""

NOISE_deg_per_h = 0.6
NOISE_g = 1e-4
NOISE_deg = 1e-5
ARCMIN = np.pi / 10800.0
EARTH_deg_per_h = 15.041067
KINDS = (
    (Case("part turns", None, dwell_s=72.0, static_s=200), True),
    (
        Case("six positions", None, nonlinearity_ppm=20.0, dwell_s=72.0, static_s=120, places=6),
        False,
    ),
    (Case("whole turns", None, turns=2, static_s=150), False),
)
USUAL_FLAGS = frozenset(
    {
        "position-missing",
        "published-rule-without-data",
        "outside-published-range",
        "part-turns",
        "not-significant",
        "not-identifiable",
        "heading-differs-from-prior",
    }
)
"""What clean datasets of these kinds say: turns of 72 deg, asymmetries that are noise, no gyros
across the turned axis, a heading beyond two of its standard deviations once in twenty."""


def clean(seed: int, kind: int | None = None) -> tuple[NineAxisDataset, Truth]:
    """Return a dataset of a kind, the seed's own unless given, and the truth behind it."""
    case, alone = KINDS[seed % len(KINDS) if kind is None else kind]
    dataset, truth = simulate(case, seed)
    # A recorder writes so many decimals.
    static = tuple(
        replace(
            one,
            rate_deg_per_h=np.round(one.rate_deg_per_h, 4),
            acceleration_g=np.round(one.acceleration_g, 6),
        )
        for one in dataset.static
    )
    turns = []
    for one in dataset.turns:
        rate = np.round(one.rate_deg_per_s, 7)
        if alone:
            rate[:, [n for n in range(3) if n != one.axis]] = np.nan
        turns.append(replace(one, rate_deg_per_s=rate))
    return replace(dataset, static=static, turns=tuple(turns)), truth


def made(dataset: NineAxisDataset, truth: Truth) -> Made:
    """Return a dataset with its truth, and what a clean one like it leaves free."""
    known: dict[tuple[str, str | None, str | None], float] = {}
    arcsec = 60.0 / ARCMIN
    for axis, name in enumerate(AXES):
        known["bias", name, None] = truth.bias[axis]
        known["scale_factor", name, None] = truth.scale[axis]
        known["asymmetry", name, None] = 1e6 * truth.asymmetry[axis]
        for other in {0, 1, 2} - {axis}:
            known["misalignment", name + AXES[other], None] = arcsec * truth.cross[axis, other]
    blocks = [_at_rest(dataset), *(_turned(dataset, axis) for axis in range(3))]
    width = sum(one[1].shape[1] for one in blocks)
    model, start = [], 0
    for _, columns, _ in blocks:
        wide = np.zeros((len(columns), width))
        wide[:, start : start + columns.shape[1]] = columns
        model.append(wide)
        start += columns.shape[1]
    return Made(
        {key: float(value) for key, value in known.items()},
        lambda folder: write(dataset, folder),
        np.concatenate([one[0] for one in blocks]),
        np.vstack(model),
        np.concatenate([one[2] for one in blocks]),
    )


def _at_rest(dataset: NineAxisDataset) -> Block:
    """Return the readings at rest; free are biases, attitudes within the priors, accelerometers."""
    prior, count = dataset.prior, len(dataset.static)
    latitude = np.radians(dataset.latitude_deg)
    data, rows, noise = [], [], []
    width = 7 + 3 * count
    for place, one in enumerate(dataset.static):
        n = len(one.time_s)
        gyro, force = np.zeros((n, 3, width)), np.zeros((n, 3, width))
        gyro[:, range(3), range(3)] = 1.0
        force[:, range(3), range(4, 7)] = 1.0
        # Small turns about east, north, up move what the axes feel of the vectors v by e x v.
        axes = POSITIONS[one.position]
        turning = EARTH_deg_per_h * np.array([0.0, np.cos(latitude), np.sin(latitude)])
        for about in range(3):
            e = np.eye(3)[about]
            gyro[:, :, 7 + 3 * place + about] = axes @ np.cross(turning, e)
            force[:, :, 7 + 3 * place + about] = axes @ np.cross(np.array([0.0, 0.0, 1.0]), e)
        gyro[:, :, 3] = gyro[:, :, 7 + 3 * place + 2]
        data += [one.rate_deg_per_h.ravel(), one.acceleration_g.ravel()]
        rows += [gyro.reshape(-1, width), force.reshape(-1, width)]
        noise += [np.full(3 * n, NOISE_deg_per_h), np.full(3 * n, NOISE_g)]
    sizes = [prior.heading_rad, *[prior.accelerometer_bias_g] * 3]
    sizes += [prior.tilt_rad, prior.tilt_rad, prior.relative_heading_rad] * count
    data.append(np.zeros(width - 3))
    rows.append(np.eye(width)[3:])
    noise.append(np.array(sizes))
    return np.concatenate(data), np.vstack(rows), np.concatenate(noise)


def _turned(dataset: NineAxisDataset, axis: int) -> Block:
    """Return the readings of one turned axis.

    Free are, for each gyro, what it answers to every rate and sense, a constant, the modulation by
    the earth's rotation; for each record where its encoder began and the rate it turned at.
    """
    records = [one for one in dataset.turns if one.axis == axis]
    sizes = sorted({abs(one.commanded_deg_per_s) for one in records})
    per_gyro, own = 3 + 1 + len(sizes), 2 * len(records)
    width = 3 * per_gyro + own
    data, rows, noise = [], [], []
    for n, one in enumerate(records):
        count, rate = len(one.time_s), one.commanded_deg_per_s
        angle = np.radians(one.encoder_deg)
        for gyro in range(3):
            if not np.isfinite(one.rate_deg_per_s[:, gyro]).any():
                continue
            wide = np.zeros((count, width))
            first = gyro * per_gyro
            wide[:, first : first + 3] = np.column_stack(
                (np.ones(count), np.cos(angle), np.sin(angle))
            )
            wide[:, first + 3] = abs(rate)
            # A gyro across answers to every rate alike, the turned one may be bent.
            wide[:, first + 4 + (sizes.index(abs(rate)) if gyro == axis else 0)] = rate
            wide[:, 3 * per_gyro + 2 * n + 1] = 1.0 if gyro == axis else 0.0
            data.append(one.rate_deg_per_s[:, gyro])
            rows.append(wide)
            noise.append(np.full(count, NOISE_deg_per_h / 3600.0))
        wide = np.zeros((count, width))
        wide[:, 3 * per_gyro + 2 * n] = 1.0
        wide[:, 3 * per_gyro + 2 * n + 1] = one.time_s
        data.append(np.unwrap(one.encoder_deg - rate * one.time_s, period=360.0))
        rows.append(wide)
        noise.append(np.full(count, NOISE_deg))
    return np.concatenate(data), np.vstack(rows), np.concatenate(noise)


def write(dataset: NineAxisDataset, folder: Path) -> None:
    """Write a dataset in the import format."""
    prior = dataset.prior
    (folder / "dataset.yaml").write_text(
        "dataset: 1\nprocedure: nine-axis-calibration\n"
        "files: {static: static.csv, rate: rate.csv}\nconditions:\n"
        f"  latitude: {dataset.latitude_deg:.10g} deg\n" + _prior(prior),
        encoding="utf-8",
    )
    lines = ["position,t_s,gx_deg_per_h,gy_deg_per_h,gz_deg_per_h,ax_g,ay_g,az_g"]
    for still in dataset.static:
        table = np.column_stack((still.time_s, still.rate_deg_per_h, still.acceleration_g))
        lines += [",".join([str(still.position), *(f"{v:.10g}" for v in row)]) for row in table]
    (folder / "static.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    alone = not all(
        bool(np.isfinite(one.rate_deg_per_s).any(axis=0).all()) for one in dataset.turns
    )
    names = "rate_deg_per_s" if alone else "gx_deg_per_s,gy_deg_per_s,gz_deg_per_s"
    lines = [f"axis,commanded_deg_per_s,t_s,{names},encoder_deg"]
    for turn in dataset.turns:
        gyros = turn.rate_deg_per_s[:, [turn.axis]] if alone else turn.rate_deg_per_s
        table = np.column_stack((turn.time_s, gyros, turn.encoder_deg))
        start = f"{AXES[turn.axis]},{turn.commanded_deg_per_s:.10g}"
        lines += [",".join([start, *(f"{value:.10g}" for value in row)]) for row in table]
    (folder / "rate.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _prior(prior: Prior) -> str:
    angles = {
        "heading": prior.heading_rad,
        "relative_heading": prior.relative_heading_rad,
        "tilt": prior.tilt_rad,
    }
    lines = [f"    {name}: {value / ARCMIN:.10g} arcmin\n" for name, value in angles.items()]
    return (
        "  prior:\n"
        + "".join(lines)
        + f"    accelerometer_bias: {prior.accelerometer_bias_g:.10g} g\n"
    )


def _fault(plant: Plant) -> Fault:
    def whole(seed: int) -> Made:
        return made(*clean(seed))

    def planted(seed: int) -> Made:
        dataset, truth = clean(seed)
        return made(plant.spoil(dataset, np.random.default_rng([seed, 31])), truth)

    return Fault(plant.name, plant.flags, whole, planted, plant.detectable)


def _of_kind(kind: int) -> Callable[[int], Made]:
    return lambda seed: made(*clean(seed, kind))


FAULTS = (*(_fault(one) for one in (*STATIC_FAULTS, *TURNING_FAULTS)), *OTHERS)
CLEAN = (*(_of_kind(kind) for kind in range(len(KINDS))), *OTHERS_CLEAN)


def of(**setting: Any) -> Callable[[int], Held]:
    """Return the maker of records of a setting in memory."""

    def make(seed: int) -> Held:
        dataset = record(Setting(seed, **setting))
        return Held(dataset, partial(analyse, allan=False), lambda one: max(off_in_u(one).values()))

    return make


def stands(**bench: Any) -> Callable[[int], Held]:
    """Return the maker of what a bench's stands and turns give of the other axes."""
    return lambda seed: Held(Stands(seed, **bench).data(), results_of, lambda _: 0.0)


QUIET = of()
Change = Callable[[NineAxisDataset, int], NineAxisDataset]


def each_turn(change: Callable[[TurnRecord], TurnRecord]) -> Change:
    """Return the change of every record on the table."""
    return lambda one, _: replace(one, turns=tuple(map(change, one.turns)))


def one_turn(rate: float, change: Callable[[TurnRecord], TurnRecord]) -> Change:
    """Return the change of the first record at a rate."""

    def changed(dataset: NineAxisDataset, _: int) -> NineAxisDataset:
        turns = list(dataset.turns)
        place = next(n for n, one in enumerate(turns) if one.commanded_deg_per_s == rate)
        turns[place] = change(turns[place])
        return replace(dataset, turns=tuple(turns))

    return changed


def at_rest(change: Callable[[Array, int], Array], positions: Sequence[int] = ()) -> Change:
    """Return the change of the gyros (n, 3) at rest in some positions, or all."""

    def changed(dataset: NineAxisDataset, _: int) -> NineAxisDataset:
        static = [
            replace(one, rate_deg_per_h=change(one.rate_deg_per_h.copy(), len(one.time_s)))
            if one.position in positions or not positions
            else one
            for one in dataset.static
        ]
        return replace(dataset, static=tuple(static))

    return changed


def wild_angle(at: int, error_deg: float) -> Callable[[TurnRecord], TurnRecord]:
    """Return the change of one reading of the encoder."""

    def changed(one: TurnRecord) -> TurnRecord:
        angle = one.encoder_deg.copy()
        angle[at] = np.mod(angle[at] + error_deg, 360.0)
        return replace(one, encoder_deg=angle)

    return changed


def spin_up(braking: bool) -> Callable[[TurnRecord], TurnRecord]:
    """Return the change of a record to one that holds the spin-up of the table, or its braking."""

    def changed(one: TurnRecord) -> TurnRecord:
        share = 1.0 - np.exp(-(np.arange(len(one.time_s)) + 0.5) / 0.6)
        lost = one.commanded_deg_per_s * ((share[::-1] if braking else share) - 1.0)
        output = one.rate_deg_per_s.copy()
        output[:, 0] += lost
        angle = np.round(np.mod(one.encoder_deg + np.cumsum(lost), 360.0), 5)
        return replace(one, rate_deg_per_s=output, encoder_deg=angle)

    return changed


def wandering_encoder(dataset: NineAxisDataset, seed: int) -> NineAxisDataset:
    """Return records whose encoder is noisy, coarse or wanders, as the seed has it."""
    draw = np.random.default_rng([seed, 9])
    turns = []
    for one in dataset.turns:
        count = len(one.time_s)
        wander = 1e-5 * one.commanded_deg_per_s * np.cumsum(draw.standard_normal(count))
        noise = [0.0, 1e-3, 0.0][seed % 3] * draw.standard_normal(count)
        angle = np.mod(one.encoder_deg + wander * (seed % 2) + noise, 360.0)
        turns.append(replace(one, encoder_deg=rounded(angle, [5, 5, 2][seed % 3])))
    return replace(dataset, turns=tuple(turns))


def in_steps(step: float, one: TurnRecord) -> TurnRecord:
    """Return a record whose rates are whole steps."""
    return replace(one, rate_deg_per_s=step * np.round(one.rate_deg_per_s / step))


def cut_off(one: TurnRecord) -> TurnRecord:
    """Return the first three fifths of a record."""
    end = int(0.6 * len(one.time_s))
    rates, angle = one.rate_deg_per_s[:end], one.encoder_deg[:end]
    return replace(one, time_s=one.time_s[:end], rate_deg_per_s=rates, encoder_deg=angle)


def wild_and_lost(dataset: NineAxisDataset, _: int) -> NineAxisDataset:
    """Return a dataset with wild samples everywhere, and samples at rest lost."""
    draw = np.random.default_rng(5)
    static = []
    for one in dataset.static:
        rate = one.rate_deg_per_h.copy()
        rate[draw.random(len(rate)) < 0.05] += 500.0
        there = draw.random(len(rate)) > 0.08
        static.append(
            replace(
                one,
                time_s=one.time_s[there],
                rate_deg_per_h=rate[there],
                acceleration_g=one.acceleration_g[there],
            )
        )
    turns = []
    for turn in dataset.turns:
        rate = turn.rate_deg_per_s.copy()
        rate[draw.random(len(rate)) < 0.05] += 0.5
        angle = turn.encoder_deg.copy()
        angle[len(angle) // 2] += 77.0
        turns.append(replace(turn, rate_deg_per_s=rate, encoder_deg=angle))
    return replace(dataset, static=tuple(static), turns=tuple(turns))


def repeats(dataset: NineAxisDataset, _: int) -> NineAxisDataset:
    """Return a dataset whose first record at rest only repeats one sample from the middle on."""
    first, *others = dataset.static
    rate, force = first.rate_deg_per_h.copy(), first.acceleration_g.copy()
    rate[100:], force[100:] = rate[100] + 2.0, force[100]
    frozen = replace(first, rate_deg_per_h=rate, acceleration_g=force)
    return replace(dataset, static=(frozen, *others))


def stands_still(values: Array, count: int) -> Array:
    values[count // 2 : count // 2 + count // 7, 0] = values[0, 0]
    return values


def limited(known: float | None) -> Change:
    """Return the change to gyros that are at their limit at 80 deg/s, which may be stated."""
    clip = each_turn(
        lambda one: replace(one, rate_deg_per_s=np.clip(one.rate_deg_per_s, -80.0, 80.0))
    )
    return lambda one, seed: replace(clip(one, seed), largest_rate_deg_per_s=known)


def leaning_stand(data: OtherAxes, _: int) -> OtherAxes:
    """Return stands of which one leans beyond its prior."""
    first, second, *rest = data.rests
    lean_g = np.array([0.0, 0.01, 0.0])
    return replace(
        data,
        rests=(first, replace(second, acceleration_g=second.acceleration_g + lean_g), *rest),
    )


def other_field(data: OtherAxes, _: int) -> OtherAxes:
    """Return stands of which one was in another field."""
    rests = list(data.rests)
    assert rests[2].field_nT is not None
    rests[2] = replace(rests[2], field_nT=rests[2].field_nT + np.array([400.0, 0.0, 0.0]))
    return replace(data, rests=tuple(rests))


def spoilt(text: str) -> str:
    """Return a table at rest with wild readings of Y and thirty rows lost."""
    head, *lines = text.splitlines()
    rows = [line.split(",") for line in lines]
    for n in range(5, len(rows), 97):
        rows[n][3] = "250.0"
    kept = rows[:100] + rows[130:]
    return "\n".join([head, *(",".join(one) for one in kept), ""])


EXAMPLE = example("nine-axis")
SPOILT = EXAMPLE.but("static.csv", spoilt)
TURNED_PLATE = EXAMPLE.but(
    "static.csv",
    # As position 1 turned by 180 deg: north gives Y the other sign, and X nothing.
    by_rows(lambda r: [*r[:2], "-0.3", "-11.4", *r[4:]] if r[0] == "2" else r),
)
WITHOUT_2 = EXAMPLE.but("static.csv", by_rows(lambda r: None if r[0] == "2" else r))
REVERSED = EXAMPLE.but("rate.csv", by_rows(lambda r: [*r[:4], f"{360 - float(r[4]):.5f}"]))
ROW = "\n1,2,0.0955,11.9633,9.9913,"

NAMED: Sequence[tuple[str, int, str]] = (
    ("gyros X and Y exchanged at rest", 0, "wrong-position"),
    ("rates at rest in deg/s", 1, "contradicts-statement"),
    ("gyro Z a copy of Y at rest", 2, "frozen"),
    ("bias drifts 1 deg/h in a record", 0, "bias-wanders"),
    ("turned gyro inverted", 2, "contradicts-statement"),
    ("rates in rad/s", 0, "contradicts-statement"),
    ("mounted 4 deg askew", 0, "contradicts-statement"),
    ("clock 300 ppm off in one record", 0, "misfit"),
    ("offset 8 deg/h in the slowest", 1, "misfit"),
    ("mains beat", 1, "misfit"),
    ("clipped at exactly 100 deg/s", 2, "overload"),
    ("gyro reads zero in a record", 1, "frozen"),
    ("axis Y a copy of X", 2, "frozen"),
    ("output in steps of 0.01 deg/s", 1, "coarse-output"),
)

# fmt: off
ROWS: Sequence[Row] = (
    *(of_fault(FAULTS, *one) for one in NAMED),
    of_fault(FAULTS, "all axes: magnetometer clipped at 25 uT", 2, "saturated", below_u=4.0),
    of_fault(FAULTS, "all axes: field of the motor, 500 nT at 100 deg/s", 2, "field-disturbed",
        below_u=4.0),
    of_fault(FAULTS, "southern latitude", 0, "contradicts-statement",
        details={"statement": "latitude", "latitude_deg": (39.9, 1.0)}, null="bias"),
    of_fault(FAULTS, "encoder graduation 0.01 deg", 0, "misfit",
        details={"amplitude_deg": (0.01, 1e-4)}, below_u=4.0),
    *(row(f"turning output in steps of {step:g} deg/s",
        but(QUIET, each_turn(partial(in_steps, step))), "coarse-output",
        without="outliers-rejected misfit overload one-sense-only", below_u=4.0)
        for step in (1e-3, 1e-2)),
    row("gyro X stands still in each record at rest", but(QUIET, at_rest(stands_still)), "frozen"),
    row("a bias changed between positions",
        but(QUIET, at_rest(lambda x, _: x + np.array([0.5, 0.0, 0.0]), (2,))),
        "contradicts-statement", says="a bias changed between the positions"),
    *(row(f"encoder {error:g} deg off at {at}", but(QUIET, one_turn(100.0, wild_angle(at, error))),
        "outliers-rejected", seeds=(3,), details={"what": "encoder", "axis": "X", "count": 1},
        below_u=4.0) for at in (0, 1, 30, -2, -1) for error in (0.1, -0.02, 150.0)),
    *(row(f"{'braking' if braking else 'spin-up'} in a record at {rate:g} deg/s",
        but(QUIET, one_turn(rate, spin_up(braking))), "unsteady-rate", seeds=(4,),
        details={"axis": "X", "rates": [rate]}, below_u=4.0) for rate in (100.0, -100.0, 10.0)
        for braking in (False, True)),
    row("noisy, coarse and wandering encoders", but(of(static_s=60), wandering_encoder),
        seeds=range(20), without="unsteady-rate outliers-rejected"),
    row("table 2 % off its rate", of(table_ppm=20000.0), "rate-differs-from-commanded",
        below_u=4.0),
    row("part turns", but(of(noise=0.01), each_turn(cut_off)), "part-turns", below_u=4.0),
    row("the turned gyro alone", of(alone=True), "not-identifiable", null="misalignment",
        known="scale_factor", below_u=3.5),
    *(row(f"position {position} stood as {really}", of(stands_as={position: really}),
        "wrong-position", says=f"as in position {really}", details={"position": position},
        below_u=4.0) for position, really in ((1, 2), (2, 1), (3, 1), (1, 4), (2, 5), (3, 6))),
    *(row(f"positions 1 and 2 exchanged, {place}", of(stands_as={1: 2, 2: 1}), "wrong-position",
        details={"position": place}, below_u=4.0) for place in (1, 2)),
    row("position 2 skipped", of(positions=(1, 3)), "position-missing published-rule-without-data",
        below_u=3.5),
    row("a straight gyro", QUIET, "not-significant", details={"name": "nonlinearity"}, below_u=3.5),
    of_fault(FAULTS, "bias 0.8 deg/h up in 3 only", 1, "positions-disagree"),
    row("heading 30 arcmin off", of(heading_arcmin=30.0, static_s=600),
        "heading-differs-from-prior", below_u=4.0),
    row("wild and lost samples", but(of(static_s=300), wild_and_lost), "outliers-rejected gap",
        seeds=(3,), below_u=4.0),
    row("samples that repeat", but(of(static_s=300), repeats), "frozen", seeds=(3,),
        details={"count": 199, "at_rest": 199, "turning": 0}, below_u=4.0),
    *(row(f"gyros at their limit, {'known' if known else 'not known'}", but(QUIET, limited(known)),
        "overload", known="scale_factor") for known in (80.0, None)),
    row("two rates", of(rates=(5.0, 50.0)), "outside-published-range", below_u=3.5),
    row("a bias that wanders", but(of(static_s=600),
        at_rest(lambda x, count: x + 0.4 * np.sin(np.arange(count) / 90.0)[:, None])),
        "bias-wanders", below_u=4.0),
    row("no position", of(positions=()), "not-identifiable", null="bias"),
    row("one sense alone", but(QUIET, lambda one, _: replace(one,
        turns=tuple(turn for turn in one.turns if turn.commanded_deg_per_s > 0))),
        "not-identifiable", null="scale_factor"),
    row("a sense lost", but(QUIET, lambda one, _: replace(one,
        turns=tuple(turn for turn in one.turns if turn.commanded_deg_per_s != -10.0))),
        "one-sense-only"),
    row("a stand that leans", but(stands(), leaning_stand), "poses-disagree", seeds=(7,),
        details={"ratio": (101.5, 100.0)}, clean=stands()),
    row("a field that changes between stands", but(stands(), other_field), "field-wanders",
        seeds=(8,)),
    row("no known field",
        but(stands(), lambda one, _: replace(one, field_nT=None, field_u_nT=0.0)),
        "scale-by-convention", seeds=(6,)),
    row("the example with wild and lost rows", lambda _: SPOILT, "gap outliers-rejected",
        details={"missing_samples": 30}, below_u=1.0),
    row("the example with position 2 turned", lambda _: TURNED_PLATE, "wrong-position",
        details={"position": 2}, known="bias/X bias/Y bias/Z", below_u=2.0),
    row("the example without position 2", lambda _: WITHOUT_2, "position-missing",
        details={"position": 2}),
    row("refused: encoder the other way round", lambda _: REVERSED, REFUSED,
        says="counter-clockwise"),
    *refusals(
        EXAMPLE,
        ("dataset.yaml", "  latitude: 39.9 deg\n", "", "conditions.latitude"),
        ("dataset.yaml", "latitude: 39.9 deg", "latitude: 39.9", "latitude"),
        ("dataset.yaml", "latitude: 39.9 deg", "latitude: 39.9 mT", "latitude"),
        ("dataset.yaml", "    heading: 10 arcmin", "    headin: 10 arcmin", "did you mean"),
        ("dataset.yaml", ", rate: rate.csv", "", "files.rate"),
        ("static.csv", "position,t_s,gx_deg_per_h", "position,t_s,gx", "gx_deg_per_h"),
        ("static.csv", ROW, "\n1,2,fast,11.9633,9.9913,", "'fast' is not a number"),
        ("static.csv", ROW, "\n9,2,0.0955,11.9633,9.9913,", "there is no position 9"),
        ("static.csv", ROW, "\n1,0.5,0.0955,11.9633,9.9913,", "times must rise"),
        ("rate.csv", "rate_deg_per_s", "rate_deg", "rate_deg_per_s"),
        ("rate.csv", "\nX,1,2,", "\nW,1,2,", "'W' is no direction"),
        ("rate.csv", "\nX,1,2,", "\nX,0,2,", "at rest"),
        ("rate.csv", "\nX,1,3,", "\nX,1,1.5,", "times must rise"),
    ),
)
# fmt: on
