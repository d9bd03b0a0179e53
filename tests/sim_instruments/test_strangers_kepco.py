"""A Kepco BOP in its several forms: what other programs send, and what its driver makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from variants import variant

from sim_instruments.kepco.current_loop import steps
from sim_instruments.truth import SimulationError
from station.errors import InstrumentError

PROCEDURE = "rlg-magnetic-sensitivity"
CARD, LARGE = ("coil_supply.x", PROCEDURE, "sim"), ("coil_supply.x", PROCEDURE, "sim-alternate")


@pytest.mark.parametrize(
    ("bench", "form", "model", "firmware", "dated"),
    [
        (CARD, "lan", "BIT 802E 36-12", "1.15-1.80", False),
        (CARD, "blanks", "BIT 4886 36-12", "1.8-1.8", False),
        (CARD, "date-after-serial", "BIT4886-6 36-12", "1.81-1.81", True),
        (CARD, "date-before-serial", "BIT 4886 36-12", "4.04-1.82", True),
        (LARGE, "plain", "BOP 72-14MG", "2.24", False),
        (LARGE, "firmware-2", "BOP1KW 72-14", "2.01", False),
        (LARGE, "calibration-date", "BOP 72-14MG", "4.05", True),
    ],
)
def test_the_serial_number_is_neither_date_nor_model_nor_revision(
    bench: tuple[str, str, str], form: str, model: str, firmware: str, dated: bool
) -> None:
    with variant(*bench, identity=form) as here:
        supply = here.driver()
        identity = supply.identify()
        wanted = here.fixture.bench.instruments["coil_supply.x"].serial
        assert (identity.model, identity.serial, identity.firmware) == (model, wanted, firmware)
        assert here.met() == [f"identity {'with' if dated else 'without'} a calibration date"]


def test_an_identity_of_another_maker_is_refused_and_an_echo_named() -> None:
    echoes = pytest.raises(InstrumentError, match=r"echoes what it is sent.*5025")
    with variant(*CARD, telnet=True) as here, echoes:
        here.driver().identify()


def test_a_card_that_echoes_answers_in_the_next_line() -> None:
    with variant(*CARD, telnet=True) as here, here.line() as line:
        assert line.raw_ask(b"OUTP?\r\n") == b"OUTP?\r\n0\n"


def test_a_card_without_a_current_limit_keeps_its_rating() -> None:
    with variant(*CARD, current_limit=False) as here:
        here.driver().programme_limits()
        assert here.met() == ["limited by its rating alone"]
    with variant(*CARD) as here:
        here.driver().programme_limits()
        assert here.met() == ["CURR:LIM is known"]


def test_a_card_takes_its_time_for_each_message() -> None:
    with variant(*CARD, command_time="25 ms") as here:
        supply = here.driver()
        began_s = here.clock.now()
        supply.programme_limits()
        supply.switch_on()
        supply.ramp_to(1.0)
        assert here.clock.now() - began_s > 0.5
        supply.make_safe(here.clock.now() + 30.0)
        assert supply.read_safety().safe


def test_numbers_of_the_1_kw_family_have_four_digits_before_and_eight_after_the_point() -> None:
    with variant(*LARGE) as here, here.line() as line:
        line.write("SYST:REM ON;:FUNC:MODE CURR")
        for text in ("00001.5", "1.123456789", "6501", "-6501"):
            assert line.ask(f"CURR {text};:SYST:ERR?").startswith("-120"), text
        assert line.ask("CURR 1.12345678;:SYST:ERR?") == '0,"No error"'
        line.write("CURR 2.5")
        assert line.ask("CURR?").endswith("E0") and len(line.ask("CURR?")) <= 9
        assert line.ask("VOLT:PROT 24;:VOLT:PROT?").split(",")[0] == "2.4E1"


def test_a_message_of_254_characters_is_refused_whole() -> None:
    with variant(*CARD) as here, here.line() as line:
        line.write("FUNC:MODE CURR;:LIST:CURR " + ",".join(["1.0"] * 70))
        assert line.ask("SYST:ERR?").startswith("-363")
        assert line.ask("LIST:CURR:POIN?") == "0"


def test_a_stranger_reads_and_measures_in_its_own_way() -> None:
    """As PyMeasure's client does."""
    with variant(*CARD) as here, here.line() as line:
        line.write("*RST")
        line.write("FUNC:MODE CURR")
        assert line.ask("FUNC:MODE?") == "1"
        line.write("VOLT 20")
        line.write("CURR 0.5")
        line.write("OUTPUT ON")
        assert line.ask("OUTPUT?") == "1"
        here.clock.sleep(1.0)
        assert float(line.ask("MEASURE:CURRENT?")) == pytest.approx(0.5, abs=5e-3)
        line.write("NONSENSE 3")
        assert line.ask("SYST:ERR?").startswith("-113")
        line.write("OUTPUT OFF")


def test_a_loop_drives_up_to_the_voltage_limit_until_the_current_is_there() -> None:
    """dI/dt = (V_limit - R I)/L from the very first moment."""
    with variant(*CARD, current_loop=True, offset="0 A") as here:
        coil = here.fixture.simulation._world.coil("x")
        with here.line() as line:
            line.write("FUNC:MODE CURR;:VOLT 12;:CURR:RANG 1;:OUTP ON")
            line.write("CURR 4")
            began_s = here.clock.now() - 1e-3
            at_s = began_s + np.array([2e-4, 1.0])
            ceiling_A = float(line.ask("VOLT?")) / coil.resistance_ohm
            early_A, late_A = coil.current(at_s).tolist()
            assert early_A == pytest.approx(ceiling_A * -math.expm1(-2e-4 / coil.tau_s), rel=1e-6)
            level_A = float(line.ask("CURR?")) * 1.0005
            assert late_A == pytest.approx(level_A, rel=1e-5)
            way_s = -coil.tau_s * math.log(1.0 - level_A / ceiling_A)
            there = coil.current(began_s + np.array([way_s * 0.9, way_s * 1.001]))
            assert there[0] < level_A * 0.99 and there[1] == pytest.approx(level_A, rel=1e-5)
            line.write("OUTP OFF")


def test_a_sine_of_the_loop_lies_on_its_set_points_and_comes_to_rest() -> None:
    with variant(*CARD, current_loop=True) as here:
        supply = here.driver()
        supply.programme_limits()
        supply.load_sine(0.1, 3.0)
        supply.start_sine()
        coil = here.fixture.simulation._world.coil("x")
        here.clock.sleep(2.5)
        assert supply.current_A() == pytest.approx(3.0, abs=0.01)
        here.clock.sleep(20.0)
        assert coil.current(np.array([here.clock.now()]))[0] == pytest.approx(3.0, abs=0.01)
        supply.stop()
        assert supply.read_safety().safe


def test_a_step_that_the_voltage_cannot_follow_goes_as_far_as_it_comes() -> None:
    (levels, dwells), end_A = steps(np.array([5.0, 0.0]), np.array([0.01, 0.1]), 0.0, 10.0, 0.1)
    assert levels[0] == 10.0 and dwells[0] == 0.01
    reached_A = 10.0 * -math.expm1(-0.1)
    way_s = 0.1 * math.log((10.0 + reached_A) / 10.0)
    assert levels[1:].tolist() == [-10.0, 0.0] and dwells[1] == pytest.approx(way_s)
    assert end_A == 0.0 and dwells.sum() == pytest.approx(0.11)


def test_the_forms_of_an_identity_are_named_where_one_is_wrong() -> None:
    wrong = pytest.raises(SimulationError, match="identity: one of lan, blanks")
    with wrong, variant(*CARD, identity="other"):
        raise AssertionError("it is served")


@pytest.mark.parametrize("bench", [CARD, LARGE])
def test_the_full_test_passes_and_an_option_is_not_asked_for(bench: tuple[str, str, str]) -> None:
    with variant(*bench) as here, here.line() as line:
        assert line.ask("DIAG:TST?;:SYST:ERR?").startswith("0;0,")
        line.write("*OPT?")
        assert line.ask("SYST:ERR?").startswith("-113")
