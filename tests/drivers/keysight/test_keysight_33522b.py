"""The driver of the 33522B against the simulated one, over a real socket on virtual time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import yaml
from fixture import EmptyRoom
from generator_fixture import LATENCY_S, TRUTH, Fixture, standing

from drivers.generic.coil_generator_messages import differs
from drivers.keysight.generator_33522b import Keysight33522B
from station.errors import InstrumentError, InstrumentTimeout
from station.instruments.scan import draft, recognised


@pytest.fixture
def fixture() -> Iterator[Fixture]:
    with standing() as fixture:
        yield fixture


@pytest.fixture
def generator(fixture: Fixture) -> Iterator[Keysight33522B]:
    generator = Keysight33522B(fixture.place())
    yield generator
    generator.close()


def now(fixture: Fixture, coil: str) -> float:
    return float(fixture.room.volts(coil, fixture.clock.now())[0])


def test_two_generators_start_together_at_one_trigger(
    fixture: Fixture, generator: Keysight33522B
) -> None:
    other = Fixture(fixture.clock, {**TRUTH, "coils": {1: "z", 2: "gradient"}}, fixture.room)
    other_generator = Keysight33522B(other.place())
    generator.prepare_step(1, 2.0, 0.1)
    other_generator.prepare_step(1, -2.0, 0.2)
    other_generator.hold(2, 8.0)
    at_s = fixture.rise()
    edges_s = [fixture.room.coils[coil].breakpoints(at_s, at_s + 1.0) for coil in "xz"]
    assert edges_s[0][0] == edges_s[1][0] == at_s + LATENCY_S
    assert fixture.room.volts("z", at_s + 0.15) == pytest.approx([-2.0])
    assert fixture.room.volts("gradient", at_s + 0.15) == [8.0]
    other_generator.close()
    other.simulator.close()


def test_a_held_voltage_may_change_while_the_other_channel_waits(
    fixture: Fixture, generator: Keysight33522B
) -> None:
    generator.prepare_step(2, 1.0, 0.1)
    generator.hold(1, 3.0)
    assert fixture.room.volts("y", fixture.rise() + 0.05) == pytest.approx([1.0])


def test_a_step_of_nothing_leaves_the_channel_at_what_it_holds(
    fixture: Fixture, generator: Keysight33522B
) -> None:
    generator.hold(1, 0.4)
    generator.prepare_step(1, 0.0, 0.1)
    assert fixture.room.volts("x", fixture.rise() + 0.05) == pytest.approx([0.4])
    with pytest.raises(InstrumentError, match=r"its least amplitude is 0\.002 V"):
        generator.prepare_step(1, 1e-3, 0.1)


def test_where_the_bench_says_bus_the_program_gives_the_trigger(fixture: Fixture) -> None:
    generator = Keysight33522B(fixture.place(trigger="bus"))
    generator.prepare_step(1, 1.0, 0.1)
    generator.prepare_step(2, 2.0, 0.1)
    assert fixture.room.volts("x", fixture.rise() + 0.05) == [0.0]
    generator.give_trigger()
    at_s = fixture.clock.now() + 0.05
    assert fixture.room.volts("x", at_s) + fixture.room.volts("y", at_s) == pytest.approx(
        [1.0, 2.0]
    )
    generator.close()


def test_nothing_but_zero_and_what_was_asked_for_reaches_the_coil(
    fixture: Fixture, generator: Keysight33522B
) -> None:
    seen: set[float] = set()
    given = fixture.room.coils["x"].set

    def watched(time_s: float, level_V: float) -> None:
        seen.add(round(level_V, 9))
        given(time_s, level_V)

    fixture.room.coils["x"].set = watched
    generator.hold(1, 0.25)
    for step_V in (1.0, -1.5, 0.5):
        generator.prepare_step(1, step_V, 0.2)
        fixture.rise()
        fixture.clock.sleep(0.5)
        fixture.room.trigger.fall(fixture.clock.now())
        generator.disarm(1)
    generator.make_safe(fixture.clock.now() + 5.0)
    assert seen == {0.0, 0.25}


# The load.


def test_the_load_of_the_bench_file_is_written_and_read_back(fixture: Fixture) -> None:
    generator = Keysight33522B(fixture.place({"voltage": 4.0}, load="50 ohm"))
    generator.hold(1, 1.0)
    assert fixture.at_its_front_panel("OUTP1:LOAD?;:OUTP2:LOAD?") == ";".join(
        ["+5.0000000000000E+01"] * 2
    )
    # These coils see no 50 ohm, whatever the bench file says.
    assert now(fixture, "x") == 2.0
    generator.close()


@pytest.mark.parametrize("message", ["OUTP1:LOAD 50", "*RST"])
def test_a_termination_that_somebody_changed_is_caught_before_it_doubles_a_voltage(
    fixture: Fixture, generator: Keysight33522B, message: str
) -> None:
    generator.hold(1, 1.0)
    fixture.at_its_front_panel(f"SOUR1:VOLT:LIM:STAT OFF;:{message}")
    fixture.clock.sleep(1.0)
    with pytest.raises(InstrumentError) as raised:
        generator.hold(1, 1.2)
    said = str(raised.value)
    assert said.startswith("signal_generator.xy: hold 1.2 V on channel 1: asked ")
    assert "and the channel was switched off; check" in said
    assert "doubles or halves every voltage" in said
    assert now(fixture, "x") == 0.0
    generator.programme_limits()
    generator.hold(1, 1.2)
    assert now(fixture, "x") == pytest.approx(1.2)


@pytest.mark.parametrize(("load", "largest"), [("high-impedance", "10 V"), ("50 ohm", "5 V")])
def test_a_limit_beyond_the_rating_is_refused(fixture: Fixture, load: str, largest: str) -> None:
    generator = Keysight33522B(fixture.place({"voltage": 10.5}, load=load))
    with pytest.raises(InstrumentError, match=f"with this load the instrument ends at {largest}"):
        generator.programme_limits()
    generator.close()


# What goes wrong.


def test_what_somebody_left_in_the_instrument_is_gone(fixture: Fixture) -> None:
    fixture.at_its_front_panel(
        "FUNC SQU;:BURS:NCYC 7;STAT ON;:OUTP1 ON;:OUTP1:POL INV;:TRIG1:DEL 3;:NONSENSE"
    )
    generator = Keysight33522B(fixture.place())
    generator.prepare_step(1, 1.0, 0.1)
    assert fixture.room.volts("x", fixture.clock.now(), fixture.rise() + 0.05) == [0.0, 1.0]
    generator.close()


def test_an_output_that_trips_is_told_and_made_safe() -> None:
    tripped = {"fault": "output-tripped", "at": "10 s", "for": "10 s"}
    with standing(tripped) as fixture:
        generator = Keysight33522B(fixture.place())
        generator.hold(1, 1.0)
        generator.hold(2, 1.0)
        fixture.clock.sleep(11.0)
        assert generator.read_quantity("output") == "off"
        with pytest.raises(InstrumentError, match="output overload"):
            generator.hold(1, 1.5)
        with pytest.raises(InstrumentError, match="output overload"):
            generator.prepare_step(1, 1.5, 0.1)
        generator.make_safe(fixture.clock.now() + 5.0)
        fixture.clock.sleep(11.0)
        generator.hold(1, 1.5)
        assert now(fixture, "x") == 1.5
        generator.close()


def test_a_trigger_that_does_not_reach_it_starts_nothing() -> None:
    with standing({"fault": "no-trigger", "at": "0 s"}) as fixture:
        generator = Keysight33522B(fixture.place())
        generator.prepare_step(1, 1.0, 0.1)
        assert fixture.room.volts("x", fixture.rise() + 0.05) == [0.0]
        generator.close()


def test_on_the_way_to_rest_a_lost_answer_does_not_decide() -> None:
    lost = [{"fault": "no-reply", "command": f"OUTP{n}", "at": "5 s"} for n in (1, 2)]
    with standing(*lost) as fixture:
        generator = Keysight33522B(fixture.place())
        generator.hold(1, 1.0)
        fixture.clock.sleep(6.0)
        generator.make_safe(fixture.clock.now() + 5.0)
        assert generator.read_safety().safe
        generator.close()


def test_where_it_does_not_listen_a_last_attempt_switches_off_and_the_error_is_told() -> None:
    # Three times asked for, then said once more without waiting for an answer.
    for lost, safe in ((3, True), (4, False)):
        with standing({"fault": "lost-command", "command": "OUTP2 OFF", "count": lost}) as fixture:
            generator = Keysight33522B(fixture.place())
            generator.programme_limits()
            fixture.at_its_front_panel("OUTP2 ON")
            with pytest.raises(InstrumentTimeout, match="no answer came"):
                generator.make_safe(fixture.clock.now() + 5.0)
            fixture.clock.sleep(1e-3)
            assert generator.read_safety().safe is safe
            channel = "channel 1 off, channel 2 " + ("off" if safe else "on")
            assert generator.read_safety().read_back == channel
            generator.close()


def test_it_works_where_there_is_nothing_to_drive() -> None:
    with standing(room=EmptyRoom()) as fixture:
        generator = Keysight33522B(fixture.place())
        generator.hold(1, 1.0)
        generator.prepare_step(2, 1.0, 0.1)
        generator.make_safe(fixture.clock.now() + 5.0)
        assert not fixture.simulator.energised()
        generator.close()


def test_a_read_back_may_be_rounded_to_its_four_digits() -> None:
    assert not differs(0.123456, "+1.2350000000000E-01")
    assert not differs(float("inf"), "+9.9000000000000E+37")
    assert not differs("DC", "DC")
    assert differs(0.5, "+1.0000000000000E+00")
    assert differs(float("inf"), "+5.0000000000000E+01")
    assert differs(0.5, "DC")


def test_two_generators_that_a_scan_finds_have_the_two_places() -> None:
    answers = {
        f"TCPIP::192.0.2.{number}::5025::SOCKET": f"{maker} Technologies,33522B,MY{number},4.00"
        for number, maker in enumerate(("Keysight", "Agilent"), 1)
    }
    text = draft([recognised(address, said) for address, said in answers.items()])
    drafted = {name: one["driver"] for name, one in yaml.safe_load(text)["instruments"].items()}
    assert drafted == {
        "signal_generator.xy": "keysight-33522b",
        "signal_generator.z_gradient": "keysight-33522b",
    }


def test_a_delayed_step_begins_that_much_after_the_trigger(
    fixture: Fixture, generator: Keysight33522B
) -> None:
    generator.prepare_step(1, 2.0, 0.1, 0.012)
    at_s = fixture.rise()
    first_s, last_s = fixture.room.coils["x"].breakpoints(at_s, at_s + 1.0)
    assert first_s == pytest.approx(at_s + 0.012 + LATENCY_S, abs=1e-12)
    assert last_s == pytest.approx(first_s + 0.1, abs=1e-9)
    with pytest.raises(InstrumentError, match="after a trigger"):
        generator.prepare_step(1, 2.0, 0.1, 2000.0)
