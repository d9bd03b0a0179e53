"""L1, L2: each instrument's line: identity, latency, answers that do not come, a pulled cable."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field

from station import registry
from station.errors import InstrumentError
from station.fields import StrictModel
from station.findings import Analysis, Estimate, Flag, InputQuantity
from station.instruments.commissioned import TriedCommand
from station.method.duration import on_the_way
from station.method.run import Run
from station.procedure import Prompt, RecordUse, Step
from station.roles import Driver, Instrument, KeepsErrors
from station.roles.base import ANSWER_TIME, ARRIVAL, MAX_DEADLINE_S

from .part import Figure, Part, ask_at_rest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

LineName = Literal[
    "coil_supply.x",
    "coil_supply.y",
    "coil_supply.z",
    "coil_supply.dc",
    "gaussmeter",
    "multimeter",
    "thermometer",
    "rotary_stage",
    "turntable",
    "thermal_chamber",
    "signal_generator.xy",
    "signal_generator.z_gradient",
    "pump_laser",
    "cell_heater",
    "dut_power",
]
"""Instruments that answer one question at a time; those that stream have their own line checks."""
LINES: tuple[LineName, ...] = get_args(LineName)
LATENCY = Figure("line_latency", "ms", LINES)
SLOWEST = Figure("line_latency_p99", "ms", LINES, limit=250.0)
"""Half of the 0.5 s that an exchange may take: more of that and interlocks, which look every
0.2 s, look too late."""
LONGEST = Figure("longest_answer", "ms", LINES)
JITTER = Figure("line_jitter", "ms", LINES)
LOST = Figure("line_errors", axes=LINES, limit=0.0)
"""A sound line loses no answer of fifty."""
KEPT = Figure("kept_errors", axes=LINES)
NEAR = 0.5
"""The share of its deadline from which an answer is near it: another day may take twice as long."""
MEDIAN, P99 = 0.5, 0.99
QUERY_S = 0.05
BACK_S = 5.0
"""A line that was disconnected may need so long; what a person does takes no bench time."""
SOURCE = "lines"
TRIED = "tried"
"""Detail of a unit: what came of each question that the driver's table does not confirm."""
BEFORE, SINCE = "errors_before", "errors_since"
"""Details of a unit: errors that the instrument kept before and since it is asked, if it can."""
COLUMNS = {
    "latency_s": "s from the question for the identity to its answer, NaN where none came",
    "answered": "1 the identity came, 0 it did not",
    "same": "1 it is the identity of the run's beginning, 0 it is not",
}
TRIES, BETWEEN_S = 10, 1.0
"""A person plugs the cable in before the prompt is answered; a line may need some seconds more."""


class LineParameters(StrictModel):
    """What the engineer chooses. `disconnected` are those whose cable a person pulls and puts back.

    `queries` are asked of each instrument, for its identity.
    """

    instruments: Annotated[tuple[LineName, ...], Field(min_length=1)] = LINES
    queries: Annotated[int, Field(ge=20, le=10000)] = 50
    disconnected: tuple[LineName, ...] = ()


def line_unit(name: str) -> str:
    """Return the name of the unit of work that asks an instrument."""
    return f"line of {name}"


def return_unit(name: str) -> str:
    """Return the name of the unit of work that disconnects an instrument."""
    return f"return of {name}"


def ask(run: Run) -> None:
    """L1: each instrument is asked many times who it is, between two looks into its error queue."""
    parameters: LineParameters = run.parameters.lines
    for name in run.unfinished(parameters.instruments, line_unit):
        with run.unit(line_unit(name)) as details:
            act = partial(question, run, line_unit(name), run.role(name, Instrument), details)
            run.read(act, takes=on_the_way(QUERY_S * parameters.queries))


def come_back(run: Run) -> None:
    """L2: each chosen instrument is disconnected by hand, and answers again.

    Coils are off and axes at rest before the hand is asked for.
    """
    parameters: LineParameters = run.parameters.lines
    for name in run.unfinished(parameters.disconnected, return_unit, pauses=False):
        instrument = run.role(name, Instrument)
        known = run.read(instrument.identify)
        ask_at_rest(run, pull(name))
        with run.unit(return_unit(name)):
            act = partial(await_return, run, name, instrument, known)
            run.read(act, takes=on_the_way(BACK_S))


def pull(name: str) -> Prompt:
    """Return the request to disconnect an instrument and to connect it again."""
    text = f"Pull the data cable of {name}, wait for ten seconds and plug it in again."
    return Prompt("reconnect", text)


def question(run: Run, unit: str, instrument: Instrument, details: dict[str, Any]) -> None:
    """Ask an instrument who it is, and what errors it kept before and since; record the answers."""
    if isinstance(instrument, KeepsErrors):
        details[BEFORE] = instrument.take_errors()
    known = instrument.identify()
    _record(run, unit, [_one(run, instrument, known) for _ in range(run.parameters.lines.queries)])
    if isinstance(instrument, KeepsErrors):
        details[SINCE] = instrument.take_errors()
    if isinstance(instrument, Driver):
        details[TRIED] = [answer_to(instrument, asked) for asked in instrument.open_questions()]


def answer_to(instrument: Driver, asked: str) -> dict[str, Any]:
    """Return what came of a question that no document confirms: the answer, or the error."""
    try:
        answer, errors = instrument.ask_openly(asked), tuple[str, ...]()
        if isinstance(instrument, KeepsErrors):
            errors = tuple(instrument.take_errors())
    except InstrumentError as error:
        return {"command": asked, "answer": str(error), "confirmed": False}
    return {"command": asked, "answer": (errors or (answer,))[0], "confirmed": not errors}


def tried(folder: RunFolder) -> Iterator[TriedCommand]:
    """Yield what came of such questions in a run."""
    finished = folder.finished_units()
    for name in LINES:
        for answer in finished.get(line_unit(name), {}).get(TRIED, ()):
            yield TriedCommand(instrument=name, **answer)


def await_return(run: Run, name: str, instrument: Instrument, known: object) -> None:
    """Ask an instrument who it is until it answers, as often as that may take; record that."""
    rows: list[tuple[float, bool, bool]] = []
    for _ in range(TRIES):
        rows.append(_one(run, instrument, known))
        if rows[-1][1]:
            break
        run.wait(BETWEEN_S, f"{name} comes back")
    _record(run, return_unit(name), rows)


def _one(run: Run, instrument: Instrument, known: object) -> tuple[float, bool, bool]:
    """Return how long one question took in s, whether it was answered, and as before."""
    began_s = run.now_s
    try:
        who = instrument.identify()
    except InstrumentError:
        return float("nan"), False, False
    return run.now_s - began_s, True, who == known


def _record(run: Run, unit: str, rows: list[tuple[float, bool, bool]]) -> None:
    import numpy as np

    names = [(name, np.float64) for name in (*COLUMNS, ARRIVAL)]
    now_s = run.now_s
    run.keep_rows(SOURCE, unit, COLUMNS, np.array([(*row, now_s) for row in rows], dtype=names))


@dataclass(frozen=True)
class Answers:
    """Answers of one instrument, shape (n,): latency in s (NaN: none came), came, and as before."""

    latency_s: Array
    answered: NDArray[np.bool_]
    same: NDArray[np.bool_]


@dataclass(frozen=True)
class Kept:
    """Errors in an instrument's queue: from before it is asked anything, and since."""

    before: tuple[str, ...]
    since: tuple[str, ...]


@dataclass(frozen=True)
class AnswerTime:
    """How long an answer took, its deadline, and the most that a bench may give it, s."""

    message: str
    took_s: float
    deadline_s: float
    most_s: float

    @property
    def is_near(self) -> bool:
        """Whether the answer came near its deadline."""
        return self.took_s > NEAR * self.deadline_s

    @property
    def longer_s(self) -> float:
        """The deadline to write instead, tenths of a second, twice what the answer took."""
        return min(math.ceil(10.0 * self.took_s / NEAR) / 10.0, self.most_s)


@dataclass(frozen=True)
class LineDataset:
    """By instrument: its answers; those after its cable was pulled and plugged in; kept errors.

    `longest`: the answer of any part of the run that took the largest share of its deadline, where
    that was a tenth or more.
    """

    asked: Mapping[str, Answers]
    returned: Mapping[str, Answers] = field(default_factory=dict)
    kept: Mapping[str, Kept] = field(default_factory=dict)
    longest: Mapping[str, AnswerTime] = field(default_factory=dict)


def units(parameters: LineParameters) -> Iterator[str]:
    """Yield the units of work of a plan."""
    yield from map(line_unit, parameters.instruments)
    yield from map(return_unit, parameters.disconnected)


def dataset(folder: RunFolder, parameters: LineParameters, bench: Bench) -> LineDataset:
    """Return what came of the questions of a run."""
    details = {name: folder.finished_units()[line_unit(name)] for name in parameters.instruments}
    return LineDataset(
        {name: answers(folder, line_unit(name)) for name in parameters.instruments},
        {name: answers(folder, return_unit(name)) for name in parameters.disconnected},
        {
            name: Kept(tuple(errors[BEFORE]), tuple(errors[SINCE]))
            for name, errors in details.items()
            if BEFORE in errors
        },
        longest(folder),
    )


def longest(folder: RunFolder) -> dict[str, AnswerTime]:
    """Return by instrument the last answer time that was noted: of the largest share."""
    return {
        str(event.details["instrument"]): AnswerTime(
            str(event.details["message"]),
            float(event.details["took_s"]),
            float(event.details["deadline_s"]),
            MAX_DEADLINE_S,
        )
        for event in folder.events_of(ANSWER_TIME)
    }


def answers(folder: RunFolder, unit: str) -> Answers:
    """Return what came of the questions of a unit of work."""
    rows = folder.rows(SOURCE, unit)
    return Answers(rows["latency_s"], rows["answered"] > 0, rows["same"] > 0)


def analyse(data: LineDataset, inputs: Sequence[InputQuantity] = ()) -> Analysis:
    """Return latency, lost answers and kept errors by instrument, and causes."""
    estimates: list[Estimate] = []
    flags: list[Flag] = []
    for name, answers in data.asked.items():
        came_s = answers.latency_s[answers.answered]
        estimates += [
            quantile(LATENCY, name, came_s, MEDIAN),
            quantile(SLOWEST, name, came_s, P99),
            longest_answer(name, came_s, data.longest.get(name)),
            jitter(name, came_s),
            LOST.measured(float((~answers.same).sum()), 0.0, "answers counted", name),
        ]
        flags += _causes(name, answers, estimates[-4].value, data.longest.get(name))
    for name, errors in data.kept.items():
        count = float(len(errors.before) + len(errors.since))
        estimates.append(KEPT.measured(count, 0.0, "errors counted", name))
        flags += _kept_causes(name, errors)
    for name, answers in data.returned.items():
        if not answers.same[-1]:
            message = (
                f"{name} does not answer as itself after its cable was pulled and plugged in "
                "again: look at the plug, or switch it off and on; a run that loses it must be "
                "started again."
            )
            flags.append(Flag("line-does-not-return", message, name))
    return Analysis(estimates, (), tuple(flags))


def quantile(figure: Figure, axis: str, latency_s: Array, share: float) -> Estimate:
    """Return a quantile of latencies in ms; its uncertainty is that of its rank, binomial."""
    import numpy as np

    if not len(latency_s):
        return figure.undetermined("no answer came", axis)
    rank_u = math.sqrt(share * (1.0 - share) / len(latency_s))
    around = (max(share - rank_u, 0.0), share, min(share + rank_u, 1.0))
    low, value, high = 1e3 * np.quantile(latency_s, around)
    method = f"quantile {share:g} of the latencies"
    return figure.measured(float(value), float(high - low) / 2.0, method, axis)


def longest_answer(axis: str, latency_s: Array, longest: AnswerTime | None) -> Estimate:
    """Return the largest answer time in ms, of an identity or of what took longer."""
    took_s = [*latency_s, *([longest.took_s] if longest else [])]
    if not took_s:
        return LONGEST.undetermined("no answer came", axis)
    return LONGEST.measured(1e3 * float(max(took_s)), 0.0, "largest of the run", axis)


def jitter(axis: str, latency_s: Array) -> Estimate:
    """Return the standard deviation of latencies in ms, with that of normal ones as its own."""
    import numpy as np

    freedom = len(latency_s) - 1
    if freedom < 1:
        return JITTER.undetermined("fewer than two answers came", axis)
    value = 1e3 * float(np.std(latency_s, ddof=1))
    u, method = value / math.sqrt(2.0 * freedom), "standard deviation of the latencies"
    return JITTER.measured(value, u, method, axis, float(freedom))


def _causes(
    name: str, answers: Answers, slowest_ms: float | None, longest: AnswerTime | None
) -> Iterator[Flag]:
    lost, others = int((~answers.answered).sum()), int((answers.answered & ~answers.same).sum())
    if lost:
        message = (
            f"{name} leaves {lost} of {len(answers.answered)} questions without a whole answer: "
            "check cable, connectors and bit rate, and that nobody else talks to it."
        )
        yield Flag("line-loses-answers", message, name)
    if others:
        message = (
            f"{name} answers {others} of {len(answers.answered)} questions as another instrument: "
            "two units share its address, or the line is out of step."
        )
        yield Flag("line-identity-changes", message, name)
    if longest is not None and longest.is_near:
        message = (
            f"{name} answers {longest.message} after {longest.took_s:.2f} s, near its deadline of "
            f"{longest.deadline_s:g} s: an answer that comes later ends a run. Look at the "
            "adapter's latency and at what else loads the line; where the instrument itself takes "
            f"so long, write `deadline: {longest.longer_s:g} s` at it in the bench file."
        )
        yield Flag("line-slow", message, name)
    elif slowest_ms is not None and SLOWEST.is_off(slowest_ms, 0.0):
        message = (
            f"The line of {name} takes {slowest_ms:.0f} ms for its slowest answers (99th "
            f"percentile), more than {SLOWEST.limit:.0f} ms: an interlock would look too late. "
            "Look at the adapter's latency and at what else loads the line."
        )
        yield Flag("line-slow", message, name)


def _kept_causes(name: str, errors: Kept) -> Iterator[Flag]:
    if errors.before:
        message = (
            f"{name} keeps {len(errors.before)} errors from before the run, the oldest "
            f"{errors.before[0]}; its queue is empty now. Find out who used it last, and run again."
        )
        yield Flag("error-queue-not-empty", message, name)
    if errors.since:
        message = (
            f"{name} reports {len(errors.since)} errors though it is only asked who it is, the "
            f"oldest {errors.since[0]}: nobody else may talk to it, and its line may not disturb "
            "what is sent."
        )
        yield Flag("error-while-asked", message, name)


def asked_on(bench: Bench) -> tuple[LineName, ...]:
    """Return the instruments of a bench whose lines are asked."""
    return tuple(name for name in LINES if name in bench.instruments and has_line(bench, name))


def has_line(bench: Bench, name: str) -> bool:
    """Return whether an instrument is asked over a line, and is no person at a switch."""
    driver = bench.instruments[name].driver
    if registry.why_not(registry.DRIVERS, driver):
        return True
    loaded = registry.load(registry.DRIVERS, driver)
    return bool(loaded.quantities) or not getattr(loaded, "prompts", None)


def fits(bench: Bench) -> Iterator[str]:
    """Yield which instruments of a bench are asked; of a real one a person pulls each cable."""
    asked = ", ".join(asked_on(bench))
    yield f"parameters.lines.instruments=[{asked}]"
    if bench.simulation is None:
        yield f"parameters.lines.disconnected=[{asked}]"


def not_tried(parameters: LineParameters) -> Mapping[str, str]:
    """Return why no cable is pulled."""
    if parameters.disconnected:
        return {}
    return {
        "L2": "no line was disconnected by hand: name some in parameters.lines.disconnected, such "
        "as [gaussmeter]"
    }


def measured_axes(parameters: LineParameters) -> Mapping[str, tuple[str, ...]]:
    """Return the instruments that a plan asks, for each figure."""
    return dict.fromkeys(PART.results, parameters.instruments)


def records_of_asked(names: Iterable[str], bench: Bench) -> Iterator[RecordUse]:
    """Yield that nothing is missing of the records of instruments that are asked who they are.

    No reading of theirs is taken, so that no figure depends on what their records state.
    """
    for name in names:
        for _, quantity in bench.statements(name):
            yield RecordUse(name, quantity, 0.0, "1", needed=False)


PART = Part(
    name="lines",
    steps=(
        Step("L1", "Lines: identity, latency, answers that do not come", ask),
        Step("L2", "Lines: disconnected by hand, and back", come_back),
    ),
    figures=(LATENCY, SLOWEST, LONGEST, JITTER, LOST, KEPT),
    needs=(),
    has=lambda bench: bool(asked_on(bench)),
    units=units,
    dataset=dataset,
    analyse=analyse,
    fits=fits,
    measured_axes=measured_axes,
    touches=False,
    not_tried=not_tried,
    short=("parameters.lines.queries=20", "parameters.lines.disconnected=[]"),
)
