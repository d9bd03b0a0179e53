"""From data to findings: the analysis, with the type B inputs that the bench file states."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from procedures.common.homogeneity import entry
from procedures.common.inputs import Declared, cosine_u, with_unstated
from station.findings import (
    Covariance,
    Detail,
    Estimate,
    Findings,
    Flag,
    InputQuantity,
    extremes,
    finite,
    undetermined,
)
from station.uncertainty import combine

from .analysis import analyse
from .coils import (
    MISALIGNMENT,
    PROBE_ANGLE,
    CoilResponse,
    coil_responses,
    slope_by_misalignment,
    slopes_by_place,
)
from .dataset import AXES, METHOD, QUANTITY, UNDRIVEN, UNIT, RlgDataset
from .fitted import RlgAnalysis
from .from_import import Conditions, dataset_of_import
from .from_record import dataset_of_run, field_record, segment_of_unit
from .parameters import COIL_OF_AXIS, AnalysisSettings, RlgParameters
from .records import GAUSSMETER, GYRO, PlannedRecord, check_of, sensitivity_records
from .steadiness import Tested, background, flags_of, repeated
from .trials import trials_of

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset
    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

PROBE_COSINE = "probe_cosine"
INPUTS: Declared = {
    "field_gain": ("gain of the gaussmeter", "1"),
    "field_time_offset_s": ("alignment of the field's and the gyro's clocks", "s"),
    MISALIGNMENT: ("direction of the gaussmeter's axes to those of the gyro", "1"),
    PROBE_COSINE: ("probe to coil angle: cosine of the field", "1"),
    "gyro_scale": ("gyro scale: pulse weight and time base", "1"),
}
"""What the results depend on, beside axes that were not driven."""


@dataclass(frozen=True)
class RlgDetail(Detail):
    """With it, how the coils' fields lie and what the plan's checks say."""

    coils: Mapping[str, CoilResponse]
    tested: Sequence[Tested]


def findings_of_run(folder: RunFolder, parameters: RlgParameters, bench: Bench) -> Findings:
    """Return what a run's finished units say, type B inputs from the bench's calibrations."""
    finished = folder.finished_units()
    measured = [record for record in sensitivity_records(parameters) if record.unit in finished]
    missing = [
        axis for axis in parameters.axes if not any(axis in record.drive for record in measured)
    ]
    units = [record.unit for record in measured]
    dataset = dataset_of_run(folder, units, parameters, bench)
    inputs = type_b_inputs(folder, units, parameters, bench) + places(dataset)
    analysis = analyse(dataset, settings(parameters))
    tested = tested_results(folder, parameters, bench, analysis)
    inputs += undriven_inputs(analysis.estimates, settings(parameters))
    findings = to_findings(analysis, dataset, inputs, tested)
    trials = trials_of(analysis, dataset, settings(parameters))
    absent = [undetermined(QUANTITY, axis, UNIT, METHOD) for axis in missing]
    flags = [
        Flag("not-identifiable", f"{axis} was not measured to its end.", axis)
        if not folder.left_out
        else Flag("not-identifiable", f"{axis} has no record that is whole.", axis)
        for axis in missing
    ]
    flags += [*overload_flags(folder, measured), *target_flags(findings, parameters)]
    return replace(
        findings,
        estimates=[*findings.estimates, *absent],
        flags=[*findings.flags, *flags],
        trials=trials,
        measured={(GAUSSMETER, "field"): extremes(peaks_mT(analysis, dataset))},
    )


def peaks_mT(analysis: RlgAnalysis, dataset: RlgDataset) -> Iterator[float]:
    """Yield how large a field the probe saw along each driven coil: the line's amplitude, and the
    ambient field's magnitude with it.
    """
    for line in analysis.lines:
        ambient_mT = float(line.ambient_field_mT[AXES.index(line.axis)])
        at_device = dataset.at_device
        ratio = 1.0 if at_device is None else at_device.ratio(COIL_OF_AXIS[line.axis])[0]
        yield (abs(line.own_field_mT) + abs(ambient_mT)) / ratio


def tested_results(
    folder: RunFolder, parameters: RlgParameters, bench: Bench, analysis: RlgAnalysis
) -> list[Tested]:
    """Return what the finished records of the plan's checks say of the results."""
    limits, finished = settings(parameters), folder.finished_units()
    tested: list[Tested] = []
    for check in parameters.checks:
        units = [record.unit for record in check_of(parameters, check) if record.unit in finished]
        again = dataset_of_run(folder, units, parameters, bench)
        if check == "background":
            for segment in again.segments:
                tested += background(segment, parameters.amplitude_mT, limits)
        elif again.segments:
            reach = limits.checks_differ
            tested += repeated(check, analysis, analyse(again, limits), again.segments, reach)
    return tested


def target_flags(findings: Findings, parameters: RlgParameters) -> Iterator[Flag]:
    """Yield a flag for each result less certain than the plan's stop asked for."""
    asked = parameters.stop.uncertainty_deg_per_h_per_mT if parameters.stop else None
    if asked is None or parameters.stop is None:
        return
    combined = combine(findings.estimates, findings.inputs)
    for estimate, total in zip(findings.estimates, combined, strict=True):
        if total is None or total.standard_uncertainty <= asked:
            continue
        u = total.standard_uncertainty
        target_said = (
            f"The standard uncertainty of {estimate.axis} is {u:.2g} deg/h/mT, {asked:g} was asked "
            f"for; its record ended at its longest, {parameters.stop.at_most_s:g} s, or by an "
            "early decision, or the rest is what no longer record makes smaller (see the budget)."
        )
        yield Flag(
            "target-not-reached",
            target_said,
            estimate.axis,
            {"standard_uncertainty": u, "asked": asked},
        )


def estimates_so_far(
    folder: RunFolder,
    units: Iterable[str],
    parameters: RlgParameters,
    bench: Bench,
    unfinished: tuple[str, Mapping[str, Any]],
) -> tuple[Sequence[Estimate], Sequence[InputQuantity]]:
    """Return estimates and type B inputs from finished units and one that is being measured."""
    name, facts = unfinished
    finished = [unit for unit in units if unit in folder.finished_units() and unit != name]
    before = dataset_of_run(folder, finished, parameters, bench)
    now = segment_of_unit(folder, name, parameters, bench, facts)
    dataset = RlgDataset((*before.segments, now), before.at_device)
    inputs = type_b_inputs(folder, [*finished, name], parameters, bench) + places(dataset)
    analysis = analyse(dataset, settings(parameters))
    return to_findings(analysis, dataset, inputs, []).estimates, inputs


def overload_flags(folder: RunFolder, records: Iterable[PlannedRecord]) -> list[Flag]:
    """Return a flag for each record during which the gaussmeter said overload."""
    flags = []
    for record in records:
        count = field_record(folder, record.unit).overloaded
        if count:
            message = (
                f"The gaussmeter was overloaded in {count} readings of {record.unit}; they are "
                "left out."
            )
            axis = record.energised[0] if len(record.energised) == 1 else None
            flags.append(Flag("overload", message, axis, {"count": count}))
    return flags


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says; it brings no calibration records.

    Beside type A u holds what is stated of axes that were not driven.
    """
    dataset = dataset_of_import(raw)
    stated = raw.conditions(Conditions).undriven_sensitivity_deg_per_h_per_mT
    limits = AnalysisSettings(undriven_sensitivity=stated)
    analysis = analyse(dataset, limits)
    inputs = with_unstated(undriven_inputs(analysis.estimates, limits), INPUTS)
    findings = to_findings(analysis, dataset, inputs, [])
    return replace(findings, trials=trials_of(analysis, dataset, limits))


def settings(parameters: RlgParameters) -> AnalysisSettings:
    """Return the analysis settings of a plan."""
    stated = parameters.undriven_sensitivity_deg_per_h_per_mT
    return AnalysisSettings.model_construct(
        **dict(parameters.thresholds), undriven_sensitivity=stated
    )


def undriven_inputs(
    estimates: Sequence[Estimate], limits: AnalysisSettings
) -> Iterator[InputQuantity]:
    """Yield the sensitivities of the axes that were not driven: zero, uniform within
    what is stated.

    One cause for all results.
    """
    for axis in AXES:
        name = f"{UNDRIVEN}{axis}"
        if any(estimate.sensitivities.get(name) for estimate in estimates):
            about = f"sensitivity of {axis}, which was not driven"
            source = f"undriven_sensitivity, {limits.undriven_sensitivity:g} {UNIT} at most"
            yield InputQuantity(
                name, about, limits.undriven_u, UNIT, source, distribution="uniform"
            )


def type_b_inputs(
    folder: RunFolder, units: Sequence[str], parameters: RlgParameters, bench: Bench
) -> list[InputQuantity]:
    """Return what the data cannot determine: field scale, time alignment, and the gyro's scale."""
    inputs: list[InputQuantity] = []
    if not units:
        return inputs
    amplitude_mT = parameters.amplitude_mT
    inputs += bench.stated_input(
        (GAUSSMETER, "field", amplitude_mT, "mT"),
        "field_gain",
        f"gaussmeter at {amplitude_mT:g} mT",
        relative=True,
    )
    worst_s = max(time_offset_u_s(folder, unit) for unit in units)
    inputs.append(
        InputQuantity(
            "field_time_offset_s",
            "alignment of the gaussmeter's and the gyro's clocks",
            worst_s,
            "s",
            "earliest arrivals of this run",
        )
    )
    about = "direction of the gaussmeter's axes to those of the gyro"
    if any(field_record(folder, unit).unseen.any() for unit in units):
        about = (
            "components of the field that a probe of one axis does not see: angle to the gyro's "
            "axis"
        )
    stated = (GAUSSMETER, PROBE_ANGLE, 0.0, "rad")
    inputs += bench.stated_input(stated, MISALIGNMENT, about, unit="1")
    about = "gyro scale: pulse weight and the board's time base"
    inputs += bench.stated_input((GYRO, "scale", 1.0, "1"), "gyro_scale", about)
    angle_u_rad, source = bench.stated(GAUSSMETER, PROBE_ANGLE, 0.0, "rad") or (None, "")
    u = cosine_u(angle_u_rad)
    inputs.append(InputQuantity.if_stated(PROBE_COSINE, INPUTS[PROBE_COSINE][0], u, "1", source))
    return inputs


def places(dataset: RlgDataset) -> list[InputQuantity]:
    """Return where coils, probe and gyro are, as far as the bench states it."""
    return [] if dataset.at_device is None else [*dataset.at_device.inputs]


def time_offset_u_s(folder: RunFolder, unit: str) -> float:
    """Return the standard uncertainty of the field's times against the gyro's, s.

    A reading that was asked for had ended up to one averaging before, evenly spread.
    """
    aligned_u_s = field_record(folder, unit).aligned.offset_u_s
    facts = folder.finished_units().get(unit, {})
    if facts.get("field_timestamp") != "on-request":
        return aligned_u_s
    return math.hypot(aligned_u_s, float(facts["field_averaging_s"]) / math.sqrt(12.0))


def to_findings(
    analysis: RlgAnalysis,
    dataset: RlgDataset,
    inputs: list[InputQuantity],
    tested: Sequence[Tested],
) -> Findings:
    """Return an analysis in the station's own terms."""
    coils = coil_responses(analysis.lines, dataset.segments)
    estimates = [
        replace(
            estimate,
            sensitivities={
                **estimate.sensitivities,
                **slope_by_misalignment(estimate, analysis.estimates),
                **slopes_by_place(estimate, analysis.estimates, dataset.at_device),
                PROBE_COSINE: estimate.value or 0.0,
            },
            extra={
                **extra_of(estimate.axis or "", coils, tested),
                **entry(dataset.at_device, COIL_OF_AXIS[estimate.axis or ""]),
            },
        )
        for estimate in analysis.estimates
    ]
    flags = [*analysis.flags, *flags_of(tested)]
    detail = RlgDetail(analysis, dataset, coils, tested)
    return Findings(estimates, analysis.published, flags, inputs, detail, related(analysis))


def related(analysis: RlgAnalysis) -> Covariance:
    """Return the covariance of the sensitivities: all driven axes are solved together."""
    keys = tuple((QUANTITY, axis) for axis in analysis.determined)
    return Covariance(keys, tuple(map(tuple, analysis.covariance.tolist())))


def extra_of(
    axis: str, coils: Mapping[str, CoilResponse], tested: Sequence[Tested]
) -> dict[str, Any]:
    """Return what stands beside a result: its coil's field over the commanded one, its checks."""
    extra: dict[str, Any] = {}
    if axis in coils:
        components = coils[axis].components
        extra["coil_field"] = {a: finite(b) for a, b in zip(AXES, components, strict=True)}
    checks = [test.to_data() for test in tested if test.axis in (axis, None)]
    return extra | ({"checks": checks} if checks else {})
