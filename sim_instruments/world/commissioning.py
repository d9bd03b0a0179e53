"""The world of a commissioning: the whole bench at once, each device in its own place."""

from __future__ import annotations

from functools import partial

from sim_instruments.faults.lasting import CONTACTS
from sim_instruments.truth import Truth
from sim_instruments.world.accelerometer import AccelerometerBench
from sim_instruments.world.base import World, nothing
from sim_instruments.world.chamber import Chamber
from sim_instruments.world.contacts import HandContacts
from sim_instruments.world.fog import FogBench
from sim_instruments.world.laser_gyro import LaserGyroBench
from sim_instruments.world.nine_axis import NineAxisBench
from sim_instruments.world.together import WorldsTogether

SECTIONS: dict[str, type[World]] = {
    "gyro": LaserGyroBench,
    "nine_axis": NineAxisBench,
    "fog": FogBench,
    "accelerometer": AccelerometerBench,
}
"""Where an instrument could stand in several of them, it stands in the first."""
POWER_ON = "dut-power-on"


class CommissioningBench(WorldsTogether):
    """The worlds of the methods whose devices a bench describes, with door and contacts.

    An operator who switches the device under test on gives power to the one that was mounted last;
    a supply on a line gives it to all of them.
    """

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth, SECTIONS)
        # Whoever is served devices that nobody mounted for it finds all of them switched on.
        self.preparations = tuple(dict.fromkeys((POWER_ON, *self.preparations)))
        self._mounted = ""
        opened, closed = (partial(self._door, is_open) for is_open in (True, False))
        self.acts["open-door"] = (opened, "The simulated chamber's door was opened.")
        for act in ("close-door", "close-door-again"):
            self.acts[act] = (closed, "The simulated chamber's door was closed.")
        self.contacts = HandContacts()
        for name in CONTACTS:
            for verb, is_open in (("open", True), ("close", False)):
                moved = partial(self._contact, name, is_open)
                text = f"The simulated contact {name} was {'opened' if is_open else 'closed'}."
                self.acts[f"{verb}-contact-{name}"] = (moved, text)
        self.acts["open-contact-thermal_chamber-door"] = self.acts["open-door"]
        self.acts["close-contact-thermal_chamber-door"] = self.acts["close-door"]
        self.acts["reconnect"] = (nothing, "The simulated data cable was put back.")

    def act(self, prompt_id: str, time_s: float) -> str:
        """Do what a person was asked to do, in every world that knows it."""
        if prompt_id.startswith("mount"):
            self._mounted = prompt_id
        return super().act(prompt_id, time_s)

    def knowing(self, prompt_id: str) -> list[World]:
        """Return the worlds that know an act; of switching on, those whose device is mounted."""
        known = super().knowing(prompt_id)
        if prompt_id != POWER_ON or not self._mounted:
            return known
        return [world for world in known if self._mounted in world.acts]

    def _door(self, is_open: bool, time_s: float) -> None:
        chamber = self.find(Chamber)
        if chamber is not None:
            chamber.door(time_s, is_open)

    def _contact(self, name: str, is_open: bool, time_s: float) -> None:
        self.contacts.move(name, is_open)
