"""What the results of a run on the simulated bench should be, by procedure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, reduce
from operator import getitem
from typing import Any

import numpy as np
from scipy.stats import t as student
from short_forms import BENCH, read_bench_at, short

from station.files.lookup import BENCHES, find

AT_A_MEAN_TEMPERATURE = ("K0", "Ki")
ARCSEC_PER_RAD = 3600.0 * 180.0 / math.pi
BY_CHANCE = 1e-6
"""How often a result that is right may lie further off. That is 4.9 u where a record leaves many
degrees of freedom, and 49 u at four: a campaign holds tens of thousands of results against this."""


def number(text: str) -> float:
    """Return the number of a quantity with its unit."""
    return float(str(text).split()[0])


def rlg_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return the sensitivity of the simulated laser gyro to the field of an axis."""
    return number(bench["simulation"]["gyro"]["magnetic_sensitivity"][result["axis"]])


def accelerometer_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return the sum of coefficients of the simulated accelerometer that a result stands for."""
    if result["value"] is None or result["name"] in AT_A_MEAN_TEMPERATURE:
        return None
    true = bench["simulation"]["accelerometer"]["coefficients"]
    return float(sum(factor * number(true[name]) for name, factor in result["terms"].items()))


def tumble_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return the sum of coefficients, or the angle, that a result of a tumble test stands for.

    The angle of the fixture is that to the encoder's zero.
    """
    true = {**bench["simulation"]["accelerometer"]["coefficients"], "Kop": "0 V/g^2"}
    fixture = number(bench["simulation"]["tumble"]["fixture_error"])
    scale = number(true["Ki"])
    true["Kf"] = f"{scale * fixture / ARCSEC_PER_RAD} V/g"
    if result["name"] == "fixture_error":
        return fixture
    if result["name"] == "misalignment":
        return number(true[f"K{result['axis']}"]) / scale * ARCSEC_PER_RAD
    if result["name"] in AT_A_MEAN_TEMPERATURE or "terms" not in result:
        return None
    return float(sum(factor * number(true[name]) for name, factor in result["terms"].items()))


def fog_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return the scale-factor error of a simulated gyro at the result's temperature."""
    if result["name"] != "scale_factor_error":
        return None
    gyros = bench["simulation"]["fog"]["gyros"]
    return fog_curve_ppm(gyros, result["axis"], result["reference_temperature"])


def fog_curve_ppm(gyros: Mapping[str, Any], axis: str, reading_degC: float) -> float:
    """Return the scale-factor error of a simulated gyro where its thermometer has a reading."""
    low, high = (number(gyros["temperature_range"][end]) for end in ("low", "high"))
    u = (2.0 * (reading_degC - number(gyros["sensor_offset"][axis])) - low - high) / (high - low)
    true = gyros[axis]["scale_factor_error"]
    return sum(number(text) * u ** int(power[1:]) for power, text in true.items())


def fog_curve_off(bench: Mapping[str, Any], result: Mapping[str, Any]) -> tuple[float, float]:
    """Return how far a curve lies from that of the simulated gyro over its range, at most.

    In ppm, and in half widths of the band of the whole curve.
    """
    gyros, band = bench["simulation"]["fog"]["gyros"], result["band"]
    off = [
        abs(value - fog_curve_ppm(gyros, result["axis"], heat_degC))
        for heat_degC, value in zip(band["temperature_degC"], band["value"], strict=True)
    ]
    wide = band["whole_curve_uncertainty"]
    return max(off), max(one / half for one, half in zip(off, wide, strict=True))


def serf_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return the angle between two coils of the simulated cell, or a coil's factor as a ratio."""
    serf = bench["simulation"]["serf"]
    if result["name"] == "nonorthogonality_angle":
        return number(serf["coils"]["angles"][result["axis"]])
    if result["name"] != "coil_factor" or not result["standard_uncertainty"]:
        return None
    if result["value"] == 1.0:  # the constants were taken as known
        return true_constant(bench, result["axis"])
    lights = (serf["pump"]["axis"], serf["detector"]["probe"]["axis"])
    alone = next(axis for axis in "xyz" if axis not in lights)
    return true_constant(bench, result["axis"]) / true_constant(bench, alone)


def true_constant(bench: Mapping[str, Any], axis: str) -> float:
    """Return by which factor a coil's field is larger than commanded, its generator included."""
    for one in bench["instruments"].values():
        for channel, coil in one.get("simulator", {}).get("coils", {}).items():
            if coil == axis:
                gain = number(one["simulator"]["gain_error"][channel])
                error = number(bench["simulation"]["serf"]["coils"][axis]["error"])
                return (1.0 + gain / 100.0) * (1.0 + error / 100.0)
    raise KeyError(axis)


def nine_axis_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return what a result of a simulated gyro should be, at the rates of the short plan.

    Its scale factor changes with the rate; K is the mean over the rates.
    """
    gyros = bench["simulation"]["nine_axis"]["sensor"]["gyros"]
    if result["name"] == "misalignment":
        return number(gyros["misalignment"][str(result["axis"]).lower()])
    own = gyros.get(str(result["axis"]).lower())
    if own is None or result["name"] not in ("bias", "scale_factor", "asymmetry"):
        return None
    if result["name"] != "scale_factor":
        return number(own[result["name"]])
    return nine_axis_scale_factor(own, short_rates("nine-axis-calibration"))


def nine_axis_scale_factor(gyro: Mapping[str, Any], rates: Sequence[float]) -> float:
    """Return the scale factor of a simulated gyro over rates in deg/s."""
    ripple, period = (number(gyro["ripple"][key]) for key in ("amplitude", "period"))
    mean = sum(math.sin(2.0 * math.pi * rate / period) for rate in rates) / len(rates)
    return (1.0 + 1e-6 * number(gyro["scale_factor_error"])) * (1.0 + 1e-6 * ripple * mean)


@lru_cache
def short_rates(plan: str) -> tuple[float, ...]:
    """Return the rates of the short form of a plan, in deg/s."""
    bench = read_bench_at(find(BENCHES, BENCH))
    rates: tuple[float, ...] = short(plan, bench).parameters.rates_deg_per_s
    return rates


def commissioning_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return the ambient field of the simulated bench along an axis in mT."""
    if result["name"] != "ambient_field":
        return None
    return number(bench["simulation"]["ambient_field"][result["axis"]])


def static_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return what the simulated laser gyro's angles scatter by: its walk, rounding and dither."""
    gyro = bench["simulation"]["gyro"]
    if result["axis"] != "IA":  # of the navigator or of the sensor
        return None
    if result["name"] == "angle_random_walk":
        return number(gyro["angle_random_walk"])
    if result["name"] != "quantisation_noise":
        return None
    rounding = number(gyro["pulse_weight"]) / math.sqrt(12.0)
    return math.hypot(rounding, number(gyro["dither_residual"]))


def rate_table_truth(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return scale factor or asymmetry of the simulated gyro at the rates of the short plan.

    K is the slope of the line through its response.
    """
    gyro = bench["simulation"]["rate_table"]
    if result["axis"] != "IA":  # of the navigator or of the sensor
        return None
    if result["name"] == "asymmetry":
        return number(gyro["asymmetry"])
    if result["name"] != "scale_factor":
        return None
    ripple, period = (number(gyro["ripple"][key]) for key in ("amplitude", "period"))
    rates = short_rates("gyro-rate-table")
    weight = sum(rate**2 for rate in rates)
    swing = sum(rate**2 * math.sin(2.0 * math.pi * rate / period) for rate in rates) / weight
    return (1.0 + 1e-6 * number(gyro["scale_factor_error"])) * (1.0 + 1e-6 * ripple * swing)


BIAS_SOURCES: Mapping[str, tuple[str, ...]] = {
    "bias_rate_sensitivity": ("rate_sensitivity",),
    "hysteresis": ("hysteresis", "size"),
    "sensor_lag": ("sensor_lag",),
    "chamber_lag": ("lag",),
}


def bias_temperature_truth(
    bench: Mapping[str, Any], result: Mapping[str, Any], soaks: Sequence[float] = ()
) -> float | None:
    """Return what the simulated gyro in the chamber does, the bias of its switch-on aside.

    Its sensitivity depends on the `soaks` of the plan, degC, its largest slope on the range.
    """
    own = bench["simulation"]["bias_temperature"]
    if (keys := BIAS_SOURCES.get(result["name"])) is not None:
        text = str(reduce(getitem, keys, own))
        return number(text) * (60.0 if text.endswith(" min") else 1.0)
    offset, warmer = (number(own[key]) for key in ("sensor_offset", "self_heating"))
    if result["name"] == "bias":
        at = number(result["conditions"]["temperature"])
        return float(bias_curve(bench, np.array([at - offset]))[0])
    if result["name"] == "bias_temperature_sensitivity" and soaks:
        ends = np.array(soaks) + warmer
        apart = ends[np.abs(ends - REFERENCE_DEGC) >= 5.0]
        change = bias_curve(bench, apart) - bias_curve(bench, np.array([REFERENCE_DEGC]))
        return float(np.max(np.abs(change / (apart - REFERENCE_DEGC))))
    if result["name"] == "largest_bias_slope" and soaks:
        low, high = min(soaks) + warmer, max(soaks) + warmer
        edge = 0.05 * (high - low)
        inner = np.linspace(low + edge, high - edge, 2001)
        return float(np.max(np.abs(np.gradient(bias_curve(bench, inner), inner))))
    return None


REFERENCE_DEGC = 20.0
"""Of the shipped plan of a bias over temperature."""


def bias_curve(bench: Mapping[str, Any], gyro_degC: np.ndarray) -> np.ndarray:
    """Return the bias in deg/h of the simulated gyro at temperatures (n,) at rest in mid-loop."""
    own = bench["simulation"]["bias_temperature"]
    low, high = (number(own["temperature_range"][end]) for end in ("low", "high"))
    u = (2.0 * gyro_degC - low - high) / (high - low)
    return np.asarray(sum(number(text) * u ** int(name[1:]) for name, text in own["curve"].items()))


def bias_temperature_short(bench: Mapping[str, Any], result: Mapping[str, Any]) -> float | None:
    """Return the same, but of a bias, whose switch-on has another one."""
    return None if result["name"] == "bias" else bias_temperature_truth(bench, result)


TRUTHS: Mapping[str, Callable[[Mapping[str, Any], Mapping[str, Any]], float | None]] = {
    "rlg-magnetic-sensitivity": rlg_truth,
    "accelerometer-magnetic-sensitivity": accelerometer_truth,
    "accelerometer-tumble": tumble_truth,
    "fog-scale-factor-temperature": fog_truth,
    "serf-nonorthogonality": serf_truth,
    "nine-axis-calibration": nine_axis_truth,
    "commissioning": commissioning_truth,
    "gyro-static-noise": static_truth,
    "gyro-rate-table": rate_table_truth,
    "gyro-bias-temperature": bias_temperature_short,
}
"""What a result of a procedure should be; None where the world has no one number for it."""


def off_the_truth(bench: Mapping[str, Any], document: Mapping[str, Any]) -> Iterator[str]:
    """Yield each result of a document that lies too far from what the bench's world knows."""
    true_of = TRUTHS.get(str(document["procedure"]))
    for result in document["results"]:
        true = true_of(bench, result) if true_of and result["value"] is not None else None
        if true is None:
            continue
        off_u = abs(result["value"] - true) / result["standard_uncertainty"]
        degrees = result["degrees_of_freedom"] or math.inf
        if off_u > student.isf(BY_CHANCE / 2, degrees):
            yield (
                f"{result['name']} {result['axis']} is {off_u:.1f} u off the truth, "
                f"{degrees:.3g} degrees of freedom"
            )
