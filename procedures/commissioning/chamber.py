"""T1: a chamber's overshoot, lag and steady error, and which thermometer of the device follows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.findings import Analysis, Flag, InputQuantity
from station.method.commands import Power
from station.method.duration import exactly
from station.method.motion import ChamberOn, TemperatureTo
from station.method.run import Run
from station.method.verbs import Recording, keep_row, look_until
from station.procedure import Prompt, Step
from station.roles import Navigator, ThermalChamber
from station.roles.base import ARRIVAL

from .part import AXES, COVERAGE, Figure, Part

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

OVERSHOOT = Figure("chamber_overshoot", "K", limit=1.0, drift=0.5)
"""A fifth of the step: more delays each soak, and a small device is warmer than the plan allows."""
LAG = Figure("chamber_lag", "s", drift=120.0)
"""A fan that slows or a filter that clogs takes minutes, another load in the chamber, too."""
STEADY_ERROR = Figure("chamber_steady_error", "K", limit=0.5, drift=0.3)
"""What a chamber's own sensor is usually stated to, against its controller's set-point."""
GAIN = Figure("thermometer_gain", axes=AXES, limit=0.2, nominal=1.0, drift=0.1)
"""A thermometer in the device shows the whole step in the end; the fit leaves a few percent."""
ABOVE_AIR = Figure("thermometer_above_air", "K", AXES, drift=0.5)
"""In the end, of the device's own warmth: it changes with the chamber's sensor, which the chamber
itself cannot show, or with that thermometer."""
THERMOMETER_LAG = Figure("thermometer_lag", axes=AXES, limit=0.67, nominal=1.0, drift=0.3)
"""Over the middle one of all: one that lags a third of it stands in the air."""
FOLLOWS = 0.5
"""Of the step: a thermometer that shows less does not stand in the chamber."""
IN_AIR_S = 120.0
"""A thermometer in a device of some hundred grams lags by more, whatever the others do."""
IN_AIR = 3.0
"""A thermometer that lags so many times less than the others' middle one stands in the air."""
UNIT = "chamber step"
STEPPED = "stepped_s"

CHAMBER, NAVIGATOR, POWER = "thermal_chamber", "navigator", "dut_power"
FROM = ("parameters", "chamber", "from")
STEP = ("parameters", "chamber", "step")
LOOK_S, OUTPUT_HZ = 10.0, 1.0
COLUMNS = {"temperature_degC": "degC, of the air", "set_point_degC": "degC"}
MOUNT = Prompt(
    "mount-navigator",
    "Set the navigation system into the chamber, connect its power and its data line; close the "
    "door.",
)


class ChamberParameters(StrictModel):
    """What the engineer chooses: where the air is held first, and the step from there."""

    from_degC: Annotated[float, Unit("degC")] = 25.0
    step_K: Annotated[float, Unit("K"), Field(ge=2, le=10)] = 5.0
    before_s: Annotated[float, Unit("s"), Field(ge=900, le=14400)] = 1800.0
    after_s: Annotated[float, Unit("s"), Field(ge=1800, le=14400)] = 3600.0


def step(run: Run) -> None:
    """T1: the air held, a step of its set-point, held again; chamber and device are recorded."""
    parameters: ChamberParameters = run.parameters.chamber
    for unit in run.unfinished([UNIT], pauses=False):
        run.ask(MOUNT)
        chamber = run.role(CHAMBER, ThermalChamber)
        navigator = run.role(NAVIGATOR, Navigator)
        chamber.programme_limits()
        run.event("field-on", instrument=CHAMBER)
        run.apply(ChamberOn(CHAMBER))
        run.apply(Power(POWER, True))
        navigator.start(OUTPUT_HZ)
        with run.unit(unit) as details:
            run.apply(first(parameters))
            hold(run, parameters.before_s, "air held")
            run.apply(second(parameters))
            details[STEPPED] = run.now_s
            hold(run, parameters.after_s, "after the step")
        navigator.stop()
        run.apply(Power(POWER, False))


def first(parameters: ChamberParameters) -> TemperatureTo:
    """Return the command that brings the air to where the step begins."""
    text = f"to {parameters.from_degC:g} degC"
    return TemperatureTo(CHAMBER, parameters.from_degC, text, decided_by=FROM)


def second(parameters: ChamberParameters) -> TemperatureTo:
    """Return the command of the step."""
    end_degC = parameters.from_degC + parameters.step_K
    return TemperatureTo(CHAMBER, end_degC, f"to {end_degC:g} degC", decided_by=STEP)


def hold(run: Run, seconds: float, doing: str) -> None:
    """Record chamber and device for a time."""
    chamber = run.role(CHAMBER, ThermalChamber)
    recording = Recording(run, UNIT, {NAVIGATOR: OUTPUT_HZ})

    def look() -> None:
        recording.take()
        values = chamber.temperature_degC(), chamber.set_point_degC()
        keep_row(run, UNIT, CHAMBER, COLUMNS, *values)

    def act() -> None:
        look_until(run, run.now_s + seconds, look, doing, LOOK_S)

    run.read(act, takes=exactly(seconds), rates={**recording.rates, CHAMBER: 1.0 / LOOK_S})


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
    """Share of the air's change that a thermometer shows, what it is above the air in the end, in
    K, the uncertainty of both, and its lag in s."""

    gain: float
    gain_u: float
    above_K: float
    above_u_K: float
    lag_s: float
    freedom: float


def dataset(folder: RunFolder, parameters: ChamberParameters, bench: Bench) -> ChamberDataset:
    """Return air and thermometers, the latter as means of some outputs."""
    import numpy as np

    air, device = folder.rows(CHAMBER, UNIT), folder.rows(NAVIGATOR, UNIT)
    read = np.column_stack([device[f"temperature_{axis}_degC"] for axis in AXES])
    cell = ((device[ARRIVAL] - device[ARRIVAL][0]) // LOOK_S).astype(np.int64)
    _, starts, counts = np.unique(cell, return_index=True, return_counts=True)
    return ChamberDataset(
        np.asarray(air[ARRIVAL]),
        np.asarray(air["temperature_degC"]),
        np.add.reduceat(device[ARRIVAL], starts) / counts,
        np.add.reduceat(read, starts) / counts[:, None],
        float(folder.finished_units()[UNIT][STEPPED]),
        parameters.from_degC,
        parameters.step_K,
    )


def analyse(data: ChamberDataset, inputs: Sequence[InputQuantity] = ()) -> Analysis:
    """Return the chamber's figures, each thermometer's share, and the causes of what is wrong."""
    import numpy as np

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

    estimates = [
        OVERSHOOT.measured(overshoot, ripple, METHOD, freedom=freedom),
        LAG.measured(lag_s, spacing_s / math.sqrt(3.0), METHOD, freedom=freedom),
        STEADY_ERROR.measured(steady - ends_degC, steady_u, METHOD, freedom=freedom),
    ]
    for axis, of in zip(AXES, followed, strict=True):
        method = "least squares of a first-order lag"
        estimates += [
            GAIN.measured(of.gain, of.gain_u, method, axis, of.freedom, lag_s=of.lag_s),
            ABOVE_AIR.measured(of.above_K, of.above_u_K, method, axis, of.freedom),
        ]
    for axis, of in zip(AXES, followed, strict=True):
        share, u = of.lag_s / middle_s, 0.05
        estimates.append(THERMOMETER_LAG.measured(share, u, METHOD, axis, of.freedom))
    flags = [*overshooting(overshoot, ripple, data.step_K), *misplaced(followed, data.step_K)]
    return Analysis(estimates, (), flags)


def follow(data: ChamberDataset, read_degC: Array, lag_s: float | None = None) -> Following:
    """Fit one thermometer's readings, shape (m,), with a lag of its own or a known one."""
    import numpy as np
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

    end_degC = data.from_degC + data.step_K
    # Of the shares: the reading with the air at the step's end for long, the warming up past.
    at_end = np.array([1.0, 0.0, end_degC - data.air_degC[0]])

    def following(shares: Array, covariance: Array, tau_s: float, freedom: float) -> Following:
        above_u_K = float(np.sqrt(at_end @ covariance @ at_end))
        gain_u = float(np.sqrt(covariance[2, 2]))
        above_K = float(at_end @ shares) - end_degC
        return Following(float(shares[2]), gain_u, above_K, above_u_K, tau_s, freedom)

    if lag_s is not None:
        shares, squares = linear(lag_s)
        known, freedom = columns(lag_s), read_degC.size - 3.0
        spread = np.asarray(np.linalg.inv(known.T @ known) * (squares / freedom), dtype=np.float64)
        return following(shares, spread, lag_s, freedom)
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
    return following(best.x[1:], covariance[1:, 1:], math.exp(best.x[0]), freedom)


def lag_of(time_s: Array, value: Array, tau_s: float) -> Array:
    """Return a first-order lag of a value that is straight between its times; at first zero."""
    import numpy as np

    out = np.zeros_like(value)
    for k in range(1, len(value)):
        span = time_s[k] - time_s[k - 1]
        slope = (value[k] - value[k - 1]) / span
        kept = math.exp(-span / tau_s)
        out[k] = value[k] - slope * tau_s + kept * (out[k - 1] - value[k - 1] + slope * tau_s)
    return out


def overshooting(overshoot_K: float, u_K: float, step_K: float) -> Iterator[Flag]:
    """Yield the flag of a chamber that goes too far beyond its set-point."""
    if overshoot_K > 0.0 and OVERSHOOT.is_off(overshoot_K, u_K):
        message = (
            f"The chamber's air goes {overshoot_K:.1f} K beyond its set-point after a step of "
            f"{abs(step_K):g} K: tune its controller."
        )
        yield Flag("chamber-overshoots", message, details={"overshoot_K": overshoot_K})


def misplaced(followed: list[Following], step_K: float) -> list[Flag]:
    """Return a flag for each thermometer that does not follow, or follows as the air does."""
    import numpy as np

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


PART = Part(
    name="chamber",
    steps=(
        Step("T1", "Chamber: overshoot, lag, steady error, and which thermometer follows", step),
    ),
    figures=(OVERSHOOT, LAG, STEADY_ERROR, GAIN, ABOVE_AIR, THERMOMETER_LAG),
    needs=(CHAMBER, NAVIGATOR, POWER),
    units=lambda parameters: (UNIT,),
    dataset=dataset,
    analyse=analyse,
    short=("parameters.chamber.before=15 min", "parameters.chamber.after=40 min"),
)
