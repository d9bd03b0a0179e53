"""The reader of the interlock chain: its protocol by a raw client, and the driver."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from interlock_helpers import CHAIN, SHIPPED, bench_with
from sim_bench import Line, served
from wires import Wire, line_to

from drivers.generic.interlock_chain import InterlockChainLine
from sim_instruments.bench import SimulatedBench
from sim_instruments.truth import SimulationError
from station.clock import RealClock, VirtualClock
from station.errors import InstrumentError
from station.instruments.opening import InstrumentPlace
from station.report.run_report import notes_of


@pytest.fixture
def bench(clock: VirtualClock) -> Iterator[SimulatedBench]:
    with served(clock, SHIPPED, simulators=None) as simulation:
        yield simulation


def test_it_answers_who_it_is_and_how_the_chain_is(
    bench: SimulatedBench, clock: VirtualClock
) -> None:
    with Line(bench, CHAIN, clock) as line:
        assert line.ask("*IDN?").split(",")[2] == "IC-0001"
        assert line.ask("CHAIN?") == "CLOSED"
        assert line.ask("CHAIN:LIST?") == "NONE"
        assert line.ask("CHAIN:CLOSE;:SYST:ERR?").startswith("-113")


def test_contacts_open_one_by_one_and_close_again(
    bench: SimulatedBench, clock: VirtualClock
) -> None:
    with Line(bench, CHAIN, clock) as line:
        bench.inject({"instrument": CHAIN, "fault": "chain-open", "contact": "door", "for": "5 s"})
        assert (line.ask("CHAIN?"), line.ask("CHAIN:LIST?")) == ("OPEN", "door")
        bench.inject({"instrument": CHAIN, "fault": "chain-open", "for": "2 s"})
        assert line.ask("CHAIN:LIST?") == "e-stop,door"
        clock.sleep(3.0)
        assert line.ask("CHAIN:LIST?") == "door"
        clock.sleep(3.0)
        assert (line.ask("CHAIN?"), line.ask("CHAIN:LIST?")) == ("CLOSED", "NONE")


def test_a_contact_can_open_at_a_message(bench: SimulatedBench, clock: VirtualClock) -> None:
    bench.inject({"instrument": CHAIN, "fault": "chain-open", "command": "CHAIN?", "nth": 3})
    with Line(bench, CHAIN, clock) as line:
        assert [line.ask("CHAIN?") for _ in range(4)] == ["CLOSED", "CLOSED", "OPEN", "OPEN"]


def test_a_contact_that_is_not_there_cannot_open(bench: SimulatedBench) -> None:
    with pytest.raises(SimulationError, match=r"no 'window' \(it has: e-stop, door\)"):
        bench.inject({"instrument": CHAIN, "fault": "chain-open", "contact": "window"})


def test_the_driver_sees_the_state_and_the_contacts(
    bench: SimulatedBench, clock: VirtualClock
) -> None:
    published: list[tuple[str, float | str]] = []
    address = bench.instruments[CHAIN]["address"]
    place = InstrumentPlace(
        CHAIN, address, clock, publisher=lambda name, value, _: published.append((name, value))
    )
    chain = InterlockChainLine(place)
    assert chain.identify().serial == "IC-0001"
    assert chain.is_closed()
    assert chain.open_contacts() == ()
    bench.inject({"instrument": CHAIN, "fault": "chain-open", "contact": "door"})
    assert not chain.is_closed()
    assert chain.open_contacts() == ("door",)
    assert chain.read_quantity("chain") == "open"
    assert chain.explain("chain") == "open: door"
    chain.close()
    assert published == [("chain", "closed"), ("chain", "open"), ("chain", "open")]


@pytest.mark.parametrize("answer", [b"MAYBE\n", b"\n", b"closed\n", b"CLOSED,OPEN\n"])
def test_whatever_is_not_closed_or_open_is_told_and_never_counts_as_closed(answer: bytes) -> None:
    with Wire((answer,)) as wire:
        chain = InterlockChainLine(InstrumentPlace(CHAIN, line_to(wire), RealClock()))
        with pytest.raises(InstrumentError, match="where CLOSED or OPEN belongs"):
            chain.is_closed()
        chain.close()


def test_a_bench_without_a_chain_is_named_in_the_report() -> None:
    assert list(notes_of(bench_with())) == []
    (note,) = notes_of(bench_with(chain=False))
    assert "The bench sim has no interlock_chain" in note
