"""Step U1 of a commissioning: each coil driven, the device off, the voltmeter read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.coils.work import supply_of
from station.method.commands import CoilOff, Power
from station.method.verbs import fetch_bursts, keep, require_off
from station.procedure import Prompt, Step
from station.roles import CoilSupply, Multimeter

from .parameters import COILS, FREQUENCY, OFF, PickUpParameters, unit_of
from .work import METER, POWER, SETTLE_S, meter_range, sine

if TYPE_CHECKING:
    from station.method.run import Run

CABLES = Prompt(
    "connect-cables",
    "Leave the device and all its cables as a measurement has them; its power stays off.",
)


def prompts(parameters: PickUpParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return (CABLES,)


def pick_up(run: Run) -> None:
    """U1: the voltmeter with all coils off, then with each coil driven at the plan's frequency."""
    parameters: PickUpParameters = run.parameters.pick_up
    run.ask(CABLES)
    run.apply(Power(POWER, False))
    run.apply(meter_range())
    for coil in COILS:
        run.role(supply_of(coil), CoilSupply).programme_limits()
    for coil in (OFF, *COILS):
        if run.is_finished(unit_of(coil)):
            continue
        run.may_pause()
        frequency_Hz = parameters.frequency_Hz
        if coil != OFF:
            drive = sine(parameters, coil)
            run.prepare(drive)
            frequency_Hz = run.apply(drive)
            run.event("field-on", axis=coil, frequency_Hz=frequency_Hz, durable=True)
            run.wait(SETTLE_S, unit_of(coil))
        with run.unit(unit_of(coil), **{FREQUENCY: frequency_Hz}):
            read(run, unit_of(coil), parameters)
        if coil != OFF:
            run.apply(CoilOff(supply_of(coil)))
            require_off(run, supply_of(coil))


def read(run: Run, unit: str, parameters: PickUpParameters) -> None:
    """Record single readings, each with the time at which it came."""
    meter = run.role(METER, Multimeter)
    until_s = due_s = run.now_s
    until_s += parameters.record_s
    while due_s < until_s:
        run.clock.sleep_until(max(due_s, run.now_s))
        meter.start(1)
        for _, block in fetch_bursts(run, unit, {METER: meter}, every_s=0.02, doing=unit):
            keep(run, unit, meter, block)
        due_s += parameters.every_s


STEPS = (Step("U1", "Pick-up at the drive frequency, the device off", pick_up),)
