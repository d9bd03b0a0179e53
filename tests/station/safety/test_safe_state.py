"""Making a bench safe: order, deadlines, a person in a hurry, and one run per instrument."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from station.clock import VirtualClock
from station.errors import InstrumentError
from station.roles import SafetyReading
from station.roles.base import Driver
from station.roles.role import roles, safe_states
from station.safety.safe_state import HURRIED_WITHIN_S, Hurry, make_bench_safe


@dataclass
class Slow:
    """An instrument on virtual time that needs a while to come to rest."""

    clock: VirtualClock
    needs_s: float
    hurry: Hurry | None = None
    deadlines_s: list[float] = field(default_factory=list)
    rest_at_s: float = 0.0

    def make_safe(self, deadline_s: float) -> None:
        """Come to rest, or wait until the deadline for it."""
        self.deadlines_s.append(deadline_s - self.clock.now())
        self.rest_at_s = self.clock.now() + self.needs_s
        if self.hurry is not None:
            self.hurry.ask()
        self.clock.sleep_until(min(self.rest_at_s, deadline_s))

    def read_safety(self) -> SafetyReading:
        """Say whether it rests."""
        rests = self.clock.now() >= self.rest_at_s
        return SafetyReading(rests, "at rest" if rests else "still turning")


def test_instruments_come_to_rest_in_the_order_of_the_bench() -> None:
    clock = VirtualClock()
    bench = {name: Slow(clock, 1.0) for name in ("dut_power", "coil_supply.y", "coil_supply.x")}
    with clock.participant("run"):
        outcomes = make_bench_safe(bench, [("coil_supply", 5.0)], clock)
    assert [one.instrument for one in outcomes] == ["coil_supply.y", "coil_supply.x", "dut_power"]
    assert all(one.verified for one in outcomes)


def test_what_does_not_come_to_rest_is_unverified_and_keeps_nobody_waiting() -> None:
    clock = VirtualClock()
    bench = {"turntable": Slow(clock, 100.0), "coil_supply.x": Slow(clock, 1.0)}
    with clock.participant("run"):
        outcomes = make_bench_safe(bench, [("turntable", 5.0), ("coil_supply", 5.0)], clock)
    assert [(one.instrument, one.verified) for one in outcomes] == [
        ("turntable", False),
        ("coil_supply.x", True),
    ]
    assert clock.now() < 12.0


def test_a_reading_that_is_none_keeps_nobody_from_rest() -> None:
    class Odd(Slow):
        def read_safety(self) -> Any:
            return True

    clock = VirtualClock()
    bench = {"pump_laser": Odd(clock, 1.0), "coil_supply.x": Slow(clock, 1.0)}
    with clock.participant("run"):
        outcomes = make_bench_safe(bench, [], clock)
    assert [outcome.verified for outcome in outcomes] == [False, True]


@pytest.mark.parametrize("said", [True, None])
def test_a_reading_that_is_none_names_instrument_and_driver(said: bool | None) -> None:
    class Odd(Driver):
        def read_safety(self) -> Any:
            return said

    odd = Odd()
    odd.place = SimpleNamespace(name="pump_laser")  # type: ignore[assignment]
    wrong = f"^pump_laser: read whether it is at rest: read_safety of .*Odd returned {said}, no Saf"
    with pytest.raises(InstrumentError, match=wrong):
        odd.read_safety()


def test_a_hurry_shortens_waits_says_so_and_leaves_nothing_out() -> None:
    clock = VirtualClock()
    hurry = Hurry(clock)
    slow, quick = Slow(clock, 40.0, hurry), Slow(clock, 1.0)
    bench = {"thermal_chamber": slow, "coil_supply.x": quick}
    with clock.participant("run"):
        outcomes = make_bench_safe(bench, [("thermal_chamber", 60.0)], clock, hurry)
        clock.interrupt(None)
    chamber, coil = outcomes
    assert slow.deadlines_s[0] == pytest.approx(60.0)
    assert slow.deadlines_s[1:] == [pytest.approx(HURRIED_WITHIN_S)] * 2
    assert not chamber.verified
    assert "5 s to come to rest instead of 60 s" in chamber.skipped
    assert coil.verified


def test_every_role_that_can_harm_says_what_its_safe_state_is() -> None:
    harmful = {name for name, one in roles().items() if "make_safe" in one.verbs}
    # A supply that switches the device off can be made safe, a person at a switch cannot.
    assert harmful | {"dut_power"} == set(safe_states())
    assert all(state.brought_to and state.proven_by for state in safe_states().values())
