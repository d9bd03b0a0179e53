"""A Red Pitaya's calendar, as other programs set it."""

from __future__ import annotations

from variants import variant

PITAYA = ("digitizer", "serf-nonorthogonality", "sim")


def test_time_and_date_are_set_and_go_on() -> None:
    with variant(*PITAYA) as here, here.line() as line:
        line.write("SYST:TIME 23,59,50;:SYST:DATE 2027,02,28")
        assert line.ask("SYST:TIME?") == "23,59,50" and line.ask("SYST:DATE?") == "2027,02,28"
        here.clock.sleep(15.0)
        assert line.ask("SYST:TIME?") == "00,00,05" and line.ask("SYST:DATE?") == "2027,03,01"
        for wrong, code in (
            ("SYST:TIME 24,0,0", "-222"),
            ("SYST:TIME 1,2", "-109"),
            ("SYST:DATE 2027,13,1", "-222"),
            ("SYST:DATE 1,2,3,4", "-108"),
        ):
            line.write(wrong)
            assert line.ask("SYST:ERR?").startswith(code), wrong
