"""Interlocks of a bench file: every fault with its place, and what is made of right ones."""

from __future__ import annotations

import pytest
from interlock_helpers import CHAIN, SHIPPED, bench_from, bench_with

from station.files.faults import FaultList
from station.safety.interlocks.conditions import AllOf, AnyOf, Level, Not, State
from station.safety.interlocks.reading import watched_in_a_run

HEAD = """\
bench: 1
name: small
instruments:
  coil_supply.x:
    driver: kepco-bop-36-12
    settings: {coil_constant: 0.3 mT/A}
    limits: {current: 8 A, voltage: 30 V, slew: 2 A/s, zero_current: 20 mA}
  gaussmeter: {driver: lakeshore-f71}
  interlock_chain: {driver: interlock-chain-line}
safe_state: []
interlocks:
"""
LINE = HEAD.count("\n") + 1


def faults_of(entry: str, *more: str) -> list[str]:
    with pytest.raises(FaultList) as raised:
        bench_from(HEAD + "".join(f"  - {one}\n" for one in (entry, *more)))
    return [str(one).removeprefix("bench.yaml:") for one in raised.value.faults]


def when(condition: str) -> str:
    return f"{{name: a, when: {condition}}}"


LEVEL = "{instrument: coil_supply.x, quantity: current, above: 8 A}"
WRONG = {
    when("{instrument: coil_suply.x, quantity: current, above: 8 A}"): (
        "this bench has no instrument 'coil_suply.x'; did you mean 'coil_supply.x'"
    ),
    when("{instrument: digitizer, quantity: voltage, above: 8 V}"): (
        "this bench has no instrument 'digitizer'; it has coil_supply.x, gaussmeter, "
        "interlock_chain"
    ),
    when("{instrument: coil_supply.x, quantity: curent, above: 8 A}"): (
        "'curent' is no quantity of a coil_supply; did you mean 'current'"
    ),
    when("{instrument: coil_supply.x, quantity: current, above: 8 mT}"): (
        "'8 mT' is a magnetic field, expected a current such as"
    ),
    when("{instrument: coil_supply.x, quantity: current, above: 8}"): "8 has no unit",
    when("{instrument: coil_supply.x, quantity: current, above: -8 A}"): (
        "means the magnitude and cannot be negative"
    ),
    when("{instrument: coil_supply.x, quantity: current, equals: 8 A}"): "is for states; write",
    when("{instrument: coil_supply.x, quantity: current, outside: 8 A}"): "must be two values",
    when("{instrument: coil_supply.x, quantity: current, outside: [8 A, 2 A]}"): (
        "must begin with the lower value"
    ),
    when("{instrument: coil_supply.x, quantity: current}"): (
        "needs an instrument, a quantity, and above, below, outside or equals"
    ),
    when("{instrument: coil_supply.x, quantity: current, above: 8 A, below: 1 A}"): (
        "has above, below; keep one, or stack them with any"
    ),
    when("{instrument: interlock_chain, quantity: chain, above: 1 A}"): "is for numbers; this is",
    when("{instrument: interlock_chain, quantity: chain, equals: closd}"): "did you mean 'closed'",
    when("{any: []}"): "must be a list of at least one condition",
    when(f"{{any: [{LEVEL}], all: [{LEVEL}]}}"): "'any' stands alone; take the other keys out",
    when(f"{{not: [{LEVEL}]}}"): "must be a mapping, such as",
    when("{al: []}"): "is not a key of a condition; did you mean 'all'",
    "{name: a}": "when: is missing",
    f"{{name: A b, when: {LEVEL}}}": "interlocks[1].name",
    f"{{name: a, when: {LEVEL}, grace: -1 s}}": "must be at least 0",
    f"{{name: a, when: {LEVEL}, period: 0 s}}": "must be above 0",
}


@pytest.mark.parametrize("entry", WRONG)
def test_a_wrong_interlock_is_one_fault_with_its_place(entry: str) -> None:
    (fault,) = faults_of(entry)
    assert WRONG[entry] in fault
    assert fault.startswith(f"{LINE}:"), fault


def test_the_place_is_that_of_the_innermost_value() -> None:
    wrong = "{instrument: gaussmeter, quantity: field, above: 3 A}"
    entry = when(f"{{any: [{LEVEL}, {{not: {wrong}}}]}}")
    (fault,) = faults_of(entry)
    line = f"  - {entry}"
    assert fault.startswith(f"{LINE}:{line.index('3 A') + 1}: interlocks[1].when.any[2].not.above:")


def test_every_interlock_is_looked_at() -> None:
    names = f"{{name: a, when: {LEVEL}}}"
    found = faults_of(names, names, when("{instrument: gaussmeter, quantity: field}"))
    assert len(found) == 3
    assert "'a' was named before; choose another" in found[0]
    assert found[0].startswith(f"{LINE + 1}:")
    assert found[2].startswith(f"{LINE + 2}:")


def test_conditions_are_stacked_as_they_stand() -> None:
    level = {"instrument": "gaussmeter", "quantity": "field", "above": "0.4 mT"}
    chain = {"instrument": CHAIN, "quantity": "chain", "equals": "closed"}
    warm = {
        "instrument": "gyro_acquisition",
        "quantity": "temperature",
        "outside": ["278.15 K", "60 degC"],
    }
    one = {
        "name": "stack",
        "when": {"any": [level, {"all": [{"not": chain}, warm]}]},
        "grace": "500 ms",
        "period": "3 s",
    }
    (found,) = bench_with([one]).interlocks
    assert found.when == AnyOf(
        (
            Level("gaussmeter", "field", "mT", high=0.4, magnitude=True),
            AllOf(
                (
                    Not(State(CHAIN, "chain", "closed")),
                    Level("gyro_acquisition", "temperature", "degC", low=5.0, high=60.0),
                )
            ),
        )
    )
    assert (found.grace_s, found.period_s) == (0.5, 3.0)
    assert found.instruments == {"gaussmeter", CHAIN, "gyro_acquisition"}


def test_periods_follow_the_quantity_unless_they_are_given() -> None:
    periods = {one.name: one.period_s for one in bench_with().interlocks}
    assert periods["coil-x-current"] == 0.2
    assert periods["gyro-temperature"] == 10.0
    assert periods["chain"] == 1.0


def test_a_chain_is_an_interlock_whether_it_is_written_or_not() -> None:
    (chain,) = bench_with([]).interlocks
    assert chain.when == State(CHAIN, "chain", "open")
    assert chain.grace_s == 0.0
    assert not [one for one in bench_with(chain=False).interlocks if CHAIN in one.instruments]


def test_a_run_watches_what_looks_at_its_instruments_and_the_chain() -> None:
    interlocks = bench_with().interlocks
    names = [one.name for one in watched_in_a_run(interlocks, ["coil_supply.y", "gaussmeter"])]
    assert names == ["chain", "coil-y-current", "coil-y-voltage", "field"]


def test_the_shipped_bench_has_an_interlock_on_every_coil() -> None:
    coils = {name for name in SHIPPED["instruments"] if name.startswith("coil_supply")}
    watched = {name for one in bench_with().interlocks for name in one.instruments}
    assert coils <= watched
