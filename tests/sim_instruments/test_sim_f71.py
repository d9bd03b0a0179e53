"""The simulated teslameter on its socket: readings, buffer, time stamps, refusals."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
import pytest
from sim_bench import Line, bench_with, served

from sim_instruments.bench import SimulatedBench
from station.clock import Clock, RealClock

CLEAN = '0,"No error"'


@pytest.fixture
def bench(clock: Clock) -> Iterator[SimulatedBench]:
    data = bench_with()
    data["instruments"]["gaussmeter"]["simulator"]["noise_per_sample"] = "0 uT"
    with served(clock, data) as simulation:
        yield simulation


@pytest.fixture
def meter(bench: SimulatedBench, clock: Clock) -> Iterator[Line]:
    with Line(bench, "gaussmeter", clock) as line:
        yield line


def records(reply: str) -> list[tuple[datetime, np.ndarray, int]]:
    """Return (stamp, magnitude x y z in T, state) of each record of a buffer reply."""
    assert reply.startswith('"') and reply.endswith('"')
    found = []
    for record in reply.strip('"').rstrip(";").split(";") if len(reply) > 2 else []:
        stamp, *values, state = record.split(",")
        found.append((datetime.fromisoformat(stamp), np.array(values, dtype=float), int(state)))
    return found


def instrument_seconds(stamp: datetime) -> float:
    return (stamp - datetime(2026, 1, 1, tzinfo=UTC)).total_seconds()


def drive_sine(bench: SimulatedBench, clock: Clock, amplitude_A: float, dwell_s: float) -> None:
    with Line(bench, "coil_supply.x", clock) as supply:
        supply.ask("FUNC:MODE CURR;:VOLT 30;:CURR:RANG 1;:OUTP ON;*OPC?")
        points = amplitude_A * np.sin(2 * np.pi * np.arange(1000) / 1000)
        for first in range(0, 1000, 20):
            part = ",".join(f"{point:.5f}" for point in points[first : first + 20])
            supply.ask(f"LIST:CURR {part};*OPC?")
        assert supply.ask(f"LIST:DWEL {dwell_s};COUN 0;:CURR:MODE LIST;:SYST:ERR?") == CLEAN


def test_its_identity_holds_a_firmware_version_that_parses(meter: Line) -> None:
    maker, model, serial, firmware = meter.ask("*IDN?").split(",")
    assert (maker, model, serial) == ("Lake Shore", "F71", "LSA2B7X")
    assert [int(part) for part in firmware.split(".")] >= [1, 6, 2019092002]


def test_replies_end_with_cr_lf_and_an_empty_line_says_nothing(meter: Line) -> None:
    assert meter.raw_ask(b"\n*IDN?\n").endswith(b"\r\n")
    assert meter.raw_ask(b"\n\n*OPC?;UNIT:FIELD?\n") == b"1;TESLA\r\n"


def test_a_command_with_the_error_query_returns_only_the_error(meter: Line) -> None:
    assert meter.ask("SENSE:AVERAGE:COUNT 20.0;:SYSTem:ERRor:ALL?") == CLEAN
    assert meter.ask("SENSE:NONSENSE 1;:SYSTem:ERRor:ALL?").startswith('-113,"Undefined header')
    assert meter.ask("SYSTem:ERRor:ALL?") == CLEAN


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("SENSE:AVERAGE:COUNT 0", "-222"),
        ("SENSE:RANGE 100", "-222"),
        ("SENSE:MODE MAGIC", "-224"),
        ("FETCH:DC? Q", "-224"),
        ("SENSE:AVERAGE:COUNT", "-109"),
    ],
)
def test_what_does_not_fit_is_refused(meter: Line, message: str, code: str) -> None:
    assert meter.ask(f"{message};:SYST:ERR?").startswith(code)


def test_it_reads_the_ambient_field_with_its_own_errors(meter: Line, clock: Clock) -> None:
    clock.sleep(1.0)
    magnitude, x, y, z = (float(text) for text in meter.ask("FETCH:DC? ALL").split(","))
    assert x == pytest.approx(21e-6 * 1.0011 + 1.2e-6, abs=3e-7)
    assert y == pytest.approx(-4e-6 - 0.8e-6, abs=3e-7)
    assert z == pytest.approx(-43e-6 * 1.0005 + 0.5e-6, abs=3e-7)
    assert magnitude == pytest.approx(np.hypot(np.hypot(x, y), z), rel=1e-6)
    assert float(meter.ask("FETC:DC? X")) == pytest.approx(x, abs=1e-9)
    meter.ask("UNIT:FIELD GAUSS;*OPC?")
    assert float(meter.ask("FETC:DC? X")) == pytest.approx(x * 1e4, rel=1e-6)


def test_the_buffer_gives_every_reading_once(meter: Line, clock: Clock) -> None:
    meter.ask("SENS:AVER:COUN 5;*OPC?")
    meter.ask("FETC:BUFF:DC?")
    assert meter.ask("FETC:BUFF:DC?") == '""'
    clock.sleep(10.0)
    first = records(meter.ask("FETC:BUFF:DC?"))
    clock.sleep(10.0)
    second = records(meter.ask("FETC:BUFF:DC?"))
    assert 199 <= len(first) <= 200 and 399 <= len(first) + len(second) <= 400
    ticks = [round(instrument_seconds(stamp) * 1000) for stamp, _, _ in first + second]
    assert set(np.diff(ticks)) == {50}


def test_a_full_buffer_loses_the_oldest_readings(meter: Line, clock: Clock) -> None:
    meter.ask("SENS:AVER:COUN 1;*OPC?")
    clock.sleep(60.0)
    kept = records(meter.ask("FETC:BUFF:DC?"))
    assert len(kept) == 1000
    assert instrument_seconds(kept[-1][0]) == pytest.approx(60.0 + 0.37, abs=0.02)


def test_a_stamp_is_the_end_of_the_window_on_the_instruments_own_clock(
    meter: Line, clock: Clock
) -> None:
    clock.sleep(5000.0)
    stamp, _, _ = records(meter.ask("FETC:BUFF:DC?"))[-1]
    expected = (clock.now() + 0.37) * (1 + 12e-6)
    assert 0 <= expected - instrument_seconds(stamp) <= 0.2 + 1e-6


def test_a_reading_is_the_true_mean_of_the_field_over_its_window(
    bench: SimulatedBench, meter: Line, clock: Clock
) -> None:
    drive_sine(bench, clock, 3.0, 0.005)
    meter.ask("SENS:AVER:COUN 20;*OPC?")
    meter.ask("FETC:BUFF:DC?")
    clock.sleep(60.0)
    readings = records(meter.ask("FETC:BUFF:DC?"))
    end_s = np.array([instrument_seconds(stamp) for stamp, _, _ in readings]) / (1 + 12e-6) - 0.37
    x_mT = np.array([values[1] for _, values, _ in readings]) * 1e3
    frequency = 0.2 / (1 + 50e-6)
    angle = 2 * np.pi * frequency * (end_s - 0.1)
    fit = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])
    (a, b, _), *_ = np.linalg.lstsq(fit, x_mT, rcond=None)
    instant = 3.0 * bench._world.probe_mT_per_A[0, 0] * 1.0005 * 1.0011
    # Boxcar of 0.2 s and the coil's first-order lag at 0.2 Hz.
    lag = 1 / np.hypot(1, 2 * np.pi * frequency * 0.015)
    assert np.hypot(a, b) == pytest.approx(instant * np.sinc(0.2 * frequency) * lag, rel=3e-4)


def test_averaging_lowers_the_noise(clock: Clock) -> None:
    with served(clock) as noisy, Line(noisy, "gaussmeter", clock) as meter:
        spread = {}
        for count in (1, 25):
            meter.ask(f"SENS:AVER:COUN {count};*OPC?")
            meter.ask("FETC:BUFF:DC?")
            clock.sleep(9.0 * count)
            values = [values[1] for _, values, _ in records(meter.ask("FETC:BUFF:DC?"))]
            spread[count] = float(np.std(values))
        assert spread[1] == pytest.approx(0.4e-6, rel=0.1)
        assert spread[25] == pytest.approx(0.08e-6, rel=0.15)


def test_a_field_beyond_a_fixed_range_is_an_overload(clock: Clock) -> None:
    narrow = bench_with(coils__x__radius="25 mm", coils__x__resistance="0.5 ohm")
    for axis in ("x", "y", "z"):
        narrow["simulation"]["probe_position"][axis] = "0 mm"
    with (
        served(clock, narrow) as bench,
        Line(bench, "gaussmeter", clock) as meter,
        Line(bench, "coil_supply.x", clock) as supply,
    ):
        # The lowest range that holds 20 mT is that of 35 mT.
        assert float(meter.ask("SENS:RANG 0.02;:SENS:RANG?")) == 0.035
        supply.ask("FUNC:MODE CURR;:VOLT 36;:CURR 11.5;:OUTP ON;*OPC?")
        clock.sleep(1.0)
        assert float(meter.ask("FETC:DC? X")) == 9.9e37
        assert int(meter.ask("STAT:OPER:COND?")) & 2
        assert records(meter.ask("FETC:BUFF:DC?"))[-1][2] == 2
        meter.ask("SENS:RANG 0.05;*OPC?")
        clock.sleep(1.0)
        assert 0.035 < float(meter.ask("FETC:DC? X")) < 0.05
        assert meter.ask("STAT:OPER:COND?") == "0"


def test_a_plain_socket_reads_it_in_real_time() -> None:
    with served(RealClock()) as simulation:
        entry = simulation.instruments["gaussmeter"]
        with socket.create_connection((entry["host"], entry["port"]), 2.0) as client:
            client.sendall(b"\n*IDN?\n")
            assert client.recv(4096).startswith(b"Lake Shore,F71,")


def test_a_sine_has_its_rms_and_its_frequency_in_ac_mode(
    bench: SimulatedBench, meter: Line, clock: Clock
) -> None:
    drive_sine(bench, clock, 1.0, 2e-3)  # 0.5 Hz
    meter.write("SENS:MODE DC;:SENS:AVER:COUN 1")
    clock.sleep(4.0)
    magnitudes = []
    for _ in range(100):
        clock.sleep(0.02)
        magnitudes.append(float(meter.ask("FETC:DC? X")))
    peak = (max(magnitudes) - min(magnitudes)) / 2
    meter.write("FETC:RMS?;:FETC:FREQ?")
    assert [meter.ask("SYST:ERR?").split(",")[0] for _ in "ab"] == ["-221", "-221"]
    meter.write("SENS:MODE AC")
    clock.sleep(12.0)
    assert float(meter.ask("FETC:RMS? X")) == pytest.approx(peak / np.sqrt(2), rel=0.02)
    assert float(meter.ask("FETC:FREQ?")) == pytest.approx(0.5, rel=0.01)
    meter.write("UNIT:FIELD GAUSS")
    assert float(meter.ask("FETC:RMS? X")) == pytest.approx(1e4 * peak / np.sqrt(2), rel=0.02)
