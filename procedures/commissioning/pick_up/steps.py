"""Step U1 of a commissioning: each coil driven, the device off, the voltmeter read."""

from __future__ import annotations

from functools import partial

from procedures.commissioning.coils.steps import supply_of
from station.method.commands import CoilOff, MeterRange, Power, SineField
from station.method.duration import exactly, on_the_way
from station.method.run import Run
from station.method.verbs import fetch_bursts, keep, require_off
from station.procedure import Prompt, Step
from station.roles import CoilSupply, Multimeter

from .parameters import COILS, FREQUENCY, OFF, PickUpParameters, unit_of

METER, POWER = "multimeter", "dut_power"
RANGE_V, CYCLES = 0.1, 1.0
SETTLE_S, RAMPS_S = 5.0, 11.0
"""After the sine has begun; to load it, and from it to zero."""
CABLES = Prompt(
    "connect-cables",
    "Leave the device and all its cables as a measurement has them; its power stays off.",
)


def pick_up(run: Run) -> None:
    """U1: the voltmeter with all coils off, then with each coil driven at the plan's frequency."""
    parameters: PickUpParameters = run.parameters.pick_up
    run.ask(CABLES)
    run.apply(Power(POWER, False))
    run.apply(meter_range())
    for coil in COILS:
        run.role(supply_of(coil), CoilSupply).programme_limits()
    for coil in run.unfinished((OFF, *COILS), unit_of):
        unit, frequency_Hz = unit_of(coil), parameters.frequency_Hz
        if coil != OFF:
            drive = sine(parameters, coil)
            run.prepare(drive)
            frequency_Hz = run.apply(drive, takes=on_the_way(RAMPS_S))
            run.event("field-on", axis=coil, frequency_Hz=frequency_Hz, durable=True)
            run.wait(SETTLE_S, unit)
        with run.unit(unit, **{FREQUENCY: frequency_Hz}):
            rates = {METER: 1.0 / parameters.every_s}
            act = partial(read, run, unit, run.role(METER, Multimeter))
            run.read(act, takes=exactly(parameters.record_s), rates=rates)
        if coil != OFF:
            run.apply(CoilOff(supply_of(coil)))
            require_off(run, supply_of(coil))


STEPS = (Step("U1", "Pick-up at the drive frequency, the device off", pick_up),)


def meter_range() -> MeterRange:
    """Return range and integration time of the voltmeter, one reading at a time."""
    return MeterRange(METER, RANGE_V, CYCLES, 1)


def sine(parameters: PickUpParameters, coil: str) -> SineField:
    """Return the drive of a coil."""
    return SineField(
        supply_of(coil),
        parameters.frequency_Hz,
        parameters.field_mT,
        decided_by=("parameters", "pick_up", "field"),
    )


def read(run: Run, unit: str, meter: Multimeter) -> None:
    """Record single readings, each with the time at which it came."""
    parameters: PickUpParameters = run.parameters.pick_up
    until_s = due_s = run.now_s
    until_s += parameters.record_s
    while due_s < until_s:
        run.clock.sleep_until(max(due_s, run.now_s))
        meter.start(1)
        for _, block in fetch_bursts(run, unit, {METER: meter}, every_s=0.02, doing=unit):
            keep(run, unit, meter, block)
        due_s += parameters.every_s
