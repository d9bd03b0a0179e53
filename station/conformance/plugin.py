"""The options of the conformance tests, and the instrument they give to each test."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any, Never

import pytest

from station import registry
from station.conformance.fixture import Fixture, fixture_of
from station.errors import StationError
from station.files.lookup import BENCHES, find
from station.instruments.bench import Bench, read_bench
from station.roles.role import Role, role_of, roles

CLAIMS = {"made_safe": "make_safe", "sampled_source": "drain"}
"""Fixtures for whatever has a verb; the other fixtures bear the name of a role."""

LONGEST_S, LONGEST_END_S = 60.0, 10.0
"""Of the computer's time, for a test on a simulated bench, and for what comes after one too long.

None takes a second, so what takes longer never ends: a `make_safe` that waits for ever.
"""

ENERGISES = "energises: current may flow; on a real bench only with --station-energise"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options, all of which begin with --station."""
    group = parser.getgroup("station", "conformance of a driver")
    group.addoption("--station-driver", metavar="NAME", help="entry point in station.drivers")
    group.addoption("--station-bench", metavar="BENCH", default="sim", help="bench file or name")
    group.addoption("--station-instrument", metavar="NAME", help="which of several instruments")
    group.addoption(
        "--station-procedure",
        metavar="NAME",
        default="rlg-magnetic-sensitivity",
        help="whose simulated world the instrument stands in",
    )
    group.addoption(
        "--station-energise", action="store_true", help="let current flow on a real bench"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Find the instrument; a driver or bench that does not exist ends the session at once."""
    config.addinivalue_line("markers", ENERGISES)
    try:
        config.stash[UNDER_TEST] = instrument_under_test(config)
    except StationError as error:
        raise pytest.UsageError(str(error)) from error


UNDER_TEST = pytest.StashKey[tuple[Bench, str]]()


def instrument_under_test(config: pytest.Config) -> tuple[Bench, str]:
    """Return the bench and the instance whose driver is under test."""
    driver = config.getoption("--station-driver")
    known = registry.names(registry.DRIVERS)
    if driver not in known:
        given = f"no driver is called {driver!r}" if driver else "no driver is given"
        raise pytest.UsageError(f"{given}; --station-driver takes one of {', '.join(known)}")
    bench = read_bench(find(BENCHES, config.getoption("--station-bench")), known)
    names = [name for name, instrument in bench.instruments.items() if instrument.driver == driver]
    wanted = config.getoption("--station-instrument")
    if not names or (wanted and wanted not in names):
        has = ", ".join(
            f"{name} ({instrument.driver})" for name, instrument in bench.instruments.items()
        )
        raise pytest.UsageError(
            f"the bench {bench.name} has no instrument {wanted or ''} with the driver {driver}; "
            f"it has {has}"
        )
    return bench, wanted or names[0]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what does not concern the instrument's role."""
    bench, name = config.stash[UNDER_TEST]
    driver = registry.load(registry.DRIVERS, bench.instruments[name].driver)
    kept: list[pytest.Item] = []
    left_out: list[pytest.Item] = []
    for item in items:
        wanted = set(getattr(item, "fixturenames", ())) & {*CLAIMS, *roles()}
        concerned = all(
            hasattr(driver, CLAIMS[want]) if want in CLAIMS else want == role_of(name)
            for want in wanted
        )
        (kept if concerned else left_out).append(item)
    items[:] = kept
    config.hook.pytest_deselected(items=left_out)


@contextmanager
def within(item: pytest.Item, longest_s: float) -> Iterator[None]:
    """Fail what takes longer, and end the session with it; only where a signal can do so."""

    def overrun(*_: object) -> Never:
        what = f"{item.name} did not end within {longest_s:g} s of the computer's time"
        item.session.shouldfail = f"{what}; does the driver wait for ever, or not by place.clock?"
        pytest.fail(what)

    main = threading.current_thread() is threading.main_thread()
    if item.config.stash[UNDER_TEST][0].simulation is None or not main:
        yield
        return
    if not hasattr(signal, "setitimer"):  # Windows
        yield
        return
    before = signal.signal(signal.SIGALRM, overrun)
    signal.setitimer(signal.ITIMER_REAL, longest_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Let no test go on for ever."""
    with within(item, LONGEST_S):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, Any, Any]:
    """Let no end of a test go on for ever: it brings the instrument to rest, too."""
    with within(item, LONGEST_END_S if item.session.shouldfail else LONGEST_S):
        return (yield)


@pytest.fixture
def fixture(request: pytest.FixtureRequest) -> Iterator[Fixture]:
    """Give the instrument under test, not yet opened."""
    bench, name = request.config.stash[UNDER_TEST]
    real = bench.simulation is None
    marked = request.node.get_closest_marker("energises")
    if real and marked and not request.config.getoption("--station-energise"):
        pytest.skip("current would flow on a real bench; give --station-energise to allow it")
    with fixture_of(bench, name, request.config.getoption("--station-procedure")) as fixture:
        yield fixture


@pytest.fixture
def role(fixture: Fixture) -> Role:
    """Give the role of the instrument under test."""
    declared = roles().get(fixture.role)
    if declared is None:
        pytest.skip(f"no installed package says what a {fixture.role} can do")
    return declared


@pytest.fixture
def instrument(fixture: Fixture) -> Any:
    """Give the instrument under test, opened."""
    return fixture.open()


# The names by which a test says whom it concerns.


@pytest.fixture
def made_safe(instrument: Any) -> Any:
    """Give an instrument that can harm."""
    return instrument


@pytest.fixture
def sampled_source(instrument: Any) -> Any:
    """Give an instrument that delivers samples."""
    return instrument


def instrument_of(role_name: str) -> Any:
    """Return a fixture by the name of a role: a test that has it concerns that role alone."""

    @pytest.fixture(name=role_name)
    def of_role(instrument: Any) -> Any:
        return instrument

    return of_role


globals().update({name: instrument_of(name) for name in roles()})
