"""Steps G1 and G2 of a commissioning: the channel of the laser gyro, and its rate at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import InstrumentError
from station.method.commands import Power
from station.method.verbs import Follower
from station.procedure import Prompt, Step
from station.roles import GyroAcquisition

from .parameters import CHANNELS, CHANNELS_UNIT, REST_UNIT, GyroParameters
from .work import GYRO, POWER, sampling

if TYPE_CHECKING:
    from station.method.run import Run

LIT = "lit"
MOUNT = Prompt(
    "mount",
    "Fix the laser gyro where it shall be measured, its input axis as the plan's `earth` states, "
    "and connect it to its supply and to the pulse board.",
)


@dataclass
class GyroState:
    """What this process of a run has done: whether the gyro is on."""

    is_on: bool = False


def prompts(parameters: GyroParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return (MOUNT,)


def channels(run: Run) -> None:
    """G1: on which channels the board sees a lit gyro.

    Raises InstrumentError where it sees none.
    """
    if run.is_finished(CHANNELS_UNIT):
        return
    switch_on(run)
    board, parameters = run.role(GYRO, GyroAcquisition), run.parameters.gyro
    # A board refuses a channel on which it sees no lit gyro; a broken line refuses all of them.
    lit: list[int] = []
    refused: InstrumentError | None = None
    with run.unit(CHANNELS_UNIT) as facts:
        for channel in CHANNELS:
            try:
                run.apply(sampling(parameters, channel))
            except InstrumentError as error:
                refused = error
            else:
                lit.append(channel)
            board.stop()
        if not lit and refused is not None:
            raise refused
        facts[LIT] = lit


def rest(run: Run) -> None:
    """G2: the gyro's pulses at rest, on the plan's channel or that on which it is."""
    if run.is_finished(REST_UNIT):
        return
    switch_on(run)
    parameters: GyroParameters = run.parameters.gyro
    run.wait(parameters.warm_up_s, "the gyro warms up")
    lit = run.read_back().finished_units()[CHANNELS_UNIT][LIT]
    channel = parameters.channel if parameters.channel in lit else lit[0]
    board = run.role(GYRO, GyroAcquisition)
    with run.unit(REST_UNIT, channel=channel):
        run.apply(sampling(parameters, channel))
        follower = Follower(run, {GYRO: board})
        follower.follow(run.now_s + parameters.record_s, REST_UNIT, REST_UNIT)
        board.stop()
        follower.take(REST_UNIT)
    run.apply(Power(POWER, False))


def switch_on(run: Run) -> None:
    """Have the gyro fixed and switched on, once in a process."""
    state = run.state(GyroState)
    if not state.is_on:
        ask_at_rest(run, MOUNT)
        run.apply(Power(POWER, True))
        state.is_on = True


STEPS = (
    Step("G1", "Laser gyro: its channel on the pulse board", channels),
    Step("G2", "Laser gyro: pulse weight by the earth's rate at rest", rest),
)
