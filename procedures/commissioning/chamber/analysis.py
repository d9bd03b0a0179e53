"""How a chamber follows a step of its set-point, and which thermometers of the device follow it.

Each thermometer is a first-order lag of the measured air, with the device's own warming up since it
was switched on: a + c exp(-t/tau) + g L(air), with L the lag of the same tau. The share g of the
air's change that it shows is one in the chamber and none elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, Flag

from .limits import COVERAGE, FOLLOWS, IN_AIR, IN_AIR_S, OVERSHOOT_K
from .parameters import AXES

Array = NDArray[np.float64]
SURE = 0.1
SHORTEST_S, MAX_S, TRIED = 20.0, 20000.0, 25
REACHED = 1.0 - math.exp(-1.0)
METHOD = "air after the step of the set-point"


@dataclass(frozen=True)
class ChamberDataset:
    """Air (n,) with its times, the device's thermometers (m, 3) with theirs, in s and degC.

    `stepped_s` is when the set-point went from `from_degC` by `step_K`.
    """

    air_s: Array
    air_degC: Array
    device_s: Array
    device_degC: Array
    stepped_s: float
    from_degC: float
    step_K: float


@dataclass(frozen=True)
class Following:
    """Share of the air's change that a thermometer shows, its uncertainty, and its lag in s."""

    gain: float
    gain_u: float
    lag_s: float
    freedom: float


def analyse(data: ChamberDataset) -> Analysis:
    """Return the chamber's figures, each thermometer's share, and the causes of what is wrong."""
    ends_degC = data.from_degC + data.step_K
    after = data.air_s > data.stepped_s
    since_s, air = data.air_s[after] - data.stepped_s, data.air_degC[after]
    late = air[since_s > 0.5 * since_s[-1]]
    steady, ripple = float(late.mean()), float(late.std(ddof=1))
    steady_u = ripple / math.sqrt(2.0)  # some two periods of a chamber's cycling
    sense = math.copysign(1.0, data.step_K)
    overshoot = float((sense * (air - ends_degC)).max()) - sense * (steady - ends_degC)
    begin = float(data.air_degC[~after][-1])
    reached = sense * (air - begin) >= REACHED * sense * (ends_degC - begin)
    lag_s = float(since_s[reached.argmax()]) if reached.any() else float(since_s[-1])
    spacing_s = float(np.diff(since_s).mean())
    followed = [follow(data, data.device_degC[:, k]) for k in range(len(AXES))]
    sure = [following.lag_s for following in followed if following.gain_u < SURE] or [MAX_S]
    # One that shows nothing of the step has no lag of its own: it is held against the others'.
    followed = [
        following
        if following.gain_u < SURE
        else follow(data, data.device_degC[:, k], float(np.median(sure)))
        for k, following in enumerate(followed)
    ]
    middle_s = float(np.median([following.lag_s for following in followed]))
    freedom = float(late.size - 1)

    def estimate(name: str, value: float, unit: str, u: float) -> Estimate:
        return Estimate(name, None, value, unit, u, freedom, METHOD)

    estimates = [
        estimate("chamber_overshoot", overshoot, "K", ripple),
        estimate("chamber_lag", lag_s, "s", spacing_s / math.sqrt(3.0)),
        estimate("chamber_steady_error", steady - ends_degC, "K", steady_u),
        *(
            Estimate(
                "thermometer_gain",
                axis,
                following.gain,
                "1",
                following.gain_u,
                following.freedom,
                "least squares of a first-order lag",
                {},
                {"lag_s": following.lag_s},
            )
            for axis, following in zip(AXES, followed, strict=True)
        ),
    ]
    estimates += [
        Estimate(
            "thermometer_lag",
            axis,
            following.lag_s / middle_s,
            "1",
            0.05,
            following.freedom,
            METHOD,
        )
        for axis, following in zip(AXES, followed, strict=True)
    ]
    flags = [*overshooting(overshoot, ripple, data.step_K), *misplaced(followed, data.step_K)]
    return Analysis(estimates, (), flags)


def follow(data: ChamberDataset, read_degC: Array, lag_s: float | None = None) -> Following:
    """Fit one thermometer's readings, shape (m,), with a lag of its own or a known one."""
    from scipy.optimize import least_squares

    time_s = data.device_s - data.device_s[0]
    grid_s = data.air_s - data.device_s[0]
    change = data.air_degC - data.air_degC[0]

    def columns(tau_s: float) -> Array:
        lagged = np.interp(time_s, grid_s, lag_of(grid_s, change, tau_s))
        return np.column_stack((np.ones_like(time_s), np.exp(-time_s / tau_s), lagged))

    def linear(tau_s: float) -> tuple[Array, float]:
        shares, *_ = np.linalg.lstsq(columns(tau_s), read_degC, rcond=None)
        return np.asarray(shares, dtype=np.float64), float(
            np.sum((read_degC - columns(tau_s) @ shares) ** 2)
        )

    if lag_s is not None:
        shares, squares = linear(lag_s)
        known = columns(lag_s)
        spread = np.linalg.inv(known.T @ known) * squares / (len(known) - 3.0)
        return Following(float(shares[2]), float(np.sqrt(spread[2, 2])), lag_s, len(known) - 3.0)
    tried = np.geomspace(SHORTEST_S, MAX_S, TRIED)
    tau_s = float(min(tried, key=lambda lag_s: linear(float(lag_s))[1]))
    start = np.array([math.log(tau_s), *linear(tau_s)[0]])

    def residuals(of: Array) -> Array:
        return columns(math.exp(of[0])) @ of[1:] - read_degC

    lowest = [math.log(SHORTEST_S / 2.0), *3 * [-np.inf]]
    highest = [math.log(MAX_S * 2.0), *3 * [np.inf]]
    best = least_squares(residuals, start, bounds=(lowest, highest), x_scale="jac")
    freedom = float(read_degC.size - start.size)
    variance = 2.0 * best.cost / freedom
    covariance = variance * np.linalg.pinv(best.jac.T @ best.jac)
    return Following(
        float(best.x[3]), float(np.sqrt(covariance[3, 3])), math.exp(best.x[0]), freedom
    )


def lag_of(time_s: Array, value: Array, tau_s: float) -> Array:
    """Return a first-order lag of a value that is straight between its times; at first zero."""
    out = np.zeros_like(value)
    for k in range(1, len(value)):
        span = time_s[k] - time_s[k - 1]
        slope = (value[k] - value[k - 1]) / span
        kept = math.exp(-span / tau_s)
        out[k] = value[k] - slope * tau_s + kept * (out[k - 1] - value[k - 1] + slope * tau_s)
    return out


def overshooting(overshoot_K: float, u_K: float, step_K: float) -> list[Flag]:
    """Return the flag of a chamber that goes too far beyond its set-point."""
    if overshoot_K <= OVERSHOOT_K + COVERAGE * u_K:
        return []
    message = (
        f"The chamber's air goes {overshoot_K:.1f} K beyond its set-point after a step of "
        f"{abs(step_K):g} K: tune its controller."
    )
    return [Flag("chamber-overshoots", message, details={"overshoot_K": overshoot_K})]


def misplaced(followed: list[Following], step_K: float) -> list[Flag]:
    """Return a flag for each thermometer that does not follow, or follows as the air does."""
    flags = []
    middle_s = float(np.median([following.lag_s for following in followed]))
    for axis, following in zip(AXES, followed, strict=True):
        if following.gain + COVERAGE * following.gain_u < FOLLOWS:
            shown = (
                f"shows {100.0 * following.gain:.0f} % of the chamber's step of {abs(step_K):g} K: "
                "it is on the wrong channel, or outside the chamber"
            )
        elif following.lag_s < max(IN_AIR_S, middle_s / IN_AIR):
            shown = (
                f"lags the air by {following.lag_s / 60.0:.1f} min, the middle one of all by "
                f"{middle_s / 60.0:.0f} min: it is on the channel of the air, or has come loose"
            )
        else:
            continue
        message = f"Thermometer {axis} of the device {shown}. Check its cable and its channel."
        flags.append(Flag("thermometer-wrong-channel", message, axis))
    return flags
