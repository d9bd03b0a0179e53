"""FOG scale factor over temperature: turns about three axes on a ramp, a polynomial, its proof.

Source: the Chinese patent text on calibrating the full-temperature scale factor of a fibre-optic
gyro by continuous turns while the temperature rises, steps one to four.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import astuple
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached
from station.method.commands import Power
from station.method.motion import ChamberOn
from station.procedure import LazyImport, Procedure, Prompt, ResultKind, Step, usual_modules

from .bench_work import PROOF, RAMP, RANDOM, SOAK, WARM_UP, BenchWork
from .parameters import SECONDS_PER_HOUR, FogParameters
from .ramping import Ramp, coldest_degC, cool_down, last_turn, make_ramp, soak_again
from .work import (
    CHAMBER,
    EXPECTED_HEAT_DEGC,
    NAVIGATOR,
    POWER,
    TABLE,
    fitted_ramp,
    instruments,
    proof_ramp,
    records,
    to_soak,
    to_zero,
    turning,
    work,
)

if TYPE_CHECKING:
    from station.method.run import Run

LEG_S = 20.0

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


def prompts(parameters: FogParameters) -> tuple[Prompt, ...]:
    """Return what the operator may be asked to do."""
    return (MOUNT, CABLES)


def soak(run: Run) -> None:
    """Step 1: mount, lowest temperature, soak, power on, align, warm gyros, random rotation.

    The soak counts from the chamber's reaching the temperature. A run that goes on in the middle of
    a ramp goes to where the ramp stood, and waits until the gyros are as warm as they were.
    """
    from station.method.verbs import come_to_rest

    parameters: FogParameters = run.parameters
    run.ask(MOUNT)
    run.ask(CABLES)
    work = run.state(BenchWork, run)
    work.chamber.programme_limits()
    work.table.programme_limits()
    run.event("field-on", instrument=CHAMBER)
    for axis in astuple(work.axes):
        if not work.table.is_homed(axis):
            work.table.home(axis)
            come_to_rest(run, TABLE, "the table looks for its zeros", axis=axis, every_s=1.0)
    stood = last_turn(run)
    run.apply(ChamberOn(CHAMBER))
    low_degC, high_degC = parameters.temperature_range_degC
    begins_degC = low_degC
    if stood is not None:
        # Where the gyros, with their own heat, come to rest at the temperature that they had.
        begins_degC = min(max(stood["gyro_degC"] - EXPECTED_HEAT_DEGC, low_degC), high_degC)
    work.reach(to_soak(parameters, begins_degC), SOAK)
    if stood is None:
        began_s = run.now_s
        work.follow(began_s + parameters.soak_s, SOAK, f"soaking at {low_degC:g} degC")
    run.apply(Power(POWER, True))
    work.start_navigator()
    align(run)
    if stood is None:
        warm_up(run)
        rotate_at_random(run)
    else:
        soak_again(run, stood)


def align(run: Run) -> None:
    """Let the navigator find its attitude at rest; raises ConditionNotReached where it does not."""
    parameters: FogParameters = run.parameters
    work = run.state(BenchWork, run)
    work.go_to(to_zero(), WARM_UP, "the table goes to zero")
    work.navigator.align(parameters.latitude_deg)
    aligned = work.follow_until(
        lambda: work.navigator.status().aligned,
        parameters.alignment_at_most_s,
        WARM_UP,
        lambda: "the navigator aligns",
    )
    if not aligned:
        faults = ", ".join(work.navigator.status().faults) or "none reported"
        raise ConditionNotReached(
            f"{NAVIGATOR} was not aligned within {parameters.alignment_at_most_s / 60:g} min "
            f"(faults: {faults}); let it rest, and compare the plan's latitude with the place"
        )


def warm_up(run: Run) -> None:
    """Wait until the gyros' own temperature is steady: self-heating is over.

    Raises ConditionNotReached when |slope| + 2 u stays above the plan's limit.
    """
    import numpy as np

    from procedures.estimation.linear import slope_with_uncertainty

    rule = run.parameters.warm_up
    work = run.state(BenchWork, run)
    began_s = run.now_s
    seen: list[tuple[float, float]] = []
    doing = "the gyros warm up"
    while True:
        work.follow(run.now_s + rule.window_s / 60, WARM_UP, doing)
        now_s = run.now_s
        seen.append((now_s, float(np.mean(work.gyro_degC()))))
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
    import random

    from station.method.verbs import come_to_rest

    parameters: FogParameters = run.parameters
    work = run.state(BenchWork, run)
    draw = random.Random(1)
    until_s = run.now_s + parameters.random_rotation_s
    while run.now_s < until_s:
        name = draw.choice(("outer", "middle", "inner"))
        rate_deg_per_s = draw.uniform(-1.0, 1.0) * parameters.turn_rate_deg_per_s
        leg = turning(rate_deg_per_s, "random rotation", name)
        axis = leg.axis_number(run.bench)
        run.apply(leg)
        work.follow(min(run.now_s + LEG_S, until_s), RANDOM, "random rotation")
        work.table.stop(axis)
        come_to_rest(run, TABLE, "random rotation", axis=axis, every_s=0.5)


def ramp_up(run: Run) -> None:
    """Step 2: the chamber warms slowly; every interval each axis up in turn, and turned once."""
    parameters: FogParameters = run.parameters
    high_degC = parameters.temperature_range_degC[1]
    make_ramp(run, Ramp(RAMP, fitted_ramp(parameters), high_degC, True))


def fit(run: Run) -> None:
    """Step 3: heading differences over gyro temperature, and a polynomial, of what is recorded."""
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


def prove(run: Run) -> None:
    """Step 4: another ramp, whose turns never enter the fit; then table, device and chamber off."""
    parameters: FogParameters = run.parameters
    work = run.state(BenchWork, run)
    rule = parameters.verification
    if rule is not None:
        low_degC, high_degC = parameters.temperature_range_degC
        down, cold_degC = rule.direction == "down", coldest_degC(run)
        if not down and not any(unit.split(" ")[0] == PROOF for unit in run.past.finished):
            cool_down(run, low_degC, cold_degC)
        end_degC = cold_degC if down else high_degC
        make_ramp(run, Ramp(PROOF, proof_ramp(parameters, rule), end_degC, not down))
    for axis in astuple(work.axes):
        work.table.stop(axis)
    work.stop_navigator()
    run.apply(Power(POWER, False))


def recorded(body: Callable[[Run], None]) -> Callable[[Run], None]:
    """Return a step that leaves on disk what had come, however it ends."""

    def step(run: Run) -> None:
        with run.state(BenchWork, run).keeps_what_came():
            body(run)

    return step


STEPS = (
    Step("1", "Lowest temperature, soak, power on, align, rotate", recorded(soak)),
    Step("2", "Slow ramp; every 10 min each axis up and turned", recorded(ramp_up)),
    Step("3", "Scale-factor error over temperature: a polynomial", fit),
    Step("4", "Another ramp, compensated; then everything off", recorded(prove)),
)


AXES = ("x", "y", "z")


def measured_axes(parameters: FogParameters) -> Mapping[str, tuple[str, ...]]:
    """Return the axes that a plan measures; of a proof and a drive none where it has none."""
    measured: tuple[str, ...] = parameters.axes
    verified = measured if parameters.verification is not None else ()
    headings = ("heading_error_uncompensated", "heading_error_compensated")
    return {
        **dict.fromkeys(headings if parameters.drive is None else (), ()),
        "scale_factor_error": measured,
        "largest_scale_factor_error": measured,
        "residual_scale_factor_error": verified,
    }


PROCEDURE = Procedure(
    name="fog-scale-factor-temperature",
    title="Fibre-optic gyro: scale factor over temperature",
    source="A method to determine the scale-factor error of fibre-optic gyros (CN 105277211 A, "
    "2016-01-27), steps 1 to 4",
    parameters=FogParameters,
    results={
        "scale_factor_error": ResultKind(AXES, "ppm"),
        "largest_scale_factor_error": ResultKind(AXES, "ppm"),
        "residual_scale_factor_error": ResultKind(AXES, "ppm"),
        "heading_error_uncompensated": ResultKind((), "deg"),
        "heading_error_compensated": ResultKind((), "deg"),
    },
    steps=STEPS,
    instruments=instruments,
    records=records,
    prompts=prompts,
    check=LazyImport(f"{__name__}.outlook:check"),
    **usual_modules(__name__),
    inputs=LazyImport(f"{__name__}.from_import:inputs"),
    files=LazyImport(f"{__name__}.compensation:files_of"),
    work=work,
    outlook=LazyImport(f"{__name__}.outlook:outlook"),
    measured_axes=measured_axes,
    assumptions=(
        "The curve is that of the ramp's direction and rate. Hysteresis between heating and "
        "cooling cannot be seen in it; a verification ramp the other way shows it.",
        "The curve is given where the gyro has been, and nowhere else: outside, compensation holds "
        "the value at the end of the range.",
        "Where turns have one sense the gyro's bias is taken for scale factor; its specification "
        "times the time of a turn is in u. Pairs of both senses cancel it.",
        "A full turn brings the table back to the same mark of its encoder, so that the error of "
        "its graduation drops out. What a table does not repeat is noise of the turns.",
    ),
)
