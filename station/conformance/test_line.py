"""What every driver owes, whatever its instrument does: identity, clear errors, an end."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from station.conformance.faulty_server import FaultyServer, closed_port, is_can, moved_to
from station.conformance.fixture import Fixture
from station.driver_checks import settings_of, wrong_units
from station.errors import InstrumentError, QuantityNotRead
from station.fields import StrictModel
from station.roles.role import Role, quantities_of

ANSWERS_WITHIN_S = 5.0
"""Run time for opening a line and one question, each exchange being at most half a second."""

SETTLES_S = 0.2
"""Run time after which whatever belongs to an exchange has come."""

NONSENSE = {
    "bytes": b"\x00\xff\xfe\x81\n",
    "another answer": b"?\r\n",
    "an empty answer": b"\n",
    "no end": b"12,",
}
NONSENSE_ON_CAN = {
    "bytes": b"\x00\xff\xfe\x81",
    "no frame": b"?\r\n",
    "bad hexadecimal": b"< frame 101 0.0 zz >",
    "short frames": b"".join(b"< frame %03X 0.0 01 >" % number for number in range(0x90, 0x140)),
}


def silent(data: bytes) -> bytes:
    """Answer nothing."""
    return b""


def hang_up(data: bytes) -> None:
    """Close the connection in place of an answer."""


def need_port(fixture: Fixture) -> None:
    """Skip a test that has to take the instrument's place on the wire."""
    if not fixture.address:
        pytest.skip("it has no line")
    if moved_to(fixture.address, 1) is None:
        pytest.skip(f"the tests cannot take the place of {fixture.address}")


def error_of(fixture: Fixture, port: int) -> InstrumentError:
    """Return the error of opening and identifying an instrument at a port; it must be a clear one.

    Clear is one sentence: instrument, what was attempted, what came back, what to do now.
    """
    began_s = fixture.clock.now()
    with pytest.raises(InstrumentError) as raised:
        fixture.open(port=port).identify()
    took_s = fixture.clock.now() - began_s
    assert took_s <= ANSWERS_WITHIN_S, f"the error came after {took_s:.3g} s"
    error, text = raised.value, str(raised.value)
    what, _, do_now = text.rpartition("; ")
    assert error.instrument == fixture.name, "the error names another instrument"
    assert len(what.split(": ")) >= 3, f"what was attempted, and what came back? {text}"
    assert do_now.strip(), f"what should the operator do? {text}"
    assert "\n" not in text, f"more than a sentence: {text}"
    return error


@contextmanager
def no_thread_left() -> Iterator[None]:
    """Prove that what is done inside leaves no thread behind."""
    before = set(threading.enumerate())
    yield
    started = [
        thread for thread in set(threading.enumerate()) - before if "faulty" not in thread.name
    ]
    for thread in started:
        thread.join(2.0)
    left = [thread.name for thread in started if thread.is_alive()]
    assert not left, f"threads go on after close(): {left}"


def test_it_has_the_verbs_of_its_role(fixture: Fixture, role: Role, instrument: Any) -> None:
    """A step finds every verb and attribute of the role it asks for."""
    assert not list(role.missing_verbs(instrument))
    assert not role.missing_attributes(instrument)


def test_it_declares_its_settings_and_what_it_reads(fixture: Fixture, instrument: Any) -> None:
    """A bench file is held against that before anything is energised."""
    declared = getattr(instrument, "Settings", StrictModel)
    assert settings_of(instrument) is declared, "its Settings is no model"
    assert issubclass(declared, StrictModel), "its Settings takes keys that it does not know"
    unknown = set(getattr(instrument, "quantities", {})) - set(quantities_of(fixture.name))
    assert not unknown, f"an interlock on its role cannot name {', '.join(sorted(unknown))}"
    for quantity, read in getattr(instrument, "quantities", {}).items():
        assert callable(read), f"nothing reads {quantity}"
    assert not list(wrong_units(instrument, fixture.name))


def test_each_quantity_reads_as_its_role_has_it(fixture: Fixture, instrument: Any) -> None:
    """An interlock compares a number with a level, or a word with the states that there are."""
    instrument.identify()
    declared = quantities_of(fixture.name)
    for quantity in declared.keys() & set(getattr(instrument, "quantities", {})):
        with suppress(QuantityNotRead):  # which no setting wires
            value = instrument.read_quantity(quantity)
            states = declared[quantity].states
            fits = value in states if states else isinstance(value, int | float)
            wanted = " or ".join(states) or f"a number in {declared[quantity].unit}"
            assert value is None or fits, f"{quantity} reads {value!r}, its role has {wanted}"


def test_it_says_who_is_there(fixture: Fixture, instrument: Any) -> None:
    """The serial number is what proves that the right unit is connected."""
    identity = instrument.identify()
    if fixture.address:
        assert identity.serial, "the identity holds no serial number"
        assert identity.model, "the identity holds no model"
    expected = fixture.bench.instruments[fixture.name].serial
    assert not expected or identity.serial == expected
    assert instrument.identify() == identity, "asked twice it is somebody else"


def test_closing_twice_does_no_harm(instrument: Any) -> None:
    """The end of a run closes what an error may have closed before."""
    instrument.identify()
    instrument.close()
    instrument.close()


def test_a_closed_port_is_reported_clearly(fixture: Fixture) -> None:
    """Nobody listens: the instrument is off, or the address is wrong."""
    need_port(fixture)
    with no_thread_left():
        error_of(fixture, closed_port())
        fixture.close()


@pytest.mark.parametrize("greets", [True, False], ids=["silent", "silent-from-the-start"])
def test_silence_is_reported_clearly_and_in_time(fixture: Fixture, greets: bool) -> None:
    """The connection stands and no answer ever comes."""
    need_port(fixture)
    can = is_can(fixture.address)
    server = FaultyServer(fixture.clock, silent, can=can, greets=greets)
    with server, no_thread_left():
        error_of(fixture, server.port)
        fixture.close()


def test_a_partner_that_hangs_up_is_reported_clearly(fixture: Fixture) -> None:
    """The connection is closed in the middle of an exchange."""
    need_port(fixture)
    with (
        FaultyServer(fixture.clock, hang_up, can=is_can(fixture.address)) as server,
        no_thread_left(),
    ):
        error_of(fixture, server.port)
        fixture.close()


@pytest.mark.parametrize("kind", [*dict.fromkeys([*NONSENSE, *NONSENSE_ON_CAN])])
def test_nonsense_is_reported_clearly(fixture: Fixture, kind: str) -> None:
    """Whatever comes back, an answer that is none never becomes an identity."""
    need_port(fixture)
    known = NONSENSE_ON_CAN if is_can(fixture.address) else NONSENSE
    if kind not in known:
        pytest.skip("not on this kind of line")
    answer: Callable[[bytes], bytes] = lambda data: known[kind]  # noqa: E731
    with (
        FaultyServer(fixture.clock, answer, can=is_can(fixture.address)) as server,
        no_thread_left(),
    ):
        error_of(fixture, server.port)
        fixture.close()


@pytest.mark.parametrize("where", ["ahead", "before", "behind", "after"])
def test_a_line_that_nobody_asked_for_is_no_answer(
    fixture: Fixture, instrument: Any, where: str
) -> None:
    """One stray line makes nobody else of the instrument, nor does it stay on the line."""
    known = instrument.identify()
    if not fixture.stray(where, "0"):
        pytest.skip("its simulator sends no stray lines")
    for _ in range(3):
        with suppress(InstrumentError):
            assert instrument.identify() == known, "a stray line is taken for its identity"
        fixture.clock.sleep(SETTLES_S)
    assert instrument.identify() == known, "the line does not come into step again"
