"""Every driver against every fault of its wire, over its simulator's real line on virtual time.

What each owes when nobody, or another, answers the question who is there, the conformance tests
ask of every driver (`tests/station/instruments/test_conformance.py`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from fixture import taken
from our_drivers import CASES, bench_data, bench_for, driver_of, name_of, stood, world_of
from wires import HANG_UP, Acts, Pause, Replay, no_thread_left

from sim_instruments.bench import SimulatedBench
from sim_instruments.faults.catalogue import wire_faults
from sim_instruments.faults.wire import CAN, FRAMES, MODBUS_TCP
from sim_instruments.truth import SimulationError
from station import registry
from station.clock import RealClock, VirtualClock
from station.conformance.faulty_server import moved_to
from station.conformance.fixture import Fixture
from station.errors import InstrumentError
from station.instruments.opening import InstrumentPlace
from station.roles.base import EXCHANGE_DEADLINE_S
from station.roles.role import role

LATE_S = 0.01
SETTLES_S = 3.0
SILENT = r"no \w+ came within [\d.]+ s"
TWO_ANSWERS = "more than one answer|more came behind"
ANOTHERS = "came back|RDGMODE. answers|is no reading"
BROKEN = "the line broke"


@dataclass(frozen=True)
class Fault:
    """What one fault of the wire is to the simulators, and what an error of it states.

    Where it only breaks the line or `doubles` an answer, a question that does no harm is asked
    again; where the answer is whole and `foreign`, it is not. What comes `later` is met by the next
    message alone, which may be in doubt then; what comes `ahead` may pass for the answer.
    """

    states: str
    options: Mapping[str, Any] = field(default_factory=dict)
    doubles: bool = False
    foreign: bool = False
    later: bool = False
    ahead: bool = False


def stray(where: str) -> Mapping[str, Any]:
    return {"fault": "stray-line", "where": where}


FAULTS: Mapping[str, Fault] = {
    "no-reply": Fault(SILENT),
    "lost-command": Fault(SILENT),
    "lost-frame": Fault(SILENT),
    "late": Fault(SILENT),
    "partial": Fault(f"without the end|no whole answer|none of its messages|{SILENT}"),
    "garbled": Fault(f"no text|wrong check sum|does not begin|{SILENT}"),
    "wrong-crc": Fault(f"wrong check sum|{SILENT}"),
    "wrong-terminator": Fault("without the end of an answer"),
    "previous-reply": Fault(f"{ANOTHERS}|to another request|{SILENT}", foreign=True),
    "nan": Fault("NaN"),
    "flood": Fault(r"more than \d+ bytes came without the end", {"bytes": 2_000_000}),
    "dropped-connection": Fault(BROKEN, doubles=True),
    "reset": Fault(BROKEN, doubles=True),
    "stray line ahead": Fault(f"{ANOTHERS}|only .* came|reads", stray("ahead"), ahead=True),
    "stray line before": Fault(f"{TWO_ANSWERS}|came back", stray("before"), doubles=True),
    "stray line behind": Fault(TWO_ANSWERS, stray("behind"), doubles=True),
    "stray line after": Fault(TWO_ANSWERS, stray("after"), later=True),
    "duplicate-reply": Fault(TWO_ANSWERS, doubles=True),
    "duplicate-reply later": Fault(
        TWO_ANSWERS, {"fault": "duplicate-reply", "delay": "1 ms"}, later=True
    ),
}


def options_of(fault: str) -> dict[str, Any]:
    return {"fault": fault, **FAULTS[fault].options}


def line_of(case_name: str) -> str:
    """Return the protocol of a case's line; empty where it has none of its own."""
    driver = driver_of(case_name)
    has_line = driver in registry.names(registry.SIMULATORS)
    return str(registry.load(registry.SIMULATORS, driver).protocol) if has_line else ""


LINES = {name: line for name in CASES if (line := line_of(name))}
MET = [
    pytest.param(name, fault, id=f"{name}-{fault}")
    for name, line in LINES.items()
    for fault in FAULTS
    if options_of(fault)["fault"] in wire_faults(line)
    and fault not in CASES[name].untouched
    # A frame on a CAN bus has the bus's own check sum.
    and not (fault == "garbled" and line in CAN)
]


def test_every_driver_and_every_fault_of_a_wire_is_here() -> None:
    ours = {
        name
        for name in registry.names(registry.DRIVERS)
        if registry.load(registry.DRIVERS, name).__module__.startswith("drivers.")
    }
    assert set(map(driver_of, CASES)) == ours
    kinds = {options_of(fault)["fault"] for fault in FAULTS}
    assert kinds == {kind for line in LINES.values() for kind in wire_faults(line)}


def clear(error: InstrumentError, name: str, states: str) -> bool:
    """Whether an error is one sentence: instrument, what was attempted, what came, what to do."""
    what, _, do_now = str(error).rpartition("; ")
    return (
        error.instrument == name
        and len(what.split(": ")) >= 3
        and bool(do_now.strip())
        and "\n" not in str(error)
        and re.search(states, what) is not None
    )


@pytest.mark.parametrize(("name", "fault"), MET)
def test_one_fault_is_borne_or_one_sentence_in_time_and_the_next_answers_are_right(
    name: str, fault: str
) -> None:
    case, of, streams = CASES[name], FAULTS[fault], LINES[name] in CAN | FRAMES
    with stood(name) as fixture:
        instrument = fixture.open()
        assert instrument.identify() == case.identity
        case.prepare(fixture, instrument)
        right = case.ask(fixture, instrument)
        if isinstance(right, float):
            right = pytest.approx(right, rel=0.2)
        instrument.identify()  # the answer before is none of this question
        meets = {"instrument": fixture.name, "command": case.command, "count": 1}
        fixture.simulation.inject({**meets, **options_of(fault)})
        fixture.heard.clear()
        again = of.doubles and not (case.asked_once or streams)
        borne = of.later or again or (case.patient and not of.foreign)
        borne = case.bears.get(fault, borne)
        answer, error = asked(lambda: case.ask(fixture, instrument))
        assert fixture.simulation._faults[fixture.name].all[-1].trigger.met == 1
        if error is not None:
            asked_s = max(time_s for time_s, way, _ in fixture.heard if way == ">")
            longest_s = max(EXCHANGE_DEADLINE_S, *instrument.deadlines.values(), 0.0)
            assert fixture.clock.now() - asked_s <= longest_s + LATE_S
            assert of.ahead or not borne
            assert clear(error, fixture.name, of.states), error
        else:
            assert of.ahead or (borne and answer == right)
        answers = []
        for _ in range(3):
            fixture.clock.sleep(SETTLES_S)  # what is late comes meanwhile, and is nobody's
            answers.append(asked(lambda: case.ask(fixture, instrument)))
        if streams and of.states == BROKEN:  # outputs are missing: it is started again by a person
            assert all(error is not None and BROKEN in str(error) for _, error in answers)
        else:
            # Of a frame that breaks off, or of two, the rest may spoil what comes next.
            doubtful = of.later or of.ahead or (streams and fault == "partial")
            first, *others = answers
            assert first[0] == right or (doubtful and first[1] is not None)
            assert [answer for answer, _ in others] == [right, right]
        instrument.close()
        instrument.close()


def asked(act: Callable[[], Any]) -> tuple[Any, InstrumentError | None]:
    """Return what an act brings: an answer, or an error of the instrument."""
    try:
        return act(), None
    except InstrumentError as error:
        return None, error


STREAMS = [name for name, line in LINES.items() if line in CAN | FRAMES]


LOSING = ("partial", "lost-frame", "no-reply", "garbled", "wrong-crc")
LOST = [
    (name, fault, nth)
    for name in STREAMS
    for fault in LOSING
    for nth in ((1, 2, 3, 4) if LINES[name] in CAN else (1,))  # an output has up to four messages
    if fault in wire_faults(LINES[name]) and not (fault == "garbled" and LINES[name] in CAN)
]
LOST.append(("kvh-1775", "previous-reply", 1))


@pytest.mark.parametrize(("name", "fault", "nth"), LOST)
def test_a_damaged_output_is_a_gap_or_an_error_and_never_a_sample(
    name: str, fault: str, nth: int
) -> None:
    with stood(name) as fixture:
        source = started(fixture)
        fixture.clock.sleep(2.0)
        before = source.drain()
        fixture.simulation.inject({"instrument": fixture.name, "fault": fault, "nth": nth})
        fixture.clock.sleep(2.0)
        block, error = asked(source.drain)
        if LINES[name] in CAN and fault == "partial":
            assert error is not None and clear(error, fixture.name, "is none of its messages")
        else:
            assert steps_of(before.columns, block.columns) == [1, 2]
        source.close()


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.parametrize("seconds", [3, 20, 40])
def test_a_silence_is_a_gap_as_long_as_it_was(name: str, seconds: int) -> None:
    """Also one that is longer than a round of a counter of seven or eight bits."""
    with stood(name) as fixture:
        silent = {"fault": "silent", "at": "10.05 s", "for": f"{seconds} s"}
        fixture.simulation.inject({"instrument": fixture.name, **silent})
        source = started(fixture)
        rows = taken(fixture, source, seconds + 20.0)
        assert steps_of(rows) == [1, 10 * seconds + 1]
        source.close()


def steps_of(*rows: Mapping[str, Any]) -> list[int]:
    """Return the steps that there are in the counter of rows that follow one another."""
    column = "counter" if "counter" in rows[0] else "sequence"
    numbers = np.concatenate([columns[column] for columns in rows]).astype(int)
    return sorted(set(np.diff(numbers).tolist()))


def started(fixture: Fixture) -> Any:
    """Return the source of samples, opened and started as its role does."""
    source, declared = fixture.open(), role(fixture.role)
    assert declared is not None and declared.start_samples is not None
    declared.start_samples(source)
    return source


@pytest.mark.parametrize("name", STREAMS)
def test_a_line_that_ends_under_a_stream_is_reported(name: str) -> None:
    with stood(name) as fixture:
        source = started(fixture)
        fixture.clock.sleep(4.0)
        assert len(source.drain())
        fixture.simulation.inject({"instrument": fixture.name, "fault": "port-gone"})
        fixture.clock.sleep(SETTLES_S)
        reported = (asked(source.drain)[1] for _ in range(50))  # a reader needs a moment
        error = next((error for error in reported if error is not None), None)
        assert error is not None and clear(error, fixture.name, BROKEN), error
        source.close()
        source.close()


# On real time, with the answers that the instrument gave to who it is.

REPLAYED = [name for name, line in LINES.items() if line not in CAN]


def recorded(name: str) -> tuple[dict[bytes, bytes], str]:
    """Return each request of an identity with its answer, and the address they went to."""
    with stood(name) as fixture:
        fixture.open().identify()
        answers: dict[bytes, bytes] = {}
        for _, way, data in fixture.heard:
            if way == ">":
                answers[request := data] = b""
            elif way == "<":
                answers[request] += data
        return answers, fixture.address


@contextmanager
def replayed(name: str, acts: Callable[[bytes], Acts]) -> Iterator[Any]:
    """Yield the driver of a case, with a wire in its instrument's place that plays its answers."""
    answers, address = recorded(name)
    entry = bench_for(name).instruments[name_of(name)]
    numbered = 2 if LINES[name] in MODBUS_TCP else 0
    with no_thread_left(), Replay(answers, acts, numbered) as wire:
        place = InstrumentPlace(
            name_of(name),
            str(moved_to(address, wire.port)),
            RealClock(),
            entry.settings,
            entry.limits,
        )
        instrument = registry.load(registry.DRIVERS, driver_of(name))(place)
        yield instrument
        assert wire.requests
        instrument.close()
        instrument.close()


def in_pieces(answer: bytes) -> Acts:
    cut = len(answer) // 2
    return (answer[:cut], Pause(0.01), answer[cut:-1], Pause(0.01), answer[-1:])


def ends_in_the_middle(answer: bytes) -> Acts:
    return (answer[: len(answer) // 2], HANG_UP)


@pytest.mark.parametrize("name", REPLAYED)
def test_an_answer_in_pieces_is_put_together(name: str) -> None:
    with replayed(name, in_pieces) as instrument:
        assert instrument.identify() == CASES[name].identity


@pytest.mark.parametrize("name", REPLAYED)
def test_a_line_that_ends_in_the_middle_of_an_answer_is_reported(name: str) -> None:
    with replayed(name, ends_in_the_middle) as instrument:
        with pytest.raises(InstrumentError) as raised:
            instrument.identify()
        assert clear(raised.value, name_of(name), BROKEN), raised.value


# Their simulators.

MAY_BE_MISSING = {"events", "door_input", "settings_protected", "gate_inverter"}
MAY_BE_MISSING |= {"axis_2", "axis_3", "angle_at_start"}
MAY_BE_MISSING |= {"acknowledges", "position", "unreferenced"}


def without(truth: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {kept: value for kept, value in truth.items() if kept != key}


@pytest.mark.parametrize("name", LINES)
def test_a_missing_truth_of_the_simulator_is_named(name: str) -> None:
    data, instrument = bench_data(name), name_of(name)
    entry = data["instruments"][instrument]
    truth = entry["simulator"]
    axis = truth.get("axis_1", {})
    lacking = {key: without(truth, key) for key in truth}
    lacking |= {key: {**truth, "axis_1": without(axis, key)} for key in axis}
    for key in lacking.keys() - MAY_BE_MISSING:
        wrong = {**data, "instruments": {instrument: {**entry, "simulator": lacking[key]}}}
        with pytest.raises(SimulationError, match=key):
            SimulatedBench(wrong, VirtualClock(), world_of(name)).close()
