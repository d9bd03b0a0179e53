"""The count of what client libraries of others find: what counts as an attempt, and as works."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import clients
import pytest
from our_drivers import CASES, driver_of

from station import registry

AT: Mapping[str, Any] = {"protocol": "ascii", "host": "127.0.0.1", "port": 9}


class Meter:
    """A client's class as those of PyMeasure and InstrumentKit are: properties, and what fails."""

    def __init__(self) -> None:
        self.kept = 3.0
        self.told: list[object] = []

    @property
    def range(self) -> float:
        return self.kept

    @range.setter
    def range(self, value: float) -> None:
        self.told.append(value)

    @property
    def silent(self) -> float:
        raise TimeoutError("timed out")

    @property
    def no_such_word(self) -> float:
        return {"a": 1.0}["b"]

    @property
    def of_its_user(self) -> float:
        raise NotImplementedError

    def _set_only(self, value: str, values: tuple[str, ...] = ("SLOW", "FAST")) -> None:
        self.told.append(value)

    speed = property(None, _set_only)

    @property
    def timeout(self) -> float:
        raise AssertionError("it is the line's, not the instrument's")


def outcome(walk: Callable[[Mapping[str, Any]], Iterator[clients.Attempt]]) -> dict[str, str]:
    return dict(clients.tried(walk, AT, registry.load(registry.DRIVERS, "thorlabs-sc10")))


def test_what_is_read_is_set_again_and_what_cannot_be_read_to_the_first_that_is_allowed() -> None:
    meter = Meter()
    assert outcome(lambda at: clients.properties(meter)) == {
        "range?": "",
        "range=": "",
        "silent?": "TimeoutError: timed out",
        "no_such_word?": "KeyError: 'b'",
        "speed=": "",
    }
    assert meter.told == [3.0, "SLOW"]


@pytest.mark.parametrize("name", sorted(clients.CLIENTS))
def test_every_client_is_of_an_instrument_that_can_be_served_alone(name: str) -> None:
    assert name in {driver_of(case) for case in CASES}


@pytest.mark.campaign
@pytest.mark.parametrize(
    "name", ["can-pulse-board", "can-navigator", "can-imu", "watlow-f4t", "watlow-f4"]
)
def test_libraries_of_the_wire_find_all_that_devices_have(name: str, tmp_path: Any) -> None:
    (walk,) = clients.CLIENTS[name].values()
    with clients.served(name, tmp_path) as at:
        tried = dict(clients.tried(walk, at, registry.load(registry.DRIVERS, name)))
    assert len(tried) >= 10 and not {what: why for what, why in tried.items() if why}


@pytest.mark.campaign
def test_an_error_that_stays_in_the_queue_does_not_count(tmp_path: Any) -> None:
    import socket

    def walk(at: Mapping[str, Any]) -> Iterator[clients.Attempt]:
        with socket.create_connection((at["host"], at["port"]), 3) as line:
            yield "nonsense", lambda: line.sendall(b"NO:SUCH 1\n*IDN?\n") or line.recv(200)
            yield "identity", lambda: line.sendall(b"*IDN?\n") or line.recv(200)

    driver = registry.load(registry.DRIVERS, "kepco-bop-36-12")
    with clients.served("kepco-bop-36-12", tmp_path) as at:
        tried = dict(clients.tried(walk, at, driver))
    assert tried["nonsense"].startswith("-113") and tried["identity"] == ""
