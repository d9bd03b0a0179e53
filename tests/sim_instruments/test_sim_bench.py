"""The simulated bench as a whole: what it serves, what it refuses, what it does for a person."""

from __future__ import annotations

import socket

import pytest
from sim_bench import BENCH, SIMULATORS, bench_with, served

from sim_instruments.bench import SimulatedBench
from sim_instruments.truth import SimulationError
from sim_instruments.world.noise import generator
from station.clock import VirtualClock


def test_it_serves_each_instrument_with_a_simulator_and_leaves_out_the_others() -> None:
    with served(VirtualClock()) as bench:
        assert set(bench.instruments) == set(BENCH["instruments"]) - {"dut_power"}
        for entry in bench.instruments.values():
            assert entry["host"] == "127.0.0.1" and str(entry["port"]) in entry["address"]
        assert bench.instruments["gyro_acquisition"]["protocol"] == "socketcand"


def test_a_fixed_port_is_used() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    data = bench_with()
    data["instruments"]["gaussmeter"]["simulator"]["port"] = port
    with served(VirtualClock(), data) as bench:
        assert bench.instruments["gaussmeter"]["port"] == port


def test_another_serial_number_stands_for_the_wrong_unit() -> None:
    data = bench_with()
    data["instruments"]["gaussmeter"]["simulator"]["serial"] = "OTHER"
    with served(VirtualClock(), data) as bench:
        entry = bench.instruments["gaussmeter"]
        assert entry["model"] == "Lake Shore F71"


def test_closing_frees_the_ports() -> None:
    with served(VirtualClock()) as bench:
        entry = bench.instruments["gaussmeter"]
    with pytest.raises(OSError):
        socket.create_connection((entry["host"], entry["port"]), 0.5)


@pytest.mark.parametrize("prompt", ["mount", "dut-power-on", "dut-power-off"])
def test_a_physical_act_is_done_and_described(prompt: str) -> None:
    with served(VirtualClock()) as bench:
        assert bench.act(prompt).endswith(".")


def test_an_unknown_act_is_an_error_that_names_the_known_ones() -> None:
    with served(VirtualClock()) as bench, pytest.raises(SimulationError, match="dut-power-on"):
        bench.act("make-coffee")


def test_an_instruments_missing_truth_is_named_with_its_place() -> None:
    data = bench_with()
    del data["instruments"]["coil_supply.y"]["simulator"]["offset"]
    with pytest.raises(SimulationError, match=r"instruments\.coil_supply\.y\.simulator: 'offset'"):
        SimulatedBench(data, VirtualClock(), "rlg-magnetic-sensitivity", SIMULATORS)


def test_a_procedure_without_a_world_is_refused() -> None:
    with pytest.raises(SimulationError, match="no simulated world"):
        SimulatedBench(BENCH, VirtualClock(), "perpetual-motion", SIMULATORS)


def test_devices_draw_from_generators_of_their_own_by_seed_and_name() -> None:
    first = generator(1, "gaussmeter").random(4)
    assert (first == generator(1, "gaussmeter").random(4)).all()
    assert (first != generator(2, "gaussmeter").random(4)).all()
    assert (first != generator(1, "gyro_acquisition").random(4)).all()
