"""What protects nobody is refused in a bench file, with its place and the reason."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from command_line import PLAN, station

from station import registry
from station.files.faults import FaultList
from station.files.lookup import BENCHES, find
from station.files.yaml.reading import read_yaml
from station.instruments.bench import bench_of, read_bench

GOOD = """\
bench: 1
name: lab
instruments:
  coil_supply.x:
    driver: kepco-bop-36-12
    address: TCPIP::192.0.2.7::5025::SOCKET
    settings: {coil_constant: 0.3 mT/A}
    limits: {current: 8 A, voltage: 30 V, slew: 2 A/s, zero_current: 20 mA}
  gaussmeter:
    driver: lakeshore-f71
    address: TCPIP::192.0.2.8::7777::SOCKET
    settings: {averaging: 100 ms, timestamp: interval-end}
  thermal_chamber:
    driver: watlow-f4t
    address: modbus-tcp://192.0.2.9
    limits: {temperature_low: -45 degC, temperature_high: 70 degC}
interlocks:
  - {name: coil, when: {instrument: coil_supply.x, quantity: current, above: 8.2 A}, grace: 0.4 s}
  - {name: air, when: {instrument: thermal_chamber, quantity: temperature, above: 80 degC}}
safe_state:
  - {role: coil_supply, within: 30 s}
"""
COIL = "{instrument: coil_supply.x, quantity: current, above: 8.2 A}"

REFUSED = {
    ("zero_current: 20 mA", "zero_current: 100 A"): (
        "8:70: instruments.coil_supply.x.limits.zero_current: 100 A is too much to count as zero: "
        "a coil that carries it would be reported as safe; at most 0.08 A, which is 1% of current"
    ),
    ("slew: 2 A/s", "slew: 1000 A/s"): (
        "8:49: instruments.coil_supply.x.limits.slew: 1000 A/s takes 8 A to zero in 0.008 s, which "
        "is no ramp: a coil that is cut off induces a high voltage; at most 16 A/s"
    ),
    ("slew: 2 A/s", "slew: 0.1 A/s"): (
        "21:33: safe_state[1].within: 30 s is shorter than the ramp of coil_supply.x to zero, 80 s"
    ),
    ("within: 30 s", "within: 2 h"): (
        "21:33: safe_state[1].within: 7200 s is too long: nobody beside the bench would learn"
    ),
    ("grace: 0.4 s", "grace: 1e9 s"): (
        "18:93: interlocks[1].grace: 1e+09 s is too long: for so long the bench would go on with "
        "what the interlock forbids; at most 60 s"
    ),
    ("grace: 0.4 s", "period: 10 min"): (
        "18:94: interlocks[1].period: 600 s is too long: an interlock that is looked at so rarely "
        "trips too late"
    ),
    ("above: 8.2 A", "above: 1e6 A"): (
        "18:78: interlocks[1].when.above: 1e+06 A is so far beyond limits.current of "
        "coil_supply.x, 8 A, that the interlock protects nothing; at most 12 A"
    ),
    ("above: 80 degC", "outside: [-50 degC, 300 degC]"): (
        "19:96: interlocks[2].when.outside[2]: 300 degC is so far beyond "
        "limits.temperature_high of thermal_chamber"
    ),
}
UNWATCHED = "4:3: instruments.coil_supply.x: no interlock looks at this coil"
BLIND = {
    "none": "interlocks: []",
    "another": "interlocks:\n  - {name: a, when: {instrument: coil_supply.x, quantity: output, "
    "equals: on}}",
    "only together": f"interlocks:\n  - {{name: a, when: {{all: [{COIL}, {COIL}]}}}}",
    "turned over": f"interlocks:\n  - {{name: a, when: {{not: {COIL}}}}}",
    "a field that it never makes": "interlocks:\n  - {name: a, when: {instrument: gaussmeter, "
    "quantity: field, above: 60 mT}}",
}
SEEING = {
    "its field": "interlocks:\n  - {name: a, when: {instrument: gaussmeter, quantity: field, "
    "above: 2.5 mT}}",
    "its voltage": "interlocks:\n  - {name: a, when: {instrument: coil_supply.x, "
    "quantity: voltage, above: 12 V}}",
    "any of several": f"interlocks:\n  - {{name: a, when: {{any: [{COIL}, {COIL}]}}}}",
    "both signs": "interlocks:\n  - {name: a, when: {instrument: coil_supply.x, "
    "quantity: current, outside: [-8.2 A, 8.2 A]}}",
}


def faults_of(folder: Path, text: str) -> list[str]:
    path = folder / "bench.yaml"
    path.write_text(text, encoding="utf-8")
    try:
        read_bench(path, registry.names(registry.DRIVERS))
    except FaultList as found:
        return [str(one).removeprefix(f"{path}:") for one in found.faults]
    return []


def with_interlocks(text: str) -> str:
    head, _, rest = GOOD.partition("interlocks:\n")
    return head + text + "\nsafe_state:" + rest.partition("safe_state:")[2]


def test_the_bench_that_is_changed_below_has_no_fault(tmp_path: Path) -> None:
    assert faults_of(tmp_path, GOOD) == []


@pytest.mark.parametrize("changed", REFUSED, ids=lambda pair: pair[1])
def test_a_value_beyond_a_bound_is_refused_at_its_place_with_the_reason(
    tmp_path: Path, changed: tuple[str, str]
) -> None:
    assert changed[0] in GOOD
    faults = faults_of(tmp_path, GOOD.replace(*changed))
    assert next(one for one in faults if not one.startswith(UNWATCHED)).startswith(REFUSED[changed])
    assert len(faults) == 1 + ("above: 1e6 A" in changed), "which is no look at the coil either"


@pytest.mark.parametrize("name", BLIND)
def test_a_coil_that_no_interlock_looks_at_is_refused_with_an_example(
    tmp_path: Path, name: str
) -> None:
    (fault,) = faults_of(tmp_path, with_interlocks(BLIND[name]))
    assert fault.startswith(UNWATCHED)
    _, _, example = fault.partition("for example, ")
    entry = yaml.safe_load(example)
    assert not faults_of(tmp_path, with_interlocks(f"interlocks: [{example}]"))
    assert entry["when"]["above"] == "8.2 A"


@pytest.mark.parametrize("name", SEEING)
def test_what_counts_as_a_look_at_a_coil(tmp_path: Path, name: str) -> None:
    assert faults_of(tmp_path, with_interlocks(SEEING[name])) == []


@pytest.mark.parametrize("name", ["sim", "sim-alternate"])
def test_the_shipped_benches_are_within_the_bounds(name: str) -> None:
    read_bench(find(BENCHES, name), registry.names(registry.DRIVERS))


def test_a_record_of_before_is_still_read_and_a_new_run_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text(GOOD.replace("zero_current: 20 mA", "zero_current: 100 A"), encoding="utf-8")
    bench = bench_of(read_yaml(path), registry.names(registry.DRIVERS))
    assert bench.instruments["coil_supply.x"].limits["zero_current"] == 100.0


def test_validate_says_so(tmp_path: Path) -> None:
    shipped = find(BENCHES, "sim").read_text(encoding="utf-8")
    text = shipped.replace("zero_current: 20 mA", "zero_current: 100 A", 1)
    (tmp_path / "bench.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    done = station(tmp_path, "validate", "plan.yaml", "--bench", "bench.yaml")
    assert done.returncode == 2
    assert "bench.yaml:15:70: instruments.coil_supply.x.limits.zero_current: 100 A" in done.stderr


@pytest.mark.parametrize("name", ["sim", "sim-alternate"])
def test_a_table_that_brakes_for_longer_than_it_has_is_refused(name: str, tmp_path: Path) -> None:
    text = find(BENCHES, name).read_text(encoding="utf-8")
    before = "acceleration: 50 deg/s^2}"
    assert before in text
    (fault,) = faults_of(tmp_path, text.replace(before, "acceleration: 2 deg/s^2}"))
    assert "15 s is shorter than the ramp of turntable to zero, 55 s" in fault
    assert fault.endswith("allow more, or raise its acceleration")


DEADLINES = {
    ("1.5 s", "grace: 0.4 s", "within: 30 s"): (
        "instruments.coil_supply.x.deadline: 3 tries of 1.5 s at coil_supply.x take 4.5 s, longer "
        "than the grace of the interlock 'coil', 0.4 s: for so long nobody would watch; write "
        "grace: 4.5 s there, or a shorter deadline"
    ),
    ("5 s", "grace: 15 s", "within: 8 s"): (
        "instruments.coil_supply.x.deadline: 3 tries of 5 s at coil_supply.x take 15 s, longer "
        "than its time in safe_state, 8 s; write within: 15 s there, or a shorter deadline"
    ),
    ("0.2 s", "grace: 0.4 s", "within: 30 s"): (
        "instruments.coil_supply.x.deadline: 0.2 s is shorter than what the driver "
        "'kepco-bop-36-12' gives each exchange, 0.5 s; write more, or leave it out"
    ),
    ("6 s", "grace: 30 s", "within: 30 s"): "instruments.coil_supply.x.deadline: must be at most 5",
}


def with_deadline(deadline: str, grace: str, within: str) -> str:
    driver = "driver: kepco-bop-36-12"
    slow = GOOD.replace(driver, f"{driver}\n    deadline: {deadline}")
    return slow.replace("grace: 0.4 s", grace).replace("within: 30 s", within)


@pytest.mark.parametrize(("written", "says"), DEADLINES.items())
def test_a_deadline_is_held_against_grace_and_safe_state(
    tmp_path: Path, written: tuple[str, str, str], says: str
) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text(with_deadline(*written), encoding="utf-8")
    with pytest.raises(FaultList) as refused:
        read_bench(path, registry.names(registry.DRIVERS))
    assert says in str(refused.value)


def test_a_deadline_that_grace_and_safe_state_leave_room_for_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "bench.yaml"
    path.write_text(with_deadline("1.5 s", "grace: 4.5 s", "within: 30 s"), encoding="utf-8")
    bench = read_bench(path, registry.names(registry.DRIVERS))
    assert bench.instruments["coil_supply.x"].deadline_s == 1.5


ALONE = {
    ("current: 8 A", "current: -8 A"): "8:23: instruments.coil_supply.x.limits.current: must be "
    "above 0, not '-8 A'",
    ("slew: 2 A/s", "slew: -2 A/s"): "8:49: instruments.coil_supply.x.limits.slew: must be above "
    "0, not '-2 A/s'",
    ("slew: 2 A/s", "slew: 0 A/s"): "8:49: instruments.coil_supply.x.limits.slew: must be above 0, "
    "not '0 A/s'",
    ("temperature_high: 70 degC", "temperature_high: -70 degC"): "16:59: "
    "instruments.thermal_chamber.limits.temperature_high: must be above the low limit, -45",
    ("temperature_low: -45 degC", "rate: 5 deg/s, temperature_low: -45 degC"): "16:14: "
    "instruments.thermal_chamber.limits.rate: is no limit of a thermal_chamber; it has "
    "temperature_low, temperature_high, temperature_slew",
    (
        "averaging: 100 ms, timestamp: interval-end}",
        "averaging: 100 ms, timestamp: interval-end}\n    limits: {current: 1 A}",
    ): "13:14: instruments.gaussmeter.limits.current: is no limit of a gaussmeter; it has field",
}


@pytest.mark.parametrize("change", ALONE)
def test_a_limit_that_cannot_hold_is_one_fault_at_its_place(
    change: tuple[str, str], tmp_path: Path
) -> None:
    (fault,) = faults_of(tmp_path, GOOD.replace(*change))
    assert fault == ALONE[change]
