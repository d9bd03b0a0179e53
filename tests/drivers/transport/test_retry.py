"""What may be said twice, and what is: declared by each driver, carried out in one place."""

from __future__ import annotations

import pytest

from drivers.generic.can_pulse_board import CanPulseBoard
from drivers.generic.interlock_chain import InterlockChainLine
from drivers.kepco.bop import KepcoBop, list_messages
from drivers.lakeshore.gaussmeter_f71 import LakeshoreF71
from drivers.transport.exchanges import Repeatable, patiently
from station.clock import VirtualClock
from station.errors import InstrumentError
from station.instruments.opening import InstrumentPlace
from station.roles import TRIES, Driver, Place
from station.roles.kept_settings import KeptSettings
from station.roles.patience import PATIENT, patience


def test_a_pattern_is_for_one_whole_command() -> None:
    declared = Repeatable(r"CURR -?[\d.]+", "OUTP OFF", r"\*CLS")
    assert "CURR -1.5" in declared
    assert ":curr 2" in declared
    assert "OUTP OFF;:CURR 0;*CLS" in declared
    assert "OUTP OFF;CURR 0" not in declared  # it would mean OUTP:CURR
    assert "OUTP OFF;:OUTP ON" not in declared
    assert "LIST:CURR 1" not in declared
    assert "CURR 1,2" not in declared
    assert "" not in declared


REPEATABLE = [
    (KepcoBop, "MEAS:CURR?"),
    (KepcoBop, "CURR:MODE FIX;:CURR 0"),
    (KepcoBop, "CURR -0.0123"),
    (KepcoBop, "*CLS;:SYST:ERR?"),
    (KepcoBop, "OUTP OFF"),
    (LakeshoreF71, "FETC:DC?"),
    (LakeshoreF71, "SENS:RANG 0.0015"),
    (CanPulseBoard, "stop"),
    (InterlockChainLine, "CHAIN?"),
]
ONCE = [
    (KepcoBop, "CURR:MODE LIST"),
    (KepcoBop, "OUTP ON"),
    (KepcoBop, "LIST:DWEL 0.01"),
    (KepcoBop, list_messages([0.1, 0.2])[0]),  # type: ignore[arg-type]
    (LakeshoreF71, "FETC:BUFF:DC?"),
    (CanPulseBoard, "start"),
]


@pytest.mark.parametrize(("driver", "message"), REPEATABLE, ids=[text for _, text in REPEATABLE])
def test_a_driver_declares_what_does_no_harm_twice(driver: type, message: str) -> None:
    assert message in driver.repeatable  # type: ignore[attr-defined]


@pytest.mark.parametrize(("driver", "message"), ONCE, ids=[text for _, text in ONCE])
def test_what_appends_starts_or_empties_is_said_once(driver: type, message: str) -> None:
    assert message not in driver.repeatable  # type: ignore[attr-defined]


@pytest.mark.parametrize(("message", "tries"), [("again", TRIES), ("once", 1)])
def test_the_last_error_is_believed(message: str, tries: int) -> None:
    said: list[str] = []

    def exchange() -> str:
        said.append(message)
        raise InstrumentError("it", "asked", f"no answer {len(said)} came", "look")

    with patience(), pytest.raises(InstrumentError, match=f"no answer {tries} came"):
        patiently(Repeatable("again"), message, exchange)
    assert len(said) == tries


def test_where_nobody_is_patient_the_first_error_is_believed() -> None:
    said: list[str] = []

    def exchange() -> str:
        said.append("again")
        raise InstrumentError("it", "asked", "no answer came", "look")

    with pytest.raises(InstrumentError):
        patiently(Repeatable("again"), "again", exchange)
    with patience(), pytest.raises(InstrumentError):  # an exchange within one is tried with it
        patiently(
            Repeatable("again"), "again", lambda: patiently(Repeatable("again"), "again", exchange)
        )
    assert len(said) == 1 + TRIES


def test_what_is_no_fault_of_an_instrument_is_not_tried_again() -> None:
    said: list[str] = []

    def exchange() -> str:
        said.append("again")
        raise KeyboardInterrupt

    with patience(), pytest.raises(KeyboardInterrupt):
        patiently(Repeatable("again"), "again", exchange)
    assert len(said) == 1


class Deaf(Driver):
    """A driver whose way to rest fails, and who may be switched off by one command."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.did: list[str] = []

    def make_safe(self, deadline_s: float) -> None:
        self.did.append("make_safe")
        raise self.error("switched it off", "no answer came", "look")

    def last_attempt(self) -> None:
        self.did.append("last_attempt, once" if not PATIENT.get() else "last_attempt")
        raise self.error("switched it off blindly", "the line broke", "look")

    def await_rest(self, deadline_s: float) -> None:
        self.did.append(f"await_rest before {deadline_s:g} s")


def test_where_the_way_to_rest_fails_the_last_attempt_follows_and_the_first_error_is_told() -> None:
    deaf = Deaf(InstrumentPlace("it", "", VirtualClock()))
    with pytest.raises(InstrumentError, match="no answer came"):
        deaf.make_safe(5.0)
    assert deaf.did == ["make_safe", "last_attempt, once", "await_rest before 5 s"]


class Beside:
    """What brings several of a laboratory's models to rest; no driver itself."""

    did: list[str]

    def make_safe(self, deadline_s: float) -> None:
        self.did.append("patient" if PATIENT.get() else "impatient")
        raise InstrumentError("it", "switched it off", "no answer came", "look")


class Mixed(Beside, Deaf):
    """A driver with a way to rest of a class beside it, and a pause that is no verb."""

    pause = 0.05


def test_a_way_to_rest_from_beside_the_driver_is_one_too_and_a_number_is_no_verb() -> None:
    mixed = Mixed(InstrumentPlace("it", "", VirtualClock()))
    with pytest.raises(InstrumentError, match="no answer came"):
        mixed.make_safe(5.0)
    assert mixed.did == ["patient", "last_attempt, once", "await_rest before 5 s"]
    assert mixed.pause == 0.05
    assert not PATIENT.get()


def test_what_a_step_sets_and_keeps_is_no_way_to_rest() -> None:
    """Where one answer is lost to a meter that is configured, the run ends as at any command."""
    patient: list[bool] = []

    def read() -> str:
        patient.append(PATIENT.get())
        return "AUTO"

    def write(text: str) -> None:
        patient.append(PATIENT.get())

    KeptSettings(lambda *kind, **details: None).set("RANG", "1", read, write)
    assert patient == [False, False]


def test_a_driver_written_before_still_imports() -> None:
    """Modules that a laboratory's own drivers name, from how-tos of before."""
    from drivers.transport import retry, serial_port, visa_line

    assert retry.Repeatable is Repeatable
    assert issubclass(visa_line.ScpiDriver.Settings, visa_line.VisaSettings)
    assert visa_line.ScpiLine is visa_line.VisaLine
    assert serial_port.SerialSettings().baud_rate == 9600
