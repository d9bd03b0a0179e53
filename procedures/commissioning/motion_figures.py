"""The figures of a table from a sensor on it.

The sensor's axes stand along the table's as `ALONG` says. With n the outer axis, d the middle and e
the inner one, each turn by 180 deg mirrors a device about its axis; the sums and differences of the
eight levels separate the accelerometers' biases from the axes, and a level with the sensor turned
on its plate separates the sensor's own tilt from the encoders' zeros. All angles are small; the
square of one degree is left out, 0.01 deg.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from station.findings import Analysis, Estimate, Flag, InputQuantity
from station.roles.base import ARRIVAL

from .motion import (
    AT_RATE,
    AXIS_LEAN,
    ENCODER,
    ENCODER_ZERO,
    HALF_TURNS,
    IMU,
    MISALIGNMENT,
    OFF_SQUARE,
    PLACING,
    RATE_RATIO,
    SCALE,
    TABLE_AXES,
    TURN_RATIO,
    TURNED_UNIT,
    TURNTABLE,
    VERTICAL,
    MotionParameters,
    TableTurn,
    level_unit,
)
from .part import Figure, combined_u

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

Array = NDArray[np.float64]
FOLLOWS = 0.5
"""Of the turn by the encoder: a gyro or an accelerometer that feels less does not turn with it."""
ON_THE_WAY_S = 0.2
"""An output reaches the computer so long after its interval at most."""
COUNTER_TURN = 65536
ALIGNED = 1
BODY = np.array([1.0, -1.0, -1.0])
"""A navigator's x, y, z along X, Y, Z."""
DEG_PER_G = math.degrees(1.0)
BY_PLACING = {PLACING: math.sqrt(0.5), VERTICAL: math.sqrt(0.5)}
"""Half of each counts: for the two levels of a reversal the sensor is placed, and aligned, anew."""
BY_VERTICAL = {VERTICAL: 1.0}
"""What a navigator takes for the vertical stays while the table turns: no reversal shows it."""
ALONG = {
    "outer": np.array([0.0, 0.0, -1.0]),
    "middle": np.array([0.0, -1.0, 0.0]),
    "inner": np.array([1.0, 0.0, 0.0]),
}
"""Each axis along the sensor's X, Y, Z, with all axes at zero."""
SIGNS = np.array([[1.0 if angle == 0.0 else -1.0 for angle in angles] for angles in HALF_TURNS])
SENSOR = ("X", "Y", "Z")
LEVEL = {"middle": (1, -1.0), "inner": (0, 1.0)}
"""The sensor's axis, and its sense, along each axis of the table whose turns gravity feels."""
TILTED = {"middle": "X", "inner": "Y"}
"""The accelerometer that feels the tilt of a turn about each."""
OUT_OF = {
    "outer": "the vertical: level the table",
    "middle": "the level: the yoke is out of true",
    "inner": "its plate: the plate is out of true",
}


@dataclass(frozen=True)
class Sensed:
    """Outputs: run time of arrival (n,), intervals since the one before (n,), (n, 3) each.

    The first output counts as one interval; an output that was lost on the line counts to the next.
    """

    arrived_s: Array
    steps: Array
    rate_deg_per_s: Array
    force_g: Array


def sensed(folder: RunFolder, unit: str, parameters: MotionParameters) -> Sensed:
    """Return what the device sensed in a unit; ValueError where a navigator was not aligned."""
    rows = folder.rows(parameters.device, unit)
    counted = np.diff(rows["counter"].astype(np.int64))
    steps = np.concatenate(([1.0], np.mod(counted, COUNTER_TURN)))
    if parameters.device == IMU:
        rate, force = (
            np.column_stack([rows[f"{kind}_{axis}_{unit_of}"] for axis in "xyz"])
            for kind, unit_of in (("gyro", "deg_per_s"), ("accelerometer", "g"))
        )
        return Sensed(rows[ARRIVAL], steps, rate, force)
    if not (rows["status"].astype(np.int64) & ALIGNED).all():
        raise ValueError(f"{unit}: the navigator was not aligned")
    attitude = attitude_of(rows)
    turned = Rotation.from_matrix(attitude[:-1].transpose(0, 2, 1) @ attitude[1:]).as_rotvec()
    rate = np.degrees(turned) * parameters.sample_rate_Hz / steps[1:, None]
    # At rest a device feels 1 g up, and the last row of its attitude is where down lies along it.
    return Sensed(
        rows[ARRIVAL],
        steps,
        np.concatenate((np.zeros((1, 3)), rate)) * BODY,
        -attitude[:, 2] * BODY,
    )


def attitude_of(rows: NDArray[Any]) -> Array:
    """Return a navigator's axes along north, east, down as columns, shape (n, 3, 3)."""
    angles = np.column_stack([rows[f"{angle}_deg"] for angle in ("heading", "pitch", "roll")])
    return np.asarray(Rotation.from_euler("ZYX", angles, degrees=True).as_matrix())


@dataclass(frozen=True)
class Turn:
    """A turn there and back: two angles by the encoder and the gyros, three levels at rest.

    `encoder_deg` (2,), `gyro_deg` (2, 3) and its standard uncertainty `gyro_u_deg`, `force_g`
    (3, 3); `rate_ratio` (n,) are readings of the rate over their set-points.
    """

    encoder_deg: Array
    gyro_deg: Array
    gyro_u_deg: float
    force_g: Array
    rate_ratio: Array

    @property
    def felt(self) -> Array:
        """Both turns together, by gyro, over the encoder's angle, shape (3,)."""
        sense = np.sign(self.encoder_deg)
        return np.asarray((sense @ self.gyro_deg) / np.abs(self.encoder_deg).sum())


@dataclass(frozen=True)
class Level:
    """Mean specific force in g along X, Y, Z, shape (3,), and its standard uncertainty."""

    force_g: Array
    u_g: Array


@dataclass(frozen=True)
class MotionDataset:
    """All of M1 to M3. `small` and `whole` have a turn by axis, `upright` is the outer one's.

    `levels` stand in the order of `HALF_TURNS`; `turned` is that of the sensor turned on its plate.
    """

    small: Mapping[str, Turn]
    upright: Turn
    whole: Mapping[str, Turn]
    levels: tuple[Level, ...]
    turned: Level


def dataset(folder: RunFolder, parameters: MotionParameters, bench: Bench) -> MotionDataset:
    """Return turns and levels of a run; ValueError where a rest has too few outputs."""

    def level(unit: str) -> Level:
        return mean_of(sensed(folder, unit, parameters).force_g)

    by_unit = {turn.unit: turn_of(folder, turn, parameters) for turn in parameters.turns}
    small = {turn.axis: by_unit[turn.unit] for turn in parameters.small_turns[: len(TABLE_AXES)]}
    whole = parameters.turns[len(parameters.small_turns) :]
    return MotionDataset(
        small,
        by_unit[parameters.small_turns[-1].unit],
        {turn.axis: by_unit[turn.unit] for turn in whole},
        tuple(level(level_unit(angles_deg)) for angles_deg in HALF_TURNS),
        level(TURNED_UNIT),
    )


def turn_of(folder: RunFolder, turn: TableTurn, parameters: MotionParameters) -> Turn:
    """Return a turn: what the gyros gain beyond their outputs at rest, whole intervals counted."""
    output = sensed(folder, turn.unit, parameters)
    rates, arrived_s = output.rate_deg_per_s, output.arrived_s
    marks_s = np.array(folder.finished_units()[turn.unit]["marks_s"])
    rests = [
        (arrived_s > marks_s[k] + ON_THE_WAY_S) & (arrived_s < marks_s[k + 1]) for k in (0, 2, 4)
    ]
    forces = [mean_of(output.force_g[rest]).force_g for rest in rests]
    at_rest = np.array([mean_of(rates[rest]).force_g for rest in rests])
    gained, u = [], 0.0
    for k in (0, 1):
        moving = (arrived_s >= marks_s[2 * k + 1]) & (arrived_s < marks_s[2 * k + 2] + ON_THE_WAY_S)
        bias = (at_rest[k] + at_rest[k + 1]) / 2.0
        gained.append(output.steps[moving] @ (rates[moving] - bias) / parameters.sample_rate_Hz)
        noise = np.std(rates[rests[k]], axis=0, ddof=1).max()
        count = float(moving.sum())
        share = count / min(int(rests[k].sum()), int(rests[k + 1].sum()))
        u = max(u, float(noise) * math.sqrt(count * (1.0 + share)) / parameters.sample_rate_Hz)
    table = folder.rows(TURNTABLE, turn.unit)
    moving = table["at_rate"] == AT_RATE
    angles_deg = table["angle_deg"][table["at_rate"] != AT_RATE]
    ratios = table["rate_deg_per_s"][moving] / table["commanded_deg_per_s"][moving]
    return Turn(np.diff(angles_deg), np.array(gained), u, np.array(forces), ratios)


def mean_of(values: Array) -> Level:
    """Return the mean of outputs at rest (n, 3); ValueError of fewer than two, or no numbers."""
    if len(values) < 2 or not np.isfinite(values).all():
        raise ValueError("a mean at rest needs two outputs that are numbers")
    return Level(values.mean(axis=0), np.std(values, axis=0, ddof=1) / math.sqrt(len(values)))


@dataclass(frozen=True)
class Leans:
    """Angles in deg: plate and axes at rest, by gravity.

    `pitch`, `roll`: of the plate at the axes' zeros; `outer` (2,): of the outer axis towards the
    inner and the middle one; `middle`: of the middle axis out of the level; `inner`: of the inner
    axis out of the plate. `noise_deg` is the largest standard uncertainty of a level by its noise,
    over root two: every figure is half a difference of two levels, or better.
    """

    pitch: float
    roll: float
    outer: Array
    middle: float
    inner: float
    noise_deg: float


def analyse(data: MotionDataset, inputs: Sequence[InputQuantity]) -> Analysis:
    """Return the ratio of turns, rates, encoder zeros, leaning axes, and causes."""
    estimates = [
        *(_turn_ratio(axis, data) for axis in TABLE_AXES),
        *(_rate_ratio(axis, data) for axis in TABLE_AXES),
        *_levels(leans_of(data)),
        _off_square(data.small["middle"], data.small["inner"]),
    ]
    turned = {axis: _turned(data.small[axis]) for axis in TABLE_AXES}
    flags = list(senses_of(turned, _turned(data.upright)))
    if not flags:
        flags += _turns(estimates, inputs)
    return Analysis(estimates, (), [*flags, *_rates_and_leans(estimates, inputs)])


def leans_of(data: MotionDataset) -> Leans:
    """Return what the levels say; see the module for how."""
    x, y = (np.array([level.force_g[k] for level in data.levels]) * DEG_PER_G for k in (0, 1))
    outer, middle, inner = SIGNS.T
    towards_x = float(np.mean(x * middle * outer))
    towards_y = -float(np.mean(y * inner * outer))
    here, turned = data.levels[0].force_g * DEG_PER_G, data.turned.force_g * DEG_PER_G
    pitch, roll = (float(here[k] - turned[k]) / 2.0 for k in (0, 1))
    return Leans(
        pitch,
        roll,
        np.array([towards_x, towards_y]),
        float(np.mean(y * inner)) - towards_y,
        pitch - towards_x - float(np.mean(x * middle)),
        float(np.max([level.u_g for level in (*data.levels, data.turned)]))
        * DEG_PER_G
        / math.sqrt(2.0),
    )


def _levels(leans: Leans) -> list[Estimate]:
    """Return zeros and leans; what a leaning outer axis explains counts to that alone.

    A zero, or the middle axis, is off by what it is against gravity or against the outer axis,
    whichever is less: a table that stands askew has all its axes askew by the same.
    """
    towards_x, towards_y = leans.outer.tolist()
    noise_deg = leans.noise_deg
    return [
        _zero("middle", _less(leans.pitch, leans.pitch - towards_x), noise_deg),
        _zero("inner", _less(leans.roll, leans.roll + towards_y), noise_deg),
        _lean("outer", math.hypot(towards_x, towards_y), noise_deg, BY_VERTICAL),
        _lean("middle", abs(_less(leans.middle, leans.middle + towards_y)), noise_deg, BY_VERTICAL),
        _lean("inner", abs(leans.inner), noise_deg, {**BY_PLACING, **BY_VERTICAL}),
    ]


def _zero(axis: str, value_deg: float, noise_deg: float) -> Estimate:
    by = {**BY_PLACING, ENCODER: 1.0}
    method = "the plate's level at zero, the sensor reversed on it"
    return ENCODER_ZERO.measured(value_deg, noise_deg, method, axis, by=by)


def _lean(axis: str, value_deg: float, noise_deg: float, by: Mapping[str, float]) -> Estimate:
    method = "levels by reversal of each axis"
    return AXIS_LEAN.measured(value_deg, noise_deg, method, axis, by=by)


def _off_square(middle: Turn, inner: Turn) -> Estimate:
    """Return by how much middle and inner axis are not square, as the gyros feel their turns.

    Gravity does not feel it: a lean within the plate's plane is a heading.
    """
    along = [turn.felt / max(float(np.linalg.norm(turn.felt)), 1e-9) for turn in (middle, inner)]
    value_deg = math.degrees(math.asin(float(along[0] @ along[1])))
    turned_deg = min(float(np.abs(turn.encoder_deg).sum()) for turn in (middle, inner))
    noise_deg = math.degrees(2.0 * max(middle.gyro_u_deg, inner.gyro_u_deg) / turned_deg)
    method = "directions of small turns along the sensor's gyros"
    by = {MISALIGNMENT: math.sqrt(2.0)}
    return OFF_SQUARE.measured(value_deg, noise_deg, method, by=by)


def _less(first: float, second: float) -> float:
    return min(first, second, key=abs)


def _turn_ratio(axis: str, data: MotionDataset) -> Estimate:
    turn = data.whole.get(axis, data.small[axis])
    value = float(turn.felt @ ALONG[axis])
    u = turn.gyro_u_deg * math.sqrt(2.0) / float(np.abs(turn.encoder_deg).sum())
    by_angle = math.sqrt(0.5) / float(np.abs(turn.encoder_deg).max())
    method = "integral of the gyro over the encoder's angle, there and back"
    return TURN_RATIO.measured(value, u, method, axis, by={SCALE: value, ENCODER: by_angle})


def _rate_ratio(axis: str, data: MotionDataset) -> Estimate:
    ratios = data.whole.get(axis, data.small[axis]).rate_ratio
    method = "mean of the rate's readings over their set-points"
    if ratios.size < 2:
        return RATE_RATIO.undetermined(method, axis)
    u = float(np.std(ratios, ddof=1)) / math.sqrt(ratios.size)
    return RATE_RATIO.measured(float(ratios.mean()), u, method, axis, ratios.size - 1.0)


@dataclass(frozen=True)
class Turned:
    """A turn over the encoder's angle: by gyro (3,), by gravity (3,); down at its beginning."""

    by_gyro: Array
    by_gravity: Array
    down: Array


def _turned(turn: Turn) -> Turned:
    """Return a small turn as gyros and accelerometers feel it, over the encoder's angle."""
    down = -turn.force_g / np.linalg.norm(turn.force_g, axis=1, keepdims=True)
    # What is fixed to the earth turns against the sensor: the cross product of later and earlier
    # is along the turn. About the vertical there is none.
    across = np.cross(down[1], down[0])
    size = float(np.linalg.norm(across))
    turned_rad = math.radians(float(turn.encoder_deg[0]))
    by_gravity = across * (math.asin(min(size, 1.0)) / max(size, 1e-9)) / turned_rad
    return Turned(turn.felt, by_gravity, down[0])


def senses_of(turned: Mapping[str, Turned], upright: Turned) -> Iterator[Flag]:
    """Yield what of the senses of axes, gyros and accelerometers is not as it should be."""
    if turned["outer"].down[2] > FOLLOWS:
        message = (
            "At the axes' zeros the sensor feels itself upside down: it is mounted so, the zero of "
            "the middle or inner axis is off by half a turn, or its accelerometer Z is reversed."
        )
        yield Flag("sensor-upside-down", message)
        return
    still = [axis for axis, turn in turned.items() if np.abs(turn.by_gyro).max() < FOLLOWS]
    felt = {axis: sense * float(turned[axis].by_gravity[k]) for axis, (k, sense) in LEVEL.items()}
    if still or any(abs(share) < FOLLOWS for share in felt.values()):
        yield _otherwise(still, felt)
        return
    senses = {axis: float(np.sign(value)) for axis, value in felt.items()}
    gyros = np.zeros((3, 3))
    """Columns: what the three gyros read of a turn about the sensor's X, Y, Z."""
    for axis, (k, sense) in LEVEL.items():
        gyros[:, k] = senses[axis] * sense * turned[axis].by_gyro
    proven = gyros[:, :2] @ upright.down[:2]
    agreement = float(upright.by_gyro @ proven)
    if abs(agreement) < FOLLOWS:
        yield _otherwise(["outer"], felt)
        return
    senses["outer"] = float(np.sign(agreement))
    gyros[:, 2] = -senses["outer"] * turned["outer"].by_gyro
    yield from _named(senses, gyros)


def _otherwise(still: list[str], felt: Mapping[str, float]) -> Flag:
    axes = still or [axis for axis, value in felt.items() if abs(value) < FOLLOWS]
    message = (
        f"Turns of the {' and '.join(axes)} axis are not felt where they should be: the sensor "
        "is mounted otherwise than asked, or the bench file numbers the table's axes otherwise "
        "(outer_axis, middle_axis, inner_axis)."
    )
    return Flag("table-axes-otherwise", message, details={"axes": axes})


def _named(senses: dict[str, float], gyros: Array) -> Iterator[Flag]:
    """Yield what is reversed and exchanged, `senses` by axis and `gyros` as they read."""
    reads = np.abs(gyros).argmax(axis=0)
    signs = np.sign(gyros[reads, range(3)])
    if senses["middle"] < 0.0 and senses["inner"] < 0.0 < senses["outer"] and (signs > 0.0).all():
        message = (
            "The middle and the inner axis turn against their sense, or the sensor stands turned "
            "by half a turn about Z: look how it is mounted."
        )
        yield Flag("sensor-turned", message)
        return
    for axis, (k, _) in LEVEL.items():
        if senses[axis] < 0.0 and signs[k] < 0.0:
            # Gyro and encoder agree, gravity does not: two reversed parts are less likely than one.
            senses[axis], signs[k] = 1.0, 1.0
            name = TILTED[axis]
            message = (
                f"Accelerometer {name} of the sensor reads the tilt of the {axis} axis reversed, "
                "its gyro does not: its channel is reversed."
            )
            yield Flag("accelerometer-reversed", message, name)
    for axis, sense in senses.items():
        if sense < 0.0:
            message = (
                f"The {axis} axis of the table turns against its sense: gyros and gravity both "
                "show it. Reverse it in its controller, or its motor and its encoder."
            )
            yield Flag("table-sense-reversed", message, axis)
    moved = [k for k in range(3) if reads[k] != k]
    if moved:
        where = ", ".join(f"{SENSOR[k]} on {SENSOR[reads[k]]}" for k in moved)
        message = (
            f"Gyro channels of the sensor are swapped (turns about {where}), its accelerometers "
            "are not: look at its cable, or its configuration of axes."
        )
        yield Flag("gyro-channels-swapped", message)
    for k in range(3):
        if signs[k] < 0.0:
            name = SENSOR[reads[k]]
            message = f"Gyro {name} of the sensor reads turns reversed: its channel is reversed."
            yield Flag("gyro-channel-reversed", message, name)


def _turns(estimates: Sequence[Estimate], inputs: Sequence[InputQuantity]) -> Iterator[Flag]:
    for axis, value in _off(TURN_RATIO, estimates, inputs):
        message = (
            f"Turns of the {axis} axis are {100.0 * (value - 1.0):+.2g} % by the sensor's gyro "
            "against the encoder: its counts per turn, or the gyro's scale factor."
        )
        yield Flag("turn-not-whole", message, axis)


def _rates_and_leans(
    estimates: Sequence[Estimate], inputs: Sequence[InputQuantity]
) -> Iterator[Flag]:
    for axis, value in _off(RATE_RATIO, estimates, inputs):
        message = (
            f"The rate of the {axis} axis reads back {100.0 * (value - 1.0):+.2g} % off its "
            "set-point: look at its controller's units and scale."
        )
        yield Flag("table-rate-off", message, axis)
    for axis, value in _off(AXIS_LEAN, estimates, inputs):
        message = f"The {axis} axis of the table leans by {value:.2g} deg out of {OUT_OF[axis]}."
        yield Flag("table-axis-leans", message, axis)


def _off(
    figure: Figure, estimates: Sequence[Estimate], inputs: Sequence[InputQuantity]
) -> Iterator[tuple[str, float]]:
    for estimate in estimates:
        axis, value = estimate.axis, estimate.value
        if estimate.name != figure.name or axis is None or value is None:
            continue
        if figure.is_off(value, combined_u(estimate, inputs)):
            yield axis, value
