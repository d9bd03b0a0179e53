"""What the reader must know of the data and their analysis: one flag a sentence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri

from procedures.common.constants import ARCMIN_PER_RAD, EARTH_RATE_DEG_PER_H
from procedures.common.frozen import frozen_flag
from procedures.estimation.flags import Gaps, counted, gaps_of, not_identifiable
from station.findings import Flag, FlagThresholds, contradiction

from .dataset import AXES, Array, Mask, Prior, Screened
from .findings import ASYMMETRY, BIAS, MISALIGNMENT, NONLINEARITY, NineAxisAnalysis, StaticSummary
from .means import interval_of
from .pose import ATTITUDES, PUBLISHED

FEWEST_RATES = 5
RATE_DIFFERS = 0.01
STATED_GAIN = 0.05
"""No gyro whose output is in deg/s is further from 1 than that."""
TURNING = {
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


@dataclass(frozen=True)
class Rotation:
    """The earth's rotation as the gyros at rest measure it by themselves."""

    latitude_deg: float
    latitude_u_deg: float
    size_deg_per_h: float
    size_u_deg_per_h: float


def plausible(gain: Array) -> Mask:
    """Return which gains can be those of gyros whose output has the unit that it should have."""
    return np.asarray(np.abs(gain - 1.0) < STATED_GAIN)


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
    measured_deg = float(np.degrees(np.arctan2(up, across)))
    u_deg = float(np.degrees(np.sqrt(lean @ covariance @ lean)))
    same = abs(whole - EARTH_RATE_DEG_PER_H) <= DENIED_SIGMAS * size_u
    near = abs(measured_deg - latitude_deg) <= DENIED_SIGMAS * u_deg
    return None if same and near else Rotation(measured_deg, u_deg, whole, size_u)


def flags_of(
    analysis: NineAxisAnalysis,
    screened: Screened,
    rotation: Rotation | None,
    *,
    lost: bool,
    thresholds: FlagThresholds,
) -> tuple[Flag, ...]:
    """Return all flags; `lost` says that no position could be used though there were some."""
    usable = () if lost else analysis.static
    return (
        *_screened(screened),
        *_outliers(analysis, screened),
        *_gaps(screened, thresholds.gap),
        *_table(analysis),
        *_statements(analysis, rotation, screened.dataset.latitude_deg),
        *_disturbed(analysis),
        *_positions(usable),
        *_biases(analysis, usable),
        *_noise(analysis, thresholds.not_significant),
        *_undetermined(analysis),
    )


def _screened(screened: Screened) -> Iterator[Flag]:
    """Yield the flags of samples that measured nothing: repeated ones, and saturated ones."""
    gyros, turning, felt = screened.frozen
    for sensor, at_rest, spun in (("gyro", gyros, turning), ("accelerometer", felt, 0 * felt)):
        for name, still, moving in zip(AXES, at_rest.tolist(), spun.tolist(), strict=True):
            if count := still + moving:
                where = {"at_rest": still, "turning": moving}
                extent = " and ".join(
                    f"{counted(n, 'sample')} {way.replace('_', ' ')}"
                    for way, n in where.items()
                    if n
                )
                details = {"count": count, **where, "sensor": sensor}
                reading, then = f"The output of {sensor} {name}", "They are left out."
                yield frozen_flag(reading, extent, "the sensor", then, details, name)
    for axis, name in enumerate(AXES):
        own = [(rate, count) for where, rate, count in screened.saturated if where == axis]
        if own:
            rates, count = _by_size(rate for rate, _ in own), sum(count for _, count in own)
            text = (
                f"Saturated: {counted(count, 'sample')} of gyro {name} at {_listed(rates)} deg/s; "
                "they are left out, and whole records that hold more than a few."
            )
            yield Flag("overload", text, name, {"count": count, "rates": rates})
    if screened.saturated_at_rest:
        count = screened.saturated_at_rest
        text = f"Saturated: {counted(count, 'sample')} at rest; they are left out."
        yield Flag("overload", text, None, {"count": count})


def _outliers(analysis: NineAxisAnalysis, screened: Screened) -> Iterator[Flag]:
    for axis, name in enumerate(AXES):
        at_rest = sum(
            int(np.sum(np.isfinite(record.rate_deg_per_h[:, axis]) & ~summary.kept[:, axis]))
            for record, summary in zip(screened.dataset.static, analysis.static, strict=True)
        )
        turning, means = 0, analysis.means.get(axis)
        if means is not None:
            own = [turn for turn in screened.dataset.turns if turn.axis == axis]
            turning = sum(
                int(np.sum(np.isfinite(record.rate_deg_per_s[:, axis]) & ~kept)) - unsteady
                for record, kept, unsteady in zip(own, means.kept, means.unsteady, strict=True)
                if bool(kept.any())
            )
        if at_rest + turning:
            text = (
                f"Left out, for they lie far from the others: {counted(at_rest, 'sample')} of gyro "
                f"{name} at rest and {turning} of it turning."
            )
            details = {"count": at_rest + turning, "at_rest": at_rest, "turning": turning}
            yield Flag("outliers-rejected", text, name, details)


def _gaps(screened: Screened, wider: float) -> list[Flag]:
    gaps, nominal_s = Gaps(), 0.0
    for records in (screened.dataset.static, screened.dataset.turns):
        times = [record.time_s for record in records]
        nominal_s = interval_of(times)
        gaps = sum((gaps_of(time_s, nominal_s, wider) for time_s in times), gaps)
    return gaps.flags("The records have", nominal_s, "the means do not mind")


def _table(analysis: NineAxisAnalysis) -> Iterator[Flag]:
    """Yield the flags of what the table did: part turns, few or wrong rates, its encoder."""
    for axis, means in analysis.means.items():
        name = AXES[axis]
        if rates := _by_size(np.abs(means.commanded[means.part])):
            text = (
                f"{name} did not turn whole turns at {_listed(rates)} deg/s; the part of the "
                "earth's rotation that this leaves in the means is solved for and taken off."
            )
            yield Flag("part-turns", text, name, {"count": len(rates), "rates": rates})
        if (count := len(np.unique(np.abs(means.commanded)))) < FEWEST_RATES:
            text = f"{name} was turned at {count} rates; the method is published for five and more."
            yield Flag("outside-published-range", text, name, {"count": count})
        off = np.nan_to_num(means.rate / means.commanded - 1.0)
        worst = int(np.argmax(np.abs(off)))
        if abs(off[worst]) > RATE_DIFFERS:
            text = (
                f"At {means.commanded[worst]:g} deg/s the encoder of {name} says "
                f"{means.rate[worst]:.5g} deg/s; the result uses the encoder."
            )
            details = {"relative_difference": float(off[worst])}
            yield Flag("rate-differs-from-commanded", text, name, details)
        if count := means.wild_readings:
            text = (
                f"Left out, for they do not fit the turn: {counted(count, 'reading')} of the "
                f"table's angle with {name} up."
            )
            yield Flag("outliers-rejected", text, name, {"count": count, "what": "encoder"})
        if rates := _by_size(means.commanded[np.array(means.unsteady) > 0]):
            count = sum(means.unsteady)
            text = (
                "Left out, for by its encoder the table was not at its rate: "
                f"{counted(count, 'sample')} of {name} at {_listed(rates)} deg/s. Spin-up and "
                "braking belong into no record."
            )
            yield Flag("unsteady-rate", text, name, {"count": count, "rates": rates})
        solution = analysis.axes[axis]
        if solution is not None and solution.one_sense:
            rates = [*solution.one_sense]
            text = (
                f"{name} has no usable record at {_listed(rates)} deg/s in one sense or in both; "
                "these rates are left out."
            )
            yield Flag("one-sense-only", text, name, {"count": len(rates), "rates": rates})


def _statements(
    analysis: NineAxisAnalysis, rotation: Rotation | None, latitude_deg: float
) -> Iterator[Flag]:
    """Yield the flags of data that deny the stated latitude, unit, sign or axis."""
    if rotation is not None:
        yield _of_rotation(rotation, latitude_deg)
    for axis, means in analysis.means.items():
        name, solution = AXES[axis], analysis.axes[axis]
        lean, u = means.lean_rad
        leans = [lean] if lean > DENIED_SIGMAS * u else []
        gains = means.output[:, axis] / means.rate
        gains = gains[np.isfinite(gains)]
        if solution is not None:
            scale = solution.scale_factor.value
            leans += [abs(cross.value / scale) for cross in solution.cross.values()]
            gains = np.append(gains, scale)
        if leans and MAX_LEAN_RAD < (lean := max(leans)) <= 1.0:
            text = (
                f"{name} does not turn about the table's axis: by the gyros it leans by "
                f"{np.degrees(lean):.2g} deg, which alone makes its scale factor "
                f"{5e5 * lean**2:.2g} ppm too small. Mount the sensor straight and turn it again."
            )
            yield contradiction("axis", text, name, lean_deg=float(np.degrees(lean)))
        if not bool(plausible(gains).all()):
            worst = float(gains[np.argmax(np.abs(gains - 1.0))])
            likely = _likely(worst, TURNING, 1.0) or "has another unit, sign or axis"
            text = (
                f"Gyro {name} answers {worst + 0.0:.4g} of the table's rate, but its output is "
                f"stated in deg/s: likely it {likely} in some record or in all. Correct the column "
                "and analyse again."
            )
            yield contradiction("rate_deg_per_s", text, name, ratio=worst)


def _of_rotation(rotation: Rotation, latitude_deg: float) -> Flag:
    details: dict[str, Any] = {
        "latitude_deg": rotation.latitude_deg,
        "rotation_deg_per_h": rotation.size_deg_per_h,
    }
    off_deg_per_h = abs(rotation.size_deg_per_h - EARTH_RATE_DEG_PER_H)
    if off_deg_per_h <= DENIED_SIGMAS * rotation.size_u_deg_per_h:
        text = (
            f"By the gyros the latitude is {rotation.latitude_deg:.2f} deg (u = "
            f"{rotation.latitude_u_deg:.2g} deg), where {latitude_deg:g} deg is stated. Check its "
            "sign and its minutes, then analyse again."
        )
        return contradiction("latitude", text, **details)
    likely = _likely(rotation.size_deg_per_h / EARTH_RATE_DEG_PER_H, AT_REST, 1e-5)
    cause = f"the rates {likely or 'have another unit or scale than turning'}. "
    cause += "Correct the columns and analyse again."
    if not likely and off_deg_per_h < NEARLY_EARTH * EARTH_RATE_DEG_PER_H:
        cause = "a bias changed between the positions, or a gyro's scale is not the same at rest. "
        cause += "Measure the positions again, one shortly after the other."
    text = (
        f"At rest the gyros feel {rotation.size_deg_per_h:.4g} deg/h (u = "
        f"{rotation.size_u_deg_per_h:.2g} deg/h) where the earth turns at "
        f"{EARTH_RATE_DEG_PER_H:.4g} deg/h: likely {cause}"
    )
    return contradiction("earth-rate", text, **details)


def _likely(ratio: float, known: Mapping[str, float], least: float) -> str:
    """Return what a ratio to the stated unit means, nothing where it is like none that is known."""
    near = {what: abs(ratio - other) / max(abs(other), least) for what, other in known.items()}
    what = min(near, key=near.__getitem__)
    return what if near[what] <= LIKE else ""


def _disturbed(analysis: NineAxisAnalysis) -> Iterator[Flag]:
    """Yield the flags of records that contradict the others, change within, or are coarse."""
    for axis, name in enumerate(AXES):
        means, solution = analysis.means.get(axis), analysis.axes.get(axis)
        at_rest = float(analysis.rounding[axis])
        turning = means.rounding if means is not None else 0.0
        if turning > 0.0 or at_rest > 0.0:
            text = (
                f"The output of gyro {name} has steps larger than its noise: a mean may be off by "
                f"{at_rest:.2g} deg/h at rest and {turning:.2g} deg/s turning, which is in the "
                "uncertainties. Record with more digits."
            )
            yield Flag("coarse-output", text, name)
        if means is not None and means.graduation_deg > 0.0:
            text = (
                f"With {name} up the table's angle departs from even turns by "
                f"{means.graduation_deg:.2g} deg once or twice a turn, and the gyro does not feel "
                "it: it is the encoder's graduation and is taken off. Have the encoder looked at."
            )
            details: dict[str, object] = {"what": "encoder", "amplitude_deg": means.graduation_deg}
            yield Flag("misfit", text, name, details)
        if means is not None and any(means.restless):
            rates = means.commanded[np.array(means.restless) > 0.0].tolist()
            text = (
                f"Gyro {name} changed within its records at {', '.join(f'{r:g}' for r in rates)} "
                "deg/s by more than noise: a step, a drift, or a rate not yet settled. The change "
                "is in the uncertainties; wait longer before the record, and look for shocks and "
                "warm-up."
            )
            yield Flag("misfit", text, name, {"what": "within", "rates": rates})
        if solution is not None and solution.uneven_deg_per_s > 0.0:
            text = (
                f"What gyro {name} reads in both senses does not grow evenly with the rate, by "
                f"{solution.uneven_deg_per_s:.2g} deg/s and most at {solution.worst_rate:g} deg/s: "
                "a bias, time stamps or an angle were wrong in some record, or it belongs to "
                "another axis. The uncertainties are widened; measure that rate again."
            )
            details = {"what": "senses", "rates": [solution.worst_rate]}
            yield Flag("misfit", text, name, details)


def _positions(static: Sequence[StaticSummary]) -> Iterator[Flag]:
    for summary in static:
        if not summary.pose.right:
            text = (
                f"The sensor did not stand as in position {summary.position}: {summary.pose.seems}"
                "; its record is left out of the biases, and where gravity lies along another axis "
                "also of what the accelerometers come to. Look at how it stood, and at the columns "
                "of gyros and accelerometers: their order, signs and units."
            )
            yield Flag("wrong-position", text, None, {"position": int(summary.position)})
    there = {summary.position for summary in static}
    for position in PUBLISHED:
        if static and position not in there:
            text = (
                f"Position {position} was not recorded: the published mean of the axis that faces "
                "east there is missing, the best estimate takes the other positions."
            )
            yield Flag("position-missing", text, None, {"position": position})


def _biases(analysis: NineAxisAnalysis, static: Sequence[StaticSummary]) -> Iterator[Flag]:
    bias = analysis.bias
    if bias is not None and not bias.heading_used and len({s.position for s in static}) > 1:
        heading_arcmin = bias.heading_rad * ARCMIN_PER_RAD
        text = (
            f"By the gyros the plate's heading is {heading_arcmin:.1f} arcmin off, beyond its "
            "prior; the biases are solved without that prior."
        )
        yield Flag("heading-differs-from-prior", text, None, {"heading_arcmin": heading_arcmin})
    if analysis.wider > 1.0:
        text = (
            "The static means contradict each other beyond their uncertainties, which are "
            f"multiplied by {analysis.wider:.2g}: a bias changed between the positions, or the "
            "sensor stood less well than the priors say."
        )
        yield Flag("positions-disagree", text, None, {"factor": analysis.wider})
    for name, wander in zip(AXES, analysis.wander.tolist(), strict=True):
        if wander > 0.0:
            text = (
                f"The bias of gyro {name} wanders by {wander:.2g} deg/h at rest; that is in its "
                "uncertainty. Longer records do not help."
            )
            yield Flag("bias-wanders", text, name, {"wander_deg_per_h": wander})


def _noise(analysis: NineAxisAnalysis, significant: float) -> Iterator[Flag]:
    agree = {AXES[axis]: solution and solution.agree for axis, solution in analysis.axes.items()}
    for estimate in analysis.estimates:
        if estimate.name not in {ASYMMETRY, NONLINEARITY} or estimate.value is None:
            continue
        u = estimate.standard_uncertainty or 0.0
        alike = estimate.name == NONLINEARITY and agree[str(estimate.axis)]
        if alike or abs(estimate.value) < significant * u:
            text = (
                f"The {estimate.name} of {estimate.axis}, {estimate.value:.3g} ppm with u = "
                f"{u:.2g} ppm, cannot be distinguished from noise."
            )
            yield Flag("not-significant", text, estimate.axis, {"name": estimate.name})


def _undetermined(analysis: NineAxisAnalysis) -> Iterator[Flag]:
    names = [f"{entry.name} {entry.axis}" for entry in analysis.estimates if entry.value is None]
    cross = [name for name in names if name.startswith(MISALIGNMENT)]
    other = [name for name in names if name not in cross]
    if cross:
        text = (
            f"The data do not determine {', '.join(cross)}: the other gyros were not recorded "
            "there, or their output never changed."
        )
        yield not_identifiable(text, cross, count=len(cross))
    if other:
        text = f"The data do not determine {', '.join(other)}."
        if any(name.startswith(BIAS) for name in other):
            text += " No static record was usable."
        yield not_identifiable(text, other, count=len(other))
    silent = [f"{entry.name} {entry.axis}" for entry in analysis.published if entry.value is None]
    if silent:
        text = f"The published rule has no data for {', '.join(silent)}."
        which = {"count": len(silent), "coefficients": silent}
        yield Flag("published-rule-without-data", text, None, which)


def _by_size(rates: Iterable[float]) -> list[float]:
    """Return rates, each once, the slowest first and of each the positive sense."""
    return sorted(map(float, set(rates)), key=lambda rate: (abs(rate), -rate))


def _listed(values: Sequence[float]) -> str:
    """Return numbers in words: 1, 5 and 10."""
    texts = [f"{value:g}" for value in values]
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else texts[0]
