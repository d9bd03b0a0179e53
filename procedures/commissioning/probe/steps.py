"""Step P1 of a commissioning: each coil's field at the place of the device and about it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from procedures.commissioning.coils.steps import PLACE_PROBE
from procedures.commissioning.coils.work import GAUSSMETER, supply_of
from station.method.commands import CoilOff, CoilOn
from station.method.verbs import Follower, require_off
from station.procedure import Prompt, Step
from station.roles import DirectCurrentSupply, Gaussmeter

from .parameters import COILS, DEVICE, MOVE_MM, PLACES, PlaceRecord, ProbeParameters, ProbePlace
from .work import coil_field, field_range

if TYPE_CHECKING:
    from station.method.run import Run

LOOK_S = 0.5
BACK = Prompt("move-probe-back", "Move the probe back to the place of the device.")


def move_of(place: ProbePlace) -> Prompt:
    """Return what a person is asked to do to bring the probe to a place."""
    if place == DEVICE:
        return PLACE_PROBE
    axis, sense = place.name.split("-")
    way = {"plus": f"+{axis}", "minus": f"-{axis}"}[sense]
    return Prompt(
        f"move-probe-{place.name}",
        f"All coils are off. Move the probe by {MOVE_MM:g} mm from the place of the device towards "
        f"{way}, without turning it.",
    )


def prompts(parameters: ProbeParameters) -> tuple[Prompt, ...]:
    """Return what the operator is asked to do."""
    return (*(move_of(place) for place in PLACES), BACK)


def places(run: Run) -> None:
    """P1: the probe at each place, there each coil alone in both senses."""
    parameters: ProbeParameters = run.parameters.probe
    for coil in COILS:
        run.role(supply_of(coil), DirectCurrentSupply).programme_limits()
    run.apply(field_range(parameters))
    for place in PLACES:
        records = parameters.records_at(place)
        wanted = [record for record in records if not run.is_finished(record.unit)]
        if not wanted:
            continue
        all_off(run)
        run.may_pause()
        move = move_of(place)
        run.ask(move)
        for record in wanted:
            measure(run, record, parameters)
        all_off(run)
    run.ask(BACK)


def all_off(run: Run) -> None:
    """Switch every coil off and prove it, before a hand comes near."""
    for coil in COILS:
        run.apply(CoilOff(supply_of(coil)))
        require_off(run, supply_of(coil))


def measure(run: Run, record: PlaceRecord, parameters: ProbeParameters) -> None:
    """Record the field of one coil in one sense."""
    supply = supply_of(record.coil)
    gaussmeter = run.role(GAUSSMETER, Gaussmeter)
    run.apply(CoilOn(supply))
    run.apply(coil_field(record))
    with run.unit(record.unit):
        run.wait(parameters.settle_s, record.unit)
        gaussmeter.drain()
        until_s = run.now_s + parameters.record_s
        follower = Follower(run, {GAUSSMETER: gaussmeter})
        follower.follow(until_s, record.unit, record.unit, LOOK_S)
    if record.sense == "minus":
        run.apply(CoilOff(supply))


STEPS = (Step("P1", "Place of the probe and homogeneity, by moving the probe", places),)
