"""The patent's steps one to four: soak; a slow ramp with turns; the polynomial; its proof."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TYPE_CHECKING

from procedures.common.constants import SECONDS_PER_HOUR
from station.errors import ConditionNotReached
from station.method.commands import Power
from station.method.duration import Duration, exactly, on_the_way
from station.method.motion import AxisTo, ChamberOn, TemperatureRamp, TemperatureTo
from station.method.set_points import Bounded, Bounds
from station.method.verbs import axis_of, come_to_rest
from station.procedure import Prompt, Step

from .following import (
    CHAMBER,
    COOLING,
    NAVIGATOR,
    PROOF,
    RAMP,
    RANDOM,
    SOAK,
    TABLE,
    WARM_UP,
    Following,
)
from .parameters import FogParameters, Verification
from .ramping import (
    EXPECTED_HEAT_DEGC,
    PROVED_WITHIN_DEGC,
    TURN_RATE,
    Ramp,
    left_degC,
    make_ramp,
    moves,
    near_degC,
    nearing_s,
    turning,
)

if TYPE_CHECKING:
    from station.instruments.bench import Bench
    from station.method.run import Run

POWER = "dut_power"
TEMPERATURE_RANGE = ("parameters", "temperature_range")
RAMP_RATE = ("parameters", "ramp_rate")
VERIFICATION_RATE = ("parameters", "verification", "ramp_rate")
APPROACH_S = 2700.0
LEG_S = 20.0
DRIFTED_DEGC = 1.0

MOUNT = Prompt(
    "mount",
    "Mount the navigation system on the three-axis table in the chamber, x along the inner axis "
    "and z down with all axes at zero; close the door.",
)
CABLES = Prompt(
    "connect-cables",
    "Connect its power and its data line through the slip rings.",
    checklist=(
        "The fixture is bolted and no cable is in the way of an axis.",
        "Nobody is in the chamber or at the table, and the door is closed.",
    ),
    then="the chamber goes to its lowest temperature; later the table turns",
)


def soak(run: Run) -> None:
    """Step 1: mount, lowest temperature, soak, power on, align, warm gyros, random rotation.

    The soak counts from the chamber's reaching the temperature. A run that goes on in the middle of
    a ramp goes to where the ramp stood, and waits until the gyros are as warm as they were.
    """
    parameters: FogParameters = run.parameters
    run.ask(MOUNT)
    run.ask(CABLES)
    bench = run.state(Following, run)
    bench.chamber.programme_limits()
    bench.table.programme_limits()
    run.event("field-on", instrument=CHAMBER)
    find_zeros(run)
    stood = last_turn(run)
    run.apply(ChamberOn(CHAMBER))
    low_degC, high_degC = parameters.temperature_range_degC
    begins_degC = low_degC
    if stood is not None:
        # Where the gyros, with their own heat, come to rest at the temperature that they had.
        begins_degC = min(max(stood["gyro_degC"] - EXPECTED_HEAT_DEGC, low_degC), high_degC)
    reach(run, to_soak(parameters, begins_degC), SOAK)
    if stood is None:
        bench.follow(run.now_s + parameters.soak_s, SOAK, f"soaking at {low_degC:g} degC")
    run.apply(Power(POWER, True))
    bench.start_navigator()
    align(run)
    if stood is None:
        warm_up(run)
        rotate_at_random(run)
    else:
        soak_again(run, stood)


def ramp_up(run: Run) -> None:
    """Step 2: the chamber warms slowly; every interval each axis up in turn, and turned once."""
    parameters: FogParameters = run.parameters
    high_degC = parameters.temperature_range_degC[1]
    make_ramp(run, Ramp(RAMP, fitted_ramp(parameters), high_degC, True))


def fit(run: Run) -> None:
    """Step 3: heading differences over gyro temperature, and a polynomial, of what is recorded."""
    run.read(partial(say_fit, run))


def prove(run: Run) -> None:
    """Step 4: another ramp, whose turns never enter the fit; then table, device and chamber off."""
    parameters: FogParameters = run.parameters
    bench = run.state(Following, run)
    rule = parameters.verification
    if rule is not None:
        low_degC, high_degC = parameters.temperature_range_degC
        down, cold_degC = rule.direction == "down", run.read(partial(coldest_degC, run), low_degC)
        if not down and not any(unit.split(" ")[0] == PROOF for unit in run.past.finished):
            cool_down(run, low_degC, cold_degC)
        end_degC = cold_degC if down else high_degC
        make_ramp(run, Ramp(PROOF, proof_ramp(parameters, rule), end_degC, not down))
    for move in to_zero():
        bench.table.stop(axis_of(run, move))
    bench.stop_navigator()
    run.apply(Power(POWER, False))


def recorded(body: Callable[[Run], None]) -> Callable[[Run], None]:
    """Return a step that leaves on disk what had come, however it ends."""

    def step(run: Run) -> None:
        with run.state(Following, run).keeps_what_came():
            body(run)

    return step


STEPS = (
    Step("1", "Lowest temperature, soak, power on, align, rotate", recorded(soak)),
    Step("2", "Slow ramp; every 10 min each axis up and turned", recorded(ramp_up)),
    Step("3", "Scale-factor error over temperature: a polynomial", fit),
    Step("4", "Another ramp, compensated; then everything off", recorded(prove)),
)


def find_zeros(run: Run) -> None:
    """Let each axis of the table look for its zero where that is not known."""
    table, to_go = run.state(Following, run).table, to_zero()
    each = on_the_way(run.parameters.reorientation_s / len(to_go))
    doing = "the table looks for its zeros"
    for move in to_go:
        axis = axis_of(run, move)
        if not run.read(partial(table.is_homed, axis), assumed=False):
            table.home(axis)
            come_to_rest(run, TABLE, doing, axis=axis, every_s=1.0, takes=each)


def reach(run: Run, command: TemperatureTo, unit: str) -> None:
    """Bring the chamber's air to a temperature as fast as it can.

    Raises ConditionNotReached where it does not come there in the plan's time.
    """
    parameters: FogParameters = run.parameters
    bench, temperature_degC = run.state(Following, run), command.temperature_degC
    run.apply(command)
    at_most_s = parameters.chamber_at_most_s
    there = bench.follow_until(
        lambda: (
            abs(bench.chamber.temperature_degC() - temperature_degC)
            <= parameters.soaked_within_degC
        ),
        APPROACH_S,
        at_most_s,
        unit,
        lambda: f"the chamber goes to {temperature_degC:g} degC",
    )
    if not there:
        raise ConditionNotReached(
            f"{CHAMBER} did not come to {temperature_degC:g} degC within "
            f"{at_most_s / SECONDS_PER_HOUR:.3g} h, it stands at "
            f"{bench.chamber.temperature_degC():.1f} degC; look at its door, its alarms and its "
            "load"
        )


def align(run: Run) -> None:
    """Let the navigator find its attitude at rest; raises ConditionNotReached where it does not."""
    parameters: FogParameters = run.parameters
    bench, to_go = run.state(Following, run), to_zero()
    run.declare(
        OnTheWay(TABLE, "on the way to its angles", decided_by=TURN_RATE),
        OnTheWay(NAVIGATOR, "on the way to its angles", decided_by=TURN_RATE),
    )
    each = on_the_way(parameters.reorientation_s / len(to_go))
    bench.go_to(to_go, WARM_UP, "the table goes to zero", each)
    bench.navigator.align(parameters.latitude_deg)
    at_most_s = parameters.alignment_at_most_s
    aligned = bench.follow_until(
        lambda: bench.navigator.status().aligned,
        parameters.alignment_s,
        at_most_s,
        WARM_UP,
        lambda: "the navigator aligns",
    )
    if not aligned:
        faults = ", ".join(bench.navigator.status().faults) or "none reported"
        raise ConditionNotReached(
            f"{NAVIGATOR} was not aligned within {at_most_s / 60:g} min "
            f"(faults: {faults}); let it rest, and compare the plan's latitude with the place"
        )


def warm_up(run: Run) -> None:
    """Wait until the gyros' own temperature is steady: self-heating is over."""
    parameters: FogParameters = run.parameters
    rule, rates = parameters.warm_up, run.state(Following, run).rates
    warm_s = max(nearing_s(EXPECTED_HEAT_DEGC, left_degC(parameters)), rule.window_s)
    most_s = rule.at_most_s + rule.window_s / 60.0
    takes = Duration(min(warm_s, rule.at_most_s), rule.window_s, most_s)
    run.read(partial(until_steady, run), takes=takes, rates=rates)


def until_steady(run: Run) -> None:
    """Follow the gyros until they are steady.

    Raises ConditionNotReached when |slope| + 2 u stays above the plan's limit.
    """
    import numpy as np

    from procedures.estimation.linear import slope_with_uncertainty

    rule = run.parameters.warm_up
    bench = run.state(Following, run)
    began_s = run.now_s
    seen: list[tuple[float, float]] = []
    doing = "the gyros warm up"
    while True:
        bench.follow(run.now_s + rule.window_s / 60, WARM_UP, doing)
        now_s = run.now_s
        seen.append((now_s, float(np.mean(bench.gyro_degC()))))
        seen = [reading for reading in seen if reading[0] > now_s - rule.window_s]
        if now_s - began_s >= rule.window_s and len(seen) > 3:
            times, temperatures = np.array(seen).T
            slope, u = slope_with_uncertainty(times, temperatures)
            size = SECONDS_PER_HOUR * (abs(slope) + 2 * u)
            doing = f"the gyros change by {SECONDS_PER_HOUR * slope:+.2f} degC/h"
            if size < rule.slope_limit_degC_per_h:
                run.say(f"    warm: {doing}")
                return
        if now_s - began_s > rule.at_most_s:
            raise ConditionNotReached(
                f"{NAVIGATOR}: the gyros did not become steady within {rule.at_most_s / 3600:.3g} "
                f"h: {doing}, the "
                f"plan allows {rule.slope_limit_degC_per_h:g}; wait longer (warm_up.at_most)"
            )


def rotate_at_random(run: Run) -> None:
    """Turn about changing axes at changing rates for a while; the navigator's output is kept."""
    parameters: FogParameters = run.parameters
    bench, lasts_s = run.state(Following, run), parameters.random_rotation_s
    if lasts_s <= 0.0:
        return
    rate_deg_per_s = parameters.turn_rate_deg_per_s
    text, bounds = "random rotation as fast as the turns", Bounds(rate_deg_per_s=rate_deg_per_s)
    run.declare(Bounded(TABLE, text, within=bounds, decided_by=TURN_RATE))
    draw = random.Random(1)
    until_s = run.now_s + lasts_s
    # The last leg is stopped at the end of the time.
    stopping = on_the_way(rate_deg_per_s / parameters.turn_acceleration_deg_per_s2)
    for _ in run.repeats(count(), exactly(lasts_s) + stopping):
        name = draw.choice(("outer", "middle", "inner"))
        leg = turning(draw.uniform(-1.0, 1.0) * rate_deg_per_s, "random rotation", name)
        axis = axis_of(run, leg)
        run.apply(leg)
        bench.follow(min(run.now_s + LEG_S, until_s), RANDOM, "random rotation")
        bench.table.stop(axis)
        come_to_rest(run, TABLE, "random rotation", axis=axis, every_s=0.5)
        if run.now_s >= until_s:
            break


def last_turn(run: Run) -> dict[str, float] | None:
    """Return where the ramp stood at the last turn of an earlier process, None without one."""
    finished = run.past.finished.items()
    turns = [details for unit, details in finished if unit.split(" ")[0] in (RAMP, PROOF)]
    return dict(turns[-1]["stands"]) if turns else None


def soak_again(run: Run, stood: dict[str, float]) -> None:
    """Bring gyros and chamber to where they were when the run was interrupted."""
    bench, limit_s = run.state(Following, run), run.parameters.warm_up.at_most_s
    wanted_degC = stood["gyro_degC"]
    run.say(f"    the gyros go back to {wanted_degC:.1f} degC")

    def there() -> bool:
        return bool(abs(bench.gyro_degC().mean() - wanted_degC) <= DRIFTED_DEGC)

    expected_s = nearing_s(EXPECTED_HEAT_DEGC, DRIFTED_DEGC)
    if not bench.follow_until(there, expected_s, limit_s, COOLING, bench.how_warm):
        run.say("    they do not come there: the ramp goes on from where they are")
    # A controller rounds what it reads back: at an end of the range it may lie a digit beyond.
    low_degC, high_degC = run.parameters.temperature_range_degC
    set_degC = min(max(stood["set_point_degC"], low_degC), high_degC)
    reach(run, to_temperature(set_degC, "back to where the ramp stood"), COOLING)


def say_fit(run: Run) -> None:
    """Fit what is recorded, and tell the operator."""
    import numpy as np

    from .analysis import analyse
    from .from_record import dataset_of_run

    analysis = analyse(dataset_of_run(run.read_back(), run.parameters, run.bench))
    for axis, fit in analysis.fits.items():
        if fit.curve is not None:
            at = fit.curve.largest_at_degC()
            run.say(
                f"    {axis}: order {fit.curve.order}, largest error "
                f"{float(fit.curve.error_ppm(np.array([at]))[0]):+.1f} ppm at {at:.1f} degC"
            )


def coldest_degC(run: Run) -> float:
    """Return how cold, in the mean, the gyros have to become in a proof."""
    units = run.read_back().finished_units()
    first = next(details for unit, details in units.items() if unit.split(" ")[0] == RAMP)
    return float(first["stands"]["gyro_degC"]) + PROVED_WITHIN_DEGC


def cool_down(run: Run, chamber_degC: float, gyros_degC: float) -> None:
    """Let the gyros become cold again, as far as they do within the plan's time."""
    parameters: FogParameters = run.parameters
    bench, at_most_s = run.state(Following, run), parameters.chamber_at_most_s
    reach(run, to_temperature(chamber_degC, "the gyros cool down"), COOLING)
    bench.follow_until(
        lambda: bool((bench.gyro_degC() <= gyros_degC).all()),
        nearing_s(parameters.span_degC, near_degC(parameters)),
        at_most_s,
        COOLING,
        bench.how_warm,
    )


@dataclass(frozen=True)
class OnTheWay(Bounded):
    """The table goes to its angles as fast as the bench allows, and what is mounted on it, too."""

    def bounds(self, bench: Bench) -> Bounds:
        """Return the table's limit."""
        fastest = (
            bench.instruments[TABLE].limits.get("rate") if TABLE in bench.instruments else None
        )
        return {} if fastest is None else {"rate_deg_per_s": fastest}


def to_temperature(temperature_degC: float, text: str) -> TemperatureTo:
    """Return the command that brings the chamber's air to a temperature."""
    return TemperatureTo(CHAMBER, temperature_degC, text, decided_by=TEMPERATURE_RANGE)


def to_soak(parameters: FogParameters, temperature_degC: float) -> TemperatureTo:
    """Return the command that brings the chamber to where the run begins: the lowest, at first."""
    hours = parameters.soak_s / SECONDS_PER_HOUR
    return to_temperature(temperature_degC, f"soak of {hours:g} h")


def to_zero() -> tuple[AxisTo, ...]:
    """Return the moves of all axes to zero."""
    return moves("all axes to zero", outer=0.0, middle=0.0, inner=0.0)


def fitted_ramp(parameters: FogParameters) -> TemperatureRamp:
    """Return the ramp of step 2."""
    return TemperatureRamp(
        CHAMBER,
        parameters.temperature_range_degC[1],
        parameters.ramp_rate_degC_per_h,
        RAMP_RATE,
        decided_by=TEMPERATURE_RANGE,
    )


def proof_ramp(parameters: FogParameters, rule: Verification) -> TemperatureRamp:
    """Return the ramp of step 4."""
    low_degC, high_degC = parameters.temperature_range_degC
    end_degC = low_degC if rule.direction == "down" else high_degC
    rate = rule.ramp_rate_degC_per_h
    return TemperatureRamp(CHAMBER, end_degC, rate, VERIFICATION_RATE, decided_by=TEMPERATURE_RANGE)
