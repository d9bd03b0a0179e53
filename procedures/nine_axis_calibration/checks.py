"""Whether the data agree with what is stated of them, and each record with the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri

from procedures.common.constants import EARTH_RATE_DEG_PER_H
from station.findings import Flag, contradiction

from .dataset import AXES, Array, Mask, Prior
from .findings import StaticSummary
from .pose import ATTITUDES
from .scale import ScaleSolution
from .turning import AxisMeans

STATED_GAIN = 0.05
"""No gyro whose output is in deg/s is further from 1 than that."""
UNITS = {
    "is in rad/s": np.pi / 180.0,
    "is in deg/h": 3600.0,
    "has the wrong sign": -1.0,
    "is in rad/s with the wrong sign": -np.pi / 180.0,
    "is in deg/h with the wrong sign": -3600.0,
    "is in rad/h": 3600.0 * np.pi / 180.0,
    "holds another gyro": 0.0,
}
AT_REST = {
    "are in deg/s": 1.0 / 3600.0,
    "are in rad/h": np.pi / 180.0,
    "are in rad/s": np.pi / 648000.0,
    "have the earth's rotation taken off": 0.0,
}
LIKE = 0.05
NEARLY_EARTH = 0.3
"""No two units are so near to each other; a bias that changed makes up as much."""
AGREE = 0.999
DENIED_SIGMAS = 5.0
MAX_EAST = 0.2
SENSOR_LEANS_RAD = 1e-3
MAX_LEAN_RAD = 0.02
"""About one degree, 200 ppm of the scale factor: more is no misalignment but a wrong mounting."""


def plausible(gain: Array) -> Mask:
    """Return which gains can be those of gyros whose output has the unit that it should have."""
    return np.asarray(np.abs(gain - 1.0) < STATED_GAIN)


@dataclass(frozen=True)
class Rotation:
    """The earth's rotation as the gyros at rest measure it by themselves."""

    latitude_deg: float
    latitude_u_deg: float
    size_deg_per_h: float
    size_u_deg_per_h: float


def denied_rotation(
    static: Sequence[StaticSummary],
    latitude_deg: float,
    prior: Prior,
    scale_factor: Array,
    off_g: float,
) -> Rotation | None:
    """Return the earth's rotation where the gyros agree on one that is not the stated one.

    Biases and a rotation common to all positions are solved for; where they do not fit, or not all
    of them can be determined, the gyros say nothing: None. `scale_factor` (3,) is what the turns
    found, NaN where nothing.
    """
    level = [
        summary
        for summary in static
        if summary.pose.off_g <= off_g and np.isfinite(summary.gyro).all()
    ]
    if not level:
        return None
    leans = [prior.tilt_rad, prior.relative_heading_rad, prior.misalignment_rad, SENSOR_LEANS_RAD]
    attitude = EARTH_RATE_DEG_PER_H * float(np.linalg.norm(leans))
    scale = np.where(plausible(scale_factor), scale_factor, 1.0)[:, None]
    design = np.vstack(
        [np.hstack((np.eye(3), scale * ATTITUDES[summary.position])) for summary in level]
    )
    data = np.concatenate([summary.gyro for summary in level])
    size = np.hypot(np.concatenate([summary.gyro_u for summary in level]), attitude)
    freedom = len(data) - design.shape[1]
    weighted = design / size[:, None]
    if freedom < 1 or np.linalg.matrix_rank(weighted) < design.shape[1]:
        return None
    solved, *_ = np.linalg.lstsq(weighted, data / size, rcond=None)
    left = (data - design @ solved) / size
    if float(left @ left) > float(chdtri(freedom, 1.0 - AGREE)):
        return None
    east, north, up = solved[3:]
    covariance = np.linalg.inv(weighted.T @ weighted)[3:, 3:]
    turned = DENIED_SIGMAS * float(np.sqrt(covariance[0, 0]))
    if abs(east) > MAX_EAST * abs(north) + turned:
        return None  # not another latitude: the sensor stood otherwise
    across, whole = float(np.hypot(east, north)), float(np.linalg.norm(solved[3:]))
    along = solved[3:] / max(whole, 1e-9)
    size_u = float(np.sqrt(along @ covariance @ along))
    lean = np.array([-east * up, -north * up, across**2]) / max(across * whole**2, 1e-9)
    rotation = Rotation(
        float(np.degrees(np.arctan2(up, across))),
        float(np.degrees(np.sqrt(lean @ covariance @ lean))),
        whole,
        size_u,
    )
    same = abs(whole - EARTH_RATE_DEG_PER_H) <= DENIED_SIGMAS * size_u
    near = abs(rotation.latitude_deg - latitude_deg) <= DENIED_SIGMAS * rotation.latitude_u_deg
    return None if same and near else rotation


def statement_flags(
    rotation: Rotation | None,
    latitude_deg: float,
    axes: Mapping[int, ScaleSolution | None],
    means: Mapping[int, AxisMeans],
) -> list[Flag]:
    """Return the flags of data that deny the stated latitude, unit, sign or axis."""
    flags = []
    if rotation is not None:
        flags.append(_of_rotation(rotation, latitude_deg))
    for axis, solution in axes.items():
        turned = means[axis]
        flags += _askew(axis, turned, solution)
        gains = turned.output[:, axis] / turned.rate
        gains = gains[np.isfinite(gains)]
        scale = solution.scale_factor.value if solution is not None else None
        if scale is None and len(gains):
            scale = float(np.median(gains))
        if scale is None or bool(plausible(np.array([scale, *gains])).all()):
            continue
        worst = float(gains[np.argmax(np.abs(gains - 1.0))]) if len(gains) else scale
        near = {text: abs(worst - ratio) / max(abs(ratio), 1) for text, ratio in UNITS.items()}
        likely = sorted((text for text in near if near[text] <= LIKE), key=near.__getitem__)
        what = likely[0] if likely else "has another unit, sign or axis"
        text = (
            f"Gyro {AXES[axis]} answers {worst + 0.0:.4g} of the table's rate, but its output is "
            f"stated in deg/s: likely it {what} in some record or in all. Correct the column "
            "and analyse again."
        )
        flags.append(contradiction("rate_deg_per_s", text, AXES[axis], ratio=worst))
    return flags


def _askew(axis: int, means: AxisMeans, solution: ScaleSolution | None) -> list[Flag]:
    """Return the flag of a sensor that does not turn about the axis that it is stated to."""
    lean, u = means.lean_rad
    seen = [lean] if lean > DENIED_SIGMAS * u else []
    if solution is not None:
        seen += [
            abs(cross.value / solution.scale_factor.value) for cross in solution.cross.values()
        ]
    if not seen or max(seen) <= MAX_LEAN_RAD or max(seen) > 1.0:
        return []
    lean = max(seen)
    text = (
        f"{AXES[axis]} does not turn about the table's axis: by the gyros it leans by "
        f"{np.degrees(lean):.2g} deg, which alone makes its scale factor {5e5 * lean**2:.2g} ppm "
        "too small. Mount the sensor straight and turn it again."
    )
    return [contradiction("axis", text, AXES[axis], lean_deg=float(np.degrees(lean)))]


def _of_rotation(rotation: Rotation, latitude_deg: float) -> Flag:
    ratio = rotation.size_deg_per_h / EARTH_RATE_DEG_PER_H
    details: dict[str, Any] = {
        "latitude_deg": rotation.latitude_deg,
        "rotation_deg_per_h": rotation.size_deg_per_h,
    }
    if abs(ratio - 1.0) * EARTH_RATE_DEG_PER_H <= DENIED_SIGMAS * rotation.size_u_deg_per_h:
        text = (
            f"By the gyros the latitude is {rotation.latitude_deg:.2f} deg (u = "
            f"{rotation.latitude_u_deg:.2g} deg), where {latitude_deg:g} deg is stated. Check its "
            "sign and its minutes, then analyse again."
        )
        return contradiction("latitude", text, **details)
    likely = [
        text for text, known in AT_REST.items() if abs(ratio - known) <= LIKE * max(known, 1e-5)
    ]
    if abs(ratio) < 1e-6:
        likely = ["have the earth's rotation taken off"]
    cause = f"the rates {likely[0] if likely else 'have another unit or scale than turning'}. "
    cause += "Correct the columns and analyse again."
    if not likely and abs(ratio - 1.0) < NEARLY_EARTH:
        cause = "a bias changed between the positions, or a gyro's scale is not the same at rest. "
        cause += "Measure the positions again, one shortly after the other."
    text = (
        f"At rest the gyros feel {rotation.size_deg_per_h:.4g} deg/h (u = "
        f"{rotation.size_u_deg_per_h:.2g} deg/h) where the earth turns at "
        f"{EARTH_RATE_DEG_PER_H:.4g} deg/h: likely {cause}"
    )
    return contradiction("earth-rate", text, **details)


def record_flags(
    axes: Mapping[int, ScaleSolution | None], means: Mapping[int, AxisMeans], rounding: Array
) -> list[Flag]:
    """Return the flags of records that contradict the others, change within, or are coarse.

    `rounding` (3,) is what the output's steps add to a mean at rest, in deg/h.
    """
    flags = []
    for axis, name in enumerate(AXES):
        solution, turned = axes.get(axis), means.get(axis)
        turning = turned.rounding if turned is not None else 0.0
        if turning > 0.0 or rounding[axis] > 0.0:
            text = (
                f"The output of gyro {name} has steps larger than its noise: a mean may be off by "
                f"{rounding[axis]:.2g} deg/h at rest and {turning:.2g} deg/s turning, which is in "
                "the uncertainties. Record with more digits."
            )
            flags.append(Flag("coarse-output", text, name))
        if turned is None:
            continue
        if turned.graduation_deg > 0.0:
            text = (
                f"With {name} up the table's angle departs from even turns by "
                f"{turned.graduation_deg:.2g} deg once or twice a turn, and the gyro does not feel "
                "it: it is the encoder's graduation and is taken off. Have the encoder looked at."
            )
            details: dict[str, object] = {"what": "encoder", "amplitude_deg": turned.graduation_deg}
            flags.append(Flag("misfit", text, name, details))
        rates = [
            float(rate)
            for rate, size in zip(turned.commanded, turned.restless, strict=True)
            if size
        ]
        if rates:
            listed = ", ".join(f"{rate:g}" for rate in rates)
            text = (
                f"Gyro {name} changed within its records at {listed} deg/s by more than noise: a "
                "step, a drift, or a rate not yet settled. The change is in the uncertainties; "
                "wait longer before the record, and look for shocks and warm-up."
            )
            details = {"what": "within", "rates": rates}
            flags.append(Flag("misfit", text, name, details))
        if solution is not None and solution.uneven_deg_per_s > 0.0:
            text = (
                f"What gyro {name} reads in both senses does not grow evenly with the rate, by "
                f"{solution.uneven_deg_per_s:.2g} deg/s and most at {solution.worst_rate:g} deg/s: "
                "a bias, time stamps or an angle were wrong in some record, or it belongs to "
                "another axis. The uncertainties are widened; measure that rate again."
            )
            details = {"what": "senses", "rates": [solution.worst_rate]}
            flags.append(Flag("misfit", text, name, details))
    return flags
