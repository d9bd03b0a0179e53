"""What a Kepco supply answers on its wire, and the sine of the two families."""

from __future__ import annotations

import re

import pytest
from variants import variant
from wires import HANG_UP, NO_ERROR, KepcoWire, Wire, no_thread_is_left, supply  # noqa: F401

from drivers.kepco.bop import KepcoBop
from drivers.kepco.bop_1kw import KepcoBop1kW
from station.errors import InstrumentError

SUPPLY = ("coil_supply.x", "rlg-magnetic-sensitivity", "sim-alternate")


@pytest.mark.parametrize("answer", [b"ERR\n", b"nan\n", b"inf\n", b"1,2\n", b"\n"])
def test_what_is_no_number_is_never_a_current(answer: bytes) -> None:
    with Wire((answer,)) as wire:
        instrument = supply(wire)
        with pytest.raises(InstrumentError, match=r"MEAS:CURR\?.*where a number belongs"):
            instrument.current_A()
        instrument.close()


def test_a_refused_command_says_what_the_instrument_said() -> None:
    refusal = b'-222,"Data out of range"\n'
    with KepcoWire((b"0\n",), (NO_ERROR,), (refusal,)) as wire:
        instrument = supply(wire)
        with pytest.raises(
            InstrumentError, match=r'FUNC:MODE CURR.*refused with -222,"Data out of'
        ):
            instrument.programme_limits()
        instrument.close()


def test_a_supply_that_refuses_everything_is_switched_off_all_the_same() -> None:
    with Wire((b'-310,"System error"\n',)) as wire:
        instrument = supply(wire)
        with pytest.raises(InstrumentError):
            instrument.make_safe(instrument.place.clock.now() + 5.0)
        with pytest.raises(InstrumentError):
            instrument.read_safety()
        instrument.close()
    assert wire.requests[0].startswith(b"*CLS")
    assert b"OUTP OFF\n" in wire.requests


def test_two_bad_answers_are_borne_by_whoever_watches_and_not_by_a_step() -> None:
    with Wire((b"nan\n",), (HANG_UP,), (b"1.5\n",), (b"nan\n",)) as wire:
        instrument = supply(wire)
        assert instrument.read_quantity("current") == 1.5
        with pytest.raises(InstrumentError):
            instrument.current_A()
        instrument.close()
    assert len(wire.requests) == 4


def test_the_way_to_rest_bears_a_bad_answer_to_any_of_its_messages() -> None:
    # Clear errors, register, current, set-point twice, zero, current, output off: each lost once.
    answers = [NO_ERROR, b"0\n", *[b"0.0\n"] * 3, NO_ERROR, b"0.0\n", NO_ERROR]
    acts = [act for answer in answers for act in ((HANG_UP,), (answer,))]
    with KepcoWire(*acts) as wire:
        instrument = supply(wire)
        instrument.make_safe(instrument.place.clock.now() + 5.0)
        instrument.close()
    assert len(wire.requests) == 2 * len(answers)
    assert wire.requests[-1] == b"OUTP OFF;:SYST:ERR?\n"


def test_a_supply_of_the_1_kw_family_is_told_from_a_card() -> None:
    large, small = "KEPCO,BOP 72-14MG,K2304411,2.24", "KEPCO,BIT 802E 36-12,H148201,1.15-1.80"
    found = re.match(KepcoBop1kW.recognises, large)
    assert found is not None and found["serial"] == "K2304411"
    assert re.match(KepcoBop1kW.recognises, small) is None
    assert re.match(KepcoBop.recognises, large) is None


def test_a_sine_left_at_any_moment_ends_without_a_step() -> None:
    """The list is left near a zero, whatever FIX does there; what remains is ramped."""
    with variant(*SUPPLY) as here:
        supply = here.driver()
        for wait_s in (0.4, 3.1):
            supply.programme_limits()
            assert supply.load_sine(0.1, 5.0) == 0.1
            supply.start_sine()
            here.fixture.clock.sleep(wait_s)
            supply.stop()
            assert supply.read_safety().safe
        coil = here.fixture.simulation.simulation_report()["coils"]["x"]
        assert coil["largest_current_A"] > 1.0
        assert coil["largest_slew_A_per_s"] * coil["time_constant_s"] < 0.25


def test_a_frequency_that_the_generator_cannot_do_is_refused() -> None:
    with variant(*SUPPLY) as here:
        supply = here.driver()
        supply.programme_limits()
        with pytest.raises(InstrumentError, match=r"in one segment it makes 0\.01 Hz to 1\.8 Hz"):
            supply.load_sine(2.0, 1.0)
        assert supply.read_safety().safe
