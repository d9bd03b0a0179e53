"""Steps G1 and G2 of a commissioning: the channel of the laser gyro, and its rate at rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from procedures.commissioning.at_rest import ask_at_rest
from station.errors import InstrumentError
from station.method.commands import GyroSampling, Power
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.verbs import Recording
from station.procedure import Prompt, Step
from station.roles import GyroAcquisition

from .parameters import CHANNELS, CHANNELS_UNIT, REST_UNIT, GyroParameters

GYRO = "gyro_acquisition"
POWER = "dut_power"
SCALE = (GYRO, "scale", 1.0, "1")
"""What the calibration record states of the pulse weight."""
LOOK_S = 2.0
LIT = "lit"
MOUNT = Prompt(
    "mount",
    "Fix the laser gyro where it shall be measured, its input axis as the plan's `earth` states, "
    "and connect it to its supply and to the pulse board.",
)


def channels(run: Run) -> None:
    """G1: on which channels the board sees a lit gyro.

    Raises InstrumentError where it sees none.
    """
    for unit in run.unfinished([CHANNELS_UNIT], pauses=False):
        switch_on(run)
        board, parameters = run.role(GYRO, GyroAcquisition), run.parameters.gyro
        # A board refuses a channel on which it sees no lit gyro; a broken line refuses all of them.
        lit: list[int] = []
        refused: InstrumentError | None = None
        with run.unit(unit) as facts:
            for channel in CHANNELS:
                try:
                    run.apply(sampling(parameters, channel), takes=on_the_way(LOOK_S))
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
    parameters: GyroParameters = run.parameters.gyro
    for unit in run.unfinished([REST_UNIT], pauses=False):
        switch_on(run)
        run.wait(parameters.warm_up_s, "the gyro warms up")
        channel = run.read(partial(lit_channel, run), assumed=parameters.channel)
        with run.unit(unit, channel=channel):
            run.apply(sampling(parameters, channel))
            pulses = Recording(run, unit, {GYRO: 1.0 / parameters.sample_interval_s})
            pulses.follow(parameters.record_s, unit)
            run.role(GYRO, GyroAcquisition).stop()
            run.read(pulses.take)
        run.apply(Power(POWER, False))


STEPS = (
    Step("G1", "Laser gyro: its channel on the pulse board", channels),
    Step("G2", "Laser gyro: pulse weight by the earth's rate at rest", rest),
)


def sampling(parameters: GyroParameters, channel: int) -> GyroSampling:
    """Return the command that samples a channel."""
    return GyroSampling(GYRO, parameters.sample_interval_s, channel)


def lit_channel(run: Run) -> int:
    """Return the plan's channel where the gyro is on it, or the first on which it is."""
    lit: list[int] = run.read_back().finished_units()[CHANNELS_UNIT][LIT]
    wanted: int = run.parameters.gyro.channel
    return wanted if wanted in lit else lit[0]


@dataclass
class GyroState:
    """What this process of a run has done: whether the gyro is on."""

    is_on: bool = False


def switch_on(run: Run) -> None:
    """Have the gyro fixed and switched on, once in a process."""
    state = run.state(GyroState)
    if not state.is_on:
        ask_at_rest(run, MOUNT)
        run.apply(Power(POWER, True))
        state.is_on = True
