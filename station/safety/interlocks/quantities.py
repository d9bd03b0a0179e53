"""What an interlock may watch: the quantities of each role, their units, states and periods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

IDLE_PERIOD_S = 10.0
"""How often a quantity that only an energised bench can change is looked at on one at rest."""


@dataclass(frozen=True)
class Kind:
    """A quantity as drivers publish it: the unit of a number, or the states it may have.

    `period_s` is how often an interlock looks where its own `period` does not say. `magnitude`:
    `above` and `below` mean the magnitude, for what flows or turns either way. `while_on`: looked
    at that often only while something is energised or moves.
    """

    unit: str = ""
    states: tuple[str, ...] = ()
    period_s: float = 1.0
    magnitude: bool = False
    while_on: bool = False


CONTACT_STATES = ("closed", "open")
CONTACT = Kind(states=CONTACT_STATES)
TEMPERATURE = Kind("degC", period_s=10.0)
OUTPUT = Kind(states=("on", "off"))
MOTION = Kind(states=("moving", "at-rest"))
CURRENT = Kind("A", period_s=0.2, magnitude=True, while_on=True)
# What a coil's voltage tells beside its current, its resistance, changes slowly.
VOLTAGE = Kind("V", period_s=2.0, magnitude=True, while_on=True)
RATE = Kind("deg/s", period_s=0.2, magnitude=True, while_on=True)
ANGLE = Kind("deg", period_s=0.2, while_on=True)
# Longer than the pause between two looks of a running record, whose reading then serves.
FIELD = Kind("mT", period_s=2.0, magnitude=True, while_on=True)
TURNING = {"rate": RATE, "angle": ANGLE, "motion": MOTION}

QUANTITIES: Mapping[str, Mapping[str, Kind]] = {
    "coil_supply": {
        "current": CURRENT,
        "voltage": VOLTAGE,
        "temperature": TEMPERATURE,
        "output": OUTPUT,
    },
    "gaussmeter": {"field": FIELD, "temperature": TEMPERATURE},
    "multimeter": {"voltage": Kind("V", magnitude=True)},
    "thermometer": {"temperature": TEMPERATURE},
    "rotary_stage": TURNING,
    "turntable": {**TURNING, "chain": Kind(states=CONTACT_STATES, while_on=True)},
    "thermal_chamber": {
        "temperature": TEMPERATURE,
        "door": CONTACT,
        "chain": CONTACT,
        "output": OUTPUT,
    },
    "gyro_acquisition": {"temperature": TEMPERATURE},
    "navigator": {"temperature": TEMPERATURE},
    "imu": {"temperature": TEMPERATURE},
    "signal_generator": {"output": OUTPUT},
    "digitizer": {"voltage": Kind("V", magnitude=True)},
    "pump_laser": {"temperature": TEMPERATURE, "output": OUTPUT},
    "dut_power": {
        "voltage": Kind("V", magnitude=True),
        "current": Kind("A", magnitude=True),
        "output": OUTPUT,
    },
    "interlock_chain": {"chain": CONTACT},
}
"""Role, quantity, kind; what a driver publishes is in these units."""

ENERGISED = {"output": "on", "motion": "moving"}
"""The state that says of an instrument that it is energised or moves."""


def role_of(instance: str) -> str:
    """Return the role of an instance: `coil_supply` of `coil_supply.x`."""
    return instance.split(".")[0]


def quantities_of(instance: str) -> Mapping[str, Kind]:
    """Return what can be watched of an instance, by name."""
    return QUANTITIES.get(role_of(instance), {})


def kind_of(instance: str, quantity: str) -> Kind:
    """Return the kind of a quantity of an instance."""
    return quantities_of(instance)[quantity]
