"""What other programs send a Keysight 34465A every day, and what its driver leaves behind."""

from __future__ import annotations

import pytest
from keysight_fixture import standing
from variants import variant

from drivers.keysight.multimeter_34465a import Keysight34465A

PROCEDURE = "accelerometer-magnetic-sensitivity"


@pytest.mark.parametrize("name", ["FREQ", "PER", "CONT", "DIOD", "VOLT:RAT", "CURR:AC", "RES"])
def test_every_function_is_chosen_and_answered_in_quotes(name: str) -> None:
    with standing() as here, here.line() as line:
        assert line.ask(f'FUNC "{name}";FUNC?;:SYST:ERR?') == f'"{name}";+0,"No error"'
        open_end = name in ("CONT", "RES")
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
