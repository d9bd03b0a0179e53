"""The 34465A, simulated on its socket and driven by our drivers, in a small world of its own."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock
from typing import Any

import numpy as np
import pytest
from sim_bench import Line

from drivers.keysight_34465a import Keysight34465A
from drivers.keysight_34465a_pt100 import Keysight34465APt100, temperature_degC
from sim_instruments.faults.instrument import InstrumentFaults, Schedule
from sim_instruments.faults.reading import read_fault
from sim_instruments.instrument import Setting
from sim_instruments.keysight_34465a import Keysight34465A as SimulatedMeter
from sim_instruments.truth import Truth
from station.clock import Clock, RealClock, VirtualClock
from station.errors import InputError, InstrumentError, InstrumentTimeout
from station.readings import Readings
from station.runner.opening import Place

CLEAN = '+0,"No error"'
VOLTS = {
    "measures": "accelerometer",
    "noise": "0 ppm",
    "line_frequency": "50 Hz",
    "gain_error": "0 ppm",
    "offset": "0 V",
    "zero_drift_in_one_hour": "36 uV",
}
OHMS = {
    "measures": "pt100",
    "noise": "0 ppm",
    "line_frequency": "50 Hz",
    "gain_error": "0 ppm",
    "offset": "0 ohm",
}


class Room:
    """A world with nothing but a ramp of voltage and a Pt100."""

    def __init__(self, volts: float, slope_V_per_s: float, ohms: float) -> None:
        self.lock = RLock()
        self._volts, self._slope_V_per_s, self._ohms = volts, slope_V_per_s, ohms

    def mean_output_V(self, edges_s: np.ndarray) -> np.ndarray:
        return self._volts + self._slope_V_per_s * (edges_s[1:] + edges_s[:-1]) / 2

    def mean_pt100_ohm(self, edges_s: np.ndarray) -> np.ndarray:
        return np.full(len(edges_s) - 1, self._ohms)


class EmptyRoom:
    """A world in which there is nothing to measure."""

    def __init__(self) -> None:
        self.lock = RLock()


class Stand:
    """A simulated meter that is served in a world, and whoever talks to it."""

    def __init__(self, clock: Clock, truth: dict[str, str], room: Any, *faults: dict[str, Any]):
        self.clock = clock
        self.readings = Readings(clock)
        instrument_faults = InstrumentFaults(Schedule(clock, room.lock))
        rng = np.random.default_rng(1)
        self.meter = SimulatedMeter(
            Setting(
                "multimeter",
                "MY54500001",
                Truth(truth, "simulator"),
                room,
                clock,
                rng,
                0,
                instrument_faults,
            )
        )
        self.instruments = {"multimeter": self.meter.describe()}
        for entry in faults:
            given = {"instrument": "multimeter", **entry}
            read = read_fault(
                given, Truth(given, "fault"), "scpi", [entry["fault"]], clock.now(), rng
            )
            instrument_faults.add(read[0], at_message=read[1])

    def line(self) -> Line:
        return Line(self, "multimeter", self.clock)  # type: ignore[arg-type]

    def place(self, **settings: Any) -> Place:
        return Place(
            "multimeter",
            self.instruments["multimeter"]["address"],
            self.clock,
            settings,
            publisher=self.readings.publisher("multimeter"),
        )

    def newest(self, quantity: str) -> Any:
        reading = self.readings.newest("multimeter", quantity)
        return None if reading is None else reading.value


@contextmanager
def standing(
    volts: float = 0.5,
    slope: float = 0.0,
    ohms: float = 107.79,
    truth: dict[str, str] = VOLTS,
    faults: tuple[dict[str, Any], ...] = (),
    room: Any = None,
    **changes: str,
) -> Iterator[Stand]:
    clock = VirtualClock()
    with clock.participant("test"):
        stand = Stand(clock, {**truth, **changes}, room or Room(volts, slope, ohms), *faults)
        try:
            yield stand
        finally:
            stand.meter.close()
            clock.stop()


@pytest.fixture
def stand() -> Iterator[Stand]:
    with standing() as stand:
        yield stand


@pytest.fixture
def line(stand: Stand) -> Iterator[Line]:
    with stand.line() as line:
        yield line


def numbers(reply: str) -> list[float]:
    return [float(text) for text in reply.split(",")]


def burst(meter: Any, clock: Clock, readings: int) -> Any:
    meter.start(readings)
    for _ in range(1000):
        block = meter.fetch()
        if block is not None:
            return block
        clock.sleep(0.1)
    raise AssertionError("the burst does not end")


# The instrument on its wire.


def test_it_says_who_it_is_and_what_it_has(line: Line) -> None:
    maker, model, serial, firmware = line.ask("*IDN?").split(",")
    assert (maker, model, serial) == ("Keysight Technologies", "34465A", "MY54500001")
    assert firmware[:4] >= "A.03"
    assert line.ask("*OPT?") == "DIG,MEM"
    assert line.ask("SYST:LIC:CAT?") == '"DIG","MEM"'
    assert int(line.ask("SYST:LFR?")) == 50


def test_functions_have_quotes_and_ranges_go_up(line: Line) -> None:
    assert line.ask("FUNC?") == '"VOLT"'
    assert line.ask('SENS:FUNC "FRES";:SENS:FUNC?') == '"FRES"'
    assert line.ask('FUNC "VOLTage:DC";:FUNC?') == '"VOLT"'
    assert float(line.ask("VOLT:DC:RANG 2.5;:VOLT:RANG?")) == 10.0
    assert line.ask("VOLT:RANG:AUTO?") == "0"
    assert float(line.ask("VOLT:RANG? MAX")) == 1000.0
    assert float(line.ask("SENSe:VOLTage:DC:NPLC 0.060000;:VOLT:NPLC?")) == 0.06
    assert float(line.ask("VOLT:DC:RES?")) == pytest.approx(1.5e-5)
    assert float(line.ask("VOLT:DC:RES 3e-6;:VOLT:NPLC?")) == 1.0
    assert float(line.ask("VOLT:APER 0.05;:VOLT:APER?")) == 0.05
    assert line.ask("VOLT:APER:ENAB?") == "1"
    assert line.ask("SYST:ERR?") == CLEAN


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ("VOLT:NONSENSE 1", '-113,"Undefined header"'),
        ("VOLT:RANG 2000", '-222,"Data out of range"'),
        ("VOLT:NPLC 3", '-224,"Illegal parameter value"'),
        ("FUNC VOLT", '-151,"Invalid string data"'),
        ("SAMP:COUN 2000000000", '-222,"Data out of range"'),
        ("*TRG", '-211,"Trigger ignored"'),
        ("FETC?", '-230,"Data stale"'),
        ("TRIG:SOUR BUS;:READ?", '-214,"Trigger deadlock"'),
        ("INIT;:INIT", '-213,"Init ignored"'),
    ],
)
def test_what_does_not_fit_is_refused(line: Line, message: str, error: str) -> None:
    assert line.ask(f"{message};:SYST:ERR?") == error
    assert line.ask("SYST:ERR?") == CLEAN


def test_the_error_queue_holds_twenty(line: Line) -> None:
    line.ask(";:".join(["NONSENSE"] * 25) + ";*OPC?")
    errors = [line.ask("SYST:ERR?") for _ in range(21)]
    assert errors[0] == '-113,"Undefined header"'
    assert errors[19:] == ['-350,"Queue overflow"', CLEAN]


def test_a_burst_takes_its_time_and_is_kept(stand: Stand, line: Line) -> None:
    line.ask("VOLT:RANG 1;:VOLT:NPLC 10;:SAMP:COUN 5;:INIT;:SYST:ERR?")
    began_s = stand.clock.now()
    assert int(line.ask("STAT:OPER:COND?")) & 16
    stand.clock.sleep(1.0)
    assert int(line.ask("DATA:POIN?")) == 2
    assert line.ask("DATA:LAST?") == "+5.00000000E-01 VDC"
    assert numbers(line.ask("FETC?")) == [0.5] * 5
    # Ten cycles of 50 Hz and the zero after it, five times.
    assert stand.clock.now() - began_s == pytest.approx(5 * 0.4, abs=0.02)
    assert line.ask("FETC?") == line.ask("FETC?")
    assert not int(line.ask("STAT:OPER:COND?")) & 16
    line.ask("INIT;*OPC?")
    assert line.ask("R? 3").startswith("#247+5.0")
    assert int(line.ask("DATA:POIN?")) == 2
    assert len(numbers(line.ask("DATA:REM? 2"))) == 2
    assert line.ask("FETC?;:SYST:ERR?").startswith("-230")


def test_without_auto_zero_it_is_twice_as_fast_and_drifts(stand: Stand, line: Line) -> None:
    line.ask("VOLT:RANG 1;:VOLT:NPLC 10;:VOLT:ZERO:AUTO OFF;:SAMP:COUN 5;*OPC?")
    began_s = stand.clock.now()
    assert numbers(line.ask("READ?"))[0] == pytest.approx(0.5, abs=1e-7)
    assert stand.clock.now() - began_s == pytest.approx(5 * 0.2, abs=0.02)
    stand.clock.sleep(3600.0)
    assert numbers(line.ask("READ?"))[0] - 0.5 == pytest.approx(36e-6, abs=1e-7)
    line.ask("VOLT:ZERO:AUTO ONCE;*OPC?")
    assert numbers(line.ask("READ?"))[0] - 0.5 == pytest.approx(0.0, abs=1e-7)


def test_a_reading_is_the_mean_over_its_integration(line: Line, stand: Stand) -> None:
    with standing(volts=0.0, slope=0.01) as ramp, ramp.line() as meter:
        meter.ask("VOLT:RANG 1;:VOLT:NPLC 100;:SAMP:COUN 3;*OPC?")
        began_s = ramp.clock.now()
        values = np.array(numbers(meter.ask("READ?")))
        assert np.diff(values) == pytest.approx(0.01 * 4.0, rel=2e-3)
        assert values[0] == pytest.approx(0.01 * (began_s + 1.0), abs=1e-4)


def test_a_trigger_over_the_line_and_a_timer_pace_the_readings(stand: Stand, line: Line) -> None:
    line.ask("VOLT:NPLC 1;:TRIG:SOUR BUS;COUN 2;:SAMP:COUN 4;SOUR TIM;TIM 0.1;*OPC?")
    line.ask("INIT;:SYST:ERR?")
    assert int(line.ask("STAT:OPER:COND?")) & 32
    stand.clock.sleep(1.0)
    assert int(line.ask("DATA:POIN?")) == 0
    line.ask("*TRG;:SYST:ERR?")
    stand.clock.sleep(0.25)
    assert int(line.ask("DATA:POIN?")) == 3
    stand.clock.sleep(0.25)
    assert int(line.ask("STAT:OPER:COND?")) & 32
    assert len(numbers(line.ask("*TRG;:FETC?"))) == 8


def test_an_overload_reads_as_one_and_is_told_once_for_a_burst() -> None:
    with standing(volts=-1.3) as stand, stand.line() as line:
        line.ask("VOLT:RANG 1;:SAMP:COUN 2;*OPC?")
        assert line.ask("READ?") == "-9.90000000E+37,-9.90000000E+37"
        assert line.ask("STAT:QUES:COND?") == "0"
        assert line.ask("STAT:QUES?") == "1"
        assert line.ask("STAT:QUES?") == "0"
        line.ask("VOLT:RANG 10;*OPC?")
        assert numbers(line.ask("READ?")) == [-1.3, -1.3]
        line.ask("VOLT:RANG:AUTO ON;:VOLT:RANG 1;:VOLT:RANG:AUTO ON;*OPC?")
        assert numbers(line.ask("READ?")) == [-1.3, -1.3]
        assert float(line.ask("VOLT:RANG?")) == 10.0
        assert numbers(line.ask("MEAS:VOLT:DC? 1")) == [-9.9e37]


def test_twenty_percent_beyond_the_range_can_still_be_measured() -> None:
    with standing(volts=1.19) as stand, stand.line() as line:
        assert numbers(line.ask("MEAS:VOLT:DC? 1")) == [1.19]


def test_noise_grows_with_the_range_and_falls_with_the_integration() -> None:
    with standing(noise="0.3 ppm") as stand, stand.line() as line:
        spread = {}
        for range_V, cycles in ((1, 1), (10, 1), (10, 0.02)):
            line.ask(f"VOLT:RANG {range_V};:VOLT:NPLC {cycles};:SAMP:COUN 2000;:INIT;:SYST:ERR?")
            spread[range_V, cycles] = float(np.std(numbers(line.ask("FETC?" if cycles < 1 else "FETC?"))))
        assert spread[1, 1] == pytest.approx(0.3e-6, rel=0.1)
        assert spread[10, 1] == pytest.approx(3e-6, rel=0.1)
        assert spread[10, 0.02] == pytest.approx(30e-6, rel=0.1)


def test_gain_and_offset_of_the_meter_are_in_its_readings() -> None:
    with standing(volts=1.0, gain_error="10 ppm", offset="3 uV") as stand, stand.line() as line:
        assert numbers(line.ask("MEAS:VOLT:DC? 1"))[0] == pytest.approx(1.000013, abs=1e-8)


def test_an_open_input_wanders_and_open_ohms_are_an_overload() -> None:
    with standing(room=EmptyRoom()) as stand, stand.line() as line:
        volts = np.array(numbers(line.ask("SAMP:COUN 200;:VOLT:NPLC 1;*OPC?;:READ?").split(";")[-1]))
        assert np.abs(volts).max() < 20e-3
        assert 0 < volts.std() < 5e-3
        assert numbers(line.ask("MEAS:FRES?")) == [9.9e37]
        assert line.ask("STAT:QUES?") == "512"


def test_while_one_client_waits_for_a_burst_another_is_served(stand: Stand, line: Line) -> None:
    line.ask("VOLT:NPLC 100;:SAMP:COUN 2;*OPC?")
    answers: list[str] = []

    def read() -> None:
        with stand.line() as patient:
            patient._wire.sent(6)
            patient._socket.sendall(b"READ?\n")
            patient._wire.wait(stand.clock.now() + 60.0)
            answers.append(patient._socket.recv(4096).decode())
            patient._wire.received()

    stand.clock.start("reader", read)
    stand.clock.sleep(0.5)
    with stand.line() as other:
        assert other.ask("*IDN?").startswith("Keysight")
        assert int(other.ask("STAT:OPER:COND?")) & 16
    assert not answers
    stand.clock.sleep(10.0)
    assert answers == ["+5.00000000E-01,+5.00000000E-01\n"]


def test_a_plain_socket_reads_it_in_real_time() -> None:
    clock = RealClock()
    with clock.participant("test"):
        stand = Stand(clock, VOLTS, Room(0.25, 0.0, 100.0))
        entry = stand.instruments["multimeter"]
        with socket.create_connection((entry["host"], entry["port"]), 2.0) as client:
            client.sendall(b"CONF:VOLT:DC 1\nVOLT:DC:NPLC 0.02\nREAD?\n")
            assert client.recv(4096) == b"+2.50000000E-01\n"
        stand.meter.close()
