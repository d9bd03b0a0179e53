"""A Lake Shore 336 as other programs use it: curves, alarms, relays, zones, monitor outputs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from fixture import EmptyRoom, Fixture, standing
from sim_bench import Line

from sim_instruments.lakeshore.controller_336 import Lakeshore336

TRUTH = {"full_power": "50 W", "sensor_error": "0 K", "noise": "0 K"}
ROOM_K = 22.5 + 273.15
ROOM_OHM = 100.0 * (1.0 + 3.9083e-3 * 22.5 - 5.775e-7 * 22.5**2)


@contextmanager
def controller() -> Iterator[tuple[Fixture, Line]]:
    room = EmptyRoom()
    with standing("cell_heater", Lakeshore336, TRUTH, room) as fixture, fixture.line() as line:
        line.ask("*ESR?")
        yield fixture, line


def test_a_curve_is_kept_point_by_point_and_an_input_reads_by_it() -> None:
    with controller() as (_, line):
        assert line.ask("INCRV? A;*ESR?") == "06;000"
        points = [(80.0, 200.0), (120.0, 400.0), (160.0, 600.0)]
        for index, (ohm, kelvin) in enumerate(points, start=1):
            assert line.ask(f"CRVPT 21,{index},{ohm},{kelvin};*ESR?") == "000"
        shown = [line.ask(f"CRVPT? 21,{index}") for index in (1, 2, 3, 4)]
        assert [tuple(map(float, row.split(","))) for row in shown] == [*points, (0.0, 0.0)]
        header = '"Cell, inner","77",3,600.000,2'
        assert line.ask(f"CRVHDR 21,{header};*ESR?") == "000"
        assert line.ask("CRVHDR? 21") == "Cell, inner    ,77        ,3,+600.000,2"
        assert line.ask("INCRV A,21;INCRV? A;RDGST? A") == "21;000"
        assert float(line.ask("KRDG? A")) == pytest.approx(
            200.0 + 5.0 * (ROOM_OHM - 80.0), abs=0.01
        )
        assert float(line.ask("SRDG? A")) == pytest.approx(ROOM_OHM, abs=1e-3)
        assert line.ask("CRVPT 21,1,110,200;RDGST? A;KRDG? A") == "001;+0.000", "beyond its points"
        line.ask("CRVDEL 21;*ESR?")
        assert line.ask("CRVPT? 21,2") == "+0,+0"
        line.ask("INCRV A,6;*ESR?")
        assert float(line.ask("KRDG? A")) == pytest.approx(ROOM_K, abs=1e-3)


def test_alarms_switch_relays_and_stay_where_they_are_latched() -> None:
    with controller() as (_, line):
        low, high = ROOM_K - 5.0, ROOM_K - 1.0
        assert line.ask(f"ALARM A,1,{high:.2f},{low:.2f},0.5,0,0,1;*ESR?") == "000"
        assert line.ask("ALARMST? A;OPST?") == "1,0;001"
        assert line.ask("RELAY 1,2,A,1;RELAY 2,2,A,0;RELAYST? 1;RELAYST? 2") == "1;0"
        assert line.ask("RELAY? 1") == "2,A,1"
        assert line.ask("ALARM A,1,400,200,0.5,1,0,1;ALMRST;ALARMST? A;RELAYST? 1") == "0,0;0"
        line.ask("ALARM A,1,290,200,0.5,1,0,1;ALARMST? A")
        assert line.ask("ALARM A,1,400,200,0.5,1,0,1;ALARMST? A") == "1,0", "latched"
        assert line.ask("ALMRST;ALARMST? A") == "0,0"
        line.ask("ALARM A,0,,,,,,;*ESR?")
        assert line.ask("ALARM? A") == "0,+400.000,+200.000,+0.500,1,0,1"
        assert line.ask("RELAY 1,1,,;RELAYST? 1;RELAY 1,0,,;RELAYST? 1") == "1;0"


def test_a_zone_has_its_own_terms_of_the_loop() -> None:
    with controller() as (fixture, line):
        line.ask("ZONE 1,1,400,50,20,0,0,3,1,0.1;OUTMODE 1,2,1,0;*ESR?")
        assert line.ask("ZONE? 1,1") == "+400.000,+0050.0,+0020.0,+000.0,+000.00,3,1,+000.1"
        line.ask("RAMP 1,0,0.1;SETP 1,40;RANGE 1,1;*ESR?")
        fixture.clock.sleep(900.0)
        assert line.ask("RANGE? 1") == "3", "that of the zone"
        assert float(line.ask("CRDG? A")) == pytest.approx(40.0, abs=0.1)
        line.ask("ZONE 1,1,280,50,20,0,0,3,1,0.1;*ESR?")
        fixture.clock.sleep(900.0)
        assert float(line.ask("CRDG? A")) < 39.0, "no zone holds its set-point"


def test_a_monitor_output_shows_its_input_and_extremes_are_remembered() -> None:
    with controller() as (fixture, line):
        line.ask("OUTMODE 3,4,1,0;ANALOG 3,1,1,400,200,0;*ESR?")
        percent = (ROOM_K - 200.0) / 2.0
        assert float(line.ask("AOUT? 3")) == pytest.approx(percent, abs=0.01)
        line.ask("ANALOG 3,1,2,100,0,1;*ESR?")
        assert float(line.ask("AOUT? 3")) == pytest.approx(2 * 22.5 - 100.0, abs=0.01)
        line.ask("MDAT? A;SETP 1,60;RANGE 1,3;*ESR?")
        fixture.clock.sleep(600.0)
        least, largest = map(float, line.ask("MDAT? A").split(","))
        assert least == pytest.approx(ROOM_K, abs=0.01) and largest > ROOM_K + 20.0
        least, largest = map(float, line.ask("MNMXRST;MDAT? A").split(","))
        assert least == largest


def test_panel_names_and_network_are_kept() -> None:
    kept = {
        "BRIGT": "20",
        "LEDS": "0",
        "LOCK": "1,042",
        "MODE": "1",
        "IEEE": "07",
        "INTSEL": "1",
        "DISPLAY": "4,2,3",
        "NET": "0,0,10.0.0.7,255.0.0.0,10.0.0.1,0.0.0.0,0.0.0.0,LSCI-336       ,lab,oven",
    }
    with controller() as (_, line):
        for name, value in kept.items():
            assert line.ask(f"{name} {value};{name}?;*ESR?") == f"{value};000", name
        assert line.ask('INNAME B,"Cell";INNAME? B') == "Cell           "
        assert line.ask("WARMUP 3,0,50;WARMUP? 3;DISPFLD 8,2,3;DISPFLD? 8") == "0,+050.00;2,3"
        assert line.ask("NETID?").split(",")[1] == "10.0.0.7"
        assert line.ask("SRDG? 0").count(",") == 3 and line.ask("TUNEST?;*ESR?") == "0,1,0,0;000"


@pytest.mark.parametrize(
    ("message", "event"),
    [
        ("INCRV A,60", 16),
        ("CRVPT 20,1,1,1", 16),
        ("CRVPT 21,201,1,1", 16),
        ("CRVPT 21,1,1", 16),
        ('CRVHDR 5,"a","b",3,300,2', 16),
        ('CRVHDR 21,"a","b",5,300,2', 16),
        ('INNAME A,"A name that is too long"', 16),
        ("ZONE 3,1,1,1,1,1,1,1,1,1", 16),
        ("ZONE 1,11,1,1,1,1,1,1,1,1", 16),
        ("RELAY 3,1,A,0", 16),
        ("ANALOG 1,1,1,1,0,0", 16),
        ("MODE 3", 16),
        ("IEEE 31", 16),
        ("NET 0,0,10.0.0,1,1,1,1,a,b,c", 16),
        ("AOUT? 1", 16),
        ("TEMP?", 32),
    ],
)
def test_what_it_has_not_or_cannot_be_is_refused(message: str, event: int) -> None:
    with controller() as (_, line):
        assert int(line.ask(f"{message};*ESR?")) == event
