"""The figures of a rotary stage from an accelerometer on it: a pure function of a dataset.

The output is K0 + K sin(angle + zero): outputs half a turn apart separate the zero from the bias.
With the input axis along the axis of rotation it is K0 + K sin(lean), whatever the angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, Flag, undetermined

from .limits import CLOSURE_DEG, COVERAGE, FAR_DEG, LEAN_DEG, RESPONSE, ZERO_DEG

Array = NDArray[np.float64]
MOUNTING, ANGLE = "mounting_deg", "stage_angle_deg"


@dataclass(frozen=True)
class StageDataset:
    """Mean outputs in V: `turning_V` (5,) at 0, 90, 180, 270, 360 deg, `along_V` (4,).

    `u_V` is the standard uncertainty of the noisiest; `encoder_deg` (5,) is what the encoder reads
    beyond its set-points; `mounting_u_deg` and `angle_u_deg` are those of the device's mounting
    and of the stage's angle by its calibration record.
    """

    turning_V: Array
    along_V: Array
    u_V: float
    encoder_deg: Array
    scale_factor_V_per_g: float
    mounting_u_deg: float
    angle_u_deg: float = 0.0


def analyse(data: StageDataset) -> Analysis:
    """Return response, zero, closure and lean of the stage, and the causes of what is wrong."""
    at = dict(zip((0, 90, 180, 270, 360), data.turning_V.tolist(), strict=True))
    sine_V, cosine_V = (at[0] - at[180]) / 2.0, (at[90] - at[270]) / 2.0
    gain_V, bias_V = math.hypot(sine_V, cosine_V), (at[0] + at[180]) / 2.0
    u_deg = math.degrees(data.u_V / gain_V) * math.sqrt(0.5)
    sense = math.copysign(1.0, cosine_V)
    read_deg = (data.encoder_deg[0] + data.encoder_deg[2]) / 2.0
    zero_deg = math.degrees(math.atan2(sense * sine_V, abs(cosine_V))) - read_deg
    slope_V = max(abs(cosine_V), 1e-9) * sense
    closure_deg = math.degrees((at[360] - at[0]) / slope_V) - float(
        data.encoder_deg[4] - data.encoder_deg[0]
    )
    lean_deg = math.degrees((float(data.along_V.mean()) - bias_V) / gain_V)
    closure = _of("stage_closure", closure_deg, 2.0 * u_deg, {}, "outputs at 0 and 360 deg")
    if abs(zero_deg) > FAR_DEG:
        closure = undetermined(
            "stage_closure", None, "deg", "the output does not change with angle"
        )
    response_u = data.u_V / data.scale_factor_V_per_g * math.sqrt(0.5)
    both = {MOUNTING: 1.0, ANGLE: 1.0}
    estimates = [
        Estimate(
            "stage_response",
            None,
            cosine_V / data.scale_factor_V_per_g,
            "1",
            response_u,
            None,
            "half the difference of outputs at 90 and 270 deg over the stated scale factor",
        ),
        _of("stage_zero", zero_deg, u_deg, both, "outputs at 0 and 180 deg"),
        closure,
        _of("stage_lean", lean_deg, u_deg, {MOUNTING: 1.0}, "outputs along the axis, less K0"),
    ]
    return Analysis(estimates, (), list(_causes(estimates, data)))


def _of(name: str, value_deg: float, u_deg: float, by: Mapping[str, float], how: str) -> Estimate:
    return Estimate(name, None, value_deg, "deg", u_deg, None, how, by)


def _causes(estimates: list[Estimate], data: StageDataset) -> Iterator[Flag]:
    known = {MOUNTING: data.mounting_u_deg, ANGLE: data.angle_u_deg}
    value = {estimate.name: estimate.value or 0.0 for estimate in estimates}
    u = {
        estimate.name: math.hypot(
            estimate.standard_uncertainty or 0.0,
            *(share * known[name] for name, share in estimate.sensitivities.items()),
        )
        for estimate in estimates
    }

    def is_off(name: str, limit: float) -> bool:
        return abs(value[name]) - COVERAGE * u[name] > limit

    response, is_far = value["stage_response"], abs(value["stage_zero"]) > FAR_DEG
    if response < -RESPONSE:
        message = (
            "The output falls where it should rise with the angle: the rotary stage turns against "
            "its sense, or the accelerometer is mounted or connected the other way round."
        )
        yield Flag("stage-sense-reversed", message)
    elif not is_far and abs(response - 1.0) - COVERAGE * u["stage_response"] > RESPONSE:
        message = (
            f"A quarter turn of the rotary stage changes the output by {response:.3g} of what the "
            "stated scale factor makes of it: the stage's units, or scale_factor in the plan."
        )
        yield Flag("stage-response-off", message)
    if is_off("stage_zero", ZERO_DEG):
        message = (
            f"At zero of the rotary stage's encoder the input axis is {value['stage_zero']:+.2g} "
            "deg off the level: set the encoder's zero anew, or look at the device's mounting."
        )
        yield Flag("stage-zero-off", message)
    if is_off("stage_closure", CLOSURE_DEG):
        message = (
            f"A whole turn of the rotary stage ends {value['stage_closure']:+.2g} deg off where it "
            "began: its counts per turn, or a device that is not fixed."
        )
        yield Flag("stage-turn-not-whole", message)
    if is_off("stage_lean", LEAN_DEG):
        message = (
            f"The axis of the rotary stage is {value['stage_lean']:+.2g} deg out of the level: "
            "level the stage."
        )
        yield Flag("stage-axis-leans", message)
