"""What is checked against the limits of the bench is what a run sends, and nothing else."""

from __future__ import annotations

import ast
import math
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from places import ROOT
from short_forms import SHORT_FORMS
from tiers import quick

from drivers.transport.ports import SocketPort
from station import registry
from station.errors import InputError
from station.files.lookup import BENCHES, PLANS, find
from station.files.plan import read_plan
from station.instruments.bench import Bench, read_bench
from station.method.cell_commands import CellField
from station.method.commands import Power, SineField, SteadyField
from station.method.duration import NO_TIME, Duration
from station.method.run import Run
from station.method.set_points import Bounded, Command, Envelope, SetPoint
from station.procedure import Procedures, Step, procedure_of
from station.record.folder import RunFolder
from station.roles import GyroAcquisition
from station.runner.execute import Request, execute
from station.runner.run import ActingRun
from station.runner.static_limits import problems_of_plan

DECLARING = [name for name in Procedures() if procedure_of(name).steps]
ENERGISING = {
    *("load_sine", "start_sine", "ramp_to", "switch_on", "move_to", "turn", "set_temperature"),
    *("prepare_step",),
}
"""Verbs of roles that set a current, a field, a temperature or a motion."""
SUPPLY = "coil_supply.x"


ON_THE_WIRE = {
    r"(?:^|:)(?:LIST:)?CURR ([-+\d.,E]+)": "current_A",
    r"SOUR\d:VOLT:OFFS ([-+\d.E]+)": "voltage_V",
    r":Demand:Rate \d,([-+\d.E]+)": "rate_deg_per_s",
    r":Demand:Position \d,([-+\d.E]+)": "angle_deg",
}
"""What sets a quantity, as supplies, generators and tables are told it on their lines."""
RESOLUTION = 2e-4
"""In A, V, deg and deg/s: the last digit that is sent, twice."""


def on_the_wire(folder: Path) -> dict[tuple[str, str], list[float]]:
    """Return what a traced run sent, by instrument and quantity; magnitudes but for angles."""
    found: dict[tuple[str, str], list[float]] = {}
    for path in sorted(folder.glob("*.txt")):
        for line in path.read_text(encoding="utf-8").splitlines():
            for pattern, quantity in ON_THE_WIRE.items():
                for given in re.findall(pattern, line[16:]) if line[14:15] == ">" else ():
                    values = [float(one) for one in given.split(",")]
                    sized = values if quantity == "angle_deg" else [abs(one) for one in values]
                    found.setdefault((path.stem, quantity), []).extend(sized)
    return found


def bench() -> Bench:
    return read_bench(find(BENCHES, "sim"), registry.names(registry.DRIVERS))


def plans_that_declare() -> list[str]:
    return [
        name
        for name in SHORT_FORMS
        if read_plan(find(PLANS, name), Procedures()).procedure in DECLARING
    ]


@pytest.mark.parametrize(
    "name",
    quick(
        plans_that_declare(),
        "rlg-magnetic-sensitivity",
        "accelerometer-magnetic-sensitivity",
        "gyro-static-noise",
    ),
)
def test_a_run_sends_what_its_procedure_declares_in_order_and_nothing_beyond(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[Command[Any]] = []
    apply = ActingRun.apply

    def noted(run: ActingRun, command: Command[Any], takes: Duration = NO_TIME) -> Any:
        sent.append(command)
        return apply(run, command, takes)

    monkeypatch.setattr(ActingRun, "apply", noted)
    plan = read_plan(find(PLANS, name), Procedures(), SHORT_FORMS[name])
    outcome = execute(Request(plan, bench(), tmp_path, quiet=True, report=False, trace=True))
    assert outcome.exit_code == 0, outcome.error
    procedure = procedure_of(plan.procedure)
    walk = procedure.walk(plan.parameters)
    declared = [command for command in walk.commands if not isinstance(command, Bounded)]
    left = iter(sent)
    assert all(command in left for command in declared)
    beside = [command for command in sent if command not in declared]
    envelope = Envelope.of(walk.set_points(bench()))
    for command in beside:  # such as the alternating field that degausses a coil
        envelope.require(command, bench())
    for (instrument, quantity), values in on_the_wire(outcome.folder / "trace").items():
        low, high = envelope.ranges[instrument][quantity]
        assert low - RESOLUTION <= min(values) <= max(values) <= high + RESOLUTION, instrument
        if quantity == "current_A":
            assert max(values) == pytest.approx(high, abs=RESOLUTION), instrument
    folder = RunFolder(outcome.folder)
    finished = set(folder.finished_units())
    assert finished >= set(walk.units)
    if all(act.unit in walk.units for act in walk.acts if act.repeats):  # else data decide them
        assert finished == set(walk.units)
    held = procedure.forecast(plan.parameters, bench()).set_points
    currents_A = {one.current_A for one in held if one.current_A is not None}
    driven = [event for event in folder.events if "amplitude_A" in event.details]
    assert {event.details["amplitude_A"] for event in driven} <= currents_A


@pytest.mark.parametrize("name", DECLARING)
def test_no_step_of_a_procedure_that_declares_energises_by_itself(name: str) -> None:
    module = sys.modules[procedure_of(name).parameters.__module__]
    for path in Path(str(module.__file__)).parent.glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        applied = {id(node) for command in commands(tree) for node in ast.walk(command)}
        for node in ast.walk(tree):
            if id(node) in applied:
                continue
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                assert node.func.attr not in ENERGISING, f"{path.name}:{node.lineno}"


def commands(tree: ast.Module) -> Iterator[ast.ClassDef]:
    """Yield the commands that a file declares, whose `apply` is what energises."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and any(
            ast.unparse(base).startswith("Command[") for base in node.bases
        ):
            yield node


@pytest.mark.campaign
def test_a_field_goes_from_the_plan_to_the_wire_by_the_files_that_the_architecture_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = page.split("## A field, from the plan to the wire")[1].split("\n## ")[0]
    said = re.findall(r"^\| `(\S+)` \|", section, re.MULTILINE)
    assert len(said) <= 10
    ways: list[list[str]] = []
    write = SocketPort.write

    def noted(port: SocketPort, data: bytes) -> None:
        frames = [Path(frame.filename) for frame in traceback.extract_stack()]
        own = [one.relative_to(ROOT).as_posix() for one in frames if one.is_relative_to(ROOT)]
        if said[2] in own and data.startswith(b"CURR "):
            ways.append(list(dict.fromkeys(own[own.index(said[2]) :])))
        write(port, data)

    monkeypatch.setattr(SocketPort, "write", noted)
    name = "accelerometer-magnetic-sensitivity"
    plan = read_plan(find(PLANS, name), Procedures(), SHORT_FORMS[name])
    assert execute(Request(plan, bench(), tmp_path, quiet=True, report=False)).exit_code == 0
    this = Path(__file__).relative_to(ROOT).as_posix()
    assert {tuple(one for one in way if one != this) for way in ways} == {tuple(said[2:-1])}
    assert SocketPort.__module__.replace(".", "/") + ".py" == said[-1]


class Watched:
    """A run of no plan: whatever is asked of its instruments is an error."""

    def __init__(self, declared: list[Command[Any]]) -> None:
        self.bench = bench()
        self.envelope = Envelope.of([one.set_point("S1", self.bench) for one in declared])
        self._prepared: dict[Command[Any], Any] = {}

    def role(self, name: str, kind: type[Any]) -> Any:
        raise AssertionError(f"{name} was asked as a {kind.__name__}")

    prepare, apply = ActingRun.prepare, ActingRun.apply


@pytest.mark.parametrize(
    ("declared", "sent"),
    [
        ([SineField(SUPPLY, 0.1, 1.0)], SineField(SUPPLY, 0.1, 1.001)),
        ([SineField(SUPPLY, 0.1, 1.0)], SteadyField(SUPPLY, -1.1)),
        ([SineField("coil_supply.y", 0.1, 1.0)], SineField(SUPPLY, 0.1, 1.0)),
        ([Power("dut_power", True)], SineField(SUPPLY, 0.1, 1.0)),
        ([Bounded(SUPPLY, "nulling", within={"field_mT": 2.0})], SineField(SUPPLY, 0.1, 1.0)),
    ],
)
def test_a_command_beyond_the_declaration_is_refused_before_anything_is_sent(
    declared: list[Command[Any]], sent: Command[Any]
) -> None:
    with pytest.raises(InputError, match=r"coil_supply\.x: .* its dry run saw"):
        Watched(declared).apply(sent)  # type: ignore[misc, arg-type]


def test_an_instrument_of_which_no_command_was_seen_is_not_even_switched_on() -> None:
    declared = Envelope.of([SineField(SUPPLY, 0.1, 1.0).set_point("S1", bench())])
    with pytest.raises(InputError, match=r"dut_power: .* saw no command of this instrument"):
        declared.require(Power("dut_power", True), bench())


def test_what_is_within_the_bounds_of_an_act_that_depends_on_data_is_sent() -> None:
    bounds = Bounded(SUPPLY, "nulling", within={"field_mT": 2.0, "current_A": 8.0})
    declared = Envelope.of([bounds.set_point("S1", bench())])
    for field_mT in (-2.0, 0.0, 2.0):
        declared.require(SteadyField(SUPPLY, field_mT), bench())
    with pytest.raises(InputError):
        declared.require(SteadyField(SUPPLY, -2.01), bench())


@pytest.mark.parametrize("first", [5.0, -5.0])
def test_what_is_bounded_in_magnitude_may_have_either_sign(first: float) -> None:
    declared = Envelope.of([SetPoint("S1", SUPPLY, "", voltage_V=one) for one in (first, -first)])
    for voltage_V in (-5.0, 5.0):
        declared.require(Bounded(SUPPLY, "", within={"voltage_V": voltage_V}), bench())
        with pytest.raises(InputError):
            beyond = Bounded(SUPPLY, "", within={"voltage_V": 1.1 * voltage_V})
            declared.require(beyond, bench())


@pytest.mark.parametrize("first", [60.0, -40.0])
def test_a_signed_limit_of_a_role_of_its_own_has_two_ends(first: float) -> None:
    def point(value: float) -> SetPoint:
        return SetPoint("S1", SUPPLY, "", limited={"temperature_high": value})

    def command(value: float) -> Bounded:
        return Bounded(SUPPLY, "", within={"limited": {"temperature_high": value}})

    both = Envelope.of([point(first), point(20.0 - first)])
    for value in (-40.0, 60.0):
        both.require(command(value), bench())
        with pytest.raises(InputError):
            Envelope.of([point(-value)]).require(command(value), bench())


def test_a_field_at_a_cell_that_is_no_number_is_refused() -> None:
    coil = ("signal_generator.xy", 1, "x")
    with pytest.raises(InputError, match="its dry run saw"):
        Watched([CellField(*coil, 50.0)]).apply(CellField(*coil, math.nan))  # type: ignore[misc, arg-type]


def test_fields_that_follow_each_other_are_one_set_point_with_the_largest_current() -> None:
    fields = [SteadyField(SUPPLY, field_mT, rms_mT=1.0) for field_mT in (0.5, -1.5, 1.0)]
    (point,) = SteadyField.declare("S1", fields, bench())
    assert point == SetPoint(
        "S1",
        SUPPLY,
        "0.5, -1.5, 1 mT, up to 5 A",
        field_mT=1.5,
        current_A=pytest.approx(5.0),
        rms_current_A=pytest.approx(1.0 / 0.3),
    )


def test_the_field_that_degausses_a_coil_is_checked_where_no_point_goes_as_far() -> None:
    name = "accelerometer-magnetic-sensitivity"
    small = ["parameters.fields=[0 mT, 1 mT]", "parameters.field_step=null"]
    for largest, degauss, faults in (("50 mT", "true", 0), ("60 mT", "true", 2), ("60 mT", "", 0)):
        changes = [*small, f"parameters.largest_field={largest}"]
        changes.append(f"parameters.degauss={degauss or 'false'}")
        plan = read_plan(find(PLANS, name), Procedures(), changes)
        procedure = procedure_of(name)
        found = list(problems_of_plan(procedure, plan.parameters, bench()))
        assert len([one for one in found if "60 mT" in one.what]) == faults, found


def asks_the_board(run: Run) -> None:
    if run.role("gyro_acquisition", GyroAcquisition).drain():
        run.say("never said")


def looks_at_the_bench(run: Run) -> None:
    run.say(run.bench.name)


def looks_at_the_record(run: Run) -> None:
    run.say(str(run.read_back().path))


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        (asks_the_board, r"step S1: a dry run cannot know `gyro_acquisition.drain\(\)`"),
        (looks_at_the_bench, "step S1: a dry run has no bench; put what needs it behind `run.read"),
        (looks_at_the_record, "step S1: a dry run has no record"),
    ],
)
def test_a_step_that_needs_an_instrument_where_none_is_says_what_to_write(
    body: Callable[[Run], None], sentence: str
) -> None:
    procedure = procedure_of("gyro-rate-table")
    plan = read_plan(find(PLANS, procedure.name), Procedures())
    wrong = replace(procedure, steps=(Step("S1", "", body),))
    with pytest.raises(InputError, match=sentence):
        wrong.walk(plan.parameters)


def test_the_bounds_of_an_act_that_depends_on_data_are_no_command_themselves() -> None:
    nobody: Any = None
    with pytest.raises(InputError, match="`null the field` declares how far a step may go"):
        Bounded("coil_supply.x", "null the field").apply(nobody, None)
