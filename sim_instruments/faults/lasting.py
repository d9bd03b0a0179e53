"""Faults that last: from one moment to another the instrument, or the world, is another one.

What each does stands in the simulated instrument that declares it (`lasting_faults`).
"""

from __future__ import annotations

import math
from typing import ClassVar

from sim_instruments.faults.trigger import Trigger
from sim_instruments.truth import SimulationError, Truth

CONTACTS = ("e-stop", "door")
"""The contacts of the simulated interlock chain."""


class LastingFault:
    """One state that begins at a time or at a message and ends after a while, or never."""

    kind: ClassVar[str]
    options: ClassVar[tuple[str, ...]] = ()

    def __init__(self, trigger: Trigger, truth: Truth) -> None:
        self.trigger = trigger
        self.begin_s = math.inf
        self.end_s = math.inf
        self.read(truth)

    def read(self, truth: Truth) -> None:
        """Take the options of the fault from its entry; SimulationError where one is wrong."""

    def begin(self, time_s: float) -> None:
        """Begin at `time_s`."""
        self.begin_s = time_s
        self.end_s = time_s + self.trigger.for_s

    def lasts(self, time_s: float) -> bool:
        """Return whether the fault is there at a time."""
        return self.begin_s <= time_s < self.end_s


class PortGone(LastingFault):
    """Nobody listens on the instrument's port any more, and its connections end."""

    kind = "port-gone"


class Chatter(LastingFault):
    """The instrument says a line every `interval`, 20 ms unless said, asked or not."""

    kind = "chatter"
    options = ("interval",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.interval_s = truth.positive("interval", "s", 0.02)


class Frozen(LastingFault):
    """What is measured keeps the last value, while time stamps and numbers go on."""

    kind = "frozen"


class Overload(LastingFault):
    """The input is beyond its range, and readings say so."""

    kind = "overload"


class Compliance(LastingFault):
    """The supply gives no more than `voltage`, 1 V unless said: a worn contact, a hot coil."""

    kind = "compliance"
    options = ("voltage",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.voltage_V = truth.quantity("voltage", "V", 1.0)
        if self.voltage_V < 0:
            raise SimulationError(f"{truth.where}.voltage: must not be negative")


class ListRefused(LastingFault):
    """The supply takes a list and refuses to run it, with a settings conflict."""

    kind = "list-refused"


class Overdrive(LastingFault):
    """The supply drives `factor` times the current that is commanded, 3.5 unless said."""

    kind = "overdrive"
    options = ("factor",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.factor = truth.positive("factor", "1", 3.5)


class Lies(LastingFault):
    """The supply goes on as it is, ignores what it is sent, and answers off and 0 A."""

    kind = "lies"


class ComesBack(LastingFault):
    """The output is on again, `after` 1 s unless said, with `current` 4 A; `times` 1 in all."""

    kind = "comes-back"
    options = ("after", "current", "times")

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.after_s = truth.positive("after", "s", 1.0)
        self.current_A = truth.quantity("current", "A", 4.0)
        self.times = truth.integer("times", 1, 1)


class Overheating(LastingFault):
    """The device under test is `rise` warmer than it should be, 60 K unless said."""

    kind = "overheating"
    options = ("rise",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.rise_K = truth.quantity("rise", "K", 60.0)


class ChainOpen(LastingFault):
    """A `contact` of the interlock chain is open: `e-stop`, unless said, or `door`."""

    kind = "chain-open"
    options = ("contact",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.contact = truth.text("contact", CONTACTS[0])
        if self.contact not in CONTACTS:
            raise SimulationError(
                f"{truth.where}.contact: the chain has no '{self.contact}' "
                f"(it has: {', '.join(CONTACTS)})"
            )


class Silent(LastingFault):
    """What samples goes on sampling and sends no sample."""

    kind = "silent"


class Dark(LastingFault):
    """The gyro's discharge goes out: nothing is counted, and the board sees no light."""

    kind = "dark"


class FollowingError(LastingFault):
    """A turning axis does not keep up: its controller trips and switches the motor off."""

    kind = "following-error"


class EncoderJump(LastingFault):
    """The encoder of an axis reads `angle` too much, 0.05 deg unless said."""

    kind = "encoder-jump"
    options = ("angle",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.angle_deg = truth.quantity("angle", "deg", 0.05)


class Stuck(LastingFault):
    """An axis is blocked where it stands; its controller counts on and notices nothing."""

    kind = "stuck"


class EmergencyStop(LastingFault):
    """The emergency stop of a motion controller is pressed, and stays so."""

    kind = "emergency-stop"


class NoTrigger(LastingFault):
    """The edge of the bench's trigger does not reach the instrument's trigger input."""

    kind = "no-trigger"


class StuckOpen(LastingFault):
    """The shutter opens and does not close: its blade stays where it is."""

    kind = "stuck-open"


class InterlockOpen(LastingFault):
    """The interlock of the shutter's controller is open: it closes and cannot be enabled."""

    kind = "interlock-open"


class OutputTripped(LastingFault):
    """The protection of a generator's outputs has tripped: both are off and cannot be on."""

    kind = "output-tripped"


class LoadReset(LastingFault):
    """Somebody sets a generator's terminations back to 50 ohm: what follows is doubled."""

    kind = "load-reset"


class HeaterBroken(LastingFault):
    """The heater of a chamber or a cell gives nothing: a set-point is never reached."""

    kind = "heater-broken"


class SensorOpen(LastingFault):
    """The thermometer of a heated cell is open: its controller has no reading, and says so."""

    kind = "sensor-open"


class CompressorTrip(LastingFault):
    """A thermal chamber's compressor has tripped: nothing cools, and its alarm is on."""

    kind = "compressor-trip"


class DoorOpen(LastingFault):
    """The door of a thermal chamber is open."""

    kind = "door-open"


class ChamberAlarm(LastingFault):
    """Alarm `number` (1 unless said) of a thermal chamber is on and has cut its power."""

    kind = "chamber-alarm"
    options = ("number",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.number = truth.integer("number", 1, 1)


class AlignmentFails(LastingFault):
    """The navigator does not find its attitude, or loses it, and its status says so."""

    kind = "alignment-fails"


class GyroFails(LastingFault):
    """A gyro of navigator or nine-axis sensor fails its own test, as its status shows."""

    kind = "gyro-fails"


class DeviceShorted(LastingFault):
    """The device under test takes what `resistance` takes, 0.5 ohm unless said."""

    kind = "device-shorted"
    options = ("resistance",)

    def read(self, truth: Truth) -> None:
        """Take the options."""
        self.resistance_ohm = truth.positive("resistance", "ohm", 0.5)


LASTING_FAULTS = {fault.kind: fault for fault in LastingFault.__subclasses__()}

EVERYWHERE = (PortGone.kind,)
"""What can happen to any instrument that is served on a port."""
