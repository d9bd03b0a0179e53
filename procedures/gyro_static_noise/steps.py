"""The steps, numbered as the station does it: mount, on and warm, a long record, short ones."""

from __future__ import annotations

from station.method.commands import GyroSampling, Power
from station.method.run import Run
from station.method.verbs import Recording
from station.procedure import Prompt, Step
from station.roles import GyroAcquisition

from .parameters import StaticParameters, unit_of

GYRO, POWER = "gyro_acquisition", "dut_power"
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
CABLES = Prompt("connect-cables", "Connect the gyro to its acquisition board and its supply.")


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


def switch_off(run: Run) -> None:
    """5: the gyro off."""
    run.apply(Power(POWER, False))


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
        if number > 1:
            run.apply(Power(POWER, False))
            run.wait(parameters.cool_s, f"{unit}: the gyro cools, switched off")
        run.apply(Power(POWER, True))
        on_s = run.now_s
        run.wait(parameters.warm_up_s, f"{unit}: the gyro warms up")
        run.apply(GyroSampling(GYRO, parameters.sample_interval_s, parameters.channel))
        with run.unit(unit, switch_on=number, on_s=on_s):
            pulses = Recording(run, unit, {GYRO: 1.0 / parameters.sample_interval_s})
            record_s = parameters.lengths_s[number - 1] + LATE_S
            pulses.follow(record_s, f"{unit}: the gyro is recorded")
        run.role(GYRO, GyroAcquisition).stop()
