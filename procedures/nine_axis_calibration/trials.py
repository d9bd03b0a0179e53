"""The analysis tried again: other noise of all nine axes, stands that lean, inputs that deviate.

Whatever happens to a stand or a record of turns is added to its outputs. What a budget's row says
of many at once, such as the tilt of each position, is drawn for each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from procedures.common.helmholtz import FieldAtDevice
from procedures.estimation.channel import smallest_step
from procedures.estimation.direction import LATITUDE
from procedures.estimation.linear import robust_sigma
from procedures.estimation.turn_encoder import unwrap
from station.findings import Analysis, Trials

from .all_axes.coil import ALIGNMENT, GAIN, ZERO, solve_coil
from .all_axes.inertial import EDGE, MOUNTING, SECOND_ORDER, TILT, K, shape_of
from .all_axes.magnetic import DIRECTIONS, INCLINATION, MAGNITUDE, Magnetic
from .all_axes.results import GRAVITY, OtherResults
from .all_axes.stands import Array, OtherAxes, Record, Rest, plane_across
from .attitude import PAIRS, rotation
from .dataset import NineAxisDataset, StaticRecord, TurnRecord
from .findings import NineAxisAnalysis
from .means import interval_of
from .pose import ATTITUDES, earth_rate
from .turning import round_the_turn

ONE_AXIS = 1.0 - 1e-6
COARSE = 0.3
"""Steps: noise that is smaller does not blur them."""


@dataclass(frozen=True)
class Recorded:
    """All that an analysis takes: the gyros' records, and those of the other axes."""

    dataset: NineAxisDataset
    others: OtherAxes | None


@dataclass(frozen=True)
class Added:
    """What is added to the outputs of a record, (3,) or (n, 3): deg/h of a position at rest, deg/s
    of turns; g; nT."""

    gyro: Array | float = 0.0
    force: Array | float = 0.0
    field: Array | float = 0.0


NOTHING = Added()


@dataclass(frozen=True)
class Source:
    """The noise of three channels (3,): of a sample, and of a whole record beyond that."""

    sample: Array
    record: Array

    def drawn(self, count: int, random: np.random.Generator) -> Array:
        """Return noise of a record's samples, (count, 3)."""
        whole = self.record * random.standard_normal(3)
        return np.asarray(whole + self.sample * random.standard_normal((count, 3)))


SILENT = Source(np.zeros(3), np.zeros(3))


@dataclass(frozen=True)
class Noise:
    """What the analysis saw: of the gyros in each position in deg/h and in each record of turns in
    deg/s, in their order; of accelerometers in g and magnetometer in nT by the name of a stand or
    mounting, and of accelerometers in positions without one."""

    positions: Sequence[tuple[Source, Source]]
    turns: Sequence[Source]
    force_g: Mapping[str, Source]
    field_nT: Mapping[str, Source]
    coil_nT: Array | None = None


Draw = Callable[[Recorded, float, np.random.Generator], Recorded]


def trials_of(
    analysis: NineAxisAnalysis,
    recorded: Recorded,
    again: Callable[[Recorded], Analysis],
) -> Trials:
    """Return how the analysis of all records is tried again."""
    others = analysis.others
    inertial = others.inertial if others is not None else None
    seen = Seen.by(others, recorded)
    dull, known = unchanged, np.isfinite(analysis.gain)
    drawn: dict[str, Draw] = {
        "prior_heading": partial(_headings, common=True),
        "prior_relative_heading": partial(_headings, common=False),
        TILT: partial(_tilts, seen=seen),
        EDGE: partial(_edges, seen=seen),
        MOUNTING: partial(_mountings, seen=seen, table=False),
        "prior_table_axes": partial(_mountings, seen=seen, table=True),
        "prior_misalignment": partial(_misalignments, known=known),
        # The fit of the accelerometers makes these of what moves already.
        "prior_accelerometer_bias": _accelerometer_biases if inertial is None else dull,
        DIRECTIONS: dull,
        "encoder_angle_deg": _encoder_ends,
        SECOND_ORDER: _second_orders,
        MAGNITUDE: _magnitude,
        INCLINATION: _inclination,
        ZERO: _gaussmeter_zeros,
        ALIGNMENT: _gaussmeter_lies,
    }
    noise = noise_of(analysis, recorded)
    coil = recorded.others.coil if recorded.others is not None else None
    changes = perturbed(coil.at_device if coil is not None else None)
    return Trials(recorded, again, partial(noisy, noise=noise), changes, drawn)


def perturbed(
    at_device: FieldAtDevice | None = None,
) -> Mapping[str, Callable[[Recorded, float], Recorded]]:
    """Return what each input that is one number does to the data."""
    changes: dict[str, Callable[[Recorded, float], Recorded]] = {
        "time_scale": _clock,
        LATITUDE: _latitude,
        GRAVITY: _gravity,
        GAIN: _gaussmeter_gain,
    }
    for quantity in at_device.inputs if at_device is not None else ():
        changes[quantity.name] = partial(_elsewhere, name=quantity.name)
    return changes


def unchanged(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    """Return the records as they are."""
    return recorded


# What is recorded, and additions to it.


def turns_of(recorded: Recorded) -> list[tuple[Array, TurnRecord]]:
    """Return what points up (3,) of each record of turns, and the record."""
    if recorded.others is None:
        return [(np.eye(3)[turn.axis], turn) for turn in recorded.dataset.turns]
    return [
        (mounting.up, record.turn)
        for mounting in recorded.others.mountings
        for record in mounting.records
    ]


def with_turns(recorded: Recorded, turns: Sequence[TurnRecord]) -> Recorded:
    """Return the records with others of turns, in the order of `turns_of`."""
    pairs = [(up, turn) for (up, _), turn in zip(turns_of(recorded), turns, strict=True)]
    upright = tuple(turn for up, turn in pairs if up.max() > ONE_AXIS)
    others, fresh = recorded.others, iter(turns)
    if others is not None:
        mountings = tuple(
            replace(m, records=tuple(replace(record, turn=next(fresh)) for record in m.records))
            for m in others.mountings
        )
        others = replace(others, mountings=mountings)
    return Recorded(replace(recorded.dataset, turns=upright), others)


def rests_of(recorded: Recorded) -> Sequence[Rest | None]:
    """Return every stand at rest, positions first; None of positions with gyros alone."""
    others = recorded.others
    return [None] * len(recorded.dataset.static) if others is None else others.rests


def added(recorded: Recorded, stands: Sequence[Added], turns: Sequence[Added]) -> Recorded:
    """Return the records with something added to each stand and record of turns."""
    positions = zip(recorded.dataset.static, stands, strict=False)
    static = tuple(_more_at_rest(record, more) for record, more in positions)
    recorded = replace(recorded, dataset=replace(recorded.dataset, static=static))
    if any(more is not NOTHING for more in turns):
        pairs = zip(turns_of(recorded), turns, strict=True)
        fresh = [
            replace(turn, rate_deg_per_s=turn.rate_deg_per_s + more.gyro)
            for (_, turn), more in pairs
        ]
        recorded = with_turns(recorded, fresh)
    others = recorded.others
    if others is None:
        return recorded
    own = iter(turns)
    mountings = tuple(
        replace(m, records=tuple(_more(record, next(own)) for record in m.records))
        for m in others.mountings
    )
    rests = tuple(_more(rest, more) for rest, more in zip(others.rests, stands, strict=True))
    return replace(recorded, others=replace(others, rests=rests, mountings=mountings))


def _more_at_rest(record: StaticRecord, more: Added) -> StaticRecord:
    rate, force = record.rate_deg_per_h + more.gyro, record.acceleration_g + more.force
    return replace(record, rate_deg_per_h=rate, acceleration_g=force)


def _more(record: Record, more: Added) -> Record:
    force, field = record.acceleration_g, record.field_nT
    changed: dict[str, Any] = {
        "acceleration_g": None if force is None else force + more.force,
        "field_nT": None if field is None else field + more.field,
    }
    return replace(record, **changed)


# Noise.


def noise_of(analysis: NineAxisAnalysis, recorded: Recorded) -> Noise:
    """Return the noise that the analysis saw."""
    positions = [
        (
            _source(record.rate_deg_per_h, analysis.wider * summary.gyro_u),
            _source(record.acceleration_g, summary.accelerometer_u),
        )
        for record, summary in zip(recorded.dataset.static, analysis.static, strict=False)
    ]
    of_axis = {axis: iter(_of_turns(analysis, axis)) for axis in analysis.means}
    others = analysis.others
    turned_down = iter(_of_others(others) if others is not None else ())
    turns = []
    for up, turn in turns_of(recorded):
        upright = up.max() > ONE_AXIS
        own = next(of_axis[turn.axis]) if upright else next(turned_down, np.zeros(3))
        sigma = analysis.means[turn.axis].noise if upright else own * np.sqrt(len(turn.time_s))
        turns.append(_source(turn.rate_deg_per_s, own, sigma))
    if others is None or recorded.others is None:
        return Noise(positions, turns, {}, {})
    wider = others.inertial.wider if others.inertial is not None else 1.0
    wander_nT = others.magnetic.wander_nT if others.magnetic is not None else 0.0
    felt = {direction.name: np.sqrt(np.diag(direction.covariance)[:3]) for direction in others.felt}
    force_u = {o.name: (wider * o.force_u, o.sigma_g) for o in others.orientations}
    force, field = {}, {}
    for rest in recorded.others.rests:
        if rest.name in force_u:
            force[rest.name] = _source(rest.acceleration_g, force_u[rest.name][0])
        if rest.field_nT is not None and rest.name in felt:
            field[rest.name] = _source(rest.field_nT, np.hypot(felt[rest.name], wander_nT))
    for mounting in recorded.others.mountings:
        u, sigma = force_u[mounting.name]
        forces = [r.acceleration_g for r in mounting.records if r.acceleration_g is not None]
        fields = [r.field_nT for r in mounting.records if r.field_nT is not None]
        if forces and sigma is not None:
            force[mounting.name] = _source(np.vstack(forces), u, sigma)
        if fields and mounting.name in felt:
            together = np.vstack(fields)
            sigma = felt[mounting.name] * np.sqrt(np.isfinite(together).sum(axis=0))
            own = np.hypot(felt[mounting.name], wander_nT)
            field[mounting.name] = _source(together, own, sigma)
    coil = recorded.others.coil
    solved = solve_coil(coil) if coil is not None else None
    return Noise(positions, turns, force, field, None if solved is None else solved.sigma_nT)


def _source(samples: Array, mean_u: Array, sigma: Array | None = None) -> Source:
    """Return the noise of channels (n, 3), whose means have u (3,): white, and what it leaves of u.

    Output whose steps its noise does not blur has none of its own.
    """
    white, count = np.zeros(3), np.maximum(np.isfinite(samples).sum(axis=0), 1)
    for channel, column in enumerate(samples.T):
        finite = column[np.isfinite(column)]
        own = robust_sigma(finite) if sigma is None and len(finite) > 1 else 0.0
        size = own if sigma is None else float(np.nan_to_num(sigma[channel]))
        white[channel] = 0.0 if size < COARSE * smallest_step(finite) else size
    left = np.maximum(_finite(mean_u) ** 2 - white**2 / count, 0.0)
    return Source(white, np.sqrt(left))


def _of_turns(analysis: NineAxisAnalysis, axis: int) -> Array:
    """Return u (r, 3) of the gyros' means in each record of an axis."""
    means, solution = analysis.means[axis], analysis.axes[axis]
    variance = np.diagonal(means.covariance, axis1=1, axis2=2).T.copy()
    if solution is not None:
        variance[:, axis] += solution.uneven_deg_per_s**2
    return _finite(np.sqrt(variance))


def _of_others(others: OtherResults) -> list[Array]:
    """Return u (3,) of the gyros' means in each record that was turned pointing down."""
    return [
        _finite(u)
        for orientation in others.orientations
        if orientation.response is not None and orientation.up.max() <= ONE_AXIS
        for u in orientation.response.mean_u
    ]


def _finite(values: Array) -> Array:
    return np.nan_to_num(values, nan=0.0, posinf=0.0)


def noisy(recorded: Recorded, random: np.random.Generator, *, noise: Noise) -> Recorded:
    """Return the records with more noise, of the size that theirs has."""
    stands, static = [], recorded.dataset.static
    for n, rest in enumerate(rests_of(recorded)):
        gyro, force = noise.positions[n] if n < len(static) else (SILENT, SILENT)
        field, time_s = SILENT, static[n].time_s if rest is None else rest.time_s
        if rest is not None:
            force = noise.force_g.get(rest.name, SILENT)
            field = noise.field_nT.get(rest.name, SILENT)
        stands.append(
            Added(*(source.drawn(len(time_s), random) for source in (gyro, force, field)))
        )
    gyros = [
        source.drawn(len(turn.time_s), random)
        for (_, turn), source in zip(turns_of(recorded), noise.turns, strict=True)
    ]
    # Angles that are off once more are as much less sure.
    less_sure = [
        replace(turn, encoder_u_deg=turn.encoder_u_deg * np.sqrt(2.0))
        for _, turn in turns_of(recorded)
    ]
    recorded = with_turns(recorded, less_sure)
    if recorded.others is None:
        return added(recorded, stands, [Added(gyro) for gyro in gyros])
    turns, of_record = [], iter(gyros)
    for mounting in recorded.others.mountings:
        force, field = (
            sources.get(mounting.name, SILENT) for sources in (noise.force_g, noise.field_nT)
        )
        whole = force.record * random.standard_normal(3), field.record * random.standard_normal(3)
        for record in mounting.records:
            shape = len(record.turn.time_s), 3
            white = (source.sample * random.standard_normal(shape) for source in (force, field))
            turns.append(Added(next(of_record), *map(np.add, whole, white)))
    coil = recorded.others.coil
    if coil is not None and noise.coil_nT is not None:
        more_nT = noise.coil_nT * random.standard_normal(coil.output_nT.shape)
        coil = replace(coil, output_nT=coil.output_nT + more_nT)
        recorded = replace(recorded, others=replace(recorded.others, coil=coil))
    return added(recorded, stands, turns)


# Stands that lean.


@dataclass(frozen=True)
class Seen:
    """How the fits see a turn of the sensor: outputs per force `force` (3, 3), what points up by
    the name of a stand or mounting, and the magnetometer, where they determine these.

    `felt_nT` is the field (n, 3) of each record of the magnetometer, by name: its whole vector at
    each sample, also of axes that the sensor gives at other times.
    """

    force: Array
    up: Mapping[str, Array]
    magnetic: Magnetic | None
    felt_nT: Mapping[str, Sequence[Array]]

    @classmethod
    def by(cls, others: OtherResults | None, recorded: Recorded) -> Seen:
        """Return it of results of the other axes; of an ideal sensor where there are none."""
        inertial = others.inertial if others is not None else None
        magnetic = others.magnetic if others is not None else None
        felt_nT = felt_throughout(recorded, magnetic) if magnetic is not None else {}
        if inertial is None:
            return cls(np.eye(3), {}, magnetic, felt_nT)
        force = inertial.stands.gravity_g * inertial.state[K][:, None] * shape_of(inertial.state)
        names = [orientation.name for orientation in inertial.orientations]
        return cls(force, dict(zip(names, inertial.up, strict=True)), magnetic, felt_nT)

    def more_force(self, name: str, nominal: Array, turn_rad: Array) -> Array:
        """Return what the accelerometers (3,) read more where a stand is turned."""
        return np.asarray(self.force @ _leant(self.up.get(name, nominal), turn_rad))

    def more_field(self, name: str, number: int, turn_rad: Array) -> Array | float:
        """Return what the magnetometer (n, 3) reads more in a record where it is turned."""
        if name not in self.felt_nT or self.magnetic is None or not self.magnetic.whole:
            return 0.0
        return np.asarray(_leant(self.felt_nT[name][number], turn_rad) @ self.magnetic.gain.T)


def felt_throughout(recorded: Recorded, magnetic: Magnetic) -> Mapping[str, Sequence[Array]]:
    """Return the field (n, 3) along the sensor's axes of each record, by stand or mounting.

    A sensor may give its axes one after the other. What an axis did not give is its mean at rest,
    and on the table the wave that its record leaves; zero of one that gave nothing.
    """
    others, felt = recorded.others, {}
    if others is None:
        return {}
    inverse = np.linalg.inv(magnetic.gain) if magnetic.whole else np.eye(3)

    def throughout(field_nT: Array, columns: Array) -> Array:
        read = field_nT - magnetic.offset_nT
        for channel in read.T:
            there = np.isfinite(channel)
            if there.any():
                fitted = columns @ np.linalg.lstsq(columns[there], channel[there])[0]
                channel[~there] = fitted[~there]
        return np.asarray(np.nan_to_num(read) @ inverse.T)

    for rest in others.rests:
        if rest.field_nT is not None:
            felt[rest.name] = [throughout(rest.field_nT, np.ones((len(rest.time_s), 1)))]
    for mounting in others.mountings:
        turns = [record.turn for record in mounting.records]
        interval_s = interval_of([turn.time_s for turn in turns])
        own = []
        for turn, record in zip(turns, mounting.records, strict=True):
            known = turn.time_s, turn.encoder_deg, turn.commanded_deg_per_s, interval_s
            wave = np.nan_to_num(round_the_turn(unwrap(*known), interval_s))
            if record.field_nT is not None:
                own.append(throughout(record.field_nT, np.column_stack((np.ones(len(wave)), wave))))
        if len(own) == len(turns):
            felt[mounting.name] = own
    return felt


def _leant(vector: Array, turn_rad: Array) -> Array:
    """Return by how much vectors (n, 3) or (3,) change in a sensor that is turned; none's length
    does."""
    return np.asarray(np.nan_to_num(vector) @ (rotation(turn_rad) - np.eye(3)).T)


def _stands_leant(recorded: Recorded, turn_rad: Sequence[Array], seen: Seen) -> list[Added]:
    """Return what each stand at rest reads more where it is turned by a vector in sensor axes."""
    turning, more = earth_rate(recorded.dataset.latitude_deg), []
    static = recorded.dataset.static
    for n, (rest, own) in enumerate(zip(rests_of(recorded), turn_rad, strict=True)):
        position = ATTITUDES[static[n].position] if n < len(static) else np.zeros((3, 3))
        gyro = _leant(position @ turning, own)
        if rest is None:
            more.append(Added(gyro, seen.more_force("", position[:, 2], own)))
            continue
        force = seen.more_force(rest.name, rest.up, own)
        more.append(Added(gyro, force, seen.more_field(rest.name, 0, own)))
    return more


def _turns_leant(recorded: Recorded, turn_rad: Sequence[Array], seen: Seen) -> list[Added]:
    """Return what each record of turns reads more where its mounting is turned by a vector."""
    others, more = recorded.others, []
    places = [("", 0)] * len(turn_rad)
    if others is not None:
        places = [(m.name, n) for m in others.mountings for n in range(len(m.records))]
    for (up, turn), own, (name, n) in zip(turns_of(recorded), turn_rad, places, strict=True):
        about = np.nan_to_num(turn.rate_deg_per_s)[:, turn.axis] * np.sign(up[turn.axis])
        gyro = np.outer(about, _leant(up, own))
        more.append(Added(gyro, seen.more_force(name, up, own), seen.more_field(name, n, own)))
    return more


def _about(up: Array, size_rad: float, random: np.random.Generator) -> Array:
    """Return a small turn about a random axis across a direction."""
    return np.asarray(size_rad * random.standard_normal(2) @ plane_across(up))


def _headings(
    recorded: Recorded, u: float, random: np.random.Generator, *, common: bool
) -> Recorded:
    prior, static = recorded.dataset.prior, recorded.dataset.static
    size = prior.heading_rad if common else prior.relative_heading_rad
    off_rad = u * size * random.standard_normal(len(static))
    turned = [np.zeros(3) for _ in rests_of(recorded)]
    for n, record in enumerate(static):
        turned[n] = off_rad[0 if common else n] * ATTITUDES[record.position][:, 2]
    ideal = Seen(np.eye(3), {}, None, {})
    return added(recorded, _stands_leant(recorded, turned, ideal), _none(recorded))


def _none(recorded: Recorded) -> list[Added]:
    return [NOTHING] * len(turns_of(recorded))


def _tilts(recorded: Recorded, u: float, random: np.random.Generator, *, seen: Seen) -> Recorded:
    """Let each stand with one axis up lean, and the table's axis."""
    leant = _rests_lean(recorded, u, random, seen, edges=False)
    return _table_leant(leant, u, random, seen)


def _edges(recorded: Recorded, u: float, random: np.random.Generator, *, seen: Seen) -> Recorded:
    """Let each stand and mounting with a direction between axes up lean."""
    leant = _rests_lean(recorded, u, random, seen, edges=True)
    return _mountings_lean(leant, u, random, seen, edges=True)


def _mountings(
    recorded: Recorded,
    u: float,
    random: np.random.Generator,
    *,
    seen: Seen,
    table: bool,
) -> Recorded:
    """Let each mounting lean, or the table's axes."""
    size = recorded.dataset.prior.table_axes_rad if table else None
    return _mountings_lean(recorded, u, random, seen, edges=False, size_rad=size)


def _rests_lean(
    recorded: Recorded,
    u: float,
    random: np.random.Generator,
    seen: Seen,
    *,
    edges: bool,
) -> Recorded:
    turned = []
    for n, rest in enumerate(rests_of(recorded)):
        up, size = _direction_of(recorded, n, rest)
        own = (np.abs(up).max() < ONE_AXIS) == edges
        turned.append(_about(up, u * size if own else 0.0, random))
    return added(recorded, _stands_leant(recorded, turned, seen), _none(recorded))


def _direction_of(recorded: Recorded, n: int, rest: Rest | None) -> tuple[Array, float]:
    if rest is not None:
        return rest.up, rest.u_rad
    dataset = recorded.dataset
    return ATTITUDES[dataset.static[n].position][:, 2], dataset.prior.tilt_rad


def _mountings_lean(
    recorded: Recorded,
    u: float,
    random: np.random.Generator,
    seen: Seen,
    *,
    edges: bool,
    size_rad: float | None = None,
) -> Recorded:
    others, turned = recorded.others, []
    if others is None:
        size = recorded.dataset.prior.mounting_rad if size_rad is None else size_rad
        of_axis = [_about(up, u * size, random) for up in np.eye(3)]
        turned = [of_axis[turn.axis] for turn in recorded.dataset.turns]
    else:
        for mounting in others.mountings:
            own = (np.abs(mounting.up).max() < ONE_AXIS) == edges
            size = mounting.u_rad if size_rad is None else size_rad
            turned += [_about(mounting.up, u * size * own, random)] * len(mounting.records)
    stands = [NOTHING] * len(rests_of(recorded))
    return added(recorded, stands, _turns_leant(recorded, turned, seen))


def _table_leant(recorded: Recorded, u: float, random: np.random.Generator, seen: Seen) -> Recorded:
    """Let the table's axis lean, which moves level and upward field of all turns alike."""
    others, magnetic = recorded.others, seen.magnetic
    if others is None or magnetic is None:
        return recorded
    off = u * others.tilt_rad * random.standard_normal()
    tangent = np.tan(np.radians(magnetic.inclination_deg))
    upward_nT = -magnetic.field_nT * np.cos(np.radians(magnetic.inclination_deg)) * off
    more = []
    for mounting in others.mountings:
        if mounting.name not in seen.felt_nT:
            more += [NOTHING] * len(mounting.records)
        for felt in seen.felt_nT.get(mounting.name, ()):
            level = felt - np.outer(felt @ mounting.up, mounting.up)
            moved = upward_nT * mounting.up - off * tangent * level
            more.append(Added(field=moved @ magnetic.gain.T))
    return added(recorded, [NOTHING] * len(others.rests), more)


# Other inputs.


def _misalignments(
    recorded: Recorded, u: float, random: np.random.Generator, *, known: Array
) -> Recorded:
    """Let gyros lean whose misalignment no turn measured."""
    dataset, lean = recorded.dataset, np.zeros((3, 3))
    for pair in PAIRS:
        off = u * dataset.prior.misalignment_rad * random.standard_normal()
        lean[pair] = 0.0 if known[pair] else off
    turning = earth_rate(dataset.latitude_deg)
    stands = [Added(lean @ ATTITUDES[record.position] @ turning) for record in dataset.static]
    stands += [NOTHING] * (len(rests_of(recorded)) - len(stands))
    return added(recorded, stands, _none(recorded))


def _accelerometer_biases(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    off = u * recorded.dataset.prior.accelerometer_bias_g * random.standard_normal(3)
    return added(recorded, [Added(force=off)] * len(rests_of(recorded)), _none(recorded))


def _second_orders(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    others = recorded.others
    if others is None:
        return recorded
    term = u * others.second_order_u * random.standard_normal(3)
    stands = [Added(force=term * rest.up**2) for rest in others.rests]
    turns = [Added(force=term * up**2) for up, _ in turns_of(recorded)]
    return added(recorded, stands, turns)


def _encoder_ends(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    """Let the angle at the ends of the records of a rate be off, both senses alike."""
    off: dict[tuple[int, float], float] = {}
    fresh = []
    for _, turn in turns_of(recorded):
        place = turn.axis, abs(turn.commanded_deg_per_s)
        error_deg = off.setdefault(place, u * float(random.standard_normal()))
        turned_deg = abs(turn.commanded_deg_per_s) * float(np.ptp(turn.time_s))
        whole = abs(turned_deg / 360.0 - round(turned_deg / 360.0)) < 0.02
        factor = 1.0 if whole or not turned_deg else 1.0 + error_deg / turned_deg
        first = turn.encoder_deg[:1]
        fresh.append(replace(turn, encoder_deg=first + factor * (turn.encoder_deg - first)))
    return with_turns(recorded, fresh)


def _of_others_only(recorded: Recorded, **changes: Any) -> Recorded:
    others = recorded.others
    return recorded if others is None else replace(recorded, others=replace(others, **changes))


def _magnitude(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    others = recorded.others
    if others is None or others.field_nT is None:
        return recorded
    off = u * others.field_u_nT * random.standard_normal()
    return _of_others_only(recorded, field_nT=others.field_nT + off)


def _inclination(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    others = recorded.others
    if others is None or others.inclination_rad is None:
        return recorded
    off = u * others.inclination_u_rad * random.standard_normal()
    return _of_others_only(recorded, inclination_rad=others.inclination_rad + off)


def _clock(recorded: Recorded, slower: float) -> Recorded:
    return with_turns(
        recorded,
        [replace(turn, time_s=turn.time_s * (1.0 + slower)) for _, turn in turns_of(recorded)],
    )


def _latitude(recorded: Recorded, off_rad: float) -> Recorded:
    latitude_deg = recorded.dataset.latitude_deg + float(np.degrees(off_rad))
    dataset = replace(recorded.dataset, latitude_deg=latitude_deg)
    return _of_others_only(replace(recorded, dataset=dataset), latitude_deg=latitude_deg)


def _gravity(recorded: Recorded, less_g: float) -> Recorded:
    others = recorded.others
    if others is None:
        return recorded
    return _of_others_only(recorded, gravity_g=others.gravity_g - less_g)


def _in_coil(recorded: Recorded, change: Callable[[Array], Array]) -> Recorded:
    """Return the records with other readings of the gaussmeter in the coil."""
    coil = recorded.others.coil if recorded.others is not None else None
    if coil is None:
        return recorded
    return _of_others_only(recorded, coil=replace(coil, applied_nT=change(coil.applied_nT)))


def _gaussmeter_gain(recorded: Recorded, part: float) -> Recorded:
    return _in_coil(recorded, lambda applied: applied / (1.0 + part))


def _elsewhere(recorded: Recorded, deviation: float, *, name: str) -> Recorded:
    """Return the records with the field at the sensor where coils or places are others."""
    coil = recorded.others.coil if recorded.others is not None else None
    if coil is None or coil.at_device is None:
        return recorded
    moved = coil.carried(coil.at_device.deviating(name, deviation))
    return _of_others_only(recorded, coil=moved)


def _gaussmeter_zeros(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    off_nT = u * random.standard_normal(3)
    return _in_coil(recorded, lambda applied: applied + off_nT)


def _gaussmeter_lies(recorded: Recorded, u: float, random: np.random.Generator) -> Recorded:
    turn_rad = u * random.standard_normal(3)
    return _in_coil(recorded, lambda applied: applied + _leant(applied, turn_rad))
