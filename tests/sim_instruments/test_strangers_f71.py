"""A Lake Shore F71 as other programs use it: alternating fields, filters, qualifier, outputs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from sim_bench import Line, bench_with, served

from sim_instruments.bench import SimulatedBench
from station.clock import Clock

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


def drive_sine(bench: SimulatedBench, clock: Clock, amplitude_A: float, points: int) -> None:
    """Drive coil x with a sine of 0.5 ms a point."""
    with Line(bench, "coil_supply.x", clock) as supply:
        supply.ask("FUNC:MODE CURR;:VOLT 30;:CURR:RANG 1;:OUTP ON;*OPC?")
        values = amplitude_A * np.sin(2 * np.pi * np.arange(points) / points)
        for first in range(0, points, 20):
            part = ",".join(f"{value:.5f}" for value in values[first : first + 20])
            supply.ask(f"LIST:CURR {part};*OPC?")
        assert supply.ask("LIST:DWEL 0.0005;COUN 0;:CURR:MODE LIST;:SYST:ERR?") == CLEAN


def field_T(meter: Line, question: str) -> float:
    return float(meter.ask(question))


def test_an_alternating_field_has_rms_by_axes_and_a_frequency(
    bench: SimulatedBench, meter: Line, clock: Clock
) -> None:
    drive_sine(bench, clock, 0.5, 200)
    clock.sleep(3.0)
    meter.ask("SENS:MRESET;:SYST:ERR?")
    clock.sleep(3.0)
    highest_T = field_T(meter, "FETCH:MAXP?")
    lowest_T = field_T(meter, "FETCH:MINP?")
    assert lowest_T < highest_T
    assert meter.ask("SENS:MODE AC;:SYST:ERR?") == CLEAN
    clock.sleep(1.0)
    assert field_T(meter, "FETCH:FREQ?") == pytest.approx(10.0)
    whole_T = field_T(meter, "FETCH:RMS?")
    assert whole_T > 1e-5
    every_T = [float(value) for value in meter.ask("FETCH:RMS? ALL").split(",")]
    assert every_T[0] == pytest.approx(float(np.linalg.norm(every_T[1:])), rel=1e-5)
    assert every_T[1] > 20.0 * every_T[2], "coil x drives it"
    meter.ask("UNIT:FIELD GAUSS;:SYST:ERR?")
    assert field_T(meter, "FETCH:RMS?") == pytest.approx(1e4 * whole_T, rel=1e-3)
    assert meter.ask("FETCH:DC?;:SYST:ERR?").startswith("-221")


def test_a_filter_changes_what_is_read_of_a_fast_field(
    bench: SimulatedBench, meter: Line, clock: Clock
) -> None:
    drive_sine(bench, clock, 0.5, 20)  # 100 Hz
    clock.sleep(1.0)
    meter.ask("SENS:MODE HIFR;:SENSE:FILTER:LPASS:CUTOFF F10;:SYST:ERR?")
    assert field_T(meter, "SENSE:FILTER:LPASS:CUTOFF?") == 10.0
    clock.sleep(0.5)
    free_T = field_T(meter, "FETCH:RMS?")
    filtered = {}
    for kind in ("LPASS", "HPASS", "BPASS"):
        meter.ask(f"SENSE:FILT:TYPE {kind};:SENSE:FILT 1;:SYST:ERR?")
        filtered[kind] = field_T(meter, "FETCH:RMS?") / free_T
    assert filtered["LPASS"] == pytest.approx(0.1, rel=0.1)
    assert filtered["HPASS"] == pytest.approx(1.0, rel=0.01), "none is chosen"
    assert filtered["BPASS"] == pytest.approx(0.1, rel=0.1), "it passes 1 kHz"
    assert meter.ask("SENSE:FILTER:TYPE?;:SENSE:FILTER:BPASS:CENTER 100;:SYST:ERR?") == (
        f"BPASS;{CLEAN}"
    )
    assert field_T(meter, "FETCH:RMS?") == pytest.approx(free_T, rel=0.02)


def test_extremes_follow_the_readings_and_a_baseline_is_taken_off(
    bench: SimulatedBench, meter: Line, clock: Clock
) -> None:
    clock.sleep(1.0)
    at_rest_T = field_T(meter, "FETCH:DC?")
    meter.ask("SENS:MRESET;:SYST:ERR?")
    with Line(bench, "coil_supply.x", clock) as supply:
        supply.ask("FUNC:MODE CURR;:VOLT 30;:CURR 0.5;:OUTP ON;*OPC?")
    clock.sleep(2.0)
    driven_T = field_T(meter, "FETCH:DC?")
    assert field_T(meter, "FETCH:MAX?") >= driven_T > at_rest_T + 1e-5
    assert field_T(meter, "FETCH:MIN?") <= at_rest_T * 1.01
    assert meter.ask("SENS:RELATIVE:BASELINE 0.0001;:SYST:ERR?") == CLEAN
    assert field_T(meter, "SENS:RELATIVE:BASELINE?") == pytest.approx(1e-4)
    assert field_T(meter, "FETCH:RELATIVE?") == pytest.approx(driven_T - 1e-4, abs=1e-7)
    meter.ask("UNIT:FIELD GAUSS;:SYST:ERR?")
    assert field_T(meter, "SENS:RELATIVE:BASELINE?") == pytest.approx(1.0)


def test_the_qualifier_holds_the_magnitude_against_its_thresholds(
    meter: Line, clock: Clock
) -> None:
    clock.sleep(1.0)
    here_T = field_T(meter, "FETCH:DC?")
    condition = "SENSE:QUALIFIER:CONDITION?"
    meter.ask(f"SENSE:QUALIFIER:THRESHOLD OVER,{here_T / 2};:SYST:ERR?")
    assert meter.ask(condition) == "0", "it is off"
    assert meter.ask(f"SENSE:QUALIFIER 1;:{condition}") == "1"
    meter.ask(f"SENSE:QUALIFIER:THRESHOLD BETWEEN,{here_T * 2},{here_T * 3};:SYST:ERR?")
    assert meter.ask(condition) == "0"
    low_T, high_T = map(float, meter.ask("SENSE:QUALIFIER:THRESHOLD?").split(",")[1:])
    assert (low_T, high_T) == pytest.approx((2 * here_T, 3 * here_T))
    meter.ask(f"SENSE:QUALIFIER:LATCH 1;THRESHOLD OUTSIDE,{here_T * 2},{here_T * 3};:SYST:ERR?")
    assert meter.ask(condition) == "1"
    meter.ask(f"SENSE:QUALIFIER:THRESHOLD UNDER,{here_T / 2};:SYST:ERR?")
    assert meter.ask(condition) == "1", "latched"
    assert meter.ask(f"SENSE:QUALIFIER:LRESET;:{condition}") == "0"


def test_outputs_and_field_control_are_kept_within_their_ranges(meter: Line) -> None:
    kept = {
        "SOURCE:FIELD:VLIMIT": 5.0,
        "SOURCE:FIELD:SLEW": 2.0,
        "SOURCE:FIELD:CLL:GAIN": 1.5,
        "SOURCE:FIELD:CLL:INTEGRAL": 0.5,
        "SOURCE:FIELD:CLL:SETPOINT": 0.001,
        "SOURCE:FIELD:OPL:VOLTAGE": -3.0,
        "SOURCE:AOUT:SFACTOR": 4.0,
        "SOURCE:AOUT:BASELINE": 0.02,
        "SENS:TCOM:MTEM": 31.0,
    }
    for name, value in kept.items():
        assert meter.ask(f"{name} {value};:SYST:ERR?") == CLEAN, name
        assert field_T(meter, f"{name}?") == pytest.approx(value), name
    meter.ask("SOURCE:FIELD:CLL:RAMP 0.25;:SYST:ERR?")
    assert field_T(meter, "SOURCE:FIELD:CLL:RAMPRATE?") == 0.25
    meter.ask("SOURCE:FIELD:MODE OPLOOP;STATE 1;:SOURCE:AOUT MCOR;:SYST:ERR?")
    answer = meter.ask("SOURCE:FIELD:MODE?;STATE?;:SOURCE:AOUT?;:SYST:ERR?")
    assert answer == f"OPLOOP;1;MCOR;{CLEAN}"


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("SOURCE:FIELD:VLIMIT 11", "-222"),
        ("SOURCE:FIELD:OPL:VOLTAGE -11", "-222"),
        ("SOURCE:FIELD:MODE OTHER", "-224"),
        ("SOURCE:AOUT WRAW", "-224"),
        ("SENSE:FILTER:LPASS:CUTOFF 11", "-222"),
        ("SENSE:FILTER:TYPE NOTCH", "-224"),
        ("SENSE:QUALIFIER:THRESHOLD BETWEEN,1", "-109"),
        ("SENSE:QUALIFIER:THRESHOLD OVER,1,2", "-108"),
        ("FETCH:FREQ?", "-221"),
        ("FETCH:RMS? ALL", "-221"),
    ],
)
def test_what_it_cannot_be_is_refused(meter: Line, message: str, code: str) -> None:
    assert meter.ask(f"{message};:SYST:ERR?").startswith(code)
