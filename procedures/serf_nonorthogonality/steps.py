"""The source's steps 1 to 7."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from station.errors import ConditionNotReached
from station.method.cell_commands import PumpLight
from station.method.duration import Duration
from station.method.run import Run
from station.method.verbs import keep, record_published
from station.procedure import Prompt, Step

from .cell import (
    DIGITIZER,
    PUMP,
    Cell,
    LightPassed,
    fields_lost,
    fields_of,
    held,
    null_residual_field,
    shots_s,
)
from .nulling_by_tones import null_by_tones
from .oven import HEAT, Oven, is_driven
from .parameters import SerfParameters
from .shots import REPEATED, Wanted

if TYPE_CHECKING:
    from station.roles.base import Block

    from .dataset import Shot
    from .published import PublishedAngles

CABLES = Prompt(
    "connect-cables",
    "Connect the generators to the coils x, y, z and the gradient coil, the detector to the "
    "digitizer, and the digitizer's trigger output to its trigger input, to the generators and to "
    "the shutter.",
)
REST = Prompt(
    "gyro-at-rest",
    "Fix the gyro at rest in inertial space, its loops open.",
    then="the gradient and the three coils are driven, the pump laser is shuttered",
)


def depolarise(run: Run) -> None:
    """Step 1: cell warm, gyro at rest; where it was running, a gradient depolarises its nuclei.

    A dry run takes them for depolarised after the first time.
    """
    parameters: SerfParameters = run.parameters
    run.ask(CABLES)
    if not is_driven(run):
        run.ask(HEAT)
    run.ask(REST)
    if all_finished(run):
        return
    if is_driven(run):
        run.state(Oven, run).heat()
    cell = run.state(Cell, run)
    cell.prepare()
    run.event("field-on", instrument="signal_generator")
    if not parameters.gyro_was_running:
        run.say("    the gyro was not running: no nuclei to depolarise, as published")
        return
    rule = parameters.depolarise
    low_Hz, high_Hz = expected_Hz(parameters)
    for attempt in run.repeats(range(1, rule.rounds + 1), depolarising_s(parameters)):
        run.apply(held("gradient", rule.gradient_nT_per_cm))
        run.wait(rule.duration_s, "the gradient depolarises the nuclei")
        cell.release("gradient")
        look = cell.look(parameters.wanted[0], "the nuclei are looked for")
        seen_Hz = run.read(partial(frequency_Hz, look, parameters), assumed=low_Hz)
        run.event("depolarised", attempt=attempt, frequency_Hz=seen_Hz)
        if seen_Hz is not None and low_Hz <= seen_Hz <= high_Hz:
            return
    raise ConditionNotReached(
        f"after {rule.rounds} times {rule.duration_s:g} s of {rule.gradient_nT_per_cm:g} nT/cm the "
        f"precession at the digitizer is {'not seen' if seen_Hz is None else f'{seen_Hz:.1f} Hz'}, "
        f"{low_Hz:.0f} Hz to {high_Hz:.0f} Hz would be right without a field of the nuclei; let "
        "the gradient act longer (depolarise.duration), look for a field that nobody commanded, or "
        "see that signal_generator.xy, signal_generator.z_gradient and pump_laser hear the trigger"
    )


def null(run: Run) -> None:
    """Step 2: the gradient is off; the residual field is nulled by what the spins tell of it.

    By precession in the dark, or as published by modulation, as the plan says.
    """
    if all_finished(run):
        return
    run.may_pause()
    cell = run.state(Cell, run)
    if run.parameters.nulling.method == "modulation":
        null_by_tones(run, cell)
    else:
        null_residual_field(run, cell)


def first_shot(run: Run) -> None:
    """Step 3: the field of one coil on and the pump light off together; the signal is recorded."""
    take(run, run.parameters.wanted[0])


def read_slowing_down(run: Run) -> None:
    """Step 4: the frequency of the first shot gives the slowing-down factor Q."""

    def act() -> None:
        paper, frequency_Hz = published_so_far(run, 1)
        if paper.slowing_down is not None:
            q = paper.slowing_down
            record_published(run, q, "1", name="slowing_down_factor")
            run.say(f"    {frequency_Hz:.2f} Hz, Q = {q:.3f}")

    run.read(act)


def first_pair(run: Run) -> None:
    """Step 5: two coils together, the pump light off, and the signal is recorded."""
    take(run, run.parameters.wanted[1])


def read_first_angle(run: Run) -> None:
    """Step 6: its frequency gives the total field; the law of cosines gives the angle."""

    def act() -> None:
        pair = run.parameters.wanted[1].coils
        angle_deg = published_so_far(run, 2)[0].angles_deg[pair]
        if angle_deg is not None:
            record_published(run, angle_deg, "deg", name="nonorthogonality_angle", axis=pair)
            run.say(f"    as published theta_{pair} = {angle_deg:.3f} deg")

    run.read(act)


def other_shots(run: Run) -> None:
    """Step 7: the same for the other pairs, and every other shot of the plan; then all off."""
    wanted = run.parameters.wanted
    for number, shot in enumerate(wanted[2:], 3):
        run.say_progress(f"shot {number} of {len(wanted)}")
        take(run, shot)
    cell = run.state(Cell, run)
    run.apply(PumpLight(PUMP, False))
    for generator in cell.generators.values():
        for channel in (1, 2):
            generator.switch_off(channel)
    run.event("field-off", instrument="signal_generator")


STEPS = (
    Step("1", "Warm cell, gyro at rest; depolarise the nuclei", depolarise),
    Step("2", "Gradient off; null the residual field", null),
    Step("3", "One coil on, pump light off, record the precession", first_shot),
    Step("4", "Read the frequency: slowing-down factor Q", read_slowing_down),
    Step("5", "Two coils on, pump light off, record", first_pair),
    Step("6", "Read the frequency: total field, angle", read_first_angle),
    Step("7", "The other pairs, and the other shots of the plan", other_shots),
)


def all_finished(run: Run) -> bool:
    """Whether nothing is left to measure."""
    return all(run.is_finished(shot.id) for shot in run.parameters.wanted)


def depolarising_s(parameters: SerfParameters) -> Duration:
    """Return how long the gradient acts, and the nuclei are looked for, until none are seen."""
    rule, look = parameters.depolarise, shots_s(parameters, 1, 1, 1)
    return Duration(
        rule.duration_s + look.expected_s,
        rule.duration_s + look.shortest_s,
        rule.rounds * (rule.duration_s + look.longest_s),
    )


def expected_Hz(parameters: SerfParameters) -> tuple[float, float]:
    """Return the bounds of the first shot's frequency where only its field is there."""
    field_nT = math.hypot(*parameters.wanted[0].field_nT)
    gamma, q = parameters.gyromagnetic_ratio_Hz_per_nT, parameters.slowing_down
    slack = fields_lost(field_nT)
    return gamma * field_nT / q.at_rest * (1 - slack), gamma * field_nT / q.polarised * (1 + slack)


def frequency_Hz(look: Shot, parameters: SerfParameters) -> float | None:
    """Return the frequency of a shot; None where none is seen."""
    from .precession import fit_of

    fit = fit_of(look, parameters.mains_frequency_Hz)
    return None if fit is None else fit.frequency_Hz


def take(run: Run, shot: Wanted) -> None:
    """Take one shot; a bad one is taken again, up to the plan's number of times.

    One that stays bad is kept as it is: the analysis leaves it out, and says so. A shutter that
    stays open is an error, since every other shot would be as bad.
    """
    parameters: SerfParameters = run.parameters
    for unit in run.unfinished([shot.id]):
        cell = run.state(Cell, run)
        details = {
            "field_nT": list(shot.field_nT),
            "held_nT": [cell.held_nT[axis] for axis in "xyz"],
            "delay_s": cell.delay_s,
        }
        attempts = range(parameters.repeats, -1, -1)
        with run.unit(unit, **details):
            for left in run.repeats(attempts, shots_s(parameters, 1, 1, len(attempts))):
                reason = bad_attempt(run, cell, shot, last=left == 0)
                if reason is None:
                    break
                run.say(f"    {unit}: {reason}")
                if left:
                    run.event(REPEATED, unit=unit, reason=reason)
            else:
                run.event("shot-stays-bad", unit=unit, reason=reason)


def bad_attempt(run: Run, cell: Cell, shot: Wanted, *, last: bool) -> str | None:
    """Fire a shot and record it; return why it is bad, None where it is good.

    Raises LightPassed where the light was not blocked at the last attempt.
    """
    parameters: SerfParameters = run.parameters
    try:
        block = cell.fire(fields_of(shot, parameters), f"shot {shot.id}", shot.id)
    except LightPassed:
        if last:
            raise
        return "the shutter of the pump light stayed open"
    run.count_rows(DIGITIZER, parameters.record_s * parameters.sample_rate_Hz)
    return run.read(partial(why_bad, run, cell, shot, block))


def why_bad(run: Run, cell: Cell, shot: Wanted, block: Block) -> str | None:
    """Record a shot; return why it is bad, None where it is good."""
    from .precession import bad_because, fit_of

    keep(run, shot.id, cell.digitizer, block)
    parameters: SerfParameters = run.parameters
    seen = cell.shot_of(shot, block)
    fit = fit_of(seen, parameters.mains_frequency_Hz) if len(seen.time_s) else None
    reason = bad_because(seen, fit, cell.usual, max(parameters.field_levels_nT.values()))
    if reason is None and fit is not None:
        cell.usual.append(fit)
    return reason


def published_so_far(run: Run, count: int) -> tuple[PublishedAngles, float]:
    """Return what the published rule makes of the first shots, read back from the record.

    With it the frequency of the last of them in Hz, NaN where it holds no tone.
    """
    import numpy as np

    from .evaluate import shot_of_unit
    from .precession import fit_of
    from .published import published_angles

    parameters: SerfParameters = run.parameters
    folder, wanted = run.read_back(), parameters.wanted[:count]
    shots = [shot_of_unit(folder, unit, parameters, run.bench) for unit in wanted]
    fits = [fit_of(shot, parameters.mains_frequency_Hz) for shot in shots]
    hertz = np.array([np.nan if fit is None else fit.frequency_Hz for fit in fits])
    paper = published_angles(
        np.array([shot.field_nT for shot in shots]),
        2.0 * np.pi * hertz,
        2.0 * np.pi * parameters.gyromagnetic_ratio_Hz_per_nT,
    )
    return paper, float(hertz[-1])
