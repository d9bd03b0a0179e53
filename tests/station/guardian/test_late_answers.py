"""A guardian and what it cannot understand: switched off all the same, and named where it toggles.

A supply that hears and answers late is off long before it can be verified; another model at its
address, and a shutter that one command opens and closes, get nothing.
"""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from guardian_helpers import World, is_alive, start_run, until, world
from wires import Pause, Wire, line_to

from station import registry
from station.clock import RealClock
from station.files.lookup import find
from station.guardian.make_safe import Reopening
from station.instruments.bench import read_bench
from station.instruments.instrument_locks import InstrumentLocks
from station.instruments.opening import Probe

if sys.platform != "linux":
    pytest.skip("SIGKILL and /proc; not verified elsewhere", allow_module_level=True)

VERIFIED_WITHIN_S = 180.0


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with world(tmp_path_factory.mktemp("world")) as served:
        yield served


@contextmanager
def opened_again(name: str, address: str, times: int) -> Iterator[Sequence[Probe]]:
    """Have a guardian open an instrument of the shipped bench, so many times; give all back."""
    bench = read_bench(find("benches", "sim"), registry.names(registry.DRIVERS))
    locks = InstrumentLocks("a test", "late answers")
    reopening = Reopening(bench, {name: address}, RealClock(), locks)
    probes = [reopening.open([name])[name] for _ in range(times)]
    yield probes
    for probe in probes:
        if probe.identified is not None:
            probe.identified.instrument.close()
    locks.release()


class SerialWire(Wire):
    """A wire whose requests end with a carriage return."""

    request = re.compile(rb"[^\r]*\r")


KEPCO = b"KEPCO,BIT 802E 36-12,H148201,1.15-1.80\n"


def test_a_supply_that_answers_late_is_switched_off_and_its_answer_waited_for() -> None:
    with (
        Wire((Pause(0.9), KEPCO)) as wire,
        opened_again("coil_supply.x", line_to(wire), 2) as (first, second),
    ):
        assert not first.ok
        assert "it was sent the command to switch off all the same" in first.said
        assert second.identified is not None, second.said
        assert second.identified.identity.model == "BIT 802E 36-12"
        assert wire.requests[:3] == [b"*IDN?\n", b"*IDN?\n", b"OUTP OFF\n"]


def test_another_model_gets_nothing_and_is_named() -> None:
    meter = b"Keysight Technologies,34465A,MY54500001,A.03.02\n"
    with (
        Wire((meter,)) as wire,
        opened_again("coil_supply.x", line_to(wire), 2) as probes,
    ):
        assert not any(probe.ok for probe in probes)
        assert all("Keysight Technologies,34465A" in probe.said for probe in probes)
        assert all("switch off" not in probe.said for probe in probes)
        assert set(wire.requests) == {b"*IDN?\n"}


def test_what_one_command_toggles_is_not_sent_it() -> None:
    with (
        SerialWire(()) as wire,
        opened_again("pump_laser", f"socket://127.0.0.1:{wire.port}", 1) as (probe,),
    ):
        assert not probe.ok
        assert "no answer came" in probe.said
        assert {request.strip() for request in wire.requests} <= {b"", b"id?"}


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("axis", "fault"),
    [
        ("x", {"fault": "late", "delay": "0.9 s", "for": "1 h"}),
        ("y", {"fault": "no-reply", "for": "15 s"}),
        ("z", {"fault": "garbled", "for": "15 s"}),
    ],
)
def test_a_supply_that_hears_is_off_at_once_after_a_kill_and_verified_later(
    bench: World, tmp_path: Path, axis: str, fault: dict[str, str]
) -> None:
    supply = f"coil_supply.{axis}"
    run = start_run(bench, tmp_path, supply)
    until(lambda: abs(bench.report()["coils"][axis]["current_A"]) > 2.0)
    bench.inject(instrument=supply, **fault)
    guardians = run.guardians
    run.end_by(signal.SIGKILL)
    off_s = until(lambda: not bench.report()["outputs"][supply])
    verified_s = off_s + until(lambda: not any(map(is_alive, guardians)), VERIFIED_WITHIN_S)
    run.wait_for_guardian()
    print(f"{fault['fault']}: off after {off_s:.1f} s, verified after {verified_s:.1f} s")
    assert off_s < 0.5 * verified_s, "off as soon as it hears, verified when it is heard"
    assert run.safe_states()[-1][supply]
    assert bench.at_rest(axis)
