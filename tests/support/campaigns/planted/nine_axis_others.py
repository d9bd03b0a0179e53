"""Faults planted in datasets of all nine axes: what goes wrong with accelerometers and field.

Clean datasets are those of `nine_axis_stands.py`, of a plate, of wedges, and of a table in turn.
Most causes act on stands or turns alone; the model that a test would need to know them is not
linear, so that each fault says itself whether its data can show it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from nine_axis_stands import FACES, Bench, truth_of
from nine_axis_stands import write as write_stands
from numpy.typing import NDArray

from campaigns.planted.judging import Fault, Key, Made
from procedures.nine_axis_calibration.all_axes.stands import Mounted, OtherAxes, Rest, Turned

Array = NDArray[Any]
Change = Callable[[Array], Array]
Spoil = Callable[[OtherAxes], OtherAxes]
FORCE, FIELD = "acceleration_g", "field_nT"
KINDS: Sequence[dict[str, Any]] = (
    {"poses": FACES, "mounting_arcmin": 1.0},
    {"tilt_arcmin": 0.5},
    {"tilt_arcmin": 0.1, "edge_deg": 0.00167},
)
"""On a plate, on wedges, by a table."""
ASKEW = frozenset({"poses-disagree", "contradicts-statement", "wrong-position"})
FIELDS = frozenset({"field-wanders", "field-disturbed", "contradicts-statement"})
STUCK = frozenset({"frozen", "saturated", "coarse-output"})


def clean(seed: int, kind: int | None = None) -> tuple[OtherAxes, Bench]:
    """Return the data of a kind, the seed's own unless given, and the bench that recorded them."""
    bench = Bench(seed, **KINDS[seed % len(KINDS) if kind is None else kind])
    if bench.poses == FACES:
        bench.sensor = replace(bench.sensor, second=np.zeros(3))
    return bench.data(), bench


def made(data: OtherAxes, bench: Bench) -> Made:
    """Return the data as a folder, with the truth of the six other axes."""
    truth: dict[Key, float] = {
        (name, axis, None): value
        for (name, axis), value in truth_of(bench.sensor).items()
        if name != "scale_factor"
    }
    empty = np.zeros((0, 0))

    def write(folder: Path) -> None:
        write_stands(data, folder)

    return Made(truth, write, np.zeros(0), empty, np.zeros(0))


def at_rest(what: str, change: Change, names: Sequence[str] = ()) -> Spoil:
    """Return the fault of samples (n, 3) at rest, in the stands of some names or all."""

    def spoilt(rest: Rest) -> Rest:
        if names and rest.name.removeprefix("pose ") not in names:
            return rest
        samples: dict[str, Any] = {what: change(getattr(rest, what).copy())}
        return replace(rest, **samples)

    return lambda data: replace(data, rests=tuple(map(spoilt, data.rests)))


def turning(what: str, change: Change, words: Sequence[str] = ()) -> Spoil:
    """Return the fault of samples (n, 3) on the table, in some mountings or all."""

    def spoilt(record: Turned) -> Turned:
        samples: dict[str, Any] = {what: change(getattr(record, what).copy())}
        return replace(record, **samples)

    def of(mounting: Mounted) -> Mounted:
        if words and mounting.name.removeprefix("mounting ") not in words:
            return mounting
        return replace(mounting, records=tuple(map(spoilt, mounting.records)))

    return lambda data: replace(data, mountings=tuple(map(of, data.mountings)))


def every(what: str, change: Change) -> Spoil:
    """Return the fault of all samples (n, 3) of a sensor."""
    rests, turns = at_rest(what, change), turning(what, change)
    return lambda data: turns(rests(data))


def _added(column: int, extra: float) -> Change:
    return lambda v: v + extra * np.eye(3)[column]


def _scaled(column: int, factor: float) -> Change:
    return lambda v: v * (1.0 + (factor - 1.0) * np.eye(3)[column])


def _columns(*order: int) -> Change:
    return lambda v: v[:, list(order)]


def _held(column: int, share: float = 0.0) -> Change:
    def changed(v: Array) -> Array:
        first = int(share * len(v))
        v[first:, column] = v[first, column]
        return v

    return changed


def _from(column: int, share: float, extra: float) -> Change:
    def changed(v: Array) -> Array:
        v[int(share * len(v)) :, column] += extra
        return v

    return changed


def _spikes(extra: float) -> Change:
    def changed(v: Array) -> Array:
        v[3::20] += extra
        return v

    return changed


def _clipped(limit: float) -> Change:
    return lambda v: np.clip(v, -limit, limit)


def _in_steps(step: float) -> Change:
    return lambda v: np.round(v / step) * step


def _ramp(column: int, extra: float) -> Change:
    return lambda v: v + extra * np.linspace(0.0, 1.0, len(v))[:, None] * np.eye(3)[column]


def _called(names: dict[str, str]) -> Spoil:
    """Return the fault of stands that are called by other names."""

    def spoil(data: OtherAxes) -> OtherAxes:
        rests = []
        for rest in data.rests:
            word = rest.name.removeprefix("pose ")
            rests.append(replace(rest, name=f"pose {names.get(word, word)}"))
        return replace(data, rests=tuple(rests))

    return spoil


def _mounted_as(names: dict[str, str]) -> Spoil:
    def spoil(data: OtherAxes) -> OtherAxes:
        mountings = []
        for mounting in data.mountings:
            word = mounting.name.removeprefix("mounting ")
            mountings.append(replace(mounting, name=f"mounting {names.get(word, word)}"))
        return replace(data, mountings=tuple(mountings))

    return spoil


def _copied(target: str, source: str) -> Spoil:
    """Return the fault that one stand has the samples of another."""

    def spoil(data: OtherAxes) -> OtherAxes:
        stands = {rest.name.removeprefix("pose "): rest for rest in data.rests}
        copy = stands[source]
        return replace(
            data,
            rests=tuple(
                replace(rest, acceleration_g=copy.acceleration_g, field_nT=copy.field_nT)
                if rest is stands[target]
                else rest
                for rest in data.rests
            ),
        )

    return spoil


def _turned_about(degrees: float) -> Change:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return lambda v: v @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _with_rate(size_nT: float) -> Spoil:
    """Return the fault of a motor whose field goes with the magnitude of the rate."""

    def spoil(data: OtherAxes) -> OtherAxes:
        mountings = []
        for mounting in data.mountings:
            records = []
            for record in mounting.records:
                assert record.field_nT is not None
                extra = size_nT * abs(record.turn.commanded_deg_per_s) / 100.0 * mounting.up
                records.append(replace(record, field_nT=record.field_nT + extra))
            mountings.append(replace(mounting, records=tuple(records)))
        return replace(data, mountings=tuple(mountings))

    return spoil


def _plant(name: str, flags: frozenset[str], spoil: Spoil, *, detectable: bool = True) -> Fault:
    def whole(seed: int) -> Made:
        return made(*clean(seed))

    def planted(seed: int) -> Made:
        data, bench = clean(seed)
        return made(spoil(data), bench)

    return Fault(f"all axes: {name}", flags, whole, planted, detectable)


BUMP = {"-X": "-Y", "-Y": "-X"}

# fmt: off
FAULTS = (
    _plant("accelerometer X inverted", ASKEW, every(FORCE, _scaled(0, -1.0))),
    _plant("accelerometers inverted", ASKEW, every(FORCE, lambda v: -v)),
    _plant("accelerometers X and Y exchanged", ASKEW, every(FORCE, _columns(1, 0, 2))),
    _plant("accelerometers go round", ASKEW, every(FORCE, _columns(1, 2, 0))),
    _plant("accelerometer Y a copy of X", ASKEW | STUCK, every(FORCE, _columns(0, 0, 2))),
    _plant("accelerometers in m/s2", ASKEW, every(FORCE, lambda v: 9.80665 * v)),
    _plant("accelerometers in mg", ASKEW, every(FORCE, lambda v: 1000.0 * v)),
    _plant("accelerometers in m/s2 at rest alone", ASKEW, at_rest(FORCE, lambda v: 9.80665 * v)),
    _plant("accelerometer X reads zero", ASKEW | STUCK, every(FORCE, _scaled(0, 0.0))),
    _plant("accelerometer X held in -X", ASKEW | STUCK, at_rest(FORCE, _held(0), ("-X",))),
    _plant("accelerometer X held in half of -X", ASKEW | STUCK,
        at_rest(FORCE, _held(0, 0.5), ("-X",)), detectable=False),
    _plant("accelerometer X 5 mg off in -X", ASKEW, at_rest(FORCE, _added(0, 5e-3), ("-X",))),
    _plant("accelerometer X 5 mg up on the table", ASKEW, turning(FORCE, _added(0, 5e-3))),
    _plant("bias of Z jumps by 20 mg in -Z", ASKEW, at_rest(FORCE, _from(2, 0.5, 2e-2), ("-Z",))),
    _plant("bias of Z drifts by 20 mg in -Z", ASKEW, at_rest(FORCE, _ramp(2, 2e-2), ("-Z",))),
    _plant("spikes of the accelerometers", ASKEW | {"outliers-rejected"},
        every(FORCE, _spikes(0.2)), detectable=False),
    _plant("accelerometers clipped at 0.999 g", STUCK, every(FORCE, _clipped(0.999))),
    _plant("accelerometers clipped at 0.9 g", STUCK, every(FORCE, _clipped(0.9))),
    _plant("accelerometers in steps of 1 mg", STUCK, every(FORCE, _in_steps(1e-3))),
    _plant("accelerometers in steps of 10 mg", STUCK, every(FORCE, _in_steps(1e-2))),
    _plant("pose -X stood 3 deg off", ASKEW, at_rest(FORCE, _turned_about(3.0), ("-X",))),
    _plant("poses -X and -Y exchanged", ASKEW, _called(BUMP)),
    _plant("pose -X stood as X", ASKEW, at_rest(FORCE, _scaled(0, -1.0), ("-X",))),
    _plant("pose -Y has the samples of -X", ASKEW | STUCK, _copied("-Y", "-X")),
    _plant("mountings X and Y exchanged", ASKEW, _mounted_as({"X": "Y", "Y": "X"})),
    _plant("mounting X stood 2 deg off", ASKEW, turning(FORCE, _turned_about(2.0), ("X",))),
    _plant("gravity of another place, 0.3 %", ASKEW,
        lambda data: replace(data, gravity_g=1.003 * data.gravity_g), detectable=False),
    _plant("magnetometer X inverted", FIELDS, every(FIELD, _scaled(0, -1.0))),
    _plant("magnetometer inverted", FIELDS, every(FIELD, lambda v: -v)),
    _plant("magnetometer X and Y exchanged", FIELDS, every(FIELD, _columns(1, 0, 2))),
    _plant("magnetometer in uT", FIELDS, every(FIELD, lambda v: 1e-3 * v)),
    _plant("magnetometer in mG", FIELDS, every(FIELD, lambda v: 1e-2 * v)),
    _plant("magnetometer Y a copy of X", FIELDS | STUCK, every(FIELD, _columns(0, 0, 2))),
    _plant("magnetometer X reads zero", FIELDS | STUCK, every(FIELD, _scaled(0, 0.0))),
    _plant("magnetometer X held on mounting Y", FIELDS | STUCK, turning(FIELD, _held(0), ("Y",))),
    _plant("magnetometer clipped at 45 uT", STUCK, every(FIELD, _clipped(45_000.0))),
    _plant("magnetometer clipped at 25 uT", STUCK, every(FIELD, _clipped(25_000.0))),
    _plant("magnetometer in steps of 3 uT", STUCK, every(FIELD, _in_steps(3_000.0))),
    _plant("iron near pose -Z, 500 nT", FIELDS, at_rest(FIELD, _added(0, 500.0), ("-Z",)),
        detectable=False),
    _plant("iron comes near with mounting Z, 2 uT", FIELDS,
        turning(FIELD, _added(0, 2_000.0), ("Z",))),
    _plant("offset of Y jumps by 3 uT for mounting X", FIELDS,
        turning(FIELD, _added(1, 3_000.0), ("X",))),
    _plant("field of the motor, 500 nT at 100 deg/s", FIELDS, _with_rate(500.0)),
    _plant("spikes of the magnetometer", FIELDS | {"outliers-rejected"},
        every(FIELD, _spikes(2e4)), detectable=False),
    _plant("earth's field stated 3 % off", FIELDS, lambda data: replace(
        data, field_nT=None if data.field_nT is None else 1.03 * data.field_nT),
        detectable=False),
)
# fmt: on
CLEAN = tuple(lambda seed, kind=kind: made(*clean(seed, kind)) for kind in range(len(KINDS)))
