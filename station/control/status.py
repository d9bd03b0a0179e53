"""How a run stands, from its log alone: while another process runs it, and after that one died.

The log's first event, `run-started`, says what the run is going to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from station.clock import utc_now
from station.errors import InputError, StationError
from station.files.locks import is_held
from station.guardian.notes import AtWork, guardian_at_work
from station.record.events import (
    BENCH_READ,
    LEFT,
    RECORDED_LATER,
    RESUMED,
    SAFE_STATE,
    Event,
    guardian_events,
    is_paused,
    last_word_of_guardian,
    latest_left_out,
    latest_safe_state,
    of_the_run,
    paused_s,
    read_events,
    recorded_in_words,
)
from station.record.layout import EVENTS, LOCK

if TYPE_CHECKING:
    pass


FEWEST_UNITS = 3
LATEST_PART = 4
"""The pace is that of the latest quarter of the units: later ones may take longer than early."""


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
    if done < FEWEST_UNITS or not units_left_s:
        return forecast_s
    first, *latest = finished[-max(FEWEST_UNITS, done // LATEST_PART) :]
    last = latest[-1]
    pace = (last.at_s - first.at_s) / sum(unit.expected_s for unit in latest)
    paced_s = max(units_left_s * pace - (now_s - last.at_s), 0.0)
    done_s = sum(unit.expected_s for unit in finished)
    share = done_s / (done_s + units_left_s)
    return share * paced_s + (1.0 - share) * forecast_s


RUN_STARTED = "run-started"
STAMP_LENGTH = len("20260301T081500Z")
State = Literal["running", "paused", "evaluating", "finished", "failed", "interrupted"]
SENTENCES: dict[State, str] = {
    "running": "running",
    "paused": "paused between two units of work",
    "evaluating": "measured to its end, being evaluated",
    "finished": "finished",
    "failed": "ended before its end",
    "interrupted": "interrupted: its process is gone and did not end it",
}


UNKNOWN_END = "why it ended is unknown; its disk may be full: look at the bench"
"""Of a run whose log ends early and holds no `failed`."""


@dataclass(frozen=True)
class Status:
    """How a run stands; what its log does not tell is None. Times in s of run (bench) time."""

    run: str
    state: State
    running: bool
    procedure: str | None
    dut: dict[str, str] | None
    step: str | None
    step_title: str | None
    units_finished: tuple[str, ...]
    units_planned: int | None
    run_time_s: float
    remaining_s: float | None
    bench_safe: bool | None
    left_out: tuple[dict[str, str], ...]
    """What can harm and was not read back at the end, or before the steps: instrument and why."""
    message: str

    def to_data(self) -> dict[str, Any]:
        """Return the status as plain data."""
        lists = {"units_finished": list(self.units_finished), "left_out": list(self.left_out)}
        return {**asdict(self), **lists}


def newest_run(parent: Path) -> Path:
    """Return the run folder below `parent` that began last; raises InputError without one."""
    logs = [path for path in parent.glob("*/" + EVENTS) if not path.parent.name.startswith(".")]
    if not logs:
        raise InputError(f"there is no run below {parent}; name a run folder")
    newest = max(logs, key=lambda log: (log.parent.name[:STAMP_LENGTH], log.stat().st_mtime))
    return newest.parent


def read_status(folder: Path) -> Status:
    """Return how the run of a folder stands now.

    Raises InputError when it is no run folder, RecordError when its log was altered.
    """
    log = folder / EVENTS
    if not log.is_file():
        raise InputError(f"{folder} is no run folder: it holds no {EVENTS}")
    held = is_held(folder / LOCK)  # first: a run that ends meanwhile has then ended in its log
    events = tuple(read_events(log))
    state = state_of(events, held)
    planned = next((event.details for event in events if event.kind == RUN_STARTED), {})
    now_s = events[-1].time_s if events else 0.0
    if state in ("running", "paused") and planned.get("speed"):
        age_s = utc_now().timestamp() - log.stat().st_mtime
        now_s += max(age_s, 0.0) * planned["speed"]
    step = next((event for event in reversed(events) if event.kind == "step-started"), None)
    of_guardian = guardian_events(folder)
    at_work, safe = guardian_at_work(folder), latest_safe_state(events, of_guardian)
    rests = all(outcome["verified"] for outcome in safe) if safe else None
    return Status(
        run=str(folder),
        state=state,
        running=held,
        procedure=planned.get("procedure"),
        dut=planned.get("dut"),
        step=step.details["step"] if step else None,
        step_title=step.details["title"] if step else None,
        units_finished=tuple(
            dict.fromkeys(event.details["unit"] for event in of_kind(events, "unit-finished"))
        ),
        units_planned=len(planned["units"]) if planned.get("units") else None,
        run_time_s=round(now_s - (events[0].time_s if events else 0.0), 3),
        remaining_s=remaining_s(planned, events, now_s) if planned else None,
        # A guardian that has read the bench back as safe looks at it once more before it says so.
        bench_safe=None if rests and at_work else rests,
        left_out=tuple(latest_left_out(events, of_guardian)),
        message=last_message(events, of_guardian, at_work),
    )


def is_active(folder: Path) -> bool:
    """Whether a process is at work on a run, its own or its guardian's."""
    try:
        return is_held(folder / LOCK) or guardian_at_work(folder) is not None
    except (OSError, StationError):  # nobody can act on it by its name then
        return False


def of_kind(events: Sequence[Event], kind: str) -> list[Event]:
    """Return the events of one kind, in order."""
    return [event for event in events if event.kind == kind]


def since_it_went_on(events: Sequence[Event]) -> Sequence[Event]:
    """Return the events of the run's last process."""
    return events[max((k for k, event in enumerate(events) if event.kind == RESUMED), default=0) :]


def state_of(events: Sequence[Event], held: bool) -> State:
    """Return the state of a run whose lock is held, or not."""
    last = since_it_went_on(events)
    ended = of_kind(last, "run-ended")
    if not ended and held:
        return "paused" if is_paused(last) else "running"
    if not ended:
        return "interrupted"
    if not ended[-1].details["complete"]:
        return "failed"
    return "evaluating" if held else "finished"


def remaining_s(
    planned: Mapping[str, Any], all_events: Sequence[Event], now_s: float
) -> float | None:
    """Return the bench time in s that what is not done yet is expected to take.

    `planned` are the details of the event `run-started`.
    """
    steps = planned.get("steps")
    if steps is None:
        return None
    events = since_it_went_on(all_events)
    if of_kind(events, "run-ended"):
        return 0.0
    started_s = {e.details["step"]: e.time_s for e in of_kind(events, "step-started")}
    finished = {e.details["step"] for e in of_kind(events, "step-finished")}
    left_s = 0.0
    for step in steps:
        number, expected_s = step["step"], float(step["expected_s"])
        if number in finished:
            continue
        gone_s = 0.0
        if number in started_s:
            gone_s = now_s - started_s[number] - paused_s(events, started_s[number], now_s)
        left_s += max(expected_s - gone_s, 0.0)

    def worked_s(until_s: float) -> float:
        return until_s - paused_s(events, float("-inf"), until_s)

    units = dict(planned.get("units_expected", {}))
    done = [
        FinishedUnit(worked_s(event.time_s), units[event.details["unit"]])
        for event in of_kind(events, "unit-finished")
        if event.details["unit"] in units
    ]
    for event in of_kind(all_events, "unit-finished"):
        units.pop(event.details["unit"], None)
    return round(time_left_s(left_s, done, sum(units.values()), worked_s(now_s)), 3)


def last_message(
    events: Sequence[Event], of_guardian: Sequence[Event] = (), at_work: AtWork | None = None
) -> str:
    """Return the last thing the logs have to say to a person; a failure outlives what follows it.

    Where the guardian of a dead run acted, that is the last thing, and that it is still `at_work`.
    """
    last = last_word_of_guardian(events, of_guardian)
    goes_on = f"; {at_work.sentence()}" if at_work and at_work.waits_for else ""
    if last is not None:
        return guardian_in_words(of_guardian, at_work is not None) + goes_on
    if at_work is not None:
        return at_work.sentence()
    failed = of_kind(since_it_went_on(events), "failed")
    if failed:
        return str(failed[-1].details["message"])
    later = [event for event in of_the_run(events) if event.kind != RUN_STARTED]
    if later and later[-1].kind == "run-ended" and not later[-1].details.get("complete"):
        return UNKNOWN_END
    return in_words(later[-1]) if later else "nothing yet"


def guardian_in_words(of_guardian: Sequence[Event], at_work: bool) -> str:
    """Return how far the guardian of a dead run came, as a short text."""
    last = [event for event in of_guardian if event.kind != BENCH_READ][-1]
    ended = last.kind == LEFT
    read = last.kind == SAFE_STATE or ended
    outcomes = next(
        (event.details["outcomes"] for event in reversed(of_guardian) if event.kind == SAFE_STATE),
        None,
    )
    if not read or outcomes is None:
        if at_work:
            return "the guardian is making the bench safe"
        return "the guardian has ended without a result; switch off by hand what is on"
    unverified = [outcome for outcome in outcomes if not outcome["verified"]]
    states = "; ".join(
        f"{outcome['instrument']} {outcome['read_back'].removeprefix(outcome['instrument'] + ': ')}"
        for outcome in unverified or outcomes
    )
    if unverified:
        by = ", and was ended by a person" if ended else ""
        return f"the guardian could not verify as safe{by}: {states}"
    if at_work:
        return f"the guardian has read the bench back as safe and looks at it once more: {states}"
    return f"the guardian made the bench safe and read it back: {states}"


def in_words(event: Event) -> str:
    """Return an event as a short text."""
    details = event.details
    match event.kind:
        case "identified":
            who = " ".join(str(details[key]) for key in ("maker", "model", "serial"))
            return f"{details['instrument']} is {' '.join(who.split())}"
        case "step-started":
            return f"{details['step']} began: {details['title']}"
        case "step-finished":
            return f"{details['step']} is done"
        case "prompt-shown":
            return f"waits for an answer to [{details['id']}] {details['text']}"
        case "prompt":
            return f"{details['text']} Answered: {details['answer']}"
        case "unit-started":
            return f"{details['unit']} is being recorded"
        case "unit-finished":
            return f"{details['unit']} is recorded"
        case "failed":
            return str(details["message"])
        case "run-ended":
            return "all steps are done" if details.get("complete") else "the run has ended early"
        case "safe-state":
            left = [
                outcome["instrument"]
                for outcome in details.get("outcomes", ())
                if not outcome["verified"]
            ]
            return f"NOT VERIFIED as safe: {', '.join(left)}" if left else "the bench is made safe"
        case kind if kind in RECORDED_LATER:
            return recorded_in_words(event)
        case "paused" | "pause-refused":
            states = details.get("devices") or details.get("reasons") or {}
            return ": ".join(
                [event.kind, "; ".join(f"{who} {what}" for who, what in states.items())]
            )
    plain = (f"{key} {value}" for key, value in details.items() if not isinstance(value, list))
    return f"{event.kind}: {', '.join(plain)}" if details else event.kind
