"""The steps, numbered as the station does it: mount, on and warm, a long record, short ones."""

from __future__ import annotations

from procedures.common.switch_ons import CABLES, GYRO, cool, switch_off, unit_of, warm_up
from station.method.run import Run
from station.method.verbs import Recording
from station.procedure import Prompt, Step
from station.roles import GyroAcquisition

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
    run.ask(MOUNT)
    run.ask(CABLES)


def main_record(run: Run) -> None:
    """2 and 3: on and warm, then the long record."""
    switch_on_and_record(run, 1, 1)


def repeats(run: Run) -> None:
    """4: off, cool, on, warm, a short record; again and again."""
    switch_on_and_record(run, 2, run.parameters.repeats + 1)


STEPS = (
    Step("1", "Mount the gyro on a still plate", mount),
    Step("3", "Switch it on, let it warm up, record it long", main_record),
    Step("4", "Off, cool, on, warm: a short record each time", repeats),
    Step("5", "Switch the gyro off", switch_off),
)


def switch_on_and_record(run: Run, first_number: int, last_number: int) -> None:
    """Switch the gyro on after it has cooled, let it warm up, and record it."""
    parameters: StaticParameters = run.parameters
    for number in run.unfinished(range(first_number, last_number + 1), unit_of):
        unit = unit_of(number)
        cool(run, number)
        on_s = warm_up(run, number)
        with run.unit(unit, switch_on=number, on_s=on_s):
            pulses = Recording(run, unit, {GYRO: 1.0 / parameters.sample_interval_s})
            record_s = parameters.lengths_s[number - 1] + LATE_S
            pulses.follow(record_s, f"{unit}: the gyro is recorded")
        run.role(GYRO, GyroAcquisition).stop()
