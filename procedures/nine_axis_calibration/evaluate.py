"""From data to findings: a run's rows to the dataset, the analysis, and the type B inputs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procedures.common.constants import ARCMIN_PER_RAD, FULL_TURN_DEG, SECONDS_PER_HOUR
from procedures.common.gyro_source import IMU
from procedures.common.homogeneity import at_device
from procedures.common.inputs import Declared, with_unstated
from procedures.common.sensing import ACCELEROMETERS, GYROS
from procedures.estimation.alignment import align, unwrapped
from procedures.estimation.direction import latitude_input
from procedures.estimation.turn_track import SHORT_S, track
from station.errors import MissingRows
from station.findings import (
    Analysis,
    Findings,
    FlagThresholds,
    InputQuantity,
    extremes,
    findings_of,
)

from .all_axes.channels import screened
from .all_axes.coil import sound_mean
from .all_axes.reading import other_axes, pose
from .all_axes.results import OtherResults, prior_rows, results_of, with_rows
from .all_axes.stands import CoilRecord, OtherAxes, Turned
from .analysis import USUAL_LIMITS, analyse
from .dataset import AXES, Array, Mask, NineAxisDataset, Prior, StaticRecord, TurnRecord
from .findings import NineAxisAnalysis
from .from_import import Conditions, dataset_of_import
from .in_coil import GAUSSMETER
from .measuring import ACCELEROMETER_BITS, GYRO_BITS, UP_SENSE, pose_limits
from .outlook import RATE, prior_of
from .parameters import COILS, NineAxisParameters
from .placing import TURNTABLE
from .trials import Recorded, trials_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder


PPM = 1e-6
NT_PER_MT, NT_PER_T = 1e6, 1e9
INPUTS: Declared = {
    "time_scale": ("rate of the clock of the samples", "1"),
    "encoder_angle_deg": ("angle of the table", "deg"),
}
"""What the results depend on, beside the priors and the latitude."""
ARRIVAL = "arrival_time_s"
POSITION, POSE, TURN, COIL = "position", "pose", "rate_deg_per_s", "coil"
"""What the event of a finished unit holds: its position, what points up, the rate of its turns, or
the coil that was driven."""
MAGNETOMETER = tuple(f"magnetometer_{axis}_nT" for axis in "xyz")
LATE_S = 0.3
"""Outputs of a record may reach the computer so long after its end."""
USUAL = 1.5


def findings_of_run(folder: RunFolder, parameters: NineAxisParameters, bench: Bench) -> Findings:
    """Return what a run's finished units say, type B inputs from plan and bench file."""

    dataset, others = records_of_run(folder, parameters, bench)
    inputs = [*prior_inputs(dataset.prior, "the plan"), *bench_inputs(parameters, bench)]
    u_arcmin = parameters.latitude_uncertainty_arcmin
    latitude_rad = math.radians(dataset.latitude_deg)
    inputs.append(latitude_input(latitude_rad, u_arcmin, "the plan"))
    findings = findings_with(
        dataset,
        others,
        inputs,
        thresholds=FlagThresholds(**dict(parameters.thresholds)),
        limits=pose_limits(parameters),
    )
    if others is None or others.coil is None:
        return findings
    coil = others.coil
    if coil.at_device is not None:  # the record is of what the probe read
        back = np.asarray(np.linalg.inv(coil.at_device.matrix), dtype=np.float64)
        coil = coil.carried(back)
    fields_mT = extremes(coil.applied_nT.ravel() / NT_PER_MT)
    return replace(findings, measured={(GAUSSMETER, "field"): fields_mT})


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; its type B inputs are the priors it names."""
    dataset, others = dataset_of_import(raw)
    source = "the dataset's conditions"
    inputs = with_unstated(prior_inputs(dataset.prior, source), INPUTS)
    u_arcmin = raw.conditions(Conditions).latitude_uncertainty_arcmin
    inputs.append(latitude_input(math.radians(dataset.latitude_deg), u_arcmin, source))
    return findings_with(dataset, others, inputs)


def findings_with(
    dataset: NineAxisDataset,
    others: OtherAxes | None,
    inputs: Sequence[InputQuantity],
    **chosen: Any,
) -> Findings:
    """Return what the gyros' records say, and those of the other six axes where there are any."""
    recorded = Recorded(dataset, others)
    analysis = analysed(recorded, **chosen)
    findings = findings_of(analysis, dataset, inputs)
    other_results = analysis.others
    if others is not None and other_results is not None:
        findings = with_other_axes(findings, other_results)
        estimates = with_rows([*findings.estimates], other_results)
        rows = [*findings.inputs, *prior_rows(others)]
        findings = replace(findings, estimates=estimates, inputs=rows)
    return replace(findings, trials=trials_of(analysis, recorded, partial(tried_again, **chosen)))


def analysed(recorded: Recorded, **chosen: Any) -> NineAxisAnalysis:
    """Return the analysis of the gyros with that of the other six axes."""
    dataset, others = recorded.dataset, recorded.others
    if others is None:
        return analyse(dataset, **chosen)
    other_results = results_of(others)
    gyros = analyse(dataset, **chosen, inertial=other_results.inertial)
    upright = others
    if not all(summary.pose.right for summary in gyros.static):
        limits = chosen.get("limits", USUAL_LIMITS)
        upright = standing_as_stated(others, len(gyros.static), limits.acceleration_g)
    if len(upright.rests) < len(others.rests):
        other_results = results_of(upright)
        gyros = analyse(dataset, **chosen, inertial=other_results.inertial)
    return replace(gyros, others=other_results)


def tried_again(recorded: Recorded, **chosen: Any) -> Analysis:
    """Return what a trial of all records gives, without what the report alone needs."""
    analysis = analysed(recorded, allan=False, **chosen)
    findings = findings_of(analysis, recorded.dataset, ())
    if analysis.others is not None:
        findings = with_other_axes(findings, analysis.others)
    return Analysis(findings.estimates, (), ())


def standing_as_stated(others: OtherAxes, positions: int, off_g: float) -> OtherAxes:
    """Return the data of the other axes without positions whose gravity lies along another axis.

    Positions are the first stands. Such a one moves the accelerometers' fit, and the fit what all
    others seem: the outputs as they were read say which it is, by more than `off_g`. Where most are
    off the outputs are wrong, and all stay.
    """
    felt = [rest.acceleration_g.mean(axis=0) for rest in screened(others)[0].rests[:positions]]
    # An axis that felt nothing is NaN, which is off by nothing.
    off = [
        bool(np.any(np.abs(force - rest.up) > off_g))
        for force, rest in zip(felt, others.rests, strict=False)
    ]
    if 2 * sum(off) >= len(others.rests):
        return others
    kept = (rest for rest, leave in zip_longest(others.rests, off) if not leave)
    return replace(others, rests=tuple(kept))


def with_other_axes(findings: Findings, other_results: OtherResults) -> Findings:
    """Return findings with those of accelerometers and magnetometer.

    Where the accelerometers are determined and turned with the gyros, the misalignments are those
    to them, and no mounting is in their uncertainty.
    """
    own = {(estimate.name, estimate.axis): estimate for estimate in other_results.misalignment}
    estimates = [
        own.get((estimate.name, estimate.axis), estimate) for estimate in findings.estimates
    ]
    return replace(
        findings,
        estimates=[*estimates, *other_results.estimates],
        published=[*findings.published, *other_results.published],
        flags=[*findings.flags, *other_results.flags],
        inputs=[*findings.inputs, *other_results.inputs],
    )


def prior_inputs(prior: Prior, source: str) -> Iterator[InputQuantity]:
    """Yield what is known of the set-up, each in units of its own standard uncertainty."""
    described = {
        "heading": f"heading of the plate, {prior.heading_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "relative_heading": "heading from position to position, "
        f"{prior.relative_heading_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "tilt": f"tilt of each position, {prior.tilt_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "accelerometer_bias": f"accelerometer biases, {prior.accelerometer_bias_g:.3g} g",
        "misalignment": "misalignment of the gyros' input axes",
        "mounting": "mounting of the sensor on the table, "
        f"{prior.mounting_rad * ARCMIN_PER_RAD:.3g} arcmin",
        "table_axes": "axes of the table, "
        f"{prior.table_axes_rad * ARCMIN_PER_RAD * 60.0:.3g} arcsec",
    }
    for name, text in described.items():
        yield InputQuantity(f"prior_{name}", text, 1.0, "1", source)


def bench_inputs(parameters: NineAxisParameters, bench: Bench) -> Iterator[InputQuantity]:
    """Yield what is known of the station's clock, and of the table's angle by its record."""
    clock = parameters.prior.clock_ppm
    yield InputQuantity("time_scale", "rate of the station's clock", clock * PPM, "1", "the plan")
    # Both ends of a part turn are read: root two of one reading.
    stated = (TURNTABLE, "angle", FULL_TURN_DEG, "deg")
    about = "angle of the table"
    yield from bench.stated_input(stated, "encoder_angle_deg", about, factor=math.sqrt(2.0))


def dataset_of_run(
    folder: RunFolder,
    parameters: NineAxisParameters,
    bench: Bench,
    kinds: tuple[str, ...] = (POSITION, TURN),
) -> NineAxisDataset:
    """Return all finished positions and turns of a run, or one of these kinds.

    Times are run time. An output that the sensor itself calls not valid counts as beyond its range.
    """
    return records_of_run(folder, parameters, bench, kinds)[0]


def records_of_run(
    folder: RunFolder,
    parameters: NineAxisParameters,
    bench: Bench,
    kinds: tuple[str, ...] = (POSITION, POSE, TURN, COIL),
) -> tuple[NineAxisDataset, OtherAxes | None]:
    """Return what the gyros are calibrated by, and what the other six axes are."""
    units = [
        (unit, details)
        for unit, details in folder.finished_units().items()
        if any(kind in details for kind in kinds)
    ]
    sensor = bench.instruments.get(IMU)
    limit = sensor.limits.get(RATE) if sensor is not None else None
    interval_s = 1.0 / parameters.sample_rate_Hz
    static, fields, poses, turned = [], [], [], []
    levels: list[tuple[Array, Array, Array]] = []
    for unit, details in units:
        if TURN in details:
            record = turn_record(folder, unit, details, interval_s, bench)
            turned.append((str(details["axis"]), record))
            continue
        rows, time_s = at_rest(folder, unit, details, interval_s)
        if COIL in details:
            levels += level_means(folder, unit, details, magnetometer(rows))
            continue
        if POSE in details:
            felt = accelerometers(rows), magnetometer(rows)
            poses.append(pose(parameters.prior, str(details[POSE]), time_s, *felt))
            continue
        position = int(details[POSITION])
        rate_deg_per_h = gyros(rows) * SECONDS_PER_HOUR
        static.append(StaticRecord(position, time_s, rate_deg_per_h, accelerometers(rows)))
        fields.append(magnetometer(rows))
    dataset = NineAxisDataset(
        latitude_deg=parameters.latitude_deg,
        prior=prior_of(parameters.prior),
        static=tuple(static),
        turns=tuple(record.turn for word, record in turned if word in AXES),
        largest_rate_deg_per_s=parameters.range_deg_per_s or limit or np.inf,
    )
    latitude_deg = parameters.latitude_deg
    coil = coil_record(levels, parameters, bench) if levels else None
    others = other_axes(
        parameters, latitude_deg, static, fields, turned, poses, coil, source="the plan"
    )
    return dataset, others


def level_means(
    folder: RunFolder, unit: str, details: Mapping[str, Any], output_nT: Array | None
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield what was commanded, read and felt in a field of the coil, means in nT, (3,) each.

    Nothing where the sensor has no magnetometer. Of the gaussmeter's averages the first are left
    out, which the field's settling may be in.
    """
    rows = folder.rows(GAUSSMETER, unit)
    arrival_s = rows[ARRIVAL]
    rows = rows[(arrival_s >= details["from_s"] + LATE_S) & (arrival_s <= details["until_s"])]
    if not len(rows):
        raise MissingRows(unit, "the gaussmeter said nothing while the field was steady")
    if output_nT is None:
        return
    commanded_nT = (
        NT_PER_MT
        * details["field_mT"]
        * np.array([details[COIL] == coil for coil in COILS], dtype=np.float64)
    )
    applied_nT = NT_PER_T * columns(rows, tuple(f"{coil}_T" for coil in COILS))
    yield commanded_nT, sound_mean(applied_nT), sound_mean(output_nT)


def coil_record(
    levels: Sequence[tuple[Array, Array, Array]], parameters: NineAxisParameters, bench: Bench
) -> CoilRecord:
    """Return the fields in the coil; the gaussmeter's record states what the plan does not.

    Of a record the part that grows with the reading is the gain's, the other the zero's. Where the
    bench states its coils' geometry the fields are those at the sensor.
    """
    commanded_nT, applied_nT, output_nT = (np.array(column) for column in zip(*levels, strict=True))
    prior, largest_nT = parameters.prior, float(np.abs(applied_nT).max())
    given = prior.gaussmeter_gain, prior.gaussmeter_zero_nT
    least, most = (
        bench.stated(GAUSSMETER, "field", at_nT / NT_PER_MT, "mT") for at_nT in (0.0, largest_nT)
    )
    zero_nT, gain_u, source = 0.0, 0.0, ""  # stated by nobody
    if least is not None and most is not None:
        zero_nT, source = NT_PER_MT * least[0], most[1]
        gain_u = max(NT_PER_MT * most[0] - zero_nT, 0.0) / largest_nT
    place = at_device(bench, "three_axis")
    record = CoilRecord(
        bench.corrected(GAUSSMETER, "field", applied_nT / NT_PER_MT, "mT") * NT_PER_MT,
        output_nT,
        given[0] or gain_u,
        given[1] or zero_nT,
        math.radians(prior.coil_alignment_deg),
        commanded_nT,
        "" if all(given) else source,
        place,
    )
    return record if place is None else record.carried(place.matrix)


def at_rest(
    folder: RunFolder, unit: str, details: Mapping[str, Any], interval_s: float
) -> tuple[NDArray[Any], Array]:
    """Return the outputs of a record at rest, what came while it settled left out, and times."""
    rows, time_s = outputs(folder, unit, details, interval_s)
    inside = (time_s >= details["from_s"] + interval_s) & (time_s <= details["until_s"])
    if not inside.any():
        raise MissingRows(unit, "the sensor said nothing while it was at rest")
    return rows[inside], time_s[inside]


def turn_record(
    folder: RunFolder, unit: str, details: Mapping[str, Any], interval_s: float, bench: Bench
) -> Turned:
    """Return the whole turns of one rate: as many outputs as they take at the measured rate.

    The table's angle is corrected by its record.
    """
    path = track(*readings(folder, unit, details))
    rows, time_s = outputs(folder, unit, details, interval_s)
    whole_s = details["turns"] * FULL_TURN_DEG / abs(path.rate_deg_per_s)
    from_s, until_s = path.known(details["from_s"], details["until_s"])
    inside = (time_s >= from_s + interval_s) & (time_s < from_s + whole_s + 1.5 * interval_s)
    count = round(whole_s / interval_s)
    place = np.flatnonzero(inside & (time_s <= until_s))
    if not len(place):
        raise MissingRows(unit, "the sensor said nothing while the table's angle was read")
    place = place[time_s[place] < time_s[place[0]] + (count - 0.5) * interval_s]
    record = TurnRecord(
        axis=AXES.index(str(details["axis"])[-1]),
        commanded_deg_per_s=float(details[TURN]),
        time_s=time_s[place],
        rate_deg_per_s=gyros(rows[place]),
        encoder_deg=bench.corrected(TURNTABLE, "angle", path.angle_deg(time_s[place]), "deg"),
        encoder_u_deg=path.end_u_deg,
    )
    return Turned(record, accelerometers(rows[place]), magnetometer(rows[place]))


def readings(
    folder: RunFolder, unit: str, details: Mapping[str, Any]
) -> tuple[Array, Array, Array]:
    """Return when a record's angles of the table were read, what they were, how long each took.

    Angles are positive as rates are.
    A reading is taken for one of the middle between question and answer. One that took longer than
    usual, as when others had the line, is left out: when it was made is unknown.
    """
    table = folder.rows(TURNTABLE, unit)
    asked_s, answered_s = table["asked_time_s"], table[ARRIVAL]
    inside = (asked_s >= details["from_s"]) & (answered_s <= details["until_s"])
    took_s = answered_s - asked_s
    if inside.any():
        inside &= took_s <= USUAL * float(np.median(took_s[inside])) + SHORT_S
    if int(inside.sum()) < 2:
        raise MissingRows(unit, "the table's angle was not read while it turned")
    middle_s = 0.5 * (asked_s + answered_s)
    return middle_s[inside], UP_SENSE * table["angle_deg"][inside], took_s[inside]


def outputs(
    folder: RunFolder, unit: str, details: Mapping[str, Any], interval_s: float
) -> tuple[NDArray[Any], Array]:
    """Return the outputs of a unit's record and the run time at which each interval ended (n,).

    A unit that was measured again holds the outputs of the refused attempts, too.
    """
    rows = folder.rows(IMU, unit)
    arrival_s = rows[ARRIVAL]
    near = (arrival_s >= details["from_s"]) & (arrival_s <= details["until_s"] + LATE_S)
    rows = rows[near]
    if len(rows) < 2:
        raise MissingRows(unit, "the sensor said nothing")
    number = unwrapped(rows["counter"])
    return rows, align(number, rows[ARRIVAL], interval_s).run_time_s(number)


def gyros(rows: NDArray[Any]) -> Array:
    """Return the gyros' output in deg/s, (n, 3); infinite where the sensor calls it not valid."""
    return np.where(invalid(rows, GYRO_BITS), np.inf, columns(rows, GYROS))


def accelerometers(rows: NDArray[Any]) -> Array:
    """Return the accelerometers' output in g, (n, 3); NaN where the sensor calls it not valid."""
    return np.where(invalid(rows, ACCELEROMETER_BITS), np.nan, columns(rows, ACCELEROMETERS))


def magnetometer(rows: NDArray[Any]) -> Array | None:
    """Return the magnetometer's output in nT, (n, 3); None of a sensor without one."""
    if not set(MAGNETOMETER) <= set(rows.dtype.names or ()):
        return None
    field_nT = columns(rows, MAGNETOMETER)
    return field_nT if np.isfinite(field_nT).any() else None


def columns(rows: NDArray[Any], names: tuple[str, ...]) -> Array:
    """Return some columns as an array (n, columns)."""
    return np.column_stack([rows[name].astype(np.float64) for name in names])


def invalid(rows: NDArray[Any], bits: Mapping[str, int]) -> Mask:
    """Return which outputs the sensor calls not valid, (n, bits)."""
    status = rows["status"].astype(np.int64)
    return np.asarray((status[:, None] >> np.array(list(bits.values()))) & 1 == 1)
