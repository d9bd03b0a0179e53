"""A line out of step never makes a false "safe, read back", whatever came when, on every driver.

The instrument is energised, then each message of the way to rest is met by a fault: a line that
nobody asked for, a reply that comes twice, a device that is one reply behind. What the simulated
world says of the instrument is compared with what the safe state claims.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import pytest
from our_drivers import alone, bench_from, shipped
from tiers import quick

from station.conformance.fixture import Fixture, fixture_of
from station.instruments.bench import Bench
from station.safety.safe_state import SafeOutcome, make_bench_safe

READY_S = 300.0
LARGEST_STEP_A = 0.25
SINE = ("coil_supply.x", "rlg-magnetic-sensitivity")
Energise = Callable[[Fixture, Any], None]


def sine(fixture: Fixture, supply: Any) -> None:
    supply.programme_limits()
    supply.load_sine(0.2, 3.0)
    supply.start_sine()


def steady(fixture: Fixture, supply: Any) -> None:
    supply.programme_limits()
    supply.switch_on()
    supply.ramp_to(2.0)


def held(fixture: Fixture, generator: Any) -> None:
    generator.hold(1, 1.0)


def opened(fixture: Fixture, shutter: Any) -> None:
    shutter.open_shutter()


def fired(fixture: Fixture, digitizer: Any) -> None:
    digitizer.prepare(10e3, 0.05, 1.0)
    digitizer.fire()


def turns(fixture: Fixture, table: Any) -> None:
    table.programme_limits()
    table.home(1)
    while table.is_moving(1):
        fixture.clock.sleep(0.1)
    table.turn(1, 20.0)


def heats(fixture: Fixture, chamber: Any) -> None:
    chamber.programme_limits()
    chamber.switch_on()
    chamber.set_temperature(40.0)


CASES: dict[str, tuple[str, str, str, Energise]] = {
    "kepco list": ("sim", *SINE, sine),
    "kepco steady": ("sim", "coil_supply.dc", "accelerometer-magnetic-sensitivity", steady),
    "kepco 1 kW": ("sim-alternate", *SINE, sine),
    "33522B": ("sim", "signal_generator.xy", "serf-nonorthogonality", held),
    "SC10": ("sim", "pump_laser", "serf-nonorthogonality", opened),
    "red pitaya": ("sim", "digitizer", "serf-nonorthogonality", fired),
    "ACUTROL3000": ("sim", "turntable", "fog-scale-factor-temperature", turns),
    "F4T": ("sim", "thermal_chamber", "fog-scale-factor-temperature", heats),
    "F4": ("sim-alternate", "thermal_chamber", "fog-scale-factor-temperature", heats),
}
MODBUS = ("F4T", "F4")
STRAY = [
    {"fault": "stray-line", "where": where, "text": text}
    for where in ("ahead", "before", "behind", "after")
    for text in ("+0.000000E+00", "0")
]
DOUBLE = [{"fault": "duplicate-reply"}, {"fault": "duplicate-reply", "delay": "1 ms"}]
ONCE = [{"fault": "reset"}, {"fault": "previous-reply"}]


@cache
def bench_with(shipped_name: str, name: str) -> Bench:
    return bench_from(alone(shipped(shipped_name), name))


@contextmanager
def energised(
    case: str, *faults: dict[str, Any]
) -> Iterator[tuple[Fixture, Any, Callable[[], bool]]]:
    """Yield the stand, the instrument in its energised state, and whether it is so in the world."""
    bench, name, procedure, energise = CASES[case]
    with fixture_of(bench_with(bench, name), name, procedure) as fixture:
        for fault in faults:
            fixture.simulation.inject({"instrument": name, **fault})
        instrument = fixture.open()
        instrument.identify()
        energise(fixture, instrument)

        def is_energised() -> bool:
            return bool(fixture.simulation.simulation_report()["outputs"][name])

        assert fixture.clock.now() < READY_S
        fixture.clock.sleep_until(READY_S)
        assert is_energised()
        fixture.heard.clear()
        yield fixture, instrument, is_energised


def made_safe(fixture: Fixture, instrument: Any) -> SafeOutcome:
    """Return how the safe state of the station went, as at the end of a run."""
    (outcome,) = make_bench_safe({fixture.name: instrument}, [], fixture.clock)
    return outcome


def messages_on_the_way(case: str) -> int:
    with energised(case) as (fixture, instrument, is_energised):
        assert made_safe(fixture, instrument).verified
        assert not is_energised()
        return sum(direction == ">" for _, direction, _ in fixture.heard)


def some(count: int) -> list[int]:
    """Return the first and last messages, and some of those between."""
    chosen = {*range(1, 7), *range(9, count, 101), *range(count - 6, count + 1)}
    return sorted(one for one in chosen if 1 <= one <= count)


@pytest.mark.parametrize("case", quick(CASES, *(set(CASES) - {"kepco 1 kW", "kepco steady"})))
def test_no_line_too_many_makes_a_false_rest(case: str) -> None:
    # Frames on a serial line bear no number: one that is lost cannot be told from the one before.
    once = [one for one in ONCE if case != "F4" or one["fault"] != "previous-reply"]
    faults = [*([] if case in MODBUS else STRAY), *DOUBLE, *once]
    wrong, verified, tries = [], 0, 0
    for number, nth in enumerate(some(messages_on_the_way(case))):
        # Each message is met by another fault.
        met = {**faults[number % len(faults)], "at": f"{READY_S - 1:g} s", "nth": nth}
        with energised(case, met) as (fixture, instrument, is_energised):
            outcome = made_safe(fixture, instrument)
            tries += 1
            verified += outcome.verified
            if is_energised():
                wrong.append((met, outcome))
    assert not wrong, wrong
    assert verified >= 0.9 * tries, f"{verified} of {tries} verified"


@pytest.mark.parametrize(
    "fault",
    [
        {"fault": "stray-line", "where": "behind", "text": "0"},
        {"fault": "duplicate-reply"},
        {"fault": "lost-command"},
    ],
    ids=lambda fault: str(fault["fault"]),
)
def test_a_list_is_left_at_the_next_zero_where_its_line_was_out_of_step_at_this(
    fault: dict[str, Any],
) -> None:
    with energised("kepco list") as (fixture, instrument, _):
        made_safe(fixture, instrument)
        sent = [data for _, direction, data in fixture.heard if direction == ">"]
    leaves = 1 + next(nth for nth, data in enumerate(sent) if data.startswith(b"CURR:MODE FIX;"))
    for nth in (leaves - 1, leaves):
        met = {**fault, "at": f"{READY_S - 1:g} s", "nth": nth}
        with energised("kepco list", met) as (fixture, instrument, _):
            assert made_safe(fixture, instrument).verified
            coil = fixture.simulation.simulation_report()["coils"]["x"]
            assert coil["largest_slew_A_per_s"] * coil["time_constant_s"] < LARGEST_STEP_A


@pytest.mark.parametrize("case", [one for one in CASES if one not in MODBUS])
@pytest.mark.parametrize("where", ["ahead", "after"])
def test_stray_lines_without_end_never_make_a_false_rest(case: str, where: str) -> None:
    strays = {"fault": "stray-line", "where": where, "at": f"{READY_S - 1:g} s", "for": "100 h"}
    with energised(case, strays) as (fixture, instrument, is_energised):
        outcome = made_safe(fixture, instrument)
        assert not (outcome.verified and is_energised()), outcome


@pytest.mark.parametrize("case", [one for one in CASES if one not in MODBUS])
def test_a_device_that_is_one_reply_behind_is_never_verified(case: str) -> None:
    behind = {"fault": "previous-reply", "at": f"{READY_S - 1:g} s", "for": "100 h"}
    with energised(case, behind) as (fixture, instrument, is_energised):
        outcome = made_safe(fixture, instrument)
        assert not outcome.verified
        # The shutter's one command toggles it: nobody may send that to a device not understood.
        assert case == "SC10" or not is_energised()


@pytest.mark.parametrize("fault", ["chatter", "flood"])
@pytest.mark.parametrize("case", ["kepco list", "33522B", "ACUTROL3000", "F4T"])
def test_a_device_that_never_stops_talking_is_switched_off_without_an_answer(
    case: str, fault: str
) -> None:
    talks = {"fault": fault, "at": f"{READY_S - 1:g} s", "for": "100 h"}
    with energised(case, talks) as (fixture, instrument, is_energised):
        outcome = made_safe(fixture, instrument)
        assert not (outcome.verified and is_energised()), outcome
        fixture.clock.sleep(30.0)  # a table brakes
        assert not is_energised()
