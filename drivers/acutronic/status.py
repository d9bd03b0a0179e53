"""The status registers of an ACUTROL3000 axis, and its faults in plain words."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

from drivers.acutronic.axis import AxisState
from drivers.acutronic.line import INTERLOCK, AclLine
from station.errors import InstrumentError

SERVOED, SOFTWARE_ABORT, HARDWARE_ABORT = 1 << 4, 1 << 6, 1 << 7
AT_POSITION, AT_RATE = 1 << 8, 1 << 9
HOME_AGAIN = "then home the axis again"
FAULTS = {
    1 << 2: (
        "the axis did not keep up with its profile (following error), and its servo is open",
        f"look whether a cable or the device blocks it, {HOME_AGAIN}",
    ),
    1 << 1: (
        "the axis turned faster than its rate trip, and its servo is open",
        f"compare limits.rate in the bench file with what else sets rates, {HOME_AGAIN}",
    ),
    1 << 3: (
        "the controller did not keep its frame time",
        f"switch the controller off and on, {HOME_AGAIN}",
    ),
    1 << 0: (
        "the movement was aborted at a limit of position or by a command, and the servo is open",
        f"compare the plan's angles with the axis' limits, {HOME_AGAIN}",
    ),
}
SOURCES = {
    1 << 0: "a safety interlock (SI)",
    1 << 1: "the ACP",
    1 << 2: "the SUP",
    1 << 3: "the RI",
}
"""The bits of the status byte that say whose interlock opened, in the manual's abbreviations."""


@dataclass(frozen=True)
class Status:
    """The registers of an axis: state, dynamic state, and faults of the software."""

    state: int
    dynamic: int
    fault: int

    @property
    def servoed(self) -> bool:
        """Whether the servo is closed."""
        return bool(self.state & SERVOED)

    @property
    def broken(self) -> bool:
        """Whether a break is reported that nobody has reset."""
        return bool(self.state & (SOFTWARE_ABORT | HARDWARE_ABORT) or self.fault)


def queries(axis: int) -> tuple[str, ...]:
    """Return the queries of an axis' registers, in the order of `Status`."""
    return tuple(f":Status:CSR? A{axis}{name}" for name in ("STATE", "DYN", "SWFLT"))


def fault_of(name: str, line: AclLine, axis: int, status: Status) -> InstrumentError:
    """Return what broke the servo of an axis, in plain words.

    Asks the status byte, which the controller forgets then, for whose interlock opened.
    """
    attempted = f"looked at axis {axis}"
    registers = f"state {status.state}, faults {status.fault}"
    for bit, (meaning, do_now) in FAULTS.items():
        if status.fault & bit:
            return InstrumentError(name, attempted, f"{meaning} ({registers})", do_now)
    if not status.state & HARDWARE_ABORT:
        meaning = "its servo is open, though nobody here opened it"
        do_now = f"find out who or what opened it, {HOME_AGAIN}"
        return InstrumentError(name, attempted, f"{meaning} ({registers})", do_now)
    byte = 0
    with suppress(InstrumentError):
        byte = int(line.numbers("*STB?")[0])
    source = " and ".join(said for bit, said in SOURCES.items() if byte & bit)
    said = f"the interlock was opened{f' by {source}' if source else ''}, and the servo is open"
    return InstrumentError(name, attempted, f"{said} ({registers}, status byte {byte})", INTERLOCK)


def astray(name: str, state: AxisState, attempted: str, where_deg: float) -> InstrumentError:
    """Return that an axis stands elsewhere than where it was sent; it must be homed again."""
    state.homed = False
    return InstrumentError(
        name,
        attempted,
        f"the encoder of axis {state.number} reads {state.count.angle_deg:.5f} deg where "
        f"{where_deg:.5f} deg was commanded, more than settings.in_position apart",
        "look for a blocked axis or a loose encoder cable, then home it again",
    )


def wrong_rate(name: str, state: AxisState) -> InstrumentError:
    """Return that an axis turns at another rate than the commanded one; it must be homed again."""
    state.homed = False
    return InstrumentError(
        name,
        f"turn axis {state.number} at {state.rate_demand:g} deg/s",
        f"it turns at {state.rate:.4f} deg/s",
        "look whether something blocks it, then home it again",
    )
