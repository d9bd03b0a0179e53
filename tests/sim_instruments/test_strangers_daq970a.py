"""What public programs send a Keysight DAQ970A or its predecessor, the 34970A, every day."""

from __future__ import annotations

import pytest
from daq970a_fixture import CHAMBER_DEGC, DEVICE_DEGC, FAR_K, TRUTH, scanner

NONE = '+0,"No error"'
NEAR, FAR = pytest.approx(DEVICE_DEGC, abs=1e-3), pytest.approx(DEVICE_DEGC + FAR_K, abs=1e-3)


def readings(answer: str) -> list[float]:
    return [float(text) for text in answer.split(",")]


def test_four_wire_thermometers_are_configured_scanned_and_fetched() -> None:
    with scanner() as (here, _), here.line() as line:
        line.write("*CLS;CONF:TEMP FRTD, 85, (@101,102)")
        line.write("TEMP:TRAN:FRTD:RES:REF 100, (@101,102);:TEMP:TRAN:FRTD:TYPE 85, (@101,102)")
        line.write("ROUT:SCAN (@101,102);:INIT")
        assert readings(line.ask("FETC?")) == [NEAR, FAR]
        assert readings(line.ask(":READ?")) == [NEAR, FAR]
        assert line.ask("ROUT:SCAN?").split("(@")[1] == "101,102)"
        assert line.ask("ROUT:SCAN:SIZE?;:SYST:ERR?") == f"+2;{NONE}"


def test_thermometers_are_configured_by_their_resistance_and_come_with_their_channels() -> None:
    with scanner() as (here, _), here.line() as line:
        line.write("FORMat:READing:CHANnel ON;:CONFigure:TEMPerature:FRTD 100,DEF,(@101,103)")
        line.write("SENSe:TEMPerature:NPLCycles 10,(@101,103);:UNIT:TEMPerature K,(@101,103)")
        # CONFigure has switched the channels off.
        assert len(line.ask("READ?").split(",")) == 2
        line.write("FORMat:READing:CHANnel ON")
        kelvin, channel, air, other = line.ask("READ?").split(",")
        assert (channel, other) == ("101", "103")
        assert float(kelvin) == pytest.approx(DEVICE_DEGC + 273.15, abs=1e-3)
        assert float(air) == pytest.approx(CHAMBER_DEGC + 0.5 + 273.15, abs=1e-3)
        assert line.ask("ROUTe:SCAN (@);:READ?;:SYST:ERR?").startswith("+113")


def test_all_fields_of_a_reading_are_given_in_their_order() -> None:
    with scanner() as (here, _), here.line() as line:
        line.write("CONF:TEMP FRTD,85,(@101)")
        line.write("FORM:READ:UNIT ON;TIME ON;CHAN ON;ALAR ON")
        value, time, channel, alarm = line.ask("READ?").split(",")
        assert value.endswith(" C") and (channel, alarm) == ("101", "0")
        assert float(time) == pytest.approx(0.0525, abs=1e-3)


def test_a_range_is_fixed_and_a_reading_beyond_it_is_an_overload() -> None:
    with scanner() as (here, _), here.line() as line:
        line.write(":CONF:RES (@101);:RES:RANG:AUTO 0,(@101);:RES:RANG 100,(@101)")
        line.write(":RES:NPLC 1,(@101);:ROUT:SCAN (@101)")
        assert float(line.ask(":READ?")) == pytest.approx(112.056, abs=0.01)
        line.write(":CONF:RES (@107)")
        assert float(line.ask("READ?")) == 9.9e37
        assert line.ask("STAT:QUES?;:SYST:ERR?") == f"512;{NONE}"


def test_a_value_is_scaled_and_asked_for_again_by_its_channel() -> None:
    with scanner() as (here, _), here.line() as line:
        line.write("CONF:TEMP FRTD,85,(@101,102);:CALC:SCAL:GAIN 2,(@101)")
        line.write("CALC:SCAL:STAT ON,(@101);:TRIG:COUN 3;:INIT")
        assert line.ask("*OPC?") == "1"
        assert line.ask("DATA:POIN?") == "+6"
        twice = pytest.approx(2 * DEVICE_DEGC, abs=2e-3)
        assert readings(line.ask("DATA:LAST? 2,(@101)")) == [twice, twice]
        assert readings(line.ask("DATA:LAST? (@102)")) == [FAR]
        assert line.ask("DATA:LAST? (@103);:SYST:ERR?").startswith("-230")
        assert len(readings(line.ask("DATA:REM? 2"))) == 2
        assert line.ask("R?").startswith("#2") and line.ask("DATA:POIN?") == "+0"


def test_what_is_measured_at_once_is_measured_with_the_list_that_it_names() -> None:
    with scanner() as (here, _), here.line() as line:
        assert readings(line.ask("MEAS:TEMP? FRTD, (@101,102)")) == [NEAR, FAR]
        assert line.ask("CONF? (@101,107)") == ('"TEMP FRTD,85","VOLT +3.000000E+02,+9.000000E-05"')


def test_the_modules_are_asked_for_by_slot_or_by_hundreds() -> None:
    with scanner() as (here, _), here.line() as line:
        assert line.ask("SYST:CTYP? 1").split(",")[:2] == ["Keysight Technologies", "DAQM901A"]
        assert line.ask("SYST:CTYP? 200").split(",")[1] == "DAQM908A"
        assert line.ask("SYST:CTYP? 3") == "Keysight Technologies,0,0,0"


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        ("ROUT:SCAN (@301)", "+111"),
        ("CONF:TEMP FRTD,85,(@121)", "+112"),
        ("ROUT:SCAN (@101:125)", "+112"),
        ("CONF:FRES (@111)", "+305"),
        ("CONF:FRES (@201)", "+305"),
        ("CONF:FRES", "-109"),
        ("ROUT:SCAN (@101", "-102"),
        ("FRES:NPLC 300,(@101)", "-222"),
        ("TRIG:SOUR BUS;:READ?", "-214"),
        ("FETC?", "-230"),
        ("NONSENSE", "-113"),
    ],
)
def test_what_cannot_be_is_refused_by_its_number(sent: str, code: str) -> None:
    with scanner() as (here, _), here.line() as line:
        assert line.ask(f"{sent};:SYST:ERR?").startswith(code)


def test_a_scan_is_timed_by_its_channels_and_by_its_timer() -> None:
    with scanner() as (here, _), here.line() as line:
        line.write("CONF:FRES 100,(@101,102);:FRES:NPLC 10,(@101,102)")
        line.write("TRIG:SOUR TIM;TIM 2;COUN 2;:FORM:READ:TIME ON;:INIT")
        assert line.ask("TRIG:COUN 3;:SYST:ERR?").startswith("-221")
        assert line.ask("INIT;:SYST:ERR?").startswith("-213")
        assert line.ask("STAT:OPER:COND?") == "16"
        times_s = readings(line.ask("FETC?"))[1::2]
        assert times_s == pytest.approx([0.412, 0.825, 2.412, 2.825], abs=2e-3)
        line.write("TRIG:SOUR BUS;:INIT")
        assert line.ask("STAT:OPER:COND?") == "32"
        line.write("*TRG")
        assert line.ask("DATA:POIN?;:ABOR;:STAT:OPER:COND?") == "+0;0"


def test_relays_of_a_faster_module_take_less_time() -> None:
    lasting = {}
    for module in ("DAQM901A", "DAQM900A"):
        with scanner(truth={**TRUTH, "modules": {"1": module}}) as (here, _), here.line() as line:
            line.write("CONF:RES (@101:110);:FORM:READ:TIME ON;:INIT")
            lasting[module] = readings(line.ask("FETC?"))[-1]
    assert lasting["DAQM901A"] - lasting["DAQM900A"] == pytest.approx(10 / 80 - 10 / 450, abs=2e-3)
