"""Deadlines of exchanges: stated by kind in a driver, lengthened by a bench file, and bounded."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from keysight_fixture import meter, standing
from sim_bench import ServedInstrument, served
from wires import LIMITS

from drivers.kepco.bop import KepcoBop
from drivers.keysight.multimeter_34465a import Keysight34465A
from station.clock import VirtualClock
from station.errors import InstrumentTimeout
from station.roles.base import EXCHANGE_DEADLINE_S, MAX_DEADLINE_S, TRIES, Exchanges
from station.runner.watchers import MAX_SILENCE_S


def test_a_reset_that_takes_longer_than_other_exchanges_is_waited_for() -> None:
    late = {"fault": "late", "command": "*RST", "delay": "0.8 s"}
    with meter("34465A", late) as (_, voltmeter):
        assert voltmeter.configure(1.0, 1.0) == 1.0


def test_what_no_driver_states_ends_after_half_a_second() -> None:
    late = {"fault": "late", "command": "FUNC", "delay": "0.8 s"}
    with meter("34465A", late) as (_, voltmeter), pytest.raises(InstrumentTimeout, match=r"0\.5 s"):
        voltmeter.configure(1.0, 1.0)


def test_a_bench_gives_every_exchange_longer() -> None:
    late = {"fault": "late", "delay": "0.8 s", "for": "1 h"}
    with meter("34465A", late) as (_, voltmeter):
        voltmeter.place.exchanges.deadline_s = 1.5
        assert voltmeter.configure(1.0, 1.0) == 1.0


def test_an_answer_that_comes_near_its_deadline_is_noted() -> None:
    notes: list[Any] = []
    with standing(faults=({"fault": "late", "command": "*RST", "delay": "0.8 s"},)) as here:
        place = replace(here.place(), noter=lambda kind, details: notes.append((kind, details)))
        Keysight34465A(place).configure(1.0, 1.0)
    (details,) = (details for kind, details in notes if kind == "answer-time")
    assert details["took_s"] == pytest.approx(0.8, abs=0.01)
    assert details["deadline_s"] == 2.0


def test_on_the_way_to_rest_no_exchange_waits_beyond_its_time() -> None:
    clock = VirtualClock()
    with served(clock) as simulation:
        supply = ServedInstrument(clock, simulation, "coil_supply.x", KepcoBop).opened(
            LIMITS, coil_constant="0.3 mT/A"
        )
        simulation.inject({"instrument": "coil_supply.x", "fault": "no-reply", "for": "1 h"})
        supply.place.exchanges.deadline_s = 5.0
        began_s = clock.now()
        with pytest.raises(InstrumentTimeout):
            supply.make_safe(began_s + 1.0)
        assert clock.now() - began_s < 1.0 + TRIES * EXCHANGE_DEADLINE_S + 1.0
        with pytest.raises(InstrumentTimeout, match="within 5 s"):
            supply.identify()
        supply.close()


def test_no_deadline_is_near_what_the_watch_for_standstill_allows() -> None:
    assert 2 * MAX_DEADLINE_S <= MAX_SILENCE_S


def test_a_growing_answer_time_is_noted_again_and_a_small_one_never() -> None:
    exchanges = Exchanges()
    took_s = (0.01, 0.06, 0.06, 0.065, 0.07, 0.04, 0.4)
    noted = [exchanges.is_noteworthy(each_s, 0.5) for each_s in took_s]
    assert noted == [False, True, False, False, True, False, True]
