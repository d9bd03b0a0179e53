"""The steps, numbered as the station does it: mount, on and warm, a long record, short ones."""

from __future__ import annotations

from functools import partial

from procedures.common.gyro_source import (
    CABLES,
    GYRO,
    Axis,
    earth_arcsec_per_s,
    rate_Hz,
    stop_samples,
)
from procedures.common.sensing import NeedsChanges
from procedures.common.switch_ons import POWER, cool, switch_off, unit_of, warm_up
from station.method.commands import Power
from station.method.run import Rates, Run
from station.procedure import Prompt, Step

from .parameters import StaticParameters

LATE_S = 2.0
"""A record lasts so much longer than its samples, which come late."""

MOUNT = Prompt(
    "mount",
    "Mount the gyro on a plate that nothing moves, its input axis as the plan's `input_axis` says.",
    checklist=(
        "The plate stands on the floor, not on a table that people lean on.",
        "The room stays within 1 degC and nobody walks by during the record.",
    ),
    then="cables; the gyro is switched on by the station",
)


def mount(run: Run) -> None:
    """1: the gyro on its plate, its cables connected."""
    parameters: StaticParameters = run.parameters
    axes = parameters.mountings
    run.ask(MOUNT if axes[0] is None else upright(parameters, axes[0]))
    run.ask(CABLES[parameters.source])


def main_record(run: Run) -> None:
    """2 and 3: on and warm, then the long record."""
    switch_on_and_record(run, 1, 1, run.parameters.mountings[0])


def repeats(run: Run) -> None:
    """4: off, cool, on, warm, a short record; again and again."""
    switch_on_and_record(run, 2, run.parameters.repeats + 1, run.parameters.mountings[0])


def other_axes(run: Run) -> None:
    """1 to 4 again for each further axis of a navigator, which shows one at a time."""
    parameters: StaticParameters = run.parameters
    for axis in parameters.mountings[1:]:
        last = parameters.repeats + 1
        if all(run.is_finished(unit_for(axis, number)) for number in range(1, last + 1)):
            continue
        run.apply(Power(POWER, False))
        run.ask(upright(parameters, axis))
        run.wait(parameters.cool_s, f"{axis}: the navigator cools, switched off")
        switch_on_and_record(run, 1, last, axis)


STEPS = (
    Step("1", "Mount the gyro on a still plate", mount),
    Step("3", "Switch it on, let it warm up, record it long", main_record),
    Step("4", "Off, cool, on, warm: a short record each time", repeats),
    Step("4b", "1 to 4 again, each further axis of a navigator upright", other_axes),
    Step("5", "Switch the gyro off", switch_off),
)


def upright(parameters: StaticParameters, axis: Axis) -> Prompt:
    """Return what a person does for an axis of a navigator."""
    way, sentence = "up", f"Mount the navigator on a plate that nothing moves, {axis} up."
    if parameters.input_axis[axis].elevation_deg < 0.0:
        way, sentence = "down", f"Mount the navigator on a plate that nothing moves, {axis} down."
    return Prompt(
        f"navigator-{axis}-{way}",
        sentence,
        checklist=MOUNT.checklist,
        then="the navigator is switched on by the station and aligns",
    )


def unit_for(axis: str | None, number: int) -> str:
    """Return the name of a unit of work: a switch-on, of an axis where they are mounted in turn."""
    return unit_of(number) if axis is None else f"{axis} {unit_of(number)}"


def switch_on_and_record(run: Run, first_number: int, last_number: int, axis: str | None) -> None:
    """Switch the gyro on after it has cooled, let it warm up, and record it."""
    parameters: StaticParameters = run.parameters
    earth = 0.0
    if parameters.source == GYRO:
        earth = earth_arcsec_per_s(parameters.latitude_deg, parameters.input_axis["IA"])
    weight = parameters.pulse_weight_arcsec or 0.0
    numbers = range(first_number, last_number + 1)
    for number in run.unfinished(numbers, partial(unit_for, axis)):
        unit = unit_for(axis, number)
        cool(run, number)
        on_s = warm_up(run, number)
        with run.unit(unit, switch_on=number, on_s=on_s, axis=axis):
            rates: Rates = {parameters.source: rate_Hz(parameters)}
            samples = NeedsChanges(run, unit, rates, earth, weight)
            record_s = parameters.lengths_s[number - 1] + LATE_S
            samples.follow(record_s, f"{unit}: the gyro is recorded")
        stop_samples(run)
