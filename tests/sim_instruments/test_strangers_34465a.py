"""What other programs send a Keysight 34465A every day, and what its driver leaves behind."""

from __future__ import annotations

import pytest
from keysight_fixture import standing
from variants import variant

from drivers.keysight.multimeter_34465a import Keysight34465A

PROCEDURE = "accelerometer-magnetic-sensitivity"


@pytest.mark.parametrize(
    "name", ["FREQ", "PER", "CONT", "DIOD", "VOLT:RAT", "CURR:AC", "RES", "CAP"]
)
def test_every_function_is_chosen_and_answered_in_quotes(name: str) -> None:
    with standing() as here, here.line() as line:
        assert line.ask(f'FUNC "{name}";FUNC?;:SYST:ERR?') == f'"{name}";+0,"No error"'
        open_end = name in ("CONT", "RES", "DIOD", "VOLT:RAT")
        assert (float(line.ask("READ?")) == 9.9e37) == open_end


def test_gates_ranges_and_resolution_are_taken_and_answered() -> None:
    with standing() as here, here.line() as line:
        line.write("FREQ:APER 0.01;:PER:APER 1;:VOLT:RANG MAX")
        assert float(line.ask("FREQ:APER?")) == 0.01 and float(line.ask("PER:APER?")) == 1.0
        assert float(line.ask("VOLT:RANG?")) == 1000.0
        line.write("VOLT:RANG MIN;:VOLT:RES 1e-6")
        assert float(line.ask("VOLT:RANG?")) == 0.1 and float(line.ask("VOLT:RES?")) <= 1e-6
        assert line.ask("SYST:ERR?") == '+0,"No error"'
        assert line.ask("FREQ:APER 0.02;:SYST:ERR?").startswith("-224")


def test_it_beeps_and_keeps_quiet() -> None:
    with standing() as here, here.line() as line:
        assert line.ask("SYST:BEEP;:SYST:BEEP:STAT OFF;:SYST:BEEP:STAT?") == "0"


def test_it_answers_as_its_predecessor_and_the_driver_says_so() -> None:
    with standing() as here, here.line() as line:
        line.write("SYST:IDEN AT34411A;*RST")
        assert line.ask("*IDN?").startswith("Agilent Technologies,34411A,MY54500001,")
        assert line.ask("SYST:IDEN?") == "AT34411A"
        assert line.ask("SYST:IDEN AT3458A;:SYST:ERR?").startswith("-224")
    with variant("multimeter", PROCEDURE, identity="AT34410A") as other:
        meter = other.driver()
        assert meter.identify().model == "34410A"
        assert other.met() == ["answers as Agilent Technologies 34410A (SYST:IDEN)"]
        assert meter.configure(1.0, 1.0) == 1.0


def test_function_and_range_are_put_back_as_they_were_met() -> None:
    with variant("multimeter", PROCEDURE) as here:
        here.simulator.execute("CONF:RES 1e5,10")
        met = here.simulator.execute("CONF?")
        meter = here.driver()
        assert isinstance(meter, Keysight34465A)
        meter.configure(5.0, 1.0)
        meter.configure(0.5, 1.0)
        assert here.simulator.execute("FUNC?") == '"VOLT"'
        assert here.settings() == {"CONF": (met.strip('"'), "VOLT:DC")}
        meter.kept.put_back()
        assert here.simulator.execute("CONF?") == met
        assert [kind for kind, _ in here.notes] == ["instrument-settings"]


def numbers(answer: str) -> list[float]:
    return [float(text) for text in answer.split(",")]


@pytest.mark.parametrize(
    ("command", "cycles"),
    [
        ("CONF:VOLT:DC 10,0.001", 0.001), ("CONF:VOLT:DC 10,3e-6", 1.0),
        ("CONF:VOLT:DC 10,1e-6", 10.0), ("CONF:VOLT:DC 10,MIN", 100.0),
        ("CONF:VOLT:DC 10,MAX", 0.001), ("CONF:VOLT:DC 10,DEF", 10.0),
        ("CONF:VOLT:DC AUTO,MIN", 100.0), ("CONF:VOLT:DC DEF,DEF", 10.0),
        ("CONF:VOLT:DC 0.1,1e-6", 0.006),
    ],
)  # fmt: skip
def test_range_and_resolution_choose_the_integration_time(command: str, cycles: float) -> None:
    with standing() as here, here.line() as line:
        assert line.ask(f"{command};:SYST:ERR?") == '+0,"No error"'
        assert float(line.ask("VOLT:NPLC?")) == cycles


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ("CONF:VOLT:DC AUTO,0.001", -221), ("CONF:VOLT:DC 1,1e-12", -222),
        ("CONF:VOLT:DC 2000", -222), ("CONF:DIOD 1", -108), ("CONF:FREQ 1e3,1e-9", -222),
        ("CALC:SCAL:DBM:REF 51", -224), ("CALC:TRAN:HIST:POIN 30", -224),
        ("CALC:SCAL:FUNC NULL", -224), ("CALC:LIM:LOW 1e16", -222),
        ("FUNC \"DIOD\";:CALC:SCAL:STAT ON", -221),
        ("FUNC \"RES\";:CALC:SCAL:FUNC DB;STAT ON", -221), ("CALC:SMO ON", -113),
    ],
)  # fmt: skip
def test_what_is_no_possible_combination_is_its_error_and_changes_nothing(
    wrong: str, code: int
) -> None:
    with standing() as here, here.line() as line:
        before = line.ask("VOLT:RANG?;:VOLT:NPLC?")
        assert line.ask(f"{wrong};:SYST:ERR?").startswith(f"{code},")
        assert line.ask("VOLT:RANG?;:VOLT:NPLC?;:SYST:ERR?") == f'{before};+0,"No error"'


def test_bounds_of_a_resolution_are_asked_for() -> None:
    with standing() as here, here.line() as line:
        line.write("VOLT:RANG 10")
        assert float(line.ask("VOLT:RES? MIN")) == pytest.approx(0.3e-6)
        assert float(line.ask("VOLT:DC:RES? MAX")) == pytest.approx(3e-4)


def test_every_function_is_configured_and_measured() -> None:
    with standing() as here, here.line() as line:
        for name, shown in (
            ("VOLT:AC", "VOLT:AC"), ("CURR:DC", "CURR"), ("CURR:AC", "CURR:AC"), ("FREQ", "FREQ"),
            ("PER", "PER"), ("CAP", "CAP"), ("CONT", "CONT"), ("DIOD", "DIOD"),
            ("VOLT:DC:RAT", "VOLT:RAT"),
        ):  # fmt: skip
            line.write(f"CONF:{name}")
            assert line.ask("CONF?").startswith(f'"{shown} ')
        assert float(line.ask("MEAS:VOLT:DC? DEF,DEF")) == 0.5
        assert float(line.ask("MEAS:FRES? DEF,DEF")) == 9.9e37
        assert float(line.ask("MEAS:CURR:AC? DEF,DEF")) == 0.0
        assert line.ask("SYST:ERR?") == '+0,"No error"'


def test_a_resolution_of_a_frequency_chooses_its_gate() -> None:
    with standing() as here, here.line() as line:
        line.write("CONF:FREQ 1000,1")
        assert float(line.ask("FREQ:APER?")) == 1.0
        before_s = here.clock.now()
        assert float(line.ask("READ?")) == 0.0
        assert here.clock.now() - before_s == pytest.approx(1.0, abs=0.01)


def test_statistics_of_a_burst() -> None:
    with standing(slope=1.0) as here, here.line() as line:
        line.write("CONF:VOLT:DC 10,0.001;:SAMP:COUN 50;:CALC:AVER ON")
        values = numbers(line.ask("READ?"))
        mean, deviation, low, high = numbers(line.ask("CALC:AVER:ALL?"))
        assert mean == pytest.approx(sum(values) / 50, rel=1e-6)
        assert (low, high) == (min(values), max(values)) and deviation > 0.0
        assert float(line.ask("CALC:AVER:COUN?")) == 50
        assert float(line.ask("CALC:AVER:PTP?")) == pytest.approx(high - low, rel=1e-6)
        assert len(numbers(line.ask("READ?"))) == 50
        assert float(line.ask("CALC:AVER:COUN?")) == 50, "INITiate begins anew"
        line.write("CALC:AVER:CLE")
        assert line.ask("CALC:AVER:COUN?;:CALC:AVER:AVER?") == "+0.00000000E+00;+9.91000000E+37"


def test_null_takes_off_the_first_reading_or_a_value() -> None:
    with standing() as here, here.line() as line:
        line.write("VOLT:DC:NULL ON")
        assert float(line.ask("READ?")) == 0.0
        assert line.ask("VOLT:NULL:VAL?;:VOLT:NULL:VAL:AUTO?") == "+5.00000000E-01;0"
        line.write("VOLT:NULL:VAL 0.2")
        assert float(line.ask("READ?")) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("commands", "reading"),
    [
        ("FUNC SCAL;GAIN 100;OFFS 5", 45.0), ("FUNC PCT;REF 0.4", 25.0), ("FUNC PCT", 0.0),
        ("FUNC DBM", -3.8021), ("FUNC DBM;DBM:REF 50", 6.9897),
        ("FUNC DB;DB:REF -10", 6.1979), ("FUNC DB", 0.0), ("FUNC SCAL;GAIN 1e-24", 0.0),
        ("FUNC SCAL;GAIN 1e15;OFFS -1e15", 1.5e15),
    ],
)  # fmt: skip
def test_readings_are_scaled(commands: str, reading: float) -> None:
    with standing() as here, here.line() as line:
        line.write(f":CALC:SCAL:{commands};:CALC:SCAL:STAT ON")
        assert float(line.ask("READ?")) == pytest.approx(reading, abs=1e-3)
        line.write('FUNC "RES";:FUNC "VOLT"')
        assert line.ask("CALC:SCAL:STAT?;:SYST:ERR?") == '0;+0,"No error"'


def test_limits_set_their_bits_until_they_are_cleared() -> None:
    with standing() as here, here.line() as line:
        line.write("CALC:LIM:UPP 0.4;LOW 0.1;STAT ON;:INIT")
        assert line.ask("*OPC?;:STAT:QUES:COND?") == "1;4096"
        line.write("CALC:LIM:CLE;:CALC:LIM:UPP 1;LOW 0.6;:INIT")
        assert line.ask("*OPC?;:STAT:QUES:COND?") == "1;2048"
        line.write("CONF:VOLT:DC")
        assert line.ask("CALC:LIM:UPP?;:STAT:QUES:COND?") == "+0.00000000E+00;0"


def test_a_histogram_counts_what_is_below_and_above_too() -> None:
    with standing(slope=1.0) as here, here.line() as line:
        assert line.ask("CALC:TRAN:HIST:RANG:LOW?") == "+9.91000000E+37"
        line.write("CONF:VOLT:DC 10,0.001;:SAMP:COUN 1000;:CALC:TRAN:HIST:POIN 100;STAT ON")
        line.write("INIT;*WAI")
        low, high, count, *bins = numbers(line.ask("CALC:TRAN:HIST:ALL?"))
        assert (count, len(bins), sum(bins)) == (1000, 102, 1000)
        assert bins[0] == bins[-1] == 0 and bins[1] > 0 and bins[-2] > 0
        middle = (low + high) / 2
        line.write(f"CALC:TRAN:HIST:RANG:UPP {middle};LOW {low};:INIT;*WAI")
        bins = numbers(line.ask("CALC:TRAN:HIST:DATA?"))
        assert bins[-1] > 0 and sum(bins) == 1000
        assert line.ask("CALC:TRAN:HIST:RANG:AUTO?;:CALC:TRAN:HIST:COUN?") == "0;+1000"
