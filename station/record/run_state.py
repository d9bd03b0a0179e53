"""What a run is doing, or did: one fold of its log, and of its guardian's.

Whoever asks how a run stands asks here: status, terminal, panel, abort, pause, resume, report. The
log's first event, `run-started`, says what the run is going to do. Nothing here opens a file or a
lock: whether a process holds the run's lock, and whether a guardian is at work, is handed in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from station.console import no_older
from station.record.events import (
    BENCH_READ,
    LEFT,
    RECORDED_LATER,
    RUN_STARTED,
    SAFE_STATE,
    Event,
    in_words,
    is_of_line,
)

PAUSED, WENT_ON = "paused", "went-on"
ENDS = ("failed", SAFE_STATE, "run-ended")
"""What ends a pause too: the run itself ends."""
MIN_UNITS = 3
LATEST_PART = 4
"""The pace is that of the latest quarter of the units: later ones may take longer than early."""

State = Literal["running", "paused", "evaluating", "finished", "failed", "interrupted"]
SENTENCES: dict[State, str] = {
    "running": "running",
    "paused": "paused between two units of work",
    "evaluating": "measured to its end, being evaluated",
    "finished": "finished",
    "failed": "ended before its end",
    "interrupted": "interrupted: its process is gone and did not end it",
}
GOES_ON = ("running", "paused", "evaluating")
UNKNOWN_END = "why it ended is unknown; its disk may be full: look at the bench"
"""Of a run whose log ends early and holds no `failed`."""


class FinishedUnit(NamedTuple):
    """A unit of work that is done: when, in s of work, and how long it was expected to take.

    Only the ratios of the expected times count; where none is foreseen, 1 for every unit.
    """

    at_s: float
    expected_s: float


def time_left_s(
    forecast_s: float, finished: Sequence[FinishedUnit], units_left_s: float, now_s: float
) -> float:
    """Return the expected bench time left in s.

    `forecast_s` is what the steps that are not done yet should take; `finished` are the units of
    work of this process in order, `units_left_s` what the others were expected to take in sum, and
    `now_s` the time now, in s of work from any instant. A bench that is slower than the forecast
    (instruments that answer late, time that goes faster than real time) shows in the pace; the
    further the run is, the more the pace counts.
    """
    done = len(finished)
    if done < MIN_UNITS or not units_left_s:
        return forecast_s
    first, *latest = finished[-max(MIN_UNITS, done // LATEST_PART) :]
    last = latest[-1]
    pace = (last.at_s - first.at_s) / sum(unit.expected_s for unit in latest)
    paced_s = max(units_left_s * pace - (now_s - last.at_s), 0.0)
    done_s = sum(unit.expected_s for unit in finished)
    share = done_s / (done_s + units_left_s)
    return share * paced_s + (1.0 - share) * forecast_s


@dataclass
class Process:
    """What one process of a run did: since the run began, or since it was last resumed."""

    first_event: int = 0
    step: str | None = None
    step_began_s: dict[str, float] = field(default_factory=dict)
    step_ended_s: dict[str, float] = field(default_factory=dict)
    units_finished: list[tuple[str, float]] = field(default_factory=list)
    """Each unit of work with the time of work, in s, at which it was finished."""
    open_prompts: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What waits for an answer, by id; `number` is which event of the process it is."""
    left_for_the_end: list[dict[str, Any]] = field(default_factory=list)
    failed: dict[str, Any] | None = None
    ended: dict[str, Any] | None = None
    paused_since_s: float | None = None
    pauses: list[tuple[float, float]] = field(default_factory=list)
    """Begin and end of each pause that is over, in s of run time."""
    recorded_later: list[Event] = field(default_factory=list)
    """What was done with the folder once the process had ended: revisions, signatures."""

    def paused_s(self, since_s: float, now_s: float) -> float:
        """Return how much of the run time from `since_s` to `now_s` was spent paused, in s."""
        spans = list(self.pauses)
        if self.paused_since_s is not None:
            spans.append((self.paused_since_s, now_s))
        return sum(max(min(end_s, now_s) - max(begin_s, since_s), 0.0) for begin_s, end_s in spans)

    def worked_s(self, now_s: float) -> float:
        """Return the run time less all pauses, in s."""
        return now_s - self.paused_s(float("-inf"), now_s)


class RunState:
    """How a run stands by its log; a live log is folded in as it grows, event by event."""

    def __init__(self, events: Iterable[Event] = (), of_guardian: Iterable[Event] = ()) -> None:
        self.planned: Mapping[str, Any] = {}
        """The details of `run-started`; nothing where the run never began."""
        self.began_s = 0.0
        """What the bench's clock was at when the run began: a served one goes on between runs."""
        self.last_s = 0.0
        self.step: Mapping[str, Any] = {}
        """The details of the step that began last; nothing before the first."""
        self.units: dict[str, dict[str, Any]] = {}
        """The details of each finished unit of work, in the order they were finished."""
        self.answered: list[dict[str, Any]] = []
        self.witnessed: dict[str, list[float]] = {}
        """What each witness saw before the run energised anything, NaN what it does not see."""
        self.process = Process()
        self.of_guardian: tuple[Event, ...] = ()
        self._count = 0
        self._own = 0
        """Of the events, up to the last that the run itself wrote."""
        self._last_own: Event | None = None
        self._opened = -1
        self._rests: list[tuple[float, Event]] = []
        """What was said of the bench since its instruments were opened last, and where."""
        for event in events:
            self.add(event)
        self.guardian_logged(of_guardian)

    def add(self, event: Event) -> None:
        """Take up the next event of the run's log."""
        details, kind, process = event.details, event.kind, self.process
        if not self._count:
            self.began_s = event.time_s
        if kind == PAUSED:
            process.paused_since_s = event.time_s
        elif process.paused_since_s is not None and kind in (WENT_ON, *ENDS):
            process.pauses.append((process.paused_since_s, event.time_s))
            process.paused_since_s = None
        match kind:
            case "run-started":
                self.planned = self.planned or details
            case "resumed":
                self.process = process = Process(self._count)
            case "identified":
                self._opened, self._rests = self._count, []
            case "witness-read":
                before = [math.nan if value is None else value for value in details["before"]]
                self.witnessed.setdefault(details["instrument"], before)
            case "step-started":
                self.step, process.step = details, details["step"]
                process.step_began_s[details["step"]] = event.time_s
            case "step-finished":
                process.step_ended_s[details["step"]] = event.time_s
            case "unit-finished":
                self.units[details["unit"]] = details
                done = (details["unit"], process.worked_s(event.time_s))
                process.units_finished.append(done)
            case "prompt-shown":
                number = self._count - process.first_event
                process.open_prompts[details["id"]] = {**details, "number": number}
            case "prompt":
                self.answered.append(details)
                process.open_prompts.pop(details["id"], None)
            case "prompt-left":
                process.left_for_the_end.append(details)
            case "failed":
                process.failed = details
                process.open_prompts.clear()
            case "run-ended":
                process.ended = details
                process.open_prompts.clear()
            case "safe-state" | "bench-read":
                self._rests.append((float(self._count), event))
        self._count += 1
        self.last_s = event.time_s
        if kind in RECORDED_LATER:
            process.recorded_later.append(event)
        else:
            self._own = self._count
            if kind == RUN_STARTED:
                self._last_own = None
            elif not is_of_line(event):
                self._last_own = event

    def guardian_logged(self, events: Iterable[Event]) -> None:
        """Take the events of the guardian's log; `after_events` of each says where it belongs."""
        self.of_guardian = tuple(events)

    @property
    def speed(self) -> float:
        """How many times as fast as real the run's time goes; 0 where it is virtual."""
        return float(self.planned.get("speed") or 0.0)

    @property
    def open_prompt(self) -> dict[str, Any] | None:
        """The prompt that waits for an answer, the oldest where several do."""
        return next(iter(self.process.open_prompts.values()), None)

    @property
    def measured(self) -> bool:
        """Whether every step was done and only the evaluation may be missing."""
        return bool(self.process.ended and self.process.ended.get("complete"))

    def state(self, *, held: bool) -> State:
        """Return the state of a run whose lock a process holds, or not."""
        if self.process.ended is None and held:
            return "running" if self.process.paused_since_s is None else "paused"
        if self.process.ended is None:
            return "interrupted"
        if not self.measured:
            return "failed"
        return "evaluating" if held else "finished"

    def steps(self) -> list[dict[str, Any]]:
        """Return number, title and state of each step: `waits`, `now` or `done`; and its times.

        In s of run time: when it began, how long it took, and how long it should take.
        """

        def state_of(number: str) -> str:
            if number in self.process.step_ended_s:
                return "done"
            return "now" if number == self.process.step else "waits"

        return [
            {
                "number": step["step"],
                "title": step.get("title", ""),
                "state": state_of(step["step"]),
                **self._times_of(step),
            }
            for step in self.planned.get("steps", ())
        ]

    def _times_of(self, step: Mapping[str, Any]) -> dict[str, Any]:
        process, number = self.process, step["step"]
        began_s, ended_s = process.step_began_s.get(number), process.step_ended_s.get(number)
        took_s = None if began_s is None or ended_s is None else ended_s - began_s
        return {
            "began_s": None if began_s is None else round(began_s - self.began_s, 3),
            "took_s": None if took_s is None else round(took_s, 3),
            "expected_s": step.get("expected_s"),
        }

    def remaining_s(self, now_s: float) -> float | None:
        """Return the bench time in s that what is not done yet is expected to take.

        None where nobody said what the run does; 0 once it has ended.
        """
        if "steps" not in self.planned:
            return None
        if self.process.ended is not None:
            return 0.0
        left_s = sum(
            self._step_left_s(step, now_s)
            for step in self.planned["steps"]
            if step["step"] not in self.process.step_ended_s
        )
        expected = dict(self.planned.get("units_expected", {}))
        done = [
            FinishedUnit(at_s, expected[unit])
            for unit, at_s in self.process.units_finished
            if unit in expected
        ]
        units_left_s = sum(s for unit, s in expected.items() if unit not in self.units)
        return round(time_left_s(left_s, done, units_left_s, self.process.worked_s(now_s)), 3)

    def rest_of_step_s(self, now_s: float) -> float | None:
        """Return the bench time in s that the present step is expected to take still.

        None where it is not known, as on virtual time.
        """
        steps = [
            step for step in self.planned.get("steps", ()) if step["step"] == self.step.get("step")
        ]
        if not self.speed or not steps or self.process.ended is not None:
            return None
        if steps[0]["step"] in self.process.step_ended_s:
            return 0.0
        return round(self._step_left_s(steps[0], now_s), 3)

    def _step_left_s(self, step: Mapping[str, Any], now_s: float) -> float:
        began_s = self.process.step_began_s.get(step["step"])
        if began_s is None:
            return float(step["expected_s"])
        gone_s = now_s - began_s - self.process.paused_s(began_s, now_s)
        return max(float(step["expected_s"]) - gone_s, 0.0)

    def safe_state(self) -> list[dict[str, Any]] | None:
        """Return the outcomes of the safe state in which the run left its bench.

        None where the bench was not made safe since its instruments were opened last, or where the
        guardian is still at it.
        """
        latest = [event.details for event in self._latest(SAFE_STATE)]
        # A run that opened nothing has nothing to say of what was left before it.
        telling = [
            details["outcomes"]
            for details in latest
            if any(outcome.get("used", True) for outcome in details["outcomes"])
        ]
        return list(telling[-1]) if telling else [] if latest else None

    def left_out(self) -> list[dict[str, str]]:
        """Return what can harm and was not read back at the end, or before: instrument and why."""
        latest = [event.details for event in self._latest(SAFE_STATE, BENCH_READ)]
        stated = [details["left_out"] for details in latest if "left_out" in details]
        return list(stated[-1]) if stated else []

    def age(self) -> str:
        """Return how old the oldest reading was at the last look at the bench, for a person."""
        latest = [event.details for event in self._latest(SAFE_STATE, BENCH_READ)]
        ages = [float(details["oldest_s"]) for details in latest if "oldest_s" in details]
        return f" ({no_older(ages[-1])})" if ages else ""

    def message(self, guardian: str = "", *, goes_on: bool = False) -> str:
        """Return the last thing the logs have to say to a person; a failure outlives what follows.

        `guardian` is what one that is at work does, and `goes_on` whether it could not make the
        bench safe so far and goes on. Where the guardian of a dead run acted, that is the last
        thing.
        """
        acts = [event for event in self.of_guardian if event.kind != BENCH_READ]
        if acts and acts[-1].details["after_events"] >= self._own:
            return self._of_guardian(bool(guardian)) + (f"; {guardian}" if goes_on else "")
        if guardian:
            return guardian
        if self.process.failed is not None:
            return str(self.process.failed["message"])
        last = self._last_own
        if last and last.kind == "run-ended" and not last.details.get("complete"):
            return UNKNOWN_END
        return in_words(last) if last else "nothing yet"

    def _of_guardian(self, at_work: bool) -> str:
        """Return how far the guardian of a dead run came, as a short text."""
        last = [event for event in self.of_guardian if event.kind != BENCH_READ][-1]
        made_safe = [event for event in self.of_guardian if event.kind == SAFE_STATE]
        if last.kind not in (SAFE_STATE, LEFT) or not made_safe:
            if at_work:
                return "the guardian is making the bench safe"
            return "the guardian has ended without a result; switch off by hand what is on"
        outcomes = made_safe[-1].details["outcomes"]
        unverified = [outcome for outcome in outcomes if not outcome["verified"]]
        states = "; ".join(
            f"{outcome['instrument']} "
            + outcome["read_back"].removeprefix(f"{outcome['instrument']}: ")
            for outcome in unverified or outcomes
        )
        if unverified:
            by = ", and was ended by a person" if last.kind == LEFT else ""
            return f"the guardian could not verify as safe{by}: {states}"
        if at_work:
            return (
                f"the guardian has read the bench back as safe and looks at it once more: {states}"
            )
        return f"the guardian made the bench safe and read it back: {states}"

    def _latest(self, *kinds: str) -> list[Event]:
        """Return what was said of the bench since its instruments were opened last, in order."""
        # Between the last line that the run had written, and the next one of a resumed run.
        placed = [(event.details["after_events"] - 0.5, event) for event in self.of_guardian]
        placed = [(place, event) for place, event in placed if place > self._opened]
        both = sorted([*self._rests, *placed], key=lambda pair: pair[0])
        return [event for _, event in both if event.kind in kinds]
