"""Signs of life: who gives them, who is silent for too long, and what may be silent for longer."""

from __future__ import annotations

from threading import Event, Thread

from station.clock import RealClock, VirtualClock
from station.clock.pulse import MAX_BETWEEN_LOOKS_S, Pulse, Pulses


def looked_at(pulses: Pulses, *times_s: float) -> list[list[str]]:
    """Return who was quiet at each of some looks."""
    return [[one.name for one in pulses.look(time_s)] for time_s in times_s]


def test_who_gives_no_sign_for_too_long_is_named_and_for_how_long() -> None:
    pulses, steps, reader = Pulses(), Pulse("the steps", 2.0), Pulse("the reader", 5.0)
    pulses.add(steps)
    pulses.add(reader)
    assert looked_at(pulses, 0.0, 1.0, 2.0) == [[], [], []]
    assert looked_at(pulses, 2.5) == [["the steps"]]
    assert str(pulses.look(3.0)[0]) == "the steps did not respond for 3 s"
    steps.beat()
    assert looked_at(pulses, 4.0, 5.0, 5.5) == [[], [], ["the reader"]]
    reader.end()
    assert looked_at(pulses, 5.8) == [[]]


def test_a_computer_that_slept_has_missed_no_sign() -> None:
    pulses = Pulses()
    pulses.add(Pulse("the steps", 2.0))
    assert looked_at(pulses, 0.0, 1.0, 5000.0) == [[], [], []]
    assert looked_at(pulses, 5000.0 + MAX_BETWEEN_LOOKS_S) == [["the steps"]]


def test_a_longer_silence_can_be_declared_for_a_while_or_once() -> None:
    pulses, steps = Pulses(), Pulse("the steps", 1.5)
    pulses.add(steps)
    with steps.allow(3.5):
        assert looked_at(pulses, 0.0, 1.0, 2.0, 3.0, 4.0) == [[], [], [], [], ["the steps"]]
    assert looked_at(pulses, 5.0, 6.0, 7.0) == [[], [], ["the steps"]]
    steps.expect(2.5)
    assert looked_at(pulses, 8.0, 9.0, 10.0, 11.0) == [[], [], [], ["the steps"]]
    steps.beat()
    assert looked_at(pulses, 12.0, 13.0, 14.0) == [[], [], ["the steps"]]


def test_asking_for_the_time_and_sleeping_are_signs_of_life() -> None:
    clock = RealClock(speed=100.0)
    pulse = clock.pulse("the steps", 5.0)
    clock.now()
    assert pulse.beats == 1
    clock.sleep(1.0)
    assert pulse.beats > 2
    before = pulse.beats
    other = Thread(target=clock.now)
    other.start()
    other.join()
    assert pulse.beats == before, "another thread's call is no sign of this one"


def test_a_thread_that_sleeps_long_is_heard_of() -> None:
    clock, begun, ended = RealClock(), Event(), Event()
    pulses: list[Pulse] = []

    def watch() -> None:
        with clock.pulse("the interlocks", 2.0) as pulse:
            pulses.append(pulse)
            begun.set()
            clock.sleep(3.0)
        ended.set()

    Thread(target=watch, daemon=True).start()
    begun.wait()
    while not ended.is_set():
        assert not clock.quiet_pulses()
        Event().wait(0.1)
    assert pulses[0].beats >= 3


def test_virtual_time_looks_at_no_pulse() -> None:
    clock = VirtualClock()
    with clock.pulse("the steps", 0.0), clock.allow(1.0):
        clock.expect(1.0)
        assert not clock.quiet_pulses()
    clock.stop()
