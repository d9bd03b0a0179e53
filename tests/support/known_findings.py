"""Findings of made data, of each procedure, with every input stated; and the true results."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import accelerometer_records
import bias_records
import fog_records
import numpy as np
import rate_records
import rlg_records
import static_records
import tumble_records
from nine_axis_stands import Bench, truth_of, write
from serf_shots import Cell
from trials import trials_in, with_inputs

from procedures.accelerometer_magnetic_sensitivity import analysis as accelerometer_analysis
from procedures.accelerometer_magnetic_sensitivity import evaluate as accelerometer
from procedures.accelerometer_magnetic_sensitivity.parameters import (
    AnalysisSettings as AccelerometerSettings,
)
from procedures.accelerometer_tumble import analysis as tumble_analysis
from procedures.accelerometer_tumble import evaluate as tumble
from procedures.accelerometer_tumble.dataset import AnalysisSettings as TumbleSettings
from procedures.accelerometer_tumble.solution import ENCODER, MOUNTING
from procedures.common.inputs import with_unstated
from procedures.estimation.direction import with_latitude
from procedures.fog_scale_factor_temperature import analysis as fog_analysis
from procedures.fog_scale_factor_temperature import evaluate as fog
from procedures.fog_scale_factor_temperature.parameters import AnalysisSettings as FogSettings
from procedures.fog_scale_factor_temperature.trials import trials_of as fog_trials
from procedures.gyro_bias_temperature import evaluate as bias
from procedures.gyro_bias_temperature.parameters import BiasTemperatureParameters
from procedures.gyro_rate_table import dataset as rate_dataset
from procedures.gyro_rate_table import evaluate as rate
from procedures.gyro_static_noise import dataset as static_dataset
from procedures.gyro_static_noise import evaluate as static
from procedures.nine_axis_calibration import evaluate as nine_axis
from procedures.rlg_magnetic_sensitivity import analysis as rlg_analysis
from procedures.rlg_magnetic_sensitivity import evaluate as rlg
from procedures.rlg_magnetic_sensitivity.dataset import RlgDataset
from procedures.rlg_magnetic_sensitivity.frequencies import Drive
from procedures.rlg_magnetic_sensitivity.parameters import AnalysisSettings as RlgSettings
from procedures.rlg_magnetic_sensitivity.trials import trials_of as rlg_trials
from procedures.serf_nonorthogonality import evaluate as serf
from procedures.serf_nonorthogonality.parameters import AnalysisSettings as SerfSettings
from station.dataset_reading import read_dataset
from station.findings import Findings, InputQuantity, Key
from station.reanalysis.monte_carlo import deviating, deviations_of
from station.uncertainty import combine

ACCELEROMETER_U = {
    "field_gain": 0.003,
    "field_offset_T": 2e-6,
    "voltage_gain": 2e-5,
    "voltage_offset_V": 1e-5,
    "graduation_sine_rad": 5e-6,
    "graduation_cosine_rad": 5e-6,
    "local_gravity": 1e-5,
    "stage_angle_rad": 2e-5,
    "probe_cosine": 1e-3,
    "ambient_field_T": 3e-6,
}
"""Of each input that one number states."""
ANGLES = tuple(("nonorthogonality_angle", axes) for axes in ("xy", "xz", "yz"))


@dataclass(frozen=True)
class Known:
    """What an analysis says of made data, and the true results.

    `in_the_data` are inputs whose deviations the data already have.
    """

    findings: Findings
    truth: Mapping[Key, float]
    in_the_data: frozenset[str] = frozenset()


def laser_gyro(seed: int) -> Known:
    """Return a record of one of two axes at a time, whose coils lean."""
    drive = {"IA": Drive(0.1, 1.0), "NA": Drive(0.13, 0.8)}
    sensitivity = {"IA": 0.05, "NA": -0.02}
    lean = np.array([[1.0, 0.05, -0.03], [0.02, 1.0, 0.01], [0.0, 0.0, 1.0]])
    both = rlg_records.record(2 * seed, sensitivity, drive=drive, coils=lean)
    dataset = RlgDataset((both, rlg_records.record(2 * seed + 1, sensitivity, coils=lean)))
    settings = RlgSettings()
    analysis = rlg_analysis.analyse(dataset, settings)
    inputs = with_unstated(rlg.undriven_inputs(analysis.estimates, settings), rlg.INPUTS)
    findings = rlg.to_findings(analysis, dataset, inputs, [])
    findings = replace(findings, trials=rlg_trials(analysis, dataset, settings))
    names = {name for e in findings.estimates for name in e.sensitivities}
    u = {
        "field_gain": 0.005,
        "field_time_offset_s": 0.005,
        "probe_cosine": 0.001,
        "gyro_scale": 0.003,
        **{name: 0.01 for name in names if name.startswith("undriven_")},
    }
    truth = {("magnetic_sensitivity", axis): size for axis, size in sensitivity.items()}
    return Known(with_inputs(findings, **u), truth)


def accelerometer_in_field(seed: int) -> Known:
    """Return a record in two planes."""
    record = accelerometer_records.record(seed)
    findings = accelerometer._findings(record, AccelerometerSettings(), [])
    terms = accelerometer_analysis.analyse(record).identifiability.terms
    stated = with_inputs(findings, **ACCELEROMETER_U)
    return Known(stated, _of_terms(terms, accelerometer_records.TRUTH))


def coils_of_a_cell(seed: int) -> Known:
    """Return fourteen shots of a cell whose coils' constants nobody knows."""
    cell = Cell(residual_nT=(1.0, -0.6, 0.8))
    dataset = cell.dataset(seed)
    inputs = with_unstated(serf.common_inputs(dataset), serf.INPUTS)
    findings = serf._findings(dataset, SerfSettings(), inputs)
    u = {"sample_clock": 1e-4, "gyromagnetic_ratio": 1e-4}
    u |= {f"coil_{axis}": 2e-4 for axis in "xyz"} | {f"residual_{axis}_nT": 0.01 for axis in "xyz"}
    truth = dict(zip(ANGLES, cell.angles_deg, strict=True))
    return Known(with_inputs(findings, **u), truth)


def fibre_gyro_over_temperature(seed: int) -> Known:
    """Return turns of one sense, in which the gyro's bias is."""
    dataset = fog_records.record(seed, (360,), bias_deg_per_h=0.0)
    analysis = fog_analysis.analyse(dataset)
    again = partial(fog._tried, settings=FogSettings())
    findings = fog.to_findings(analysis, dataset, [], "the test")
    heat = np.array(dataset.reference_temperature_degC)
    truth = {("scale_factor_error", "x"): float(fog_records.quartic(heat))}
    return Known(replace(findings, trials=fog_trials(analysis, dataset, again)), truth)


def nine_axes(seed: int) -> Known:
    """Return all stands and turns of a sensor; how they lean is in the data."""
    bench = Bench(seed)
    with tempfile.TemporaryDirectory() as folder:
        raw = read_dataset(write(bench.data(), Path(folder)))
        findings = nine_axis.findings_of_dataset(raw)
    there = frozenset(q.name for q in findings.inputs if q.standard_uncertainty)
    stated = {"latitude": 1e-3, "time_scale": 1e-6, "prior_local_gravity": 1e-5}
    kept = [q for q in findings.inputs if q.name not in stated]
    findings = with_inputs(findings, **stated)
    findings = replace(findings, inputs=[*kept, *findings.inputs])
    return Known(findings, truth_of(bench.sensor), there)


def bias_over_temperature(seed: int) -> Known:
    """Return a record of a board's pulses in a chamber."""
    gyro = bias_records.CASES["fibre-optic"]
    dataset = bias_records.record(gyro, seed)
    given = BiasTemperatureParameters.model_construct(
        attitude_uncertainty_arcmin=3.4,
        thermometer_uncertainty_degC=0.5,
        latitude_uncertainty_arcmin=3.4,
    )
    inputs = _inputs(clock=1e-5, pulse_weight=1e-5)
    findings = bias._findings(dataset, given, "the test", more=inputs)
    findings = replace(findings, estimates=[bias._by_board(dataset, e) for e in findings.estimates])
    truth = bias_records.truths(gyro, dataset)
    return Known(findings, {(name, "IA"): value for name, value in truth.items()})


def rate_table(seed: int) -> Known:
    """Return four switch-ons of a gyro whose scale factor scatters."""
    gyro = rate_records.Gyro(scatter_ppm=3.0, repeats=4, K=0.05)
    made = rate_records.made(np.random.default_rng((seed, 3)), gyro)
    inputs = _inputs(clock=2e-6, pulse_weight=2e-6, alignment=2e-6, level=1e-3)
    findings = rate._findings({"IA": made.dataset}, rate_dataset.AnalysisSettings(), inputs)
    latitude = rate_records.LATITUDE_RAD
    findings = with_latitude(findings, {"IA": rate.UPWARDS}, latitude, 3.4, "the test")
    return Known(findings, {(name, "IA"): value for name, value in made.truth.items()})


def gyro_at_rest(seed: int) -> Known:
    """Return one switch-on of a laser gyro."""
    device, level = static_records.DEVICES["RLG"], 0.35
    dataset = static_records.records(np.random.default_rng((seed, 4)), device, (3000,))
    inputs = _inputs(clock=0.01, pulse_weight=0.01, azimuth_IA=1e-3, elevation_IA=1e-3)
    findings = static._findings(dataset, static_dataset.AnalysisSettings(), inputs)
    latitude = static_records.LATITUDE_RAD
    findings = with_latitude(findings, dataset.directions, latitude, 3.4, "the test")
    first = np.random.default_rng((seed, 4)).standard_normal()
    truth = {"bias": level + device["switch_on"] * first, "angle_random_walk": device["N"]}
    return Known(findings, {(name, "IA"): value for name, value in truth.items()})


def accelerometer_in_gravity(seed: int) -> Known:
    """Return a tumble test; how encoder and mountings are off is in the data."""
    stage = tumble_records.Stage(positions=12)
    dataset = tumble_records.made(np.random.default_rng((seed, 5)), stage)
    u = {"multimeter_gain": 2e-6, "multimeter_zero": 2e-6, "local_gravity": 1e-6}
    inputs = _inputs(**u, **{ENCODER: 1.0, MOUNTING: 1.0})
    findings = tumble._findings(dataset, TumbleSettings(), inputs)
    truth = _of_terms(tumble_analysis.analyse(dataset).terms, tumble_records.QUARTZ)
    return Known(findings, truth, frozenset((ENCODER, MOUNTING)))


def _of_terms(
    terms: Mapping[str, Mapping[str, float]], true: Mapping[str, float]
) -> dict[Key, float]:
    return {
        (name, None): sum(share * true.get(part, 0.0) for part, share in of.items())
        for name, of in terms.items()
    }


def _inputs(**u: float) -> list[InputQuantity]:
    return [InputQuantity(name, name, own, "1", "the test") for name, own in u.items()]


KNOWN: Mapping[str, Callable[[int], Known]] = {
    "rlg-magnetic-sensitivity": laser_gyro,
    "accelerometer-magnetic-sensitivity": accelerometer_in_field,
    "serf-nonorthogonality": coils_of_a_cell,
    "fog-scale-factor-temperature": fibre_gyro_over_temperature,
    "nine-axis-calibration": nine_axes,
    "gyro-static-noise": gyro_at_rest,
    "gyro-rate-table": rate_table,
    "accelerometer-tumble": accelerometer_in_gravity,
    "gyro-bias-temperature": bias_over_temperature,
}
"""By procedure what makes data of a seed and analyses them."""


def errors_of(procedure: str, seed: int) -> dict[str, tuple[float, bool]]:
    """Return by result its error over its u, and whether U covers it, every input drawn.

    NaN stands for a result that the data leave undetermined.
    """
    known = KNOWN[procedure](seed)
    trials, random = trials_in(known.findings), np.random.default_rng((seed, 99))
    inputs = [q for q in known.findings.inputs if q.name not in known.in_the_data]
    deviations = deviations_of(known.findings.estimates, inputs, trials)
    drawn = [each.drawn(random) for each in deviations]
    dataset = deviating(trials, trials.dataset, deviations, drawn, random)
    # An analysis alone does not know what its findings were told of afterwards, such as a latitude.
    told = {(e.name, e.axis): e.sensitivities for e in known.findings.estimates}
    estimates = [
        replace(e, sensitivities={**told[e.name, e.axis], **e.sensitivities})
        for e in trials.analyse(dataset).estimates
    ]
    errors = {}
    combined = combine(estimates, known.findings.inputs)
    for estimate, whole in zip(estimates, combined, strict=True):
        key = estimate.name, estimate.axis
        if key not in known.truth:
            continue
        name = f"{estimate.name} {estimate.axis or ''}".strip()
        errors[name] = math.nan, False
        if estimate.value is not None and whole is not None:
            moved = sum(
                d.sensitivities.get(key, 0.0) * by for d, by in zip(deviations, drawn, strict=True)
            )
            off = estimate.value + moved - known.truth[key]
            errors[name] = off / whole.standard_uncertainty, abs(off) <= whole.expanded_uncertainty
    return errors
