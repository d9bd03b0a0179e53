"""What hangs, crashes or fails while the computer's lines are listed costs its own lines only."""

from __future__ import annotations

import pytest

from station.instruments.attached import serial_ports, visa_resources

GOOD = '["GPIB0::5::INSTR", "KEPCO,BOP", true]'
HANGS = f"""\
print('{GOOD}', flush=True)
print('["GPIB0::6::INSTR", "does not return", false]', flush=True)
import threading
threading.Event().wait()
"""


def test_a_visa_library_that_hangs_is_given_up_and_what_it_listed_stays() -> None:
    first, second, why = visa_resources("/opt/libvisa.so", program=HANGS, within_s=0.7)
    assert first == ("GPIB0::5::INSTR", "KEPCO,BOP", True)
    assert second == ("GPIB0::6::INSTR", "does not return", False)
    assert why == (
        "/opt/libvisa.so",
        "this VISA library lists no more (no answer in 0.7 s)",
        False,
    )


@pytest.mark.parametrize("ends", ["raise OSError('no such library')", "import os; os._exit(7)"])
def test_a_library_that_fails_says_why(ends: str) -> None:
    good, why = visa_resources("/opt/libvisa.so", program=f"print('{GOOD}', flush=True)\n{ends}")
    assert good[0] == "GPIB0::5::INSTR"
    assert "no such library" in why[1] or "it ended with code 7" in why[1]


def test_a_library_that_is_not_there_is_named() -> None:
    (why,) = visa_resources("/nowhere/libvisa.so")
    assert why[0] == "/nowhere/libvisa.so"
    assert "cannot open shared object file" in why[1]


def test_serial_ports_that_cannot_be_listed_are_a_line_of_their_own() -> None:
    (why,) = serial_ports(program="import threading; threading.Event().wait()", within_s=0.3)
    assert why == ("ASRL", "the serial ports are not listed (no answer in 0.3 s)", False)
